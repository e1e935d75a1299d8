%% @doc Formats the answer of `./starl when' as text, as a table of comma-separated values, and as a
%% plot.
-module(starl_lab_when_report).

-export([new/3, named/2, event/1, is_of/3, sentence/1, text/2, csv/1, plot/1]).
-export([share_text/1, share_cells/1, share_point/2, besides/1, plotted/3, fact/1, rise/2]).

-export_type([t/0]).

%% `facts': what the robot of the named event did at that moment.
-opaque t() :: #{
    result := starl_sim_inevitable:result(),
    run := starl_sim_future:run(),
    settings := starl_sim_future:settings(),
    facts := [{starl_machine:name(), term()}]
}.

-define(BAR, 20).
-define(MOST_FACTS, 12).
-define(MOST_RISES, 3).
%% The events that are shown after the beginning of a fault.
-define(FOLLOWERS, 6).
%% The depth to which terms are printed in one line.
-define(DEPTH, 20).

%% @doc The report of a search; looks up in the run what the robot of the named event did.
-spec new(starl_sim_inevitable:result(), starl_sim_future:run(), starl_sim_future:settings()) ->
    t().
new(Result, Run, Settings) ->
    #{result => Result, run => Run, settings => Settings, facts => facts(Result, Run)}.

facts(Result, #{moments := Moments} = Run) ->
    case entry(named(Result, Run), Moments) of
        {AtUs, Robot, #{n := _}} ->
            case starl_sim_future:facts(Run, {AtUs, Robot}) of
                {ok, Facts} -> Facts;
                {error, _} -> []
            end;
        _ ->
            []
    end.

entry(none, _Moments) -> none;
entry({_, Moment}, Moments) -> starl_sim_moments:entry(Moment, Moments).

%% @doc The moment just after the event that the answer names: the one at the step; where all futures
%% break the contract from the start on, that at which the run does.
-spec named(starl_sim_inevitable:result(), starl_sim_future:run()) ->
    {step | violation, starl_sim_moments:moment()} | none.
named(#{complete := false}, _Run) ->
    none;
named(#{step := {_, Above}}, _Run) ->
    {step, Above};
named(#{step := none, curve := Curve}, #{violation := Violation, moments := Moments}) ->
    #{at_us := AtUs, robots := Robots, contract := Contract} = Violation,
    Always = lists:all(fun({_, #{futures := N, broken := Broken}}) -> N =:= Broken end, Curve),
    case Always andalso starl_sim_moments:events_at(AtUs, Robots, Moments) of
        [_ | _] = Events -> {violation, broken_by(Contract, Events)};
        _ -> none
    end.

%% Of the events of one time the last one of the machine that the contract is about, if there is one.
broken_by(Contract, Events) ->
    Own = [Moment || {Moment, {_, _, #{machine := Machine}}} <- Events, Machine =:= Contract],
    lists:last([Moment || {Moment, _} <- Events, Own =:= []] ++ Own).

%% @doc The event that the answer names, with what its robot traced and sent then.
-spec event(t()) -> {starl_sim_moments:entry(), [{starl_machine:name(), term()}]} | none.
event(#{result := Result, run := #{moments := Moments} = Run, facts := Facts}) ->
    case entry(named(Result, Run), Moments) of
        none -> none;
        Entry -> {Entry, Facts}
    end.

%% @doc Whether an event is of a kind: a fault of a class; a start of a machine after the first; an event in which
%% a block has a part.
-spec is_of(Kind, starl_sim_moments:entry(), [{starl_machine:name(), term()}]) -> boolean() when
    Kind :: {fault, Class :: atom()} | restart | {block, Block :: atom()}.
is_of({fault, Class}, {_, fault, Fault}, _Facts) ->
    starl_run_fault:class(Fault) =:= Class;
is_of(restart, {AtUs, _, #{type := boot}}, _Facts) ->
    AtUs > 0;
is_of({block, Block}, {_, _, #{machine := Machine}}, Facts) ->
    Machine =:= Block orelse lists:any(fun(Fact) -> tells_of(Block, Fact) end, Facts);
is_of(_Kind, _Entry, _Facts) ->
    false.

tells_of(Block, {Block, _}) -> true;
tells_of(Block, {radio, {packet, _, {data, Block, _}, _, _}}) -> true;
tells_of(_Block, _Fact) -> false.

%% @doc An event in a line.
-spec sentence(starl_sim_moments:entry()) -> unicode:chardata().
sentence({AtUs, fault, Fault}) ->
    io_lib:format("~.6f s  a fault begins: ~0tp", [AtUs / 1.0e6, Fault]);
sentence({AtUs, Robot, #{n := N, machine := Machine, type := Type}}) ->
    io_lib:format("~.6f s  robot ~b, event ~b: ~ts ~ts", [
        AtUs / 1.0e6, Robot, N, Machine, handles(Type)
    ]).

%% @doc The report for a terminal of this width.
-spec text(t(), Width :: pos_integer()) -> unicode:chardata().
text(#{result := #{curve := Curve} = Result} = Report, Width) ->
    [
        "\n      time  after      futures that break it\n",
        [row(Point, Report) || Point <- Curve],
        "\n",
        answer(Result, Report, Width),
        others(Result, Report),
        draws(Report, Width)
    ].

row({Moment, Tally}, #{run := #{moments := Moments}} = Report) ->
    AtUs = starl_sim_moments:time_us(Moment, Moments),
    [
        io_lib:format("~10.6f  ~-9ts ", [AtUs / 1.0e6, place(Moment)]),
        share_text(Tally),
        mark(Moment, Report),
        besides(Tally),
        "\n"
    ].

%% @doc A share with its interval, in columns, and as a bar.
-spec share_text(starl_sim_inevitable:tally()) -> unicode:chardata().
share_text(Tally) ->
    {Broken, N} = Count = count(Tally),
    {Low, High} = starl_sim_proportion:interval(Count),
    [
        io_lib:format("~5b of ~-5b ~.2f-~.2f  ", [Broken, N, Low, High]),
        bar(starl_sim_proportion:share(Count))
    ].

place(0) -> "start";
place(Moment) -> integer_to_list(Moment).

bar(Share) ->
    Full = round(?BAR * Share),
    [lists:duplicate(Full, $#), lists:duplicate(?BAR - Full, $.)].

mark(Moment, #{result := #{step := {_, Moment}, complete := true}}) -> " <";
mark(_Moment, _Report) -> "".

%% @doc The other results of continuations.
-spec besides(starl_sim_inevitable:tally()) -> unicode:chardata().
besides(#{other := Other, unjudged := Unjudged}) ->
    [
        [io_lib:format("  (~b break another)", [Other]) || Other > 0],
        [io_lib:format("  (~b not judged)", [Unjudged]) || Unjudged > 0]
    ].

answer(#{curve := []}, _Report, _Width) ->
    "interrupted before any future has ended\n";
answer(#{complete := false, step := none}, _Report, _Width) ->
    "interrupted; no rise is certain so far\n";
answer(#{complete := false, step := {Low, High}}, #{run := #{moments := Moments}}, _Width) ->
    io_lib:format("interrupted; so far the largest rise lies between ~.6f s and ~.6f s~n", [
        starl_sim_moments:time_us(M, Moments) / 1.0e6
     || M <- [Low, High]
    ]);
answer(#{step := none, curve := [{_, First} | _] = Curve} = Result, Report, Width) ->
    #{run := #{moments := Moments} = Run} = Report,
    {_, Last} = lists:last(Curve),
    Digests = lists:usort([D || {_, #{digests := Ds}} <- Curve, D <- Ds]),
    [
        wrapped(flat(count(First), count(Last), Digests), Width),
        shows(entry(named(Result, Run), Moments), Report, Width)
    ];
answer(#{step := {Low, High}, curve := Curve}, #{run := #{moments := Moments}} = Report, Width) ->
    {_, Below} = lists:keyfind(Low, 1, Curve),
    {_, Above} = lists:keyfind(High, 1, Curve),
    [
        wrapped([became(Above), rise(Below, Above)], Width),
        event(starl_sim_moments:entry(High, Moments), Report, Width),
        followers(High, Report, Width)
    ].

%% With no event to blame, the one at which the contract is broken leads to the fault in the program.
shows(none, _Report, _Width) -> "";
shows(Entry, Report, Width) -> ["the run breaks it at\n", event(Entry, Report, Width)].

flat({0, _}, {0, _}, _Digests) ->
    "the share rises nowhere: no future breaks the contract before the run does";
flat(_First, _Last, [_]) ->
    "from the scenario: no draw changes anything, all futures are the run itself";
flat({N, N}, _Last, _Digests) ->
    "inevitable from the start: whatever is drawn, all futures break the contract, so the cause is "
    "in the scenario or the program";
flat(First, Last, _Digests) ->
    Shares = [
        element(I, starl_sim_proportion:interval(Count))
     || Count <- [First, Last], I <- [1, 2]
    ],
    case starl_sim_proportion:are_apart(First, Last) of
        true ->
            io_lib:format(
                "the share rises little by little, from ~.2f-~.2f at the start to ~.2f-~.2f: no "
                "single event decides",
                Shares
            );
        false ->
            io_lib:format(
                "the share rises nowhere beyond its intervals (at the start it is ~.2f-~.2f): no single "
                "event decides; --futures makes the intervals smaller",
                lists:sublist(Shares, 2)
            )
    end.

%% @doc The shares before and after an event.
-spec rise(starl_sim_inevitable:tally(), starl_sim_inevitable:tally()) -> unicode:chardata().
rise(Below, Above) ->
    [
        ": just before it ",
        futures(Below),
        " break the contract, just after it ",
        futures(Above)
    ].

%% That all futures do so is all that can be shown.
became(#{broken := N, futures := N}) ->
    "it became inevitable, as far as futures can tell, by one event";
became(#{}) ->
    "it became likely by one event".

futures(Tally) ->
    {Broken, N} = Count = count(Tally),
    {Low, High} = starl_sim_proportion:interval(Count),
    io_lib:format("~b of ~b futures (~.2f-~.2f)", [Broken, N, Low, High]).

event({_, fault, _} = Entry, _Report, _Width) ->
    line(Entry);
event({_, _, #{content := Content}} = Entry, #{facts := Facts}, Width) ->
    [
        line(Entry),
        [["    ", starl_lab_inspect:term(Content, 4, Width), "\n"] || Content =/= none],
        [
            [cut(["    ", fact(Fact)], Width), "\n"]
         || Fact <- lists:sublist(Facts, ?MOST_FACTS)
        ],
        [
            io_lib:format("    and ~b more~n", [length(Facts) - ?MOST_FACTS])
         || length(Facts) > ?MOST_FACTS
        ]
    ].

%% A fault shows in what its robots do next, a packet in what its receiver does.
followers(Moment, #{run := #{moments := Moments}} = Report, Width) ->
    Next =
        case starl_sim_moments:entry(Moment, Moments) of
            {_, fault, Fault} ->
                Robots = starl_run_fault:targets(Fault),
                starl_sim_moments:following(Moment, Robots, ?FOLLOWERS, Moments);
            _ ->
                lists:sublist(received(Report), ?FOLLOWERS)
        end,
    [
        ["  and then:\n" | [[cut(["  ", sentence(Entry)], Width), "\n"] || Entry <- Next]]
     || Next =/= []
    ].

received(#{facts := Facts, run := #{moments := Moments}}) ->
    Times = lists:usort([
        {AtUs, To}
     || {radio, {packet, To, _, _, {arrives, Copies}}} <- Facts, {AtUs, _} <- Copies
    ]),
    [
        Entry
     || {AtUs, To} <- Times, {_, Entry} <- starl_sim_moments:events_at(AtUs, [To], Moments)
    ].

line(Entry) -> ["  ", sentence(Entry), "\n"].

handles(boot) -> "boots";
handles({call, {From, _}}) -> io_lib:format("is called by ~0tp", [From]);
handles(packet) -> "gets a packet";
handles(timeout) -> "has a timer";
handles(Type) -> io_lib:format("handles ~0tp", [Type]).

%% @doc What a robot's machine says, or a packet to another robot, with its fate.
-spec fact({starl_machine:name(), term()}) -> unicode:chardata().
fact({radio, {packet, To, Brief, _Bytes, {lost, Why}}}) ->
    io_lib:format("sends ~0tp to robot ~b: LOST (~0tp)", [Brief, To, Why]);
fact({radio, {packet, To, Brief, _Bytes, {arrives, Copies}}}) ->
    Times = [io_lib:format("~.6f s~ts", [At / 1.0e6, state(State)]) || {At, State} <- Copies],
    io_lib:format("sends ~0tp to robot ~b: arrives ~ts", [Brief, To, lists:join(" and ", Times)]);
fact({Machine, Fact}) ->
    io_lib:format("~ts: ~0tP", [Machine, Fact, ?DEPTH]).

state(intact) -> "";
state(corrupt) -> " damaged".

cut(Text, Width) -> string:slice(Text, 0, Width).

others(#{complete := true, others := [_ | _] = Rises, curve := Curve}, Report) ->
    #{run := #{moments := Moments}} = Report,
    [
        "it rises elsewhere, too:\n",
        [
            io_lib:format("  between ~.6f s and ~.6f s, from ~.2f to ~.2f~n", [
                starl_sim_moments:time_us(Low, Moments) / 1.0e6,
                starl_sim_moments:time_us(High, Moments) / 1.0e6,
                share(Low, Curve),
                share(High, Curve)
            ])
         || {Low, High} <- lists:sublist(Rises, ?MOST_RISES)
        ]
    ];
others(_Result, _Report) ->
    "".

share(Moment, Curve) ->
    {_, Tally} = lists:keyfind(Moment, 1, Curve),
    starl_sim_proportion:share(count(Tally)).

%% What was drawn anew: the answer depends on it.
draws(#{run := #{scenario := Scenario}, settings := Settings}, Width) ->
    #{loss := Loss, until_s := Until} = Settings,
    #{delay := {Min, Max}, faults := Faults} = Scenario,
    Ahead = length([Id || {Id, _, _, Kind, _, _} <- Faults, Kind =/= drop]),
    wrapped(
        io_lib:format(
            "drawn anew from each moment on: loss (~.4g of the packets), delay (~w..~w ms), "
            "duplicates, errors of drives and positions, and when and where those of ~b faults "
            "strike that have not begun. Not drawn anew: clocks, random numbers of machines that "
            "run, the places at the start. Futures end at ~.3f s.",
            [float(Loss), Min, Max, Ahead, float(Until)]
        ),
        Width
    ).

wrapped(Text, Width) -> [starl_cli_terminal:wrap(Text, 2, Width), "\n"].

count(#{broken := Broken, futures := N}) -> {Broken, N}.

%% @doc One line for each moment: its place among the events, its time in s, its counts and the
%% interval.
-spec csv(t()) -> unicode:chardata().
csv(#{result := #{curve := Curve}, run := #{moments := Moments}}) ->
    Head = ["events", "time_s", "futures", "broken", "other", "unjudged", "share", "low", "high"],
    [starl_lab_csv:line(Head) | [starl_lab_csv:line(cells(Point, Moments)) || Point <- Curve]].

cells({Moment, Tally}, Moments) ->
    Time = number(starl_sim_moments:time_us(Moment, Moments) / 1.0e6),
    [integer_to_list(Moment), Time | share_cells(Tally)].

%% @doc Its cells: futures, broken, other, unjudged, share, low, high.
-spec share_cells(starl_sim_inevitable:tally()) -> [unicode:chardata()].
share_cells(Tally) ->
    #{futures := N, broken := Broken, other := Other, unjudged := Unjudged} = Tally,
    {Low, High} = starl_sim_proportion:interval({Broken, N}),
    Share = starl_sim_proportion:share({Broken, N}),
    [integer_to_list(Count) || Count <- [N, Broken, Other, Unjudged]] ++
        [number(X) || X <- [Share, Low, High]].

number(X) -> io_lib:format("~.6f", [X]).

%% @doc The curve with its intervals over the time, for {@link starl_lab_sweep_plot:script/1}; none
%% if no continuation has ended.
-spec plot(t()) -> {ok, starl_lab_sweep_plot:plot()} | none.
plot(#{result := #{curve := []}}) ->
    none;
plot(#{result := #{curve := Curve}, run := #{moments := Moments, violation := Violation}}) ->
    #{contract := Contract} = Violation,
    Panel = #{
        y => "share of the futures, 95 % intervals",
        curves => [{"", [point(Point, Moments) || Point <- Curve]}]
    },
    {ok, #{
        title => lists:flatten(io_lib:format("futures that break ~ts", [Contract])),
        x => "virtual time of the moment, s",
        panels => [Panel]
    }}.

point({Moment, Tally}, Moments) ->
    share_point(starl_sim_moments:time_us(Moment, Moments), Tally).

%% @doc The share at this time as a point of a plot.
-spec share_point(AtUs :: integer(), starl_sim_inevitable:tally()) ->
    {float(), float(), float(), float()}.
share_point(AtUs, Tally) ->
    {Low, High} = starl_sim_proportion:interval(count(Tally)),
    Share = starl_sim_proportion:share(count(Tally)),
    {AtUs / 1.0e6, Share, Low, High}.

%% @doc Writes these files and the plot, if there is one, into a directory.
-spec plotted({ok, starl_lab_sweep_plot:plot()} | none, Files, file:filename()) ->
    ok | {error, unicode:chardata()}
when
    Files :: [{file:filename(), unicode:chardata()}].
plotted(none, Files, Dir) ->
    starl_lab_files:put_all(Dir, Files);
plotted({ok, Plot}, Files, Dir) ->
    starl_lab_sweep_plot:put(Dir, Files, Plot).
