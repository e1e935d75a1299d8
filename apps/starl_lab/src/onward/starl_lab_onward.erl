%% @doc The command `./starl onward': continues a recorded run in the simulator, many times with
%% different random draws. It prints the fraction of continuations that break a contract.
-module(starl_lab_onward).

-behaviour(starl_cli_command).

-export([command/0]).

%% `take': takes the recording up at these times, ascending.
-type setup() :: #{
    file := file:filename(),
    recording := starl_lab_onward_recording:t(),
    take => fun(([integer()]) -> {ok, [taken()]} | {error, untaken()}),
    is_live => boolean(),
    %% modules of a user's own
    code => [module()],
    out := starl_cli_out:t(),
    values := map()
}.

-type untaken() ::
    starl_sim_onward:reason() | {recording, starl_lab_onward_recording:reason()}.

%% A moment, and the robots of a live run that start anew at it.
-type taken() :: {
    AtUs :: integer(), starl_sim_onward:point(), [{starl:robot_id(), starl_sim_follow:reason()}]
}.

%% Futures end this part of the time up to the moment after the recording's end, or this long, s.
-define(BEYOND, 0.25).
-define(LEAST_BEYOND_S, 1.0).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "onward",
        synopsis => "simulate a recording onwards from a moment, with other draws",
        argument => {required, "RUN", {example, "out/painting-1"}},
        subject => fun subject/2,
        about => [
            "RUN is a recording, or the directory of a run that holds one. Its robots are taken up as they were at "
            "the moment --at, with the packets that were under way, their places, their clocks, and what the "
            "contracts had seen; from there the run goes on in the simulator, --runs times, with other losses, "
            "delays, errors of drives, and faults that have not begun. Printed is the share of these futures that "
            "break a contract.",
            "A run that was recorded with --snapshots 5 is taken up at its last snapshot before the moment; "
            "without, a simulation is repeated from its beginning, and live robots start anew.",
            "With --moments 2 or more, futures from more moments follow where the share rises, down to a window of "
            "the simulator, the shortest delay of a packet; what happened in it is printed.",
            "Written are onward.txt, curve.csv and a plot. The same --salt gives the same curve. Ctrl-C tells what "
            "is known so far."
        ],
        flags => [{"Flags", own_flags()}],
        statuses => [
            {0, "no future breaks a contract"},
            {1, "internal error"},
            {2, "bad usage or input, also where what goes on here is not what was recorded"},
            {3, "some futures break a contract"},
            {130, "interrupted"}
        ],
        run => fun run/1
    }.

own_flags() ->
    [
        {at, {optional, {number, 0, 1.0e7}}, none, "the moment, s; none: the end of the recording"},
        {runs, {integer, 1, 10000}, 20, "futures of each moment"},
        {moments, {integer, 1, 1000}, 1, "moments, evenly up to that one"},
        {since, {number, 0, 1.0e7}, 0, "the moments lie after this time, s"},
        {contract, {optional, string}, none, "only this contract counts as broken, as mutex"},
        {beyond, {optional, {number, 0.001, 1.0e6}}, none,
            "futures end this long after the moment, s; none: a quarter of its time after the recording's end"},
        {loss_ahead, {optional, {number, 0, 1}}, none,
            "fraction of the packets that futures lose; none: as the run"},
        {salt, {integer, 0, 1 bsl 32}, 1, "the number from which the draws of the futures follow"},
        {out, string, none, "directory for the results; without it a new one under out/"},
        {quiet, switch, false, "no progress line"},
        starl_lab_jobs:at_once()
    ].

-spec subject(string(), [string()]) ->
    {ok, file:filename(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    starl_cli_out:recording(Word, "./starl run TARGET --snapshots 5 makes one", Args).

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := #{at := At, since := Since}}) when is_number(At), Since > 0, Since >= At ->
    {error, [io_lib:format("--since ~w: the moments lie after it, up to --at ~w", [Since, At])]};
run(#{subject := File, values := #{out := Into, at := At, since := Since} = Values}) ->
    {Unwritable, Out} = starl_cli_out:directory(Into, "onward"),
    case {Unwritable, starl_lab_onward_recording:read(File, until_us(Values))} of
        {[], {ok, #{end_us := End}}} when is_number(At), 1.0e6 * At > End ->
            {error, [io_lib:format("--at ~w: the recording ends at ~.3f s", [At, End / 1.0e6])]};
        {[], {ok, #{end_us := End}}} when Since > 0, 1.0e6 * Since >= End ->
            Line = "--since ~w: the recording ends at ~.3f s",
            {error, [io_lib:format(Line, [Since, End / 1.0e6])]};
        {[], {ok, Recording}} ->
            ok = starl_cli_log:install(),
            with_code(#{file => File, recording => Recording, out => Out, values => Values});
        {Problems, {ok, _}} ->
            {error, Problems};
        {[], {error, {live, _}}} ->
            ok = starl_cli_log:install(),
            live(#{file => File, out => Out, values => Values});
        {Problems, {error, Reason}} ->
            {error, Problems ++ [starl_lab_onward_recording:format_error(Reason)]}
    end.

until_us(#{at := none}) -> 1 bsl 60;
until_us(#{at := Seconds}) -> us(Seconds).

us(Seconds) -> round(1.0e6 * Seconds).

%% -- live runs ------------------------------------------------------------------------------

%% The last message tells the end of the recording.
live(#{file := File, values := #{at := At} = Values} = Setup) ->
    case starl_lab_onward_live:read(File, 0) of
        {ok, #{end_us := End}} when is_number(At), 1.0e6 * At > End ->
            {error, [io_lib:format("--at ~w: the recording ends at ~.3f s", [At, End / 1.0e6])]};
        {ok, #{scenario := #{app := App}} = Read} ->
            case own_code(App, File) of
                {ok, Code} ->
                    Options = #{
                        histories => histories(#{code => Code}), slack_us => starl_world:slack_us()
                    },
                    begun(times(Read, Values), Setup#{
                        code => Code,
                        is_live => true,
                        recording => (maps:with([scenario, end_us], Read))#{
                            not_kept => [], images => []
                        },
                        take => fun(Times) -> each_live(Times, File, Options, []) end
                    });
                {error, _} = Error ->
                    Error
            end;
        {error, Reason} ->
            {error, [starl_lab_onward_recording:format_error(Reason)]}
    end.

%% Each moment is read by itself.
each_live([], _File, _Options, Taken) ->
    {ok, lists:reverse(Taken)};
each_live([Us | Later], File, Options, Taken) ->
    case starl_lab_onward_live:read(File, Us) of
        {ok, #{live := Live}} ->
            case starl_sim_onward:live(Live, Us, Options) of
                {ok, Point, Anew} -> each_live(Later, File, Options, [{Us, Point, Anew} | Taken]);
                {error, _} = Error -> Error
            end;
        {error, Reason} ->
            {error, {recording, Reason}}
    end.

own_code(App, File) ->
    case starl_cli_inputs:source(App, File) of
        {ok, Source} ->
            case starl_cli_source:modules(Source) of
                {ok, _, Code} -> {ok, [Module || {Module, _, _} <- Code]};
                {error, _} = Error -> Error
            end;
        {error, Line} ->
            {error, [Line]};
        none ->
            {ok, []}
    end.

%% -- simulations ----------------------------------------------------------------------------

%% The source of an application of a user's own lies in `inputs' beside the recording.
-spec with_code(setup()) -> starl_cli_command:answer().
with_code(#{file := File, recording := #{scenario := #{app := App}}} = Setup) ->
    case own_code(App, File) of
        {ok, Code} -> taken_up(Setup#{code => Code});
        {error, _} = Error -> Error
    end.

-spec taken_up(setup()) -> starl_cli_command:answer().
taken_up(#{recording := Recording, values := Values} = Setup) ->
    #{scenario := #{app := App, scenario := Scenario}, facts := Facts, images := Images} =
        Recording,
    Recorded = #{scenario => Scenario#{app => App}, facts => Facts, images => Images},
    Options = #{histories => histories(Setup)},
    Take = fun(Times) ->
        case starl_sim_onward:moments(Recorded, Times, Options) of
            {ok, Points} -> {ok, [{Us, Point, []} || {Us, Point} <- Points]};
            {error, _} = Error -> Error
        end
    end,
    begun(times(Recording, Values), Setup#{take => Take, is_live => false}).

times(#{end_us := End}, #{at := At, moments := N, since := Since}) ->
    Last = last_us(At, End),
    First = min(us(Since), Last),
    lists:usort([First + (Last - First) * I div N || I <- lists:seq(1, N)]).

last_us(none, End) -> End;
last_us(At, _End) -> us(At).

%% -- futures --------------------------------------------------------------------------------

-spec begun([integer(), ...], setup()) -> starl_cli_command:answer().
begun(Times, #{take := Take} = Setup) ->
    case Take(Times) of
        {ok, Taken} -> futures(Taken, Setup);
        {error, {failed, _} = Reason} -> failed(Reason);
        {error, Reason} -> {error, [untaken(Reason)]}
    end.

untaken({recording, Reason}) -> starl_lab_onward_recording:format_error(Reason);
untaken(Reason) -> starl_sim_onward:format_error(Reason).

futures(Taken, #{recording := #{end_us := End} = Recording, values := Values} = Setup) ->
    Same = #{histories => histories(Setup), slack_us => slack_us(Setup)},
    Settings = fun(Us) -> maps:merge(settings(Us, End, Values), Same) end,
    Points = maps:from_list([{Us, Point} || {Us, Point, _} <- Taken]),
    Plan = plan(Values),
    Contract = maps:get(contract, Values),
    Future = fun(Us, Point, Salt) -> future(Point, Settings(Us), Salt, Contract) end,
    try
        starl_sim_inevitable:search(#{
            grid => lists:sort(maps:keys(Points)),
            futures => maps:get(runs, Values),
            fine => window_us(Recording),
            ask => fun(Questions) -> asked(Questions, Points, Plan, Future, Setup) end
        })
    of
        Result -> told(report(Result, Taken, Settings, Setup), Setup)
    catch
        throw:{future, Reason} -> failed(Reason)
    after
        starl_cli_signal:on_interrupt(quit)
    end.

report(#{curve := Curve, complete := IsComplete} = Result, Taken, Settings, Setup) ->
    #{recording := #{images := Images} = Recording, values := #{contract := Contract}} = Setup,
    {Last, _, Anew} = lists:last(lists:keysort(1, Taken)),
    Untaken = untaken(),
    #{
        curve => Curve,
        how => how_ended(IsComplete, Untaken),
        contract => Contract,
        settings => Settings(Last),
        recording => maps:without([facts, images], Recording),
        images => [At || {At, _, _} <- Images],
        anew => anew(Anew, Setup),
        rise => rise(Result, Untaken, length(Taken), Setup)
    }.

plan(#{salt := Salt, jobs := Jobs} = Values) ->
    Self = self(),
    Interrupt = make_ref(),
    starl_cli_signal:on_interrupt(fun() -> Self ! Interrupt end),
    #{
        time_us => fun(Us) -> Us end,
        salt => Salt,
        jobs => Jobs,
        interrupt => Interrupt,
        progress => starl_cli_progress:new(how(Values))
    }.

%% A moment between those that were asked for is taken up when it is needed. If it cannot be, the search
%% ends with what is known.
asked(Questions, Known, Plan, Future, #{take := Take}) ->
    case taken(lists:usort([Us || {Us, _} <- Questions, not is_map_key(Us, Known)]), Take) of
        {ok, Taken} ->
            Points = maps:merge(Known, maps:from_list([{Us, Point} || {Us, Point, _} <- Taken])),
            starl_lab_futures:ask(Questions, Plan#{
                future => fun(Us, Salt) -> Future(Us, maps:get(Us, Points), Salt) end
            });
        {error, Reason} ->
            self() ! {?MODULE, untaken, Reason},
            {stopped, []}
    end.

taken([], _Take) -> {ok, []};
taken(Times, Take) -> Take(Times).

untaken() ->
    receive
        {?MODULE, untaken, Reason} -> {untaken, untaken(Reason)}
    after 0 -> none
    end.

how_ended(true, _Untaken) -> done;
how_ended(false, {untaken, _}) -> done;
how_ended(false, none) -> stopped.

anew(Anew, #{is_live := true}) -> Anew;
anew(_None, #{is_live := false}) -> none.

%% A moment is the beginning of a window.
window_us(#{scenario := #{scenario := #{delay := {Ms, _}}}}) -> max(1, round(1000 * Ms)).

%% What happened where the share rises most, as far as it was halved.
rise(#{step := none}, _Untaken, Moments, _Setup) ->
    {none, Moments};
rise(#{step := {Low, High}}, {untaken, Why}, _Moments, _Setup) ->
    {untaken, {Low, High}, Why};
rise(#{step := {Low, High}, complete := true}, none, _Moments, #{take := Take, file := File}) ->
    case Take([Low, High]) of
        {ok, [{_, From, Before}, {_, To, After}]} ->
            Window = {starl_sim_onward:time_us(From), starl_sim_onward:time_us(To)},
            happened({Low, High}, Window, differ(ids(Before), ids(After)), File);
        {error, Reason} ->
            {untaken, {Low, High}, untaken(Reason)}
    end;
rise(_Interrupted, _Untaken, Moments, _Setup) ->
    {none, Moments}.

ids(Anew) -> [Id || {Id, _} <- Anew].

differ(Some, Others) -> lists:usort((Some -- Others) ++ (Others -- Some)).

happened(Step, {From, To} = Window, Anew, File) ->
    case starl_lab_onward_recording:between(File, From, To) of
        {ok, All} -> {named, Step, Window, All, Anew};
        {error, Reason} -> {untaken, Step, starl_lab_onward_recording:format_error(Reason)}
    end.

how(#{quiet := true}) -> quiet;
how(#{quiet := false}) -> auto.

settings(Us, End, #{beyond := Beyond, loss_ahead := Loss}) ->
    Until =
        case Beyond of
            none -> max(End, Us) / 1.0e6 + max(?LEAST_BEYOND_S, ?BEYOND * Us / 1.0e6);
            Seconds -> Us / 1.0e6 + Seconds
        end,
    #{
        loss =>
            case Loss of
                none -> same;
                _ -> Loss
            end,
        until_s => Until,
        until_ms => max(1, max(End, Us) div 1000)
    }.

%% The contracts of a live run allow for a computer that has other work.
slack_us(#{is_live := true}) -> starl_world:slack_us();
slack_us(#{}) -> 0.

%% As a recorded run keeps them.
histories(#{code := Code}) -> {kept, starl_block_catalogue:histories(Code)}.

future(Point, Settings, Salt, Contract) ->
    fun() ->
        {ok, Verdict, Digest} = starl_sim_onward:play(Point, Settings, Salt),
        {ok, word(Verdict, Contract), Digest}
    end.

word({broken, _}, none) ->
    broken;
word({broken, Contracts}, Name) ->
    case lists:member(Name, [atom_to_list(C) || C <- Contracts]) of
        true -> broken;
        false -> other
    end;
word(Verdict, _Contract) ->
    Verdict.

failed(Reason) ->
    starl_cli_progress:erase(),
    starl_cli_terminal:complain(["onward: ", why(Reason)]),
    1.

why({trial, {failed, Reason}}) -> starl_sim_onward:format_error({failed, Reason});
why(Reason) -> starl_sim_onward:format_error(Reason).

%% -- the answer -----------------------------------------------------------------------------

told(Report, #{out := Out}) ->
    starl_cli_progress:erase(),
    Text = starl_lab_onward_report:text(Report, starl_cli_terminal:columns()),
    starl_cli_terminal:out(Text),
    Files = [{"onward.txt", Text}, {"curve.csv", starl_lab_onward_report:csv(Report)}],
    Written = starl_cli_out:write(Out, fun(New) ->
        starl_lab_when_report:plotted(starl_lab_onward_report:plot(Report), Files, New)
    end),
    written(Written, status(Report)).

status(#{how := stopped}) ->
    130;
status(#{curve := Curve}) ->
    case lists:any(fun({_, #{broken := Broken}}) -> Broken > 0 end, Curve) of
        true -> 3;
        false -> 0
    end.

written({ok, Dir}, Status) ->
    starl_cli_terminal:out(["result: ", starl_cli_out:shown(Dir), "\n"]),
    Status;
written({error, Why}, _Status) ->
    starl_cli_terminal:complain(["the results could not be written: ", Why]),
    1.
