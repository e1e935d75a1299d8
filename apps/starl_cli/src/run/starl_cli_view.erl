%% @doc Runs a command line in a window: a page in the browser shows the run and lends hands to it
%% ({@link starl_view}). Otherwise it is the same run, with the same digest and the same files.
-module(starl_cli_view).

-export([flags/0, run/2, open/1, save/3]).

%% @doc The flags of a window.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {view, switch, false, "shows the run in a browser, while it goes on"},
        {view_port, {integer, 0, 65535}, 0, "view: port of the page; 0: a free one"},
        {view_host, string, "127.0.0.1",
            "view: address to listen at; other computers get in with the token that is printed"}
    ].

%% @doc Opens the window and prints its address.
-spec open(Values :: #{atom() => term()}) -> {ok, starl_view:t()} | {error, [unicode:chardata()]}.
open(#{view_port := Port, view_host := Host}) ->
    case starl_view:start(#{port => Port, host => Host}) of
        {ok, View} ->
            starl_cli_terminal:out(["view: ", starl_view:address(View), "\n"]),
            {ok, View};
        {error, Reason} ->
            {error, [starl_view:format_error(Reason)]}
    end.

%% @doc Runs a simulation in a window.
-spec run(starl_cli_setup:t(), Values :: #{atom() => term()}) -> starl_cli_command:answer().
run(#{nodes := Nodes, target := Target} = Setup, Values) ->
    case starl_cli_nodes:options(Nodes, Target) of
        {ok, Options} -> run(starl_cli_recording:options(Setup, Options), Setup, Values);
        {error, Line} -> {error, [Line]}
    end.

run(Options, Setup, Values) ->
    _ = process_flag(trap_exit, true),
    case open(Values) of
        {ok, View} ->
            Answer = played(View, Options, Setup, Values),
            ok = starl_view:stop(View),
            Answer;
        {error, _} = Error ->
            Error
    end.

played(View, Options, #{scenario := Scenario} = Setup, #{pace := Pace}) ->
    ok = starl_cli_log:install(),
    Begun = erlang:monotonic_time(millisecond),
    Watch = starl_cli_drive:watching() ++ starl_cli_notes:watch(Scenario),
    Config = #{
        hub => starl_view:hub(View),
        scenario => Scenario,
        options => Options#{watch => Watch},
        speed => Pace,
        linger => true,
        started => fun watched/1,
        save => fun(Name, Faulty) -> save(Name, Faulty, Setup) end
    },
    try starl_view_player:play(Config) of
        {ok, #{sim := Sim, scenario := Effective, ending := Ending, hands := Hands}} ->
            WallMs = erlang:monotonic_time(millisecond) - Begun,
            Ran = starl_cli_simulation:finish(Sim, Effective, Ending, WallMs),
            starl_cli_signal:on_interrupt(fun() -> ok end),
            starl_cli_simulation:answer({ok, Ran}, own(Hands, Effective, Setup));
        {error, _} = Error ->
            starl_cli_simulation:answer(Error, Setup)
    catch
        exit:{Reason, {gen_server, call, _}} ->
            starl_cli_simulation:answer({failed, Reason}, Setup)
    end.

%% What was done by hand belongs to the scenario of the run.
own(false, _Effective, Setup) -> Setup;
own(true, Effective, Setup) -> Setup#{scenario := Effective}.

watched(Sim) ->
    Player = self(),
    Watch = starl_cli_stall:watch(Sim),
    starl_cli_signal:on_interrupt(fun() ->
        ok = starl_view_player:stop(Player),
        starl_cli_stall:interrupt(Sim)
    end),
    fun() -> starl_sim_watch:stop(Watch) end.

%% @doc Writes a scenario with the faults by hand as NAME.term, beside the command; never over
%% another file.
-spec save(Name :: binary(), starl_sim_scenario:t(), starl_cli_setup:t()) ->
    {ok, unicode:chardata()} | {error, unicode:chardata()}.
save(Name, Scenario, Setup) ->
    File = <<Name/binary, ".term">>,
    case re:run(Name, "^[A-Za-z0-9_-]{1,60}$", [{capture, none}, dollar_endonly]) of
        nomatch -> {error, "a name has letters, digits, - and _ only"};
        match -> write(File, starl_cli_files:scenario(Setup#{scenario := Scenario}))
    end.

write(File, Text) ->
    case file:write_file(File, unicode:characters_to_binary(Text), [exclusive]) of
        ok -> {ok, ["saved; to repeat it: ./starl run ", File]};
        {error, eexist} -> {error, [File, " is there already; choose another name"]};
        {error, Posix} -> {error, [File, ": ", file:format_error(Posix)]}
    end.
