%% How the link of a live robot starts: its store, its record, its ports and senses in their order, each with
%% what it has to know; and what becomes of it when one of them does not open. This module is the driver of
%% all ports.
-module(starl_live_link_start_tests).
-include_lib("eunit/include/eunit.hrl").

-export([init/1]).
-export([open/1, hear/2, close/1, figures/1, transmit/3, drive/4, actuate/4, stop/1, condition/1]).

-import(starl_live_robot_ct, [with_dir/1, with_robot/2, spec/2, boots/1, ends/1, heard/1]).

-define(PORTS, [transport, positioning, chassis]).

%% -- a driver that tells the test -----------------------------------------------------------------------

open(#{kind := Kind, test := Test} = Config) ->
    Test ! {opens, Kind, Config},
    case Config of
        #{fails := Why} -> {error, Why};
        #{} -> {ok, {Kind, Test}}
    end.

hear({reading, Reading}, State) -> {reading, Reading, State};
hear(_Message, _State) -> unknown.

close({Kind, Test}) ->
    Test ! {closes, Kind},
    ok.

figures({Kind, _Test}) -> #{Kind => 1}.
transmit(_To, _Packet, State) -> {ok, State}.
drive(_Script, _Until, _Mark, State) -> {[], State}.
actuate(_Device, _Value, _Mark, State) -> {[], State}.
stop(State) -> State.
condition({Kind, _Test}) -> #{Kind => 1}.

driver(Kind, Given) -> {?MODULE, Given#{kind => Kind, test => self()}}.

drivers(Given) ->
    maps:from_list([{Line, driver(Line, maps:get(Line, Given, #{}))} || Line <- ?PORTS]).

opened() ->
    receive
        {opens, Kind, Config} -> {Kind, Config}
    end.

%% -- a link alone: under a supervisor without children -------------------------------------------------

init(none) -> {ok, {#{}, []}}.

alone(Spec) ->
    {ok, Sup} = supervisor:start_link(?MODULE, none),
    {Sup, starl_live_link:start_link(Spec#{robot_sup => Sup})}.

%% The reason for which it does not start.
fails(Given) ->
    with_dir(fun(Dir) ->
        {_Time, Spec} = spec(Dir, Given),
        {Sup, {error, Why}} = alone(Spec),
        shutdown = ends(Sup),
        {Why, [Kind || {opens, Kind, _} <- heard(opens)]}
    end).

%% -- ports ---------------------------------------------------------------------------------------------

%% In their order, each with its own configuration and what all have to know; each is the process of its kind.
%% The first test loads the code, on a busy machine for seconds.
ports_open_in_their_order_test_() -> {timeout, 60, fun ports_open_in_their_order/0}.

ports_open_in_their_order() ->
    Given = (drivers(#{chassis => #{port => 7}}))#{profile => #{radius_mm => 170}},
    with_dir(fun(Dir) ->
        {_Time, #{clock := Clock} = Spec} = spec(Dir, Given),
        {ok, Robot} = starl_live_robot:start_link(Spec),
        Known = #{
            test => self(),
            robot => 1,
            participants => starl_team:new([1, 2]),
            clock => Clock,
            profile => #{radius_mm => 170}
        },
        ?assertEqual({transport, Known#{kind => transport, tell => none}}, opened()),
        ?assertEqual({positioning, Known#{kind => positioning}}, opened()),
        ?assertEqual({chassis, Known#{kind => chassis, port => 7}}, opened()),
        _ = boots(app),
        Link = starl_live_robot:link(Robot),
        [Radio, Eyes, Wheels] = [starl_live_link:port(Link, Line) || Line <- ?PORTS],
        ?assertMatch(#{transport := 1}, starl_live_transport:figures(Radio)),
        ?assertMatch(#{positioning := 1}, starl_live_positioning:figures(Eyes)),
        ?assertEqual(#{chassis => 1}, starl_live_chassis:condition(Wheels)),
        %% they end with the robot
        shutdown = ends(Robot),
        Closes = fun() ->
            receive
                {closes, Kind} -> Kind
            end
        end,
        ?assertEqual(lists:sort(?PORTS), lists:sort([Closes() || _ <- ?PORTS]))
    end).

%% The record is open before them.
ports_open_with_a_record_test_() -> {timeout, 60, fun ports_open_with_a_record/0}.

ports_open_with_a_record() ->
    with_dir(fun(Dir) ->
        {_Time, Spec} = spec(Dir, (drivers(#{}))#{record => true}),
        {Sup, {ok, Link}} = alone(Spec),
        ?assertEqual(?PORTS, [Kind || {Kind, _} <- [opened(), opened(), opened()]]),
        ?assertEqual(1, length(starl_live_record:starts(Dir))),
        _ = [ends(Pid) || Pid <- [Link, Sup]]
    end).

%% One that does not open is the last.
a_line_that_does_not_open_ends_it_test_() ->
    [
        {timeout, 60,
            ?_assertEqual(
                {{shutdown, {Line, <<"no such line">>}}, Opened},
                fails(drivers(#{Line => #{fails => ["no such ", "line"]}}))
            )}
     || {Line, Opened} <- [
            {transport, [transport]},
            {positioning, [transport, positioning]},
            {chassis, [transport, positioning, chassis]}
        ]
    ].

%% The radio tells of its packets who wants to know: the sink if it asks for packets, and the observer.
the_radio_tells_of_packets_who_asks_test_() ->
    {timeout, 60, fun the_radio_tells_of_packets_who_asks/0}.

the_radio_tells_of_packets_who_asks() ->
    Sunk = {starl_radio, 1, []},
    Observed = {observed, {judged, [], []}},
    [
        ?assertEqual({Given, Told}, {Given, told_by_radio(Given)})
     || {Told, Given} <- [
            {none, #{}},
            {none, #{packets => true}},
            {none, #{sink => self()}},
            {none, #{sink => self(), packets => false}},
            {[Sunk], #{sink => self(), packets => true}},
            {[Observed], #{observe => fun observe/1}},
            {[Observed], #{observe => fun observe/1, sink => self()}},
            {[Sunk, Observed], #{observe => fun observe/1, sink => self(), packets => true}}
        ]
    ].

observe(News) ->
    starl_live_robot_ct ! {observed, News},
    ok.

told_by_radio(Given) ->
    with_dir(fun(Dir) ->
        {_Time, Spec} = spec(Dir, Given#{transport => driver(transport, #{})}),
        {Sup, {ok, Link}} = alone(Spec),
        {transport, #{tell := Tell}} = opened(),
        Told = is_function(Tell) andalso radio_tells(Tell),
        _ = [ends(Pid) || Pid <- [Link, Sup]],
        case Told of
            false -> Tell;
            _ -> Told
        end
    end).

radio_tells(Tell) ->
    _ = heard(observed),
    ok = Tell([]),
    heard(starl_radio) ++ heard(observed).

%% -- senses --------------------------------------------------------------------------------------------

%% Each is asked for what is its own; what none of them tells is asked of the chassis.
senses_open_and_are_asked_test() ->
    Given = #{senses => #{bearing => driver(bearing, #{port => 8}), range => driver(range, #{})}},
    with_robot(Given, fun(Link, _Time) ->
        {bearing, Bearing} = opened(),
        {range, Range} = opened(),
        #{clock := Clock} = Range,
        Known = #{test => self(), robot => 1, clock => Clock},
        ?assertEqual(Known#{kind => bearing, port => 8}, Bearing),
        ?assertEqual(Known#{kind => range}, Range),
        Feels = [{feel, Kind, Kind} || Kind <- [bearing, range, bump]],
        ok = starl_live_robot_ct:does(app, Feels, Link),
        ?assertEqual({info, {felt, bearing, none}}, starl_live_robot_ct:next(app)),
        ?assertEqual({info, {felt, range, none}}, starl_live_robot_ct:next(app)),
        receive
            {'$gen_cast', Cast} -> ?assertEqual({feel, bump, {app, bump, bump}}, Cast)
        end,
        ok
    end).

a_sense_that_does_not_open_ends_it_test() ->
    Bad = driver(range, #{fails => ["no such ", "sense"]}),
    ?assertEqual(
        {{shutdown, {sense, <<"no such sense">>}}, [bearing, range]},
        fails(#{senses => #{bearing => driver(bearing, #{}), range => Bad}})
    ).

%% -- the store and the record --------------------------------------------------------------------------

%% The reason is a line with the place.
without_a_store_it_does_not_start_test() ->
    with_dir(fun(Dir) ->
        ok = file:write_file(Dir, "no directory"),
        {_Time, Spec} = spec(Dir, drivers(#{})),
        {Sup, {error, {shutdown, {store, Line}}}} = alone(Spec),
        ?assertEqual(unicode:characters_to_binary([Dir, ": file already exists"]), Line),
        ?assertEqual([], heard(opens)),
        ends(Sup),
        ok = file:delete(Dir)
    end).

without_a_record_it_does_not_start_test() ->
    with_dir(fun(Dir) ->
        ok = starl_live_store:commission(Dir),
        Longest = "facts-" ++ lists:duplicate(249, $9),
        ok = file:write_file(filename:join(Dir, Longest), ""),
        {_Time, Spec} = spec(Dir, (drivers(#{}))#{record => true}),
        {Sup, {error, {shutdown, {record, Line}}}} = alone(Spec),
        ?assertMatch({match, _}, re:run(Line, "/facts-10*: file name too long$")),
        ?assertEqual([], heard(opens)),
        ends(Sup)
    end).

%% The facts of a robot that keeps a record are in it, and its ports are open.
a_robot_with_a_record_starts_test() ->
    Given = (drivers(#{}))#{record => true, sink => self(), positioning => self()},
    with_robot(Given, fun(Link, _Time) ->
        ?assertEqual([transport, chassis], [Kind || {opens, Kind, _} <- heard(opens)]),
        ok = starl_live_robot_ct:does(app, [{trace, here}], Link),
        [{starl_started, 1, Link, {[sap, app], File}}] = heard(starl_started),
        %% its next word comes when this step has been told
        ok = starl_live_robot_ct:tells(app, next, Link),
        ?assertEqual({info, {located, next, []}}, starl_live_robot_ct:next(app)),
        ?assertEqual(
            [here], [Fact || {_, 1, app, Fact} <- starl_live_record:read(File, 0)]
        ),
        ok
    end).

%% A robot whose starts cannot be counted does not run: its number of this life would come again.
starts_that_cannot_be_counted_end_it_test() ->
    with_dir(fun(Dir) ->
        ok = starl_live_store:commission(Dir),
        ok = file:make_dir(filename:join(Dir, "starts-a.new")),
        {_Time, Spec} = spec(Dir, #{sink => self()}),
        {Sup, {ok, Link}} = alone(Spec),
        receive
            {'EXIT', Link, Why} ->
                Line = unicode:characters_to_binary([Dir, ": illegal operation on a directory"]),
                ?assertEqual({shutdown, {store, Line}}, Why)
        end,
        ?assertEqual([], heard(starl_started)),
        ends(Sup)
    end).

%% -- its machines --------------------------------------------------------------------------------------

%% The positioning process itself finds a source that is stuck: the location service must not take a pose that
%% repeats itself for one. Other services and the application have their own configuration alone.
location_is_told_that_its_source_is_exact_test() ->
    Module = starl_live_robot_ct,
    Tree = #{
        participants => starl_team:new([1, 2]),
        services => [{sap, Module, #{own => 1}}, {location, Module, #{own => 2}}],
        blocks => [{mutex, Module, #{own => 3}}],
        app => {machine, Module, #{own => 4}}
    },
    with_dir(fun(Dir) ->
        {_Time, Spec} = spec(Dir, #{tree => Tree}),
        {Sup, {ok, Link}} = alone(Spec),
        Own = fun(Name) ->
            receive
                {boots, Name, _, _, Config} -> maps:with([own, exact], Config)
            end
        end,
        ?assertEqual(
            [#{own => 1}, #{own => 2, exact => true}, #{own => 3}, #{own => 4}],
            [Own(Name) || Name <- [sap, location, mutex, app]]
        ),
        _ = [ends(Pid) || Pid <- [Link, Sup]]
    end).

%% What it logs bears its robot and its domain.
its_reports_bear_its_robot_test() ->
    with_robot(#{}, fun(Link, _Time) ->
        Reports = starl_live_log_ct:reports(fun() ->
            ok = starl_live_robot_ct:tells(app, crash, Link),
            boots(app)
        end),
        [Meta] = [Meta || {error, #{what := crashed}, Meta} <- Reports],
        ?assertMatch(#{domain := [starl, robot], robot := 1, pid := Link}, Meta),
        ok
    end).

%% The observer of the node learns of the start, and whoever asks for counters what is left of leases.
its_start_and_its_leases_are_told_test() ->
    with_robot(#{observe => fun observe/1}, fun(Link, _Time) ->
        ?assertEqual(
            [{started, 0, 1, [sap, app]}],
            [Started || {observed, {started, _, _, _} = Started} <- heard(observed)]
        ),
        ok = starl_live_robot_ct:does(sap, [{trace, {leased, token, 1, 8_000_000}}], Link),
        ok = starl_live_robot_ct:tells(sap, next, Link),
        _ = starl_live_robot_ct:next(sap),
        {Gauges, _Counts} = starl_live_link:metrics(Link),
        ?assertEqual([8.0], [Seconds || {lease_seconds, [{token, token}], Seconds} <- Gauges]),
        ok
    end).

%% A robot may start anew five times in a minute, with all its machines.
a_robot_may_fail_five_times_a_minute_test() ->
    {ok, {Flags, [Link]}} = starl_live_robot:init(#{robot => 1}),
    ?assertEqual(#{strategy => rest_for_one, intensity => 5, period => 60}, Flags),
    Spec = #{robot => 1, robot_sup => self()},
    ?assertEqual(#{id => link, start => {starl_live_link, start_link, [Spec]}}, Link).

%% The link of a robot that its supervisor is about to start anew, or has given up, is none.
a_robot_may_have_no_link_test_() ->
    [
        ?_assertEqual(none, starl_live_robot:link(supervisor_of(Children)))
     || Children <- [
            [{link, restarting, worker, [starl_live_link]}],
            [{link, undefined, worker, [starl_live_link]}],
            []
        ]
    ].

supervisor_of(Children) ->
    spawn_link(fun() ->
        receive
            {'$gen_call', From, which_children} -> gen_server:reply(From, Children)
        end
    end).
