%% @doc Formats the answer of `./starl onward' as text, as a table of comma-separated values, and as
%% a plot.
-module(starl_lab_onward_report).

-export([text/2, csv/1, plot/1]).

-export_type([t/0, rise/0]).

%% `images': the times of the snapshots that were found.
-type t() :: #{
    curve := starl_sim_inevitable:curve(),
    how := done | stopped,
    contract := string() | none,
    settings := starl_sim_onward:settings(),
    recording := map(),
    images := [integer()],
    %% of a live run: the robots that start anew at the last moment
    anew := [{starl:robot_id(), starl_sim_follow:reason()}] | none,
    rise := rise()
}.

%% Where the share rises most: between two moments of one window of the simulator, with what happened in it, and the
%% robots that start anew at one of the two only; or between moments of which none between them can be taken up;
%% or nowhere beyond chance, among so many moments.
-type rise() ::
    {named, step(), {FromUs :: integer(), ToUs :: integer()},
        [starl_lab_onward_recording:happened()], [starl:robot_id()]}
    | {untaken, step(), unicode:chardata()}
    | {none, Moments :: pos_integer()}.

-type step() :: {LowUs :: integer(), HighUs :: integer()}.

-define(MOST_FACTS, 12).

%% @doc The report for a terminal of this width.
-spec text(t(), Width :: pos_integer()) -> unicode:chardata().
text(#{curve := Curve, how := How} = Report, Width) ->
    [
        taken_up(Report, Width),
        "\n      time      futures that break ",
        contract(Report),
        "\n",
        [row(Point) || Point <- Curve],
        "\n",
        [wrapped("interrupted: not all futures were run", Width) || How =:= stopped],
        answer(Curve, Report, Width),
        risen(Report, Width),
        draws(Report, Width)
    ].

contract(#{contract := none}) -> "a contract";
contract(#{contract := Name}) -> Name.

taken_up(#{anew := []}, Width) ->
    wrapped("all robots are taken up as they were", Width);
taken_up(#{anew := [_ | _] = Anew}, Width) ->
    [wrapped(starts_anew(Id, Why), Width) || {Id, Why} <- Anew];
taken_up(#{images := [], recording := #{not_kept := []}}, Width) ->
    wrapped("the recording has no snapshots: the run was repeated from its beginning", Width);
taken_up(#{images := [], recording := #{not_kept := [{Id, Reason} | _]}}, Width) ->
    Line = "no snapshot has all robots (robot ~b: ~ts): the run was repeated from its beginning",
    wrapped(io_lib:format(Line, [Id, starl_snapshot:format_reason(Reason)]), Width);
taken_up(#{images := Images, curve := [{First, _} | _]}, Width) ->
    At = lists:max([0 | [Us || Us <- Images, Us =< First]]),
    Line = "taken up at ~.3f s; from there to the moments it is the recording",
    wrapped(io_lib:format(Line, [At / 1.0e6]), Width);
taken_up(#{curve := []}, _Width) ->
    "".

starts_anew(Id, Why) ->
    Line = "robot ~b starts anew at the last moment, as after a lost store: ~ts",
    io_lib:format(Line, [Id, starl_sim_follow:format_reason(Why)]).

row({Us, Tally}) ->
    [
        io_lib:format("~10.3f  ", [Us / 1.0e6]),
        starl_lab_when_report:share_text(Tally),
        starl_lab_when_report:besides(Tally),
        "\n"
    ].

answer([], _Report, Width) ->
    wrapped("no future has ended", Width);
answer(Curve, Report, Width) ->
    {Us, #{broken := Broken, futures := N}} = lists:last(Curve),
    {Low, High} = starl_sim_proportion:interval({Broken, N}),
    wrapped(
        io_lib:format("from ~.3f s on ~ts of ~b futures break ~ts (~.2f-~.2f)", [
            Us / 1.0e6, number(Broken), N, contract(Report), Low, High
        ]),
        Width
    ).

%% -- where it rises -------------------------------------------------------------------------

risen(#{how := stopped}, _Width) ->
    "";
risen(#{rise := {none, Moments}, curve := Curve}, Width) ->
    case lists:any(fun({_, #{broken := Broken}}) -> Broken > 0 end, Curve) of
        true when Moments =:= 1 ->
            wrapped("one moment names no event: --moments 8 looks for the one that decides", Width);
        true ->
            wrapped(
                "the share rises nowhere beyond its intervals: no event is named; --runs makes them smaller",
                Width
            );
        false ->
            ""
    end;
risen(#{rise := {untaken, {Low, High} = Step, Why}} = Report, Width) ->
    Line =
        "it became likely between ~.3f s and ~.3f s~ts; nothing between them can be taken up: ~ts",
    Said = io_lib:format(Line, [Low / 1.0e6, High / 1.0e6, shares(Step, Report), Why]),
    wrapped(Said, Width);
risen(#{rise := {named, _, _, _, _}} = Report, Width) ->
    named(Report, Width).

named(#{rise := {named, Step, {From, To}, Happened, Anew}} = Report, Width) ->
    [
        wrapped(
            [
                io_lib:format("it became likely from ~.6f s to ~.6f s", [From / 1.0e6, To / 1.0e6]),
                shares(Step, Report),
                happened(Happened)
            ],
            Width
        ),
        [line(One, Width) || One <- lists:sublist(Happened, ?MOST_FACTS)],
        [
            io_lib:format("    and ~b more~n", [length(Happened) - ?MOST_FACTS])
         || length(Happened) > ?MOST_FACTS
        ],
        [wrapped(starts_anew_once(Id), Width) || Id <- Anew]
    ].

starts_anew_once(Id) ->
    Line = "robot ~b starts anew at one of the two moments only: it may be that what decides",
    io_lib:format(Line, [Id]).

shares({Low, High}, #{curve := Curve}) ->
    {_, Below} = lists:keyfind(Low, 1, Curve),
    {_, Above} = lists:keyfind(High, 1, Curve),
    starl_lab_when_report:rise(Below, Above).

happened([]) -> "; the recording has nothing in between";
happened(_) -> "; in between, in the recording:".

line({At, fault, Fault}, Width) ->
    cut(io_lib:format("  ~.6f s  a fault begins: ~0tp", [At / 1.0e6, Fault]), Width);
line({At, Robot, Fact}, Width) ->
    Text = io_lib:format("  ~.6f s  robot ~b, ~ts", [
        At / 1.0e6, Robot, starl_lab_when_report:fact(Fact)
    ]),
    cut(Text, Width).

cut(Text, Width) -> [string:slice(Text, 0, Width), "\n"].

number(0) -> "none";
number(N) -> integer_to_list(N).

%% What was drawn anew: the answer depends on it.
draws(#{settings := #{loss := Loss, until_s := Until}, recording := Recording}, Width) ->
    #{scenario := #{scenario := #{delay := {Min, Max}, loss := Before}}} = Recording,
    wrapped(
        io_lib:format(
            "drawn anew from each moment on: loss (~.4g of the packets), delay (~w..~w ms) of what is sent "
            "from then on, duplicates, errors of drives and positions, and when and where those faults "
            "strike that have not begun. Not drawn anew: packets under way, clocks, random numbers of "
            "machines that run. Futures of the last moment end at ~.3f s.",
            [float(lost(Loss, Before)), Min, Max, float(Until)]
        ),
        Width
    ).

lost(same, Before) -> Before;
lost(Loss, _Before) -> Loss.

wrapped(Text, Width) -> [starl_cli_terminal:wrap(Text, 2, Width), "\n"].

%% @doc One line for each moment: its time in s, its counts and the interval.
-spec csv(t()) -> unicode:chardata().
csv(#{curve := Curve}) ->
    Head = ["time_s", "futures", "broken", "other", "unjudged", "share", "low", "high"],
    [
        starl_lab_csv:line(Head)
        | [
            starl_lab_csv:line([
                io_lib:format("~.6f", [Us / 1.0e6])
                | starl_lab_when_report:share_cells(Tally)
            ])
         || {Us, Tally} <- Curve
        ]
    ].

%% @doc The curve with its intervals over the time; none if no continuation has ended.
-spec plot(t()) -> {ok, starl_lab_sweep_plot:plot()} | none.
plot(#{curve := []}) ->
    none;
plot(#{curve := Curve} = Report) ->
    Panel = #{
        y => "share of the futures, 95 % intervals",
        curves => [{"", [starl_lab_when_report:share_point(Us, Tally) || {Us, Tally} <- Curve]}]
    },
    {ok, #{
        title => lists:flatten(["futures that break ", contract(Report)]),
        x => "time of the moment, s",
        panels => [Panel]
    }}.
