%% @doc Runs a simulation in short pieces, between which it shows the progress and obeys Ctrl-C. The
%% length of the pieces does not change the run.
-module(starl_lab_drive).

-export([with/2, with/3, run/3, again/4, watching/0]).

-export_type([answer/1, ending/0]).

%% The result of the given function; or the reason why the simulation could not start, or failed.
-type answer(Result) ::
    {ok, Result} | {error, starl_sim:reason()} | {failed, Reason :: term()}.

%% The end of a run; `none': the run has only reached the requested time.
-type ending() :: starl_sim_run:ending() | none.

%% The intended length of a piece in wall time, and the length of the first in virtual time.
-define(PIECE_MS, 100).
-define(FIRST_US, 100000).

-record(drive, {
    sim :: starl_sim:sim(),
    until_us :: non_neg_integer(),
    piece_us = ?FIRST_US :: pos_integer(),
    progress :: starl_cli_progress:t(),
    label :: string(),
    %% With a requested time limit the progress is measured by it.
    limited :: boolean(),
    begun_ms :: integer()
}).

%% @doc Starts the simulation of a checked scenario and applies a function to it. Meanwhile Ctrl-C
%% ends the run.
-spec with(starl_run_scenario:t(), fun((starl_sim:sim()) -> Result)) -> answer(Result).
with(Scenario, Do) -> with(Scenario, #{}, Do).

%% @doc The same with options of the simulation.
-spec with(starl_run_scenario:t(), starl_sim:options(), fun((starl_sim:sim()) -> Result)) ->
    answer(Result).
with(Scenario, Options, Do) ->
    ok = starl_cli_log:install(),
    _ = process_flag(trap_exit, true),
    try starl_sim:start(Scenario, watched(Options)) of
        {ok, Sim} -> started(Sim, Do);
        {error, Reason} -> {error, Reason}
    catch
        exit:Reason -> {failed, Reason}
    end.

watched(Options) ->
    %% nobody looks at processes
    Options#{
        auto => inline, checked => true, watch => watching() ++ maps:get(watch, Options, [])
    }.

%% @doc The monitors that inform the user while a run goes on.
-spec watching() -> [{module(), map()}].
watching() -> [{starl_lab_first_crash, #{tell => fun starl_cli_progress:note/1}}].

started(Sim, Do) ->
    Watch = starl_lab_stall:watch(Sim),
    starl_cli_signal:on_interrupt(fun() -> starl_lab_stall:interrupt(Sim) end),
    try
        Result = Do(Sim),
        starl_cli_signal:on_interrupt(fun() -> ok end),
        {ok, Result}
    catch
        exit:{Reason, {gen_server, call, _}} ->
            starl_cli_progress:erase(),
            {failed, Reason}
    after
        ok = starl_sim_watchdog:stop(Watch)
    end.

%% @doc Runs to a virtual time or an earlier end, with a progress line; gives the end of the run and
%% the wall time taken.
-spec run(starl_sim:sim(), UntilUs :: non_neg_integer(), starl_lab_setup:t()) ->
    {ending(), Ms :: integer()}.
run(Sim, UntilUs, Setup) ->
    Drive = drive(Sim, UntilUs, Setup),
    Ending = drive_on(Drive),
    starl_cli_progress:erase(),
    {Ending, wall_ms(Drive)}.

%% @doc Repeats a simulation up to a virtual time or an earlier end, and finishes it.
-spec again(starl_run_scenario:t(), starl_sim:options(), UntilUs, starl_lab_setup:t()) ->
    answer({ending(), starl_sim_run:outcome()})
when
    UntilUs :: non_neg_integer().
again(Scenario, Options, UntilUs, Setup) ->
    with(Scenario, Options, fun(Sim) ->
        {Ending, _} = run(Sim, UntilUs, Setup),
        {Outcome, _Report} = starl_sim:finish(Sim),
        {Ending, Outcome}
    end).

drive(Sim, UntilUs, #{scenario := Scenario, target := #{name := Name}, quiet := Quiet}) ->
    #{app := App, time := Seconds} = Scenario,
    Usual = starl_cli_flags:defaults(starl_run_scenario:options(App)),
    #drive{
        sim = Sim,
        until_us = UntilUs,
        progress = starl_cli_progress:new(
            case Quiet of
                true -> quiet;
                false -> auto
            end
        ),
        label = Name,
        limited = maps:get(time, Usual) =/= Seconds orelse UntilUs < round(Seconds * 1.0e6),
        begun_ms = now_ms()
    }.

drive_on(#drive{sim = Sim, until_us = Until, piece_us = Piece} = Drive) ->
    #{now_us := From} = starl_sim:status(Sim),
    Begin = now_ms(),
    case starl_sim:run(Sim, min(Until, From + Piece) / 1.0e6) of
        #{ending := none, now_us := Now} when Now >= Until ->
            none;
        #{ending := none} = Status ->
            drive_on(shown(Status, Drive#drive{piece_us = fitted(Piece, now_ms() - Begin)}));
        #{ending := Ending} ->
            Ending
    end.

%% The next piece should fill its wall time, but is at most twice as long as this one.
fitted(Piece, Ms) -> max(1000, min(2 * Piece, Piece * ?PIECE_MS div max(1, Ms))).

shown(#{now_us := Now, running := Running}, #drive{progress = Progress, until_us = End} = Drive) ->
    Words = fun() ->
        Seconds = Now / 1.0e6,
        Speed = Seconds * 1000 / max(1, wall_ms(Drive)),
        [
            io_lib:format("~ts ~.1f s", [Drive#drive.label, Seconds]),
            io_lib:format("~.1f x real time", [Speed]),
            io_lib:format("~b at work", [Running])
        ]
    end,
    Part =
        case Drive#drive.limited of
            true -> Now / End;
            false -> unknown
        end,
    Drive#drive{progress = starl_cli_progress:show(Progress, Part, Words)}.

wall_ms(#drive{begun_ms = Begun}) -> now_ms() - Begun.

now_ms() -> erlang:monotonic_time(millisecond).
