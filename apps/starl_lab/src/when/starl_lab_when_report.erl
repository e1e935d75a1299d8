%% @doc Formats the answer of `./starl when' as text, as a table of comma-separated values, and as a
%% plot.
-module(starl_lab_when_report).

-export([new/4, event/1, status/1, is_of/3, sentence/1, text/2, csv/1, plot/1]).

-export_type([t/0]).

%% `named': the index just after the event that the answer names; `facts': what its robot did then.
-opaque t() :: #{
    result := starl_sim_inevitable:result(),
    run := starl_sim_continuation:run(),
    question := starl_sim_continuation:question(),
    settings := starl_sim_continuation:settings(),
    named := starl_sim_timeline:index() | none,
    facts := [{starl_machine:name(), term()}]
}.

-define(BAR, 20).
-define(MOST_FACTS, 12).
-define(MOST_RISES, 3).
%% The events that are shown after the beginning of a fault.
-define(FOLLOWERS, 6).
%% The depth to which terms are printed in one line.
-define(DEPTH, 20).

%% @doc The report of a search. It repeats the run once more to find out what the robot of the named
%% event did.
-spec new(
    starl_sim_inevitable:result(),
    starl_sim_continuation:run(),
    starl_sim_continuation:question(),
    starl_sim_continuation:settings()
) -> t().
new(Result, Run, Question, Settings) ->
    Named = named(Result, Question, Run),
    #{
        result => Result,
        run => Run,
        question => Question,
        settings => Settings,
        named => Named,
        facts => facts(Named, Run)
    }.

facts(none, _Run) ->
    [];
facts(Index, #{timeline := Timeline} = Run) ->
    case starl_sim_timeline:entry(Index, Timeline) of
        {AtUs, Robot, #{n := _}} ->
            case starl_sim_continuation:facts(Run, {AtUs, Robot}) of
                {ok, Facts} -> Facts;
                {error, _} -> []
            end;
        _ ->
            []
    end.

%% The event at the step; where all continuations break the contract from the start on, the event at
%% which the run does.
named(#{complete := false}, _Question, _Run) ->
    none;
named(#{step := {_, Above}}, _Question, _Run) ->
    Above;
named(_Result, {at, _}, _Run) ->
    none;
named(#{step := none, curve := Curve}, violation, Run) ->
    #{violation := Violation, timeline := Timeline} = Run,
    #{at_us := AtUs, robots := Robots, contract := Contract} = Violation,
    Always = lists:all(fun({_, #{draws := N, broken := Broken}}) -> N =:= Broken end, Curve),
    case Always andalso starl_sim_timeline:events_at(AtUs, Robots, Timeline) of
        [_ | _] = Events -> broken_by(Contract, Events);
        _ -> none
    end.

%% Of the events of one time the last one of the machine that the contract is about, if there is one.
broken_by(Contract, Events) ->
    Own = [Index || {Index, {_, _, #{machine := Machine}}} <- Events, Machine =:= Contract],
    lists:last([Index || {Index, _} <- Events, Own =:= []] ++ Own).

%% @doc The event that the answer names, with what its robot traced and sent then.
-spec event(t()) -> {starl_sim_timeline:entry(), [{starl_machine:name(), term()}]} | none.
event(#{named := none}) ->
    none;
event(#{named := Index, facts := Facts, run := #{timeline := Timeline}}) ->
    {starl_sim_timeline:entry(Index, Timeline), Facts}.

%% @doc The exit status of the command.
-spec status(t()) -> starl_cli_terminal:status().
status(#{result := #{complete := false}}) ->
    130;
status(#{question := {at, _}, result := #{curve := Curve}}) ->
    case is_ever_broken(Curve) of
        true -> 3;
        false -> 0
    end;
status(#{question := violation, result := #{step := none}}) ->
    4;
status(#{question := violation}) ->
    0.

is_ever_broken(Curve) -> lists:any(fun({_, #{broken := Broken}}) -> Broken > 0 end, Curve).

%% @doc The report for a terminal of this width.
-spec text(t(), Width :: pos_integer()) -> unicode:chardata().
text(#{result := #{curve := Curve}} = Report, Width) ->
    [
        ["\n      time  after      continuations that break ", contract(Report), "\n"],
        [row(Point, Report) || Point <- Curve],
        "\n",
        answer(Report, Width),
        others(Report),
        drawn(Report, Width)
    ].

contract(#{question := violation}) -> "it";
contract(#{settings := #{contract := any}}) -> "a contract";
contract(#{settings := #{contract := Contract}}) -> Contract.

row({Index, Tally}, #{run := #{timeline := Timeline}, named := Named, result := Result}) ->
    AtUs = starl_sim_timeline:time_us(Index, Timeline),
    {Low, High} = starl_sim_proportion:interval(count(Tally)),
    {Broken, N} = count(Tally),
    [
        io_lib:format("~10.6f  ~-9ts ~5b of ~-5b ~.2f-~.2f  ", [
            AtUs / 1.0e6, place(Index), Broken, N, Low, High
        ]),
        bar(fraction(Tally)),
        [" <" || Index =:= Named, maps:get(step, Result) =/= none],
        besides(Tally),
        "\n"
    ].

place(0) -> "start";
place(Index) -> integer_to_list(Index).

bar(Fraction) ->
    Full = round(?BAR * Fraction),
    [lists:duplicate(Full, $#), lists:duplicate(?BAR - Full, $.)].

besides(#{other := Other, unjudged := Unjudged}) ->
    [
        [io_lib:format("  (~b break another)", [Other]) || Other > 0],
        [io_lib:format("  (~b not judged)", [Unjudged]) || Unjudged > 0]
    ].

answer(#{result := #{curve := []}}, _Width) ->
    "interrupted before any continuation has ended\n";
answer(#{result := #{complete := false, step := none}}, _Width) ->
    "interrupted; no rise is certain so far\n";
answer(#{result := #{complete := false, step := {Low, High}}} = Report, _Width) ->
    #{run := #{timeline := Timeline}} = Report,
    io_lib:format("interrupted; so far the largest rise lies between ~.6f s and ~.6f s~n", [
        starl_sim_timeline:time_us(Index, Timeline) / 1.0e6
     || Index <- [Low, High]
    ]);
answer(#{question := {at, AtUs}} = Report, Width) ->
    [wrapped(from(AtUs, Report), Width), rise(Report, Width)];
answer(Report, Width) ->
    rise(Report, Width).

from(AtUs, #{result := #{curve := Curve}} = Report) ->
    {_, Last} = lists:last(Curve),
    {Broken, N} = count(Last),
    {Low, High} = starl_sim_proportion:interval({Broken, N}),
    io_lib:format("from ~.3f s on ~ts of ~b continuations break ~ts (~.2f-~.2f)", [
        AtUs / 1.0e6, none_or(Broken), N, contract(Report), Low, High
    ]).

none_or(0) -> "none";
none_or(N) -> integer_to_list(N).

rise(#{result := #{step := {Low, High}, curve := Curve}} = Report, Width) ->
    {_, Below} = lists:keyfind(Low, 1, Curve),
    {_, Above} = lists:keyfind(High, 1, Curve),
    [
        wrapped(
            [
                became(Above),
                [": just before it ", continuations(Below)],
                [" break the contract, just after it ", continuations(Above)]
            ],
            Width
        ),
        shown(Report, Width),
        followers(Report, Width)
    ];
rise(#{question := {at, _}, result := #{curve := Curve}}, Width) ->
    case is_ever_broken(Curve) of
        true when length(Curve) =:= 1 ->
            wrapped("one point names no event: --points 8 looks for the one that decides", Width);
        true ->
            wrapped(
                "the fraction rises nowhere beyond its intervals: no event is named; --draws makes the "
                "intervals smaller",
                Width
            );
        false ->
            ""
    end;
rise(#{result := #{curve := [{_, First} | _] = Curve}} = Report, Width) ->
    {_, Last} = lists:last(Curve),
    Digests = lists:usort([D || {_, #{digests := Ds}} <- Curve, D <- Ds]),
    [
        wrapped(flat(count(First), count(Last), Digests), Width),
        [["the run breaks it at\n", shown(Report, Width)] || event(Report) =/= none]
    ].

flat({0, _}, {0, _}, _Digests) ->
    "the fraction rises nowhere: no continuation breaks the contract before the run does";
flat(_First, _Last, [_]) ->
    "from the scenario: no draw changes anything, all continuations are the run itself";
flat({N, N}, _Last, _Digests) ->
    "inevitable from the start: whatever is drawn, all continuations break the contract, so the "
    "cause is in the scenario or the program";
flat(First, Last, _Digests) ->
    Fractions = [
        element(I, starl_sim_proportion:interval(Count))
     || Count <- [First, Last], I <- [1, 2]
    ],
    case starl_sim_proportion:are_apart(First, Last) of
        true ->
            io_lib:format(
                "the fraction rises little by little, from ~.2f-~.2f at the start to ~.2f-~.2f: no "
                "single event decides",
                Fractions
            );
        false ->
            io_lib:format(
                "the fraction rises nowhere beyond its intervals (at the start it is ~.2f-~.2f): no "
                "single event decides; --draws makes the intervals smaller",
                lists:sublist(Fractions, 2)
            )
    end.

%% That all continuations do so is all that can be shown.
became(#{broken := N, draws := N}) ->
    "it became inevitable, as far as continuations can show, by one event";
became(#{}) ->
    "it became likely by one event".

continuations(Tally) ->
    {Broken, N} = Count = count(Tally),
    {Low, High} = starl_sim_proportion:interval(Count),
    io_lib:format("~b of ~b continuations (~.2f-~.2f)", [Broken, N, Low, High]).

%% -- the event ------------------------------------------------------------------------------

%% The named event, with what its robot handled, traced and sent.
shown(Report, Width) ->
    case event(Report) of
        {{_, fault, _} = Entry, _Facts} ->
            line(Entry);
        {{_, _, #{content := Content}} = Entry, Facts} ->
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
            ]
    end.

line(Entry) -> ["  ", sentence(Entry), "\n"].

%% @doc An event in a line.
-spec sentence(starl_sim_timeline:entry()) -> unicode:chardata().
sentence({AtUs, fault, Fault}) ->
    io_lib:format("~.6f s  a fault begins: ~0tp", [AtUs / 1.0e6, Fault]);
sentence({AtUs, Robot, #{n := N, machine := Machine, type := Type}}) ->
    io_lib:format("~.6f s  robot ~b, event ~b: ~ts ~ts", [
        AtUs / 1.0e6, Robot, N, Machine, handles(Type)
    ]).

handles(boot) -> "boots";
handles({call, {From, _}}) -> io_lib:format("is called by ~0tp", [From]);
handles(packet) -> "gets a packet";
handles(timeout) -> "has a timer";
handles(Type) -> io_lib:format("handles ~0tp", [Type]).

%% A fault shows in what its robots do next, a packet in what its receiver does.
followers(#{named := Index, run := #{timeline := Timeline}} = Report, Width) ->
    Next =
        case starl_sim_timeline:entry(Index, Timeline) of
            {_, fault, Fault} ->
                Robots = starl_run_fault:targets(Fault),
                starl_sim_timeline:following(Index, Robots, ?FOLLOWERS, Timeline);
            _ ->
                lists:sublist(received(Report), ?FOLLOWERS)
        end,
    [
        ["  and then:\n" | [[cut(["  ", sentence(Entry)], Width), "\n"] || Entry <- Next]]
     || Next =/= []
    ].

received(#{facts := Facts, run := #{timeline := Timeline}}) ->
    Times = lists:usort([
        {AtUs, To}
     || {radio, {packet, To, _, _, {arrives, Copies}}} <- Facts, {AtUs, _} <- Copies
    ]),
    [
        Entry
     || {AtUs, To} <- Times, {_, Entry} <- starl_sim_timeline:events_at(AtUs, [To], Timeline)
    ].

%% A trace event of a machine, or a packet with its delivery outcome.
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

%% @doc Whether an event is of a kind: a fault of a class; a start of a machine after the first; an event in which
%% a block has a part.
-spec is_of(Kind, starl_sim_timeline:entry(), [{starl_machine:name(), term()}]) -> boolean() when
    Kind :: {fault, Class :: atom()} | restart | {block, Block :: atom()}.
is_of({fault, Class}, {_, fault, Fault}, _Facts) ->
    starl_run_fault:class(Fault) =:= Class;
is_of(restart, {AtUs, _, #{type := boot}}, _Facts) ->
    AtUs > 0;
is_of({block, Block}, {_, _, #{machine := Machine}}, Facts) ->
    Machine =:= Block orelse lists:any(fun(Fact) -> is_of_block(Block, Fact) end, Facts);
is_of(_Kind, _Entry, _Facts) ->
    false.

is_of_block(Block, {Block, _}) -> true;
is_of_block(Block, {radio, {packet, _, {data, Block, _}, _, _}}) -> true;
is_of_block(_Block, _Fact) -> false.

%% -- beside the answer ----------------------------------------------------------------------

others(#{result := #{complete := true, others := [_ | _] = Rises, curve := Curve}} = Report) ->
    #{run := #{timeline := Timeline}} = Report,
    [
        "it rises elsewhere, too:\n",
        [
            io_lib:format("  between ~.6f s and ~.6f s, from ~.2f to ~.2f~n", [
                starl_sim_timeline:time_us(Low, Timeline) / 1.0e6,
                starl_sim_timeline:time_us(High, Timeline) / 1.0e6,
                fraction(proplists:get_value(Low, Curve)),
                fraction(proplists:get_value(High, Curve))
            ])
         || {Low, High} <- lists:sublist(Rises, ?MOST_RISES)
        ]
    ];
others(_Report) ->
    "".

%% What was drawn anew: the answer depends on it.
drawn(#{run := #{scenario := Scenario}, settings := Settings}, Width) ->
    #{loss := Loss, until_s := Until} = Settings,
    #{delay := {Min, Max}, faults := Faults} = Scenario,
    Ahead = length([Id || {Id, _, _, Kind, _, _} <- Faults, Kind =/= drop]),
    wrapped(
        io_lib:format(
            "drawn anew from each point on: loss (~.4g of the packets), delay (~w..~w ms), "
            "duplicates, errors of drives and positions, and when and where those of ~b faults "
            "strike that have not begun. Not drawn anew: packets under way, clocks, random numbers "
            "of machines that run, the places at the start. Continuations end at ~.3f s.",
            [float(Loss), Min, Max, Ahead, float(Until)]
        ),
        Width
    ).

wrapped(Text, Width) -> [starl_cli_terminal:wrap(Text, 2, Width), "\n"].

count(#{broken := Broken, draws := N}) -> {Broken, N}.

fraction(Tally) -> starl_sim_proportion:fraction(count(Tally)).

%% -- table and plot -------------------------------------------------------------------------

%% @doc One line for each point: its place among the events, its time in s, its counts and the
%% interval.
-spec csv(t()) -> unicode:chardata().
csv(#{result := #{curve := Curve}, run := #{timeline := Timeline}}) ->
    Head = ["events", "time_s", "draws", "broken", "other", "unjudged", "fraction", "low", "high"],
    [starl_lab_csv:line(Head) | [starl_lab_csv:line(cells(Point, Timeline)) || Point <- Curve]].

cells({Index, Tally} = Point, Timeline) ->
    #{draws := N, broken := Broken, other := Other, unjudged := Unjudged} = Tally,
    {Seconds, Fraction, Low, High} = point(Point, Timeline),
    [integer_to_list(Index), number(Seconds)] ++
        [integer_to_list(Count) || Count <- [N, Broken, Other, Unjudged]] ++
        [number(X) || X <- [Fraction, Low, High]].

number(X) -> io_lib:format("~.6f", [X]).

point({Index, Tally}, Timeline) ->
    {Low, High} = starl_sim_proportion:interval(count(Tally)),
    {starl_sim_timeline:time_us(Index, Timeline) / 1.0e6, fraction(Tally), Low, High}.

%% @doc The curve with its intervals over the time, for {@link starl_lab_sweep_plot:script/1}; none
%% if no continuation has ended.
-spec plot(t()) -> {ok, starl_lab_sweep_plot:plot()} | none.
plot(#{result := #{curve := []}}) ->
    none;
plot(#{result := #{curve := Curve}, run := #{timeline := Timeline}, settings := Settings}) ->
    Panel = #{
        y => "fraction of the continuations, 95 % intervals",
        curves => [{"", [point(Point, Timeline) || Point <- Curve]}]
    },
    {ok, #{
        title => title(Settings),
        x => "virtual time, s",
        panels => [Panel]
    }}.

title(#{contract := any}) -> "continuations that break a contract";
title(#{contract := Contract}) -> "continuations that break " ++ Contract.
