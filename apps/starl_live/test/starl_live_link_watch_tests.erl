%% The link of a live robot watches its machines: one that hangs is killed and starts anew, an application
%% that takes long is told of, and so is one that crashes.
-module(starl_live_link_watch_tests).
-include_lib("eunit/include/eunit.hrl").

-export([log/2]).

-import(starl_live_link_ct, [with_link/2, took/2, hung/1, app_hangs/1, sap/0]).

%% One that has not answered from one watch to the next is killed, and starts anew. One that has answered
%% meanwhile has its time anew, though it is at work again.
hung_machine_is_killed_test() ->
    with_link(1, fun(Link, _Times) ->
        {Sap, First} = sap(),
        Monitor = monitor(process, Sap),
        ok = hung(Link),
        Link ! watch,
        Sap ! go_on,
        ok = hung(Link),
        Link ! watch,
        _ = starl_live_link:metrics(Link),
        ?assert(is_process_alive(Sap)),
        Link ! watch,
        killed_and_anew(Sap, Monitor, First, Link)
    end).

%% The machine was killed, and its next life has begun and steps.
killed_and_anew(Sap, Monitor, First, Link) ->
    receive
        {'DOWN', Monitor, process, Sap, Why} -> ?assertEqual(killed, Why)
    end,
    ?assertMatch({_, N} when N =:= First + 1, sap()),
    ?assertEqual(0, took(again, Link)),
    ok.

%% One that is at rest is left alone, however often it is looked at.
resting_machine_is_left_alone_test() ->
    with_link(1, fun(Link, _Times) ->
        {Sap, _} = sap(),
        _ = [Link ! watch || _ <- lists:seq(1, 3)],
        ?assertEqual(0, took(here, Link)),
        ?assert(is_process_alive(Sap)),
        ok
    end).

%% It looks every five seconds.
it_watches_every_five_seconds_test() ->
    with_link(1, fun(Link, _Times) ->
        Watch = fun() ->
            receive
                {watch_in, Ms} -> Ms
            end
        end,
        ?assertEqual(5000, Watch()),
        Link ! watch,
        ?assertEqual(5000, Watch()),
        ok
    end).

%% A machine that is killed by hand starts anew; of one that is not there nothing becomes.
kill_test() ->
    with_link(1, fun(Link, _Times) ->
        {Sap, First} = sap(),
        Monitor = monitor(process, Sap),
        ok = starl_live_link:kill(Link, nobody),
        ok = starl_live_link:kill(Link, sap),
        killed_and_anew(Sap, Monitor, First, Link)
    end).

%% An application may take its time, but of one step that takes very long the log has one line, with its
%% place; a step after that has its time anew.
long_step_is_told_once_test() ->
    with_link(1, fun(Link, _Times) ->
        Watches = fun(N) ->
            logged(fun() ->
                _ = [Link ! watch || _ <- lists:seq(1, N)],
                starl_live_link:metrics(Link)
            end)
        end,
        Seconds = fun() ->
            {Gauges, _} = starl_live_link:metrics(Link),
            [N] = [N || {step_seconds, [], N} <- Gauges],
            N
        end,
        App = app_hangs(Link),
        ?assertEqual(0, Seconds()),
        ?assertEqual([], Watches(2)),
        ?assertEqual(5, Seconds()),
        [Line] = Watches(8),
        ?assertEqual(45, Seconds()),
        ?assertMatch(
            {match, _},
            re:run(
                Line,
                "^in one step for 10 s at starl_live_link_ct.erl:[0-9]+; an endless loop\\?$"
            )
        ),
        App ! go_on,
        App = app_hangs(Link),
        ?assertEqual([], Watches(2)),
        ?assertMatch([_], Watches(1)),
        ?assert(is_process_alive(App)),
        App ! go_on,
        ok
    end).

%% A node's log has one line for a crash, and none of OTP's reports of the same.
crash_is_told_once_test() ->
    with_link(1, fun(Link, _Times) ->
        receive
            {starts, app, _, _} -> ok
        end,
        Handler = #{
            config => #{robot => 1, sink => self()},
            formatter => {logger_formatter, #{single_line => true, template => [msg]}},
            filter_default => log,
            filters => [{again, {fun starl_live_log:again/2, []}}]
        },
        while_logging(starl_live_log, Handler, fun() ->
            Link ! {starl_located, self(), {app, crash}, []},
            receive
                {starts, app, _, _} -> starl_live_link:metrics(Link)
            end
        end),
        [Line] = node_lines(),
        ?assertMatch({match, _}, re:run(Line, "^app crashed: planted at starl_live_link_ct:")),
        ok
    end).

%% -- its log ----------------------------------------------------------------------------------------

node_lines() ->
    receive
        {starl_log, 1, error, Line} -> [Line | node_lines()]
    after 0 -> []
    end.

%% The errors that are logged meanwhile, in words.
logged(Fun) ->
    while_logging(?MODULE, #{config => #{test => self()}}, Fun),
    lines().

while_logging(Module, Handler, Fun) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, error),
    ok = logger:add_handler(?MODULE, Module, Handler),
    _ = Fun(),
    ok = logger:remove_handler(?MODULE),
    ok = logger:set_primary_config(level, Level).

lines() ->
    receive
        {logged, Line} -> [Line | lines()]
    after 0 -> []
    end.

log(#{msg := {report, Report}, meta := #{report_cb := Words}}, #{config := #{test := Test}}) ->
    {Format, Terms} = Words(Report),
    Test ! {logged, unicode:characters_to_binary(io_lib:format(Format, Terms))};
log(_Event, _Config) ->
    ok.
