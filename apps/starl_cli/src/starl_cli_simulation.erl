%% @doc Runs a simulation piece by piece, so that the progress is seen and Ctrl-C is heard, and
%% writes its results. How a run is cut into pieces does not change it.
-module(starl_cli_simulation).

-export([run/1]).

%% How long a piece is to take, in wall time, and how long the first is, in virtual time.
-define(PIECE_MS, 100).
-define(FIRST_US, 100000).

-record(drive, {
    sim :: starl_sim:sim(),
    end_us :: pos_integer(),
    piece_us = ?FIRST_US :: pos_integer(),
    progress :: starl_cli_progress:t(),
    label :: string(),
    %% where a time limit was asked for, the way to it is the progress
    limited :: boolean(),
    begun_ms :: integer()
}).

%% @doc Runs what a command line asks for; gives the exit status.
-spec run(starl_cli_run:setup()) -> starl_cli_terminal:status().
run(#{nodes := Nodes, target := Target} = Setup) ->
    ok = starl_cli_log:install(),
    _ = process_flag(trap_exit, true),
    case starl_cli_nodes:options(Nodes, Target) of
        {ok, Options} -> start(Options, Setup);
        {error, Line} -> starl_cli_terminal:bad_input([Line])
    end.

start(Options, #{scenario := Scenario} = Setup) ->
    try starl_sim:start(Scenario, Options) of
        {ok, Sim} -> started(Sim, Setup);
        {error, {nodes, {lost, Loss}}} -> lost([Loss], 4);
        {error, Reason} -> starl_cli_terminal:bad_input([starl_sim:format_error(Reason)])
    catch
        exit:Reason -> failed(Reason, Setup)
    end.

started(Sim, Setup) ->
    starl_cli_signal:on_interrupt(fun() -> starl_sim:stop(Sim) end),
    Drive = drive(Sim, Setup),
    try finish(drive_on(Drive), Drive) of
        {Ending, WallMs, Outcome, AppReport} ->
            tell(Setup, Ending, WallMs, Outcome, AppReport)
    catch
        exit:{Reason, {gen_server, call, _}} ->
            starl_cli_progress:erase(),
            failed(Reason, Setup)
    end.

drive(Sim, #{scenario := #{time := Seconds}, target := #{name := Name}, quiet := Quiet} = Setup) ->
    #{scenario := #{app := App}} = Setup,
    Usual = starl_cli_flags:defaults(starl_sim_scenario:options() ++ starl_app:options(App)),
    #drive{
        sim = Sim,
        end_us = round(Seconds * 1.0e6),
        progress = starl_cli_progress:new(
            case Quiet of
                true -> quiet;
                false -> auto
            end
        ),
        label = Name,
        limited = maps:get(time, Usual) =/= Seconds,
        begun_ms = now_ms()
    }.

drive_on(#drive{sim = Sim, end_us = End, piece_us = Piece} = Drive) ->
    #{now_us := From} = starl_sim:status(Sim),
    Begin = now_ms(),
    case starl_sim:run(Sim, min(End, From + Piece) / 1.0e6) of
        #{ending := none, now_us := Now} when Now >= End ->
            time;
        #{ending := none} = Status ->
            drive_on(shown(Status, Drive#drive{piece_us = fitted(Piece, now_ms() - Begin)}));
        #{ending := Ending} ->
            Ending
    end.

%% The next piece is as long as fills its wall time, but at most twice as long as this one.
fitted(Piece, Ms) -> max(1000, min(2 * Piece, Piece * ?PIECE_MS div max(1, Ms))).

shown(#{now_us := Now, running := Running}, #drive{progress = Progress, end_us = End} = Drive) ->
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

finish(Ending, #drive{sim = Sim} = Drive) ->
    WallMs = wall_ms(Drive),
    starl_cli_signal:on_interrupt(fun() -> ok end),
    {Outcome, AppReport} = starl_sim:finish(Sim),
    starl_cli_progress:erase(),
    case Outcome of
        #{lost := []} -> {Ending, WallMs, Outcome, AppReport};
        #{lost := [_ | _]} -> {lost, WallMs, Outcome, AppReport}
    end.

wall_ms(#drive{begun_ms = Begun}) -> now_ms() - Begun.

now_ms() -> erlang:monotonic_time(millisecond).

%% -- results --------------------------------------------------------------------------------

tell(#{target := #{name := Name}, scenario := Scenario} = Setup, Ending, WallMs, Outcome, App) ->
    Report = starl_cli_report:make(#{
        name => Name, scenario => Scenario, ending => Ending, wall_s => WallMs / 1000,
        outcome => Outcome, figures => maps:get(figures, App)
    }),
    Write = maps:get(write, App, fun(_) -> {ok, []} end),
    Written = starl_cli_out:write(maps:get(out, Setup), fun(Dir) ->
        starl_cli_files:write(Dir, Setup, Report, Write)
    end),
    _ = summarize(Setup, Report),
    violated(Setup, Outcome),
    where(Written, lost(maps:get(lost, Outcome), status(Report))).

%% Says which nodes are gone; passes the status on.
lost(Losses, Status) ->
    lists:foreach(fun(L) -> starl_cli_terminal:complain(starl_sim_nodes:format_loss(L)) end, Losses),
    Status.

%% What is not as it should be is told in any case.
summarize(#{quiet := true}, Report) ->
    status(Report) =:= 0 orelse
        starl_cli_terminal:out([hd(starl_cli_report:summary(Report)), "\n"]);
summarize(#{quiet := false}, Report) ->
    starl_cli_terminal:out([[Line, "\n"] || Line <- starl_cli_report:summary(Report)]).

violated(_Setup, #{violations := []}) ->
    ok;
violated(#{target := Target, scenario := Scenario}, #{violations := Violations}) ->
    Lines = [[starl_monitor:format_violation(V), "\n"] || V <- Violations],
    starl_cli_terminal:out([Lines, "replay: ", starl_cli_run:replay(Target, Scenario), "\n"]).

where({ok, Dir}, Status) ->
    Crashes =
        case starl_cli_log:lines() of
            [] -> "";
            [_ | _] -> " (run.log tells of crashes)"
        end,
    starl_cli_terminal:out(["result: ", starl_cli_out:shown(Dir), Crashes, "\n"]),
    Status;
where({error, Why}, _Status) ->
    starl_cli_terminal:complain(["the results could not be written: ", Why]),
    1.

status(Report) ->
    case {starl_cli_report:figure(violations, Report), starl_cli_report:ending(Report)} of
        {[_ | _], _} -> 3;
        {[], stopped} -> 130;
        {[], _} -> finished(starl_cli_report:complete(Report))
    end.

finished(true) -> 0;
finished(false) -> 4.

%% The simulation itself came to grief: what was logged tells more.
failed(Reason, #{out := Out} = Setup) ->
    starl_cli_signal:on_interrupt(quit),
    Fill = fun(Dir) -> starl_cli_files:write_failure(Dir, Setup, Reason) end,
    Where =
        case starl_cli_out:write(Out, Fill) of
            {ok, Dir} -> ["see ", starl_cli_out:shown(filename:join(Dir, "run.log"))];
            {error, Why} -> ["and its log could not be written: ", Why]
        end,
    starl_cli_terminal:complain(["the simulation failed: ", why(Reason), "; ", Where]),
    1.

why({shard_failed, Reason}) ->
    why(Reason);
why({no_answer, [_ | _] = Busy}) ->
    Names = [io_lib:format("~ts of robot ~b", [Name, Robot]) || {Robot, Name} <- Busy],
    ["no answer from ", lists:join(", ", Names), " for long; is there an endless loop in it?"];
why(Reason) ->
    io_lib:format("~0tP", [Reason, 15]).
