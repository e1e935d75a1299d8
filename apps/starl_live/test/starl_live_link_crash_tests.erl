%% What the link of a live robot makes of the ends of its machines, of what was late, and of new code: who
%% starts anew, what is told and logged, and when the link ends.
-module(starl_live_link_crash_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_live_robot_ct, [
    with_robot/2, dir/0, boots/1, tells/3, does/3, hangs/2, next/1, heard/1
]).

%% -- a machine that ends -------------------------------------------------------------------------------

%% Whatever ends a machine, it starts anew, and the others learn of it. A crash by itself has a cause, which
%% is told and logged; an end from outside has none.
a_machine_starts_anew_test_() -> {timeout, 60, fun a_machine_starts_anew/0}.

a_machine_starts_anew() ->
    [
        with_robot(#{sink => self()}, fun(Link, _Time) ->
            Reports = starl_live_log_ct:reports(fun() ->
                ok = End(Name, Link),
                restarted(Name, 2, Link)
            end),
            ?assertEqual({info, {restarted, Name}}, next(Other)),
            Logged = [
                starl_live_log_ct:words(Report)
             || {error, #{what := crashed, machine := M}, _} = Report <- Reports, M =:= Name
            ],
            ?assertEqual({How, Name, Logs}, {How, Name, length(Logged)}),
            [
                ?assertMatch({match, _}, re:run(L, ["^", atom_to_list(Name), " crashed: "]))
             || L <- Logged
            ],
            Facts = facts(Link),
            ?assertEqual([crashed], [What || {_, 1, M, What} <- Facts, M =:= Name]),
            ?assertEqual(Logs, length([M || {_, 1, supervisor, {crashed, M, _}} <- Facts])),
            ok
        end)
     || {How, Logs, End} <- [
            {killed, 0, fun(Name, Link) -> starl_live_link:kill(Link, Name) end},
            {crashes, 1, fun(Name, Link) -> tells(Name, crash, Link) end},
            {full, 0, fun stores_in_vain/2}
        ],
        {Name, Other} <- [{sap, app}, {app, sap}]
    ].

%% A directory has the name of its new file.
stores_in_vain(Name, Link) ->
    ok = file:make_dir(filename:join(dir(), atom_to_list(Name) ++ ".kept.new")),
    does(Name, [{store, kept}, {trace, too_late}], Link).

%% The machine has started this often, and answers.
restarted(Name, Times, Link) ->
    {Pid, N} = boots(Name),
    ?assertEqual({Name, Times}, {Name, N}),
    ok = tells(Name, {news, Times}, Link),
    ?assertEqual({info, {located, {news, Times}, []}}, next_but(restarted, Name)),
    Pid.

next_but(What, Name) ->
    case next(Name) of
        {info, {What, _}} -> next_but(What, Name);
        Event -> Event
    end.

%% All facts that the sink was told so far.
facts(Link) ->
    _ = starl_live_link:metrics(Link),
    [Fact || {starl_traced, 1, _, {_, _, Facts}} <- heard(starl_traced), Fact <- Facts].

%% A machine at work is not disturbed by the end of another one: that starts anew when it is done.
an_end_waits_for_who_is_at_work_test() ->
    with_robot(#{}, fun(Link, _Time) ->
        Sap = hangs(sap, Link),
        ok = starl_live_link:kill(Link, app),
        ok = tells(sap, news, Link),
        _ = starl_live_link:metrics(Link),
        _ = starl_live_link:metrics(Link),
        ?assertEqual([], heard(took)),
        Sap ! {go_on, []},
        _ = restarted(app, 2, Link),
        %% before what waits
        ?assertEqual({info, {restarted, app}}, next(sap)),
        ?assertEqual({info, {located, news, []}}, next(sap)),
        ok
    end).

%% The link waits for an application that has ended while it computed no more: its orders are forgotten.
an_application_that_ends_at_work_starts_anew_test() ->
    with_robot(#{}, fun(Link, _Time) ->
        _ = hangs(app, Link),
        ok = tells(app, forgotten, Link),
        ok = starl_live_link:kill(Link, app),
        _ = restarted(app, 2, Link),
        {Gauges, _} = starl_live_link:metrics(Link),
        ?assertEqual([0], [N || {queue_application, [], N} <- Gauges]),
        ok
    end).

%% What it has answered before its end does not take place when the robot is quiet again.
an_answer_of_who_has_ended_is_void_test() ->
    with_robot(#{sink => self()}, fun(Link, _Time) ->
        App = hangs(app, Link),
        Sap = hangs(sap, Link),
        App ! {go_on, [{trace, in_vain}]},
        ok = counts({queue_events, [], 1}, Link),
        ok = starl_live_link:kill(Link, app),
        ok = counts({starts, [{machine, app}], 2}, Link),
        Sap ! {go_on, []},
        _ = restarted(app, 2, Link),
        ok = tells(sap, news, Link),
        ?assertEqual({info, {located, news, []}}, next_but(restarted, sap)),
        ?assertEqual([], [What || {_, 1, app, in_vain = What} <- facts(Link)]),
        ok
    end).

%% The link has come so far: it is asked until it tells so.
counts(Gauge, Link) ->
    {Gauges, _} = starl_live_link:metrics(Link),
    case lists:member(Gauge, Gauges) of
        true -> ok;
        false -> counts(Gauge, Link)
    end.

%% A simulation that holds the link's state learns of its processes, and which of them are at work.
who_is_at_work_test() ->
    with_robot(#{}, fun(Link, _Time) ->
        At = fun() ->
            State = sys:get_state(Link),
            {starl_live_link:at_work(State), lists:sort(starl_live_link:processes(State))}
        end,
        {[], [_, _]} = At(),
        Sap = hangs(sap, Link),
        ?assertMatch({[Sap], [_, _]}, At()),
        Sap ! {go_on, []},
        App = hangs(app, Link),
        ?assertEqual({[App], lists:sort([App, Sap])}, At()),
        _ = hangs(sap, Link),
        ?assertEqual({[Sap, App], lists:sort([App, Sap])}, At()),
        _ = [Pid ! {go_on, []} || Pid <- [Sap, App]],
        ok
    end).

%% An application that crashes again and again is given up: the robot goes on without it, and its sink learns
%% of it.
an_application_is_given_up_test_() -> {timeout, 60, fun an_application_is_given_up/0}.

an_application_is_given_up() ->
    with_robot(#{sink => self(), tree => tree(#{intensity => 1})}, fun(Link, _Time) ->
        ok = tells(app, crash, Link),
        _ = restarted(app, 2, Link),
        ok = tells(app, crash, Link),
        ?assertEqual({info, {given_up, app}}, next_but(restarted, sap)),
        receive
            {starl_ended, 1, Link, How} -> ?assertEqual(given_up, How)
        end,
        ok = starl_live_link:kill(Link, app),
        ok = tells(app, nobody_hears_it, Link),
        ok = tells(sap, news, Link),
        ?assertEqual({info, {located, news, []}}, next(sap)),
        Facts = facts(Link),
        ?assertEqual([app], [Name || {_, 1, supervisor, {given_up, Name}} <- Facts]),
        ?assertEqual([app], [Name || {_, 1, app, {unknown_machine, Name}} <- Facts]),
        ok
    end).

tree(Given) ->
    maps:merge(
        #{
            participants => starl_team:new([1, 2]),
            services => [{sap, starl_live_robot_ct, #{}}],
            blocks => [],
            app => {machine, starl_live_robot_ct, #{}}
        },
        Given
    ).

%% -- the end of the link -------------------------------------------------------------------------------

%% It ends with its services, when they crash too often or their supervisors end, and when a start cannot be
%% counted; what was known until then has left.
it_ends_with_its_services_test_() -> {timeout, 60, fun it_ends_with_its_services/0}.

it_ends_with_its_services() ->
    [
        with_robot(#{sink => self(), tree => tree(#{intensity => 1})}, fun(Link, _Time) ->
            Monitor = monitor(process, Link),
            ok = End(Link),
            receive
                {'DOWN', Monitor, process, Link, Why} ->
                    ?assertEqual({How, {shutdown, gave_up}}, {How, Why})
            end,
            Facts = [
                F
             || {starl_traced, 1, L, {_, _, Some}} <- heard(starl_traced), L =:= Link, F <- Some
            ],
            ?assertEqual({How, Crashes}, {How, length([sap || {_, 1, sap, crashed} <- Facts])}),
            ok
        end)
     || {How, Crashes, End} <- [
            {too_often, 2, fun crashes_too_often/1},
            {no_supervisor, 0, fun(Link) -> without_supervisor(machines_sup(Link), Link) end},
            {not_counted, 1, fun(Link) ->
                uncounted(Link, fun() -> starl_live_link:kill(Link, sap) end)
            end},
            {not_counted_full, 1, fun(Link) ->
                uncounted(Link, fun() -> stores_in_vain(sap, Link) end)
            end},
            {too_often_full, 2, fun full_too_often/1}
        ]
    ].

crashes_too_often(Link) ->
    ok = starl_live_link:kill(Link, sap),
    _ = restarted(sap, 2, Link),
    starl_live_link:kill(Link, sap).

full_too_often(Link) ->
    ok = stores_in_vain(sap, Link),
    _ = restarted(sap, 2, Link),
    does(sap, [{store, kept}], Link).

%% The news of its end come alone.
without_supervisor(Sup, Link) ->
    Link ! {'DOWN', make_ref(), process, Sup, killed},
    ok.

machines_sup(Link) ->
    {dictionary, Kept} = process_info(Link, dictionary),
    {_, [Robot | _]} = lists:keyfind('$ancestors', 1, Kept),
    {machines, Sup, _, _} = lists:keyfind(machines, 1, supervisor:which_children(Robot)),
    Sup.

uncounted(_Link, End) ->
    ok = file:make_dir(filename:join(dir(), "starts-b.new")),
    End().

%% -- a successor that comes first ----------------------------------------------------------------------

%% The end of its predecessor is handled before it boots. Here the test is the first successor, whose end
%% makes room for that of the supervisor.
a_successor_waits_for_the_end_of_its_predecessor_test() ->
    with_robot(#{}, fun(Link, _Time) ->
        Sap = hangs(sap, Link),
        Sap ! {go_on, []},
        Services = proplists:get_value(services, starl_robot_sup:parts(machines_sup(Link))),
        ok = sys:suspend(Services),
        Test = self(),
        Link ! {starl_attach, 1, sap, spawn_link(fun() -> Test ! {boots_too, booted()} end)},
        true = exit(Sap, kill),
        receive
            {boots_too, #{incarnation := 2}} -> ok
        end,
        ok = sys:resume(Services),
        _ = restarted(sap, 3, Link),
        %% of a machine that there is not nothing becomes
        Link ! {starl_attach, 1, mutex, self()},
        ok = tells(sap, news, Link),
        ?assertEqual({info, {located, news, []}}, next_but(restarted, sap)),
        ok
    end).

booted() ->
    receive
        {starl_boot, Base} -> Base
    end.

%% -- what is late --------------------------------------------------------------------------------------

%% The radio tells that a packet was late: its machine learns of it at once, or when the robot is quiet,
%% before all that waits.
a_late_packet_is_told_to_its_machine_test() ->
    with_robot(#{}, fun(Link, _Time) ->
        Link ! {starl_late, {sap, mark}},
        ?assertEqual({info, {late, mark}}, next(sap)),
        Sap = hangs(sap, Link),
        ok = tells(sap, news, Link),
        Link ! {starl_late, {sap, again}},
        _ = starl_live_link:metrics(Link),
        Sap ! {go_on, []},
        ?assertEqual({info, {late, again}}, next(sap)),
        ?assertEqual({info, {located, news, []}}, next(sap)),
        ok
    end).

%% The log has a warning, in words, of a computer that was late; each time one.
a_late_computer_is_logged_test() ->
    with_robot(#{}, fun(Link, Time) ->
        ok = does(sap, [{{timeout, wake}, 10_000, ring}], Link),
        Timer =
            receive
                {timer, 10, Planned} -> Planned
            end,
        Reports = starl_live_log_ct:reports(fun() ->
            ok = atomics:put(Time, 1, 210_001),
            Link ! {timeout, make_ref(), Timer},
            ?assertEqual({{timeout, wake}, ring}, next(sap)),
            ok = tells(sap, news, Link),
            ?assertEqual({info, {located, news, []}}, next(sap))
        end),
        [{Level, Report, _} = Late] = Reports,
        ?assertMatch({warning, #{what := late, machine := robot}}, {Level, Report}),
        ?assertEqual(
            "its computer was late by more than 200 ms", starl_live_log_ct:words(Late)
        ),
        ok
    end).

%% -- what it does not know -----------------------------------------------------------------------------

%% It leaves alone what is no word to it, and an answer of a process that nobody has asked.
what_it_does_not_know_is_left_alone_test() ->
    with_robot(#{}, fun(Link, _Time) ->
        Sap = hangs(sap, Link),
        Link ! {starl_done, 1, self(), [{actuate, pen, down}]},
        Link ! {'DOWN', make_ref(), process, self(), gone},
        ok = gen_server:cast(Link, unknown),
        Sap ! {go_on, [{actuate, pen, up}]},
        receive
            {'$gen_cast', Cast} -> ?assertEqual({actuate, pen, up, none}, Cast)
        end,
        ok
    end).
