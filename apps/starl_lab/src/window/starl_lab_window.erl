%% @doc Runs a command line in a window: a page in the browser shows the run, and the user can apply
%% faults ({@link starl_view}). Otherwise it is the same run, with the same digest and the same
%% files.
-module(starl_lab_window).

-export([flags/0, run/2, run/3, played/4, open/1, open/2, live/2]).

-export_type([ended/0]).

-define(LINGER_MS, 500).
-define(INTERRUPTED, 130).

%% How a run in a window has ended: it stays open, to be looked at; or why it did not run. `is_changed': a
%% user has changed its faults. `again': it was changed after an end that was shown.
-type ended() ::
    {ok, #{
        sim := starl_sim:sim(),
        scenario := starl_run_scenario:t(),
        ending := starl_lab_drive:ending(),
        is_changed := boolean(),
        again := boolean(),
        wall_ms := integer()
    }}
    | {error, starl_sim:reason()}
    | {failed, Reason :: term()}.

%% @doc The flags of a window.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {view, switch, false, "shows the run in a browser, while it goes on"},
        {view_port, {integer, 0, 65535}, 0, "view: port of the page; 0: a free one"},
        {view_host, string, "127.0.0.1",
            "view: address to listen at; other computers get in with the token that is printed; 0.0.0.0 "
            "for a telephone"},
        {no_wait, switch, false, "view: begins at once, not when the first page is open"},
        {no_open, switch, false, "view: opens no browser, where there is a display"}
    ].

%% @doc Opens the window, prints its address, and shows it in the user's browser.
-spec open(Values :: #{atom() => term()}) ->
    {ok, starl_view:t()} | {error, [unicode:chardata(), ...]}.
open(Values) -> open(Values, #{}).

%% @doc The same with options of the window.
-spec open(Values :: #{atom() => term()}, starl_view:options()) ->
    {ok, starl_view:t()} | {error, [unicode:chardata(), ...]}.
open(#{view_port := Port, view_host := Host, no_open := NoOpen}, Options) ->
    case starl_view:start(Options#{port => Port, host => Host}) of
        {ok, View} ->
            Address = starl_view:address(View),
            starl_cli_terminal:out(["view: ", Address, "\n"]),
            _ = NoOpen orelse starl_lab_browser:open(Address),
            {ok, View};
        {error, Reason} ->
            {error, [starl_view:format_error(Reason)]}
    end.

%% @doc Runs a simulation in a window.
-spec run(starl_lab_setup:t(), Values :: #{atom() => term()}) -> starl_cli_command:answer().
run(Setup, Values) -> run(Setup, Values, #{}).

%% @doc The same with a configuration of the player ({@link starl_lab_player:config()}).
-spec run(starl_lab_setup:t(), Values :: #{atom() => term()}, map()) ->
    starl_cli_command:answer().
run(#{nodes := Nodes, target := Target} = Setup, Values, Config) ->
    case starl_lab_nodes:options(Nodes, Target) of
        {ok, Options} ->
            Watched = Options#{watch => starl_lab_findings:watch(maps:get(scenario, Setup))},
            Own = Config#{options => Watched, recorded => is_map_key(recording, Setup)},
            played(Setup, Values, Own, fun told/2);
        {error, Line} ->
            {error, [Line]}
    end.

told({ok, #{sim := Sim, ending := Ending, scenario := Effective} = Ended}, Setup) ->
    #{wall_ms := WallMs, is_changed := IsChanged} = Ended,
    Ran = starl_lab_simulation:conclude(Sim, Effective, Ending, WallMs),
    starl_lab_simulation:answer({ok, Ran}, own(IsChanged, Effective, Setup));
told(Failed, Setup) ->
    starl_lab_simulation:answer(Failed, Setup).

%% @doc Plays a simulation in a window, with a configuration of the player. When it has ended, a
%% function reports how, while the window may still be open; it leaves the simulation open.
-spec played(starl_lab_setup:t(), Values :: #{atom() => term()}, map(), Tell) ->
    starl_cli_command:answer()
when
    Tell :: fun((ended(), starl_lab_setup:t()) -> starl_cli_command:answer()).
played(Setup, Values, Config, Tell) ->
    _ = process_flag(trap_exit, true),
    ok = starl_cli_log:install(),
    case open(Values) of
        {ok, View} ->
            Hub = starl_view:hub(View),
            Answer = attended(Hub, Values, fun() -> play(Hub, Setup, Values, Config, Tell) end),
            ok = starl_view:stop(View),
            Answer;
        {error, _} = Error ->
            Error
    end.

%% A run begins when somebody can see it.
attended(_Hub, #{no_wait := true}, Run) ->
    Run();
attended(Hub, #{no_wait := false}, Run) ->
    starl_cli_terminal:out("waiting for a browser to open this page (--no-wait: begins at once)\n"),
    Self = self(),
    starl_cli_signal:on_interrupt(fun() -> Self ! interrupted end),
    ok = starl_view_hub:first_page(Hub),
    receive
        {first_page, Hub} ->
            starl_cli_signal:on_interrupt(quit),
            Run();
        interrupted ->
            starl_cli_terminal:out("interrupted\n"),
            ?INTERRUPTED
    end.

play(Hub, #{scenario := Scenario} = Setup, #{pace := Pace}, Config, Tell) ->
    #{options := Options} = Config,
    Begun = erlang:monotonic_time(millisecond),
    Watch = starl_lab_drive:watching() ++ maps:get(watch, Options, []),
    Player = #{
        hub => Hub,
        scenario => Scenario,
        options => starl_lab_recording:options(Setup, Options#{watch => Watch}),
        speed => Pace,
        linger => true,
        started => fun watched/1,
        over => fun(Ran) -> over(Ran, Begun, {Hub, Setup, Tell}) end,
        save => fun(Name, Faulty) -> save(Name, Faulty, Setup) end
    },
    try starl_lab_player:play(maps:merge(Player, maps:remove(options, Config))) of
        {ok, #{sim := Sim, answer := Answer}} ->
            ok = starl_sim:close(Sim),
            Answer;
        {error, _} = Error ->
            Tell(Error, Setup)
    catch
        exit:{Reason, {gen_server, call, _}} -> Tell({failed, Reason}, Setup)
    end.

%% Results are written at once: who closes the page, or the computer, loses none.
over(#{again := Again} = Ran, Begun, {Hub, #{out := Out} = Setup, Tell}) ->
    starl_cli_signal:on_interrupt(fun() -> ok end),
    WallMs = erlang:monotonic_time(millisecond) - Begun,
    Told =
        case Again of
            true -> Setup#{out := starl_cli_out:again(Out)};
            false -> Setup
        end,
    Answer = Tell({ok, Ran#{wall_ms => WallMs}}, Told),
    Player = self(),
    starl_cli_signal:on_interrupt(fun() -> starl_lab_player:stop(Player) end),
    ok = stays(Hub),
    Answer.

stays(Hub) ->
    case starl_view_hub:is_attended(Hub) of
        true ->
            starl_cli_terminal:out(
                "the run is over; its page can be looked at until it is closed, or for Ctrl-C\n"
            );
        false ->
            ok
    end.

%% What was done by hand belongs to the scenario of the run.
own(false, _Effective, Setup) -> Setup;
own(true, Effective, Setup) -> Setup#{scenario := Effective}.

watched(Sim) ->
    Player = self(),
    Watch = starl_lab_stall:watch(Sim),
    starl_cli_signal:on_interrupt(fun() ->
        ok = starl_lab_player:stop(Player),
        starl_lab_stall:interrupt(Sim)
    end),
    fun() -> starl_sim_watchdog:stop(Watch) end.

%% @doc Runs robots in real time in a window, if that is wanted. The function gets a function for the
%% options of the run, and another one to be called with the run when it has started.
-spec live(Values :: #{atom() => term()}, Run) -> starl_cli_command:answer() when
    Run :: fun((Options, Attach) -> starl_cli_command:answer()),
    Options :: fun((map()) -> map()),
    Attach :: fun((starl_run:t()) -> ok).
live(#{view := true, pace := Pace} = Values, Run) ->
    case open(Values) of
        {ok, View} ->
            Hub = starl_view:hub(View),
            Answer = attended(Hub, Values, fun() -> seen(Hub, Pace, Run) end),
            ok = starl_view:stop(View),
            Answer;
        {error, _} = Error ->
            Error
    end;
live(_Values, Run) ->
    Run(fun(Options) -> Options end, fun(_Run) -> ok end).

seen(Hub, Pace, Run) ->
    {ok, Live} = starl_lab_window_live:start_link(#{hub => Hub, speed => Pace}),
    Answer = Run(fun(Options) -> observed(Live, Options) end, fun(Started) ->
        starl_lab_window_live:attach(Live, Started)
    end),
    ok = linger(Hub),
    true = unlink(Live),
    true = exit(Live, shutdown),
    Answer.

%% A run that is over can be looked at until the last page is closed, or for Ctrl-C.
linger(Hub) ->
    Self = self(),
    starl_cli_signal:on_interrupt(fun() -> Self ! interrupted end),
    ok = stays(Hub),
    ok = lingering(Hub),
    starl_cli_signal:on_interrupt(fun() -> ok end).

lingering(Hub) ->
    case starl_view_hub:is_attended(Hub) of
        false ->
            ok;
        true ->
            receive
                interrupted -> ok
            after ?LINGER_MS -> lingering(Hub)
            end
    end.

observed(Live, Options) ->
    Observers = [maps:get(observe, Options, none), starl_lab_window_live:observer(Live)],
    Options#{observe => starl_observer:all(Observers)}.

%% Writes a scenario with the manual faults as NAME.term, beside the command; never over
%% another file.
-spec save(Name :: binary(), starl_run_scenario:t(), starl_lab_setup:t()) ->
    {ok, unicode:chardata()} | {error, unicode:chardata()}.
save(Name, Scenario, Setup) ->
    File = <<Name/binary, ".term">>,
    case re:run(Name, "^[A-Za-z0-9_-]{1,60}$", [{capture, none}, dollar_endonly]) of
        nomatch -> {error, "a name has letters, digits, - and _ only"};
        match -> write(File, starl_lab_files:scenario(Setup#{scenario := Scenario}))
    end.

write(File, Text) ->
    case file:write_file(File, unicode:characters_to_binary(Text), [exclusive]) of
        ok -> {ok, ["saved; to repeat it: ./starl run ", File]};
        {error, eexist} -> {error, [File, " is there already; choose another name"]};
        {error, Posix} -> {error, [File, ": ", file:format_error(Posix)]}
    end.
