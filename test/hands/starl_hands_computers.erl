%% Three robots on computers of their own (starl_namespaces), by UDP, one of which is killed while they
%% elect. The facts that they wrote to their disks are judged.
-module(starl_hands_computers).

-export([allowed/0, election/2]).
%% called on the computers
-export([open/1, await/1]).

-define(NETWORK, "10.78.0.").
-define(PORT, 4711).
-define(ROBOTS, [1, 2, 3]).
-define(CALL_MS, 300000).

allowed() -> starl_namespaces:allowed([], "apt install iproute2").

%% Robot 3 has the ballot of robot 1, but does not hear it any more: its radio is one-sided. It does not
%% hear robot 2 either. When robot 1 has elected, the node of robot 2 is killed; it is started anew with
%% its store, and robot 3 hears it. Answers what is wrong: the leaders of robots 1 and 3, if they
%% differ, and the violations.
election(Seed, Dir) ->
    Tag = "starl-elect-" ++ os:getpid(),
    ok = starl_namespaces:up(Tag, ?NETWORK, ?ROBOTS),
    try
        [ok = hears(Tag, From, To) || From <- ?ROBOTS, To <- ?ROBOTS, From =/= To],
        elected(Tag, Seed, Dir)
    after
        starl_namespaces:down(Tag, ?ROBOTS)
    end.

elected(Tag, Seed, Dir) ->
    Key = starl_live_key:new(),
    Start = fun(N) -> started(Tag, spec(N, Seed, Key, Dir)) end,
    {One, Three} = {Start(1), Start(3)},
    ok = peer:call(Three, ?MODULE, await, [{delivered, 1}], ?CALL_MS),
    ok = starl_namespaces:deafen(Tag, ?NETWORK, 1, 3),
    ok = starl_namespaces:deafen(Tag, ?NETWORK, 2, 3),
    Two = Start(2),
    ok = peer:call(One, ?MODULE, await, [elected], ?CALL_MS),
    ok = killed(Two),
    ok = hears(Tag, 2, 3),
    _ = Start(2),
    ok = peer:call(Three, ?MODULE, await, [elected], ?CALL_MS),
    judged(lists:sort(lists:append([facts(N, Dir) || N <- ?ROBOTS]))).

hears(Tag, From, To) -> starl_namespaces:hears(Tag, ?NETWORK, From, To).

killed(Computer) ->
    Monitor = erlang:monitor(process, Computer),
    _ = os:cmd("kill -KILL " ++ peer:call(Computer, os, getpid, [])),
    receive
        {'DOWN', Monitor, _, _, _} -> ok
    end.

judged(Facts) ->
    Leaders = [{R, Leader} || {_, R, election, {elected, _, Leader, _}} <- Facts, R =/= 2],
    Apart = [{apart, Leaders} || length(lists:usort([Leader || {_, Leader} <- Leaders])) > 1],
    Apart ++ [lists:flatten(starl_violation:format(V)) || V <- violations(Facts)].

violations(Facts) ->
    Monitors = [{starl_election_monitor, #{robots => ?ROBOTS, bound_us => 1000000 * ?CALL_MS}}],
    {End, _, _, _} = lists:last(Facts),
    Election = [Fact || {_, _, election, _} = Fact <- Facts],
    Judge = fun(Fact, {Found, Monitor}) ->
        case starl_monitor:step(Fact, Monitor) of
            {ok, Next} -> {Found, Next};
            {violation, Violation, Next} -> {[Violation | Found], Next}
        end
    end,
    {Found, Monitor} = lists:foldl(Judge, {[], starl_monitor:new(Monitors)}, Election),
    {Last, _} = starl_monitor:finish(End, Monitor),
    lists:reverse(Found) ++ Last.

facts(N, Dir) ->
    lists:append([starl_live_record:read(F, 0) || F <- starl_live_record:starts(dir(N, Dir))]).

dir(N, Dir) -> filename:join(Dir, "robot-" ++ integer_to_list(N)).

%% -- on the computers -----------------------------------------------------------------------

started(Tag, #{robot := N} = Spec) ->
    Own = [Dir || Dir <- code:get_path(), not lists:prefix(code:lib_dir(), Dir)],
    Paths = lists:append([["-pa", filename:absname(D)] || D <- Own, filelib:is_dir(D)]),
    In = ["netns", "exec", starl_namespaces:name(Tag, N), os:find_executable("erl")],
    {ok, Computer, _} = peer:start(#{
        exec => {starl_namespaces:tool("ip"), In},
        connection => standard_io,
        shutdown => close,
        wait_boot => 60000,
        args => ["-nocookie", "-kernel", "logger_level", "none" | Paths]
    }),
    ok = peer:call(Computer, ?MODULE, open, [Spec], ?CALL_MS),
    Computer.

spec(N, Seed, Key, Dir) ->
    {ok, {_, _, Plan}} = starl_run:plan(#{app => starl_hands_app, robots => 3, seed => Seed}, #{}),
    #{tree := Tree, world := #{profiles := Profiles}} = Plan,
    ok = starl_live_store:commission(dir(N, Dir)),
    #{
        robot => N,
        team_seed => Seed,
        tree => Tree,
        profile => starl_chassis:of_robot(N, Profiles),
        clock => starl_live_clock:new(0, 1),
        dir => dir(N, Dir),
        record => true,
        positioning => {starl_fleet_no_positioning, #{}},
        chassis => {starl_fleet_no_chassis, #{}},
        transport =>
            {starl_live_udp, #{
                fleet => "computers",
                run => 1,
                key => Key,
                all => each,
                peers => maps:from_list([{R, {{10, 78, 0, R}, ?PORT}} || R <- ?ROBOTS])
            }}
    }.

%% The facts go to a process with a name, which remembers them.
open(Spec) ->
    Witness = spawn(fun() -> witness([], []) end),
    true = register(?MODULE, Witness),
    Modules = [M || App <- [starl_platform, starl_blocks, starl_live], M <- modules(App)],
    ok = code:ensure_modules_loaded(Modules),
    {ok, _} = application:ensure_all_started(starl_live, permanent),
    {ok, _} = starl_live_sup:open(Spec#{sink => Witness}),
    ok.

modules(App) ->
    _ = application:load(App),
    {ok, Modules} = application:get_key(App, modules),
    Modules.

%% Waits for a fact.
await(What) ->
    ?MODULE ! {await, What, self()},
    receive
        {?MODULE, What} -> ok
    end.

witness(Facts, Waiting) ->
    receive
        {starl_traced, _, _, {_, _, Events}} ->
            answered(Events ++ Facts, Waiting);
        {await, What, From} ->
            answered(Facts, [{What, From} | Waiting]);
        _ ->
            witness(Facts, Waiting)
    end.

answered(Facts, Waiting) ->
    {Seen, Left} = lists:partition(
        fun({What, _}) -> lists:any(fun(Fact) -> is_fact(What, Fact) end, Facts) end, Waiting
    ),
    _ = [From ! {?MODULE, What} || {What, From} <- Seen],
    witness(Facts, Left).

is_fact(elected, {_, _, election, {elected, _, _, _}}) -> true;
is_fact({delivered, From}, {_, _, sap, {delivered, {From, _, _}, ballot, _}}) -> true;
is_fact(_, _) -> false.
