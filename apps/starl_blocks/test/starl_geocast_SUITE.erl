%% The contract of the geocast (README), in the simulator: outside the area during the
%% whole window, never delivered; nothing delivered after the window; at most once; inside during
%% the whole window, delivered over several hops. starl_geocast_monitor is the judge.
-module(starl_geocast_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0]).
-export([
    safety_under_faults/1,
    progress_over_several_hops/1,
    planted_bugs_are_caught/1,
    chain_of_hops/1,
    lifetimes_and_clocks/1,
    slow_packets_are_not_late/1,
    memory_shrinks/1,
    memory_is_bounded/1,
    late_comer_gets_it/1,
    dead_relay_is_gone_around/1,
    not_again_after_a_restart/1,
    not_again_by_a_clock/1,
    not_before_the_clock_is_back/1,
    lives_long_enough/1,
    sent_after_the_restart/1,
    listeners_come_late/1,
    hops_are_limited/1,
    mistakes_of_the_caller/1
]).

all() ->
    [
        safety_under_faults,
        progress_over_several_hops,
        planted_bugs_are_caught,
        chain_of_hops,
        lifetimes_and_clocks,
        slow_packets_are_not_late,
        memory_shrinks,
        memory_is_bounded,
        late_comer_gets_it,
        dead_relay_is_gone_around,
        not_again_after_a_restart,
        not_again_by_a_clock,
        not_before_the_clock_is_back,
        lives_long_enough,
        sent_after_the_restart,
        listeners_come_late,
        hops_are_limited,
        mistakes_of_the_caller
    ].

%% -- properties -----------------------------------------------------------------------------

%% Safety under loss, duplicates, delays, clocks that differ and drift, limited range, robots that
%% drive in and out of areas, crashes of machines and robots.
safety_under_faults(_) ->
    Prop = ?FORALL(
        Case,
        geocasts(),
        starl_platform_ct:safely(fun() -> holds(Case, none) end)
    ),
    starl_platform_ct:property(Prop, 60).

holds(Case, Bug) ->
    #{violations := Violations} = run(Case, Bug),
    Violations =:= [] orelse tell(Violations).

tell(Violations) ->
    ok = starl_platform_ct:tell(Violations),
    false.

%% Progress: every robot inside during the whole window gets the message where packets get
%% through: rows of robots in range of their neighbours, loss up to a fifth, machines that crash.
progress_over_several_hops(_) ->
    Prop = ?FORALL(
        Case,
        rows(),
        starl_platform_ct:safely(fun() -> holds(Case, none) end)
    ),
    starl_platform_ct:property(Prop, 40).

%% The properties find what is planted.
planted_bugs_are_caught(_) ->
    _ = rand:seed(exsss, starl_platform_ct:seed()),
    [
        ?assert(caught(Generator, Bug), Bug)
     || {Generator, Bug} <- [
            {rows(), clocks},
            {geocasts(), holds},
            {geocasts(), trusts},
            {geocasts(), forgets},
            {geocasts(), restart}
        ]
    ].

%% By a violation, not by an exception: that would fail the test case.
caught(Generator, Bug) ->
    caught(Generator, Bug, 300).

caught(_Generator, _Bug, 0) ->
    false;
caught(Generator, Bug, Left) ->
    {ok, Case} = proper_gen:pick(Generator),
    #{violations := Violations} = run(Case, Bug),
    case [What || #{contract := geocast, what := What} <- Violations] of
        [] ->
            caught(Generator, Bug, Left - 1);
        [What | _] ->
            ct:log("~p is caught as ~p in case ~b", [Bug, What, 301 - Left]),
            true
    end.

geocasts() ->
    ?LET(
        {N, Seed, Range},
        {range(3, 8), seed(), oneof([none, 2500, 6000])},
        map([
            {robots, N},
            {seed, Seed},
            {range, Range},
            {loss, oneof([0.0, 0.2, 0.4])},
            {duplicate, oneof([0.0, 0.3])},
            {delay, oneof([{5, 20}, {2, 100}, {40, 40}, {5, 800}])},
            {clock_offset, oneof([0, 1000, 100000])},
            {clock_drift, oneof([0, 50, 9000])},
            {lifetime, oneof([50, 300, 2000, 6000])},
            {speed, oneof([100, 500])},
            {area, area()},
            {drives, boolean()},
            {progress, false},
            {faults,
                list(
                    oneof([
                        {moment(), kill_machine, {range(1, N), geocast}},
                        {moment(), kill_machine, {range(1, N), oneof([sap, location, geocast])}},
                        {moment(), kill_robot, range(1, N)},
                        {moment(), reboot, range(1, N)},
                        {moment(), pause, range(1, N)}
                    ])
                )}
        ])
    ).

rows() ->
    ?LET(
        {N, Seed},
        {range(2, 9), seed()},
        map([
            {robots, N},
            {seed, Seed},
            {range, 2500},
            {loss, oneof([0.0, 0.1, 0.2])},
            {duplicate, oneof([0.0, 0.3])},
            {delay, oneof([{5, 20}, {2, 100}])},
            {clock_offset, 1000},
            {clock_drift, oneof([0, 50, 9000])},
            {lifetime, 8000},
            {speed, 100},
            {area, area()},
            {drives, false},
            {progress, true},
            {faults, list({moment(), kill_machine, {range(1, N), oneof([sap, location, geocast])}})}
        ])
    ).

%% A map with values from these generators.
map(Pairs) -> ?LET(Drawn, Pairs, maps:from_list(Drawn)).

moment() -> oneof([10, 400, 1200, 3000]).

seed() -> noshrink(integer(1, 100000)).

area() ->
    oneof(
        [
            {circle, {float(X), float(Y)}, float(R)}
         || X <- [1000, 4000], Y <- [1000, 2500], R <- [700, 2100, 5000]
        ] ++
            [
                {rectangle, {0.0, 0.0, 4000.0, 2000.0}},
                {polygon, [
                    {0.0, 0.0}, {8000.0, 0.0}, {8000.0, 4000.0}, {4500.0, 500.0}, {0.0, 4000.0}
                ]}
            ]
    ).

%% Each robot sends a message now and then; with `drives' they go to and fro.
run(#{progress := Progress, robots := N, faults := Faults} = Case, Bug) ->
    Config = #{listeners => #{news => app}},
    Monitor = #{
        robots => lists:seq(1, N), progress => Progress, healed_us => 0, delay_us => 0, broken => []
    },
    Around = #{
        blocks => [machine(Bug, Config)],
        monitors => [{starl_geocast_monitor, Monitor}],
        %% four in a row, two metres apart
        poses => maps:from_list([{I, pose(I)} || I <- lists:seq(1, N)])
    },
    Scenario = maps:without([lifetime, area, drives, progress], Case),
    starl_blocks_script_app:play(fun(R) -> script(R, Case) end, Around, Scenario#{
        faults => planned(Faults), time => 30
    }).

machine(none, Config) -> hd(starl_geocast:machines(Config));
machine(Bug, Config) -> {geocast, starl_geocast_bug, Config#{bug => Bug}}.

pose(I) -> {1000.0 + 2000.0 * ((I - 1) rem 4), 1000.0 + 2000.0 * ((I - 1) div 4), 0.0}.

planned(Faults) ->
    [
        {starl_platform_ct:fault_id(f, K), At, At + 700, Kind, Target, #{}}
     || {K, {At, Kind, Target}} <- lists:zip(lists:seq(1, length(Faults)), Faults)
    ].

script(R, #{area := Area, lifetime := Lifetime, drives := Drives}) ->
    Id = starl:id(R),
    ok = starl:sleep(R, 300 * Id),
    _ = starl_geocast:send(R, Area, news, {from, Id}, #{lifetime_ms => Lifetime}),
    {X, Y, _} = pose(Id),
    _ = [starl:go_to(R, {X, Y + Dy}) || Drives, Dy <- [1900.0, 100.0]],
    ok = starl:sleep(R, 700 * Id),
    _ = starl_geocast:send(R, Area, news, {again, Id}, #{lifetime_ms => Lifetime}),
    starl:sleep(R, Lifetime + 12000).

%% -- pitfalls -------------------------------------------------------------------------------

%% Eight robots in a line, each in range of its neighbours only: the last one hears from the first.
chain_of_hops(_) ->
    {Results, _} = line(
        8,
        fun(R) ->
            ok = starl_geocast:listen(R, news),
            case starl:id(R) of
                1 -> ok = starl_geocast:send(R, everywhere(), news, hello, #{lifetime_ms => 8000});
                _ -> ok
            end,
            starl:await(R, news, 8000)
        end,
        #{loss => 0.2}
    ),
    ?assertEqual(lists:duplicate(8, {done, {ok, 1, hello}}), Results).

%% Clocks that lie minutes apart neither end a lifetime early nor prolong it.
lifetimes_and_clocks(_) ->
    {Results, Trace} = line(
        4,
        fun(R) ->
            ok = starl_geocast:listen(R, news),
            ok = starl:sleep(R, 1000),
            case starl:id(R) of
                2 -> ok = starl_geocast:send(R, everywhere(), news, hello, #{lifetime_ms => 1000});
                _ -> ok
            end,
            {starl:await(R, news, 4000), starl:await(R, news, 60000)}
        end,
        #{clock_offset => 600000}
    ),
    ?assertEqual(lists:duplicate(4, {done, {{ok, 2, hello}, timeout}}), Results),
    [Sent] = [T || {T, _, geocast, {sent, _, _, _, _}} <- Trace],
    [?assert(T =< Sent + 1000000) || {T, _, geocast, {delivered, _, _}} <- Trace].

%% Packets that take longer than the lifetime: nothing is delivered but to the sender. A fifth as
%% long, some come in time; none is late (play/5).
slow_packets_are_not_late(_) ->
    Reached = [
        begin
            {_, Trace} = line(
                3,
                fun(R) ->
                    _ = [
                        starl_geocast:send(R, everywhere(), news, hello, #{lifetime_ms => 1200})
                     || starl:id(R) =:= 1
                    ],
                    starl:sleep(R, 8000)
                end,
                #{faults => [{slow, 0, 8000, delay, all, #{extra_ms => Extra}}]},
                #{listeners => #{news => app}}
            ),
            length([R || {_, R, geocast, {delivered, _, _}} <- Trace])
        end
     || Extra <- [1300, 250, 1]
    ],
    ?assertEqual([1, 2, 3], Reached).

%% Nothing is remembered of messages whose lifetime is long over.
memory_shrinks(_) ->
    {ok, Sim} = starl_sim:start(
        scenario(
            3,
            fun(R) ->
                [
                    ok = starl_geocast:send(
                        R, everywhere(), news, {K, binary:copy(<<0>>, 1000)}, #{}
                    )
                 || K <- lists:seq(1, 20)
                ],
                starl:sleep(R, 100000)
            end,
            #{},
            #{}
        )
    ),
    _ = starl_sim:run(Sim, 2),
    Full = size_of(Sim),
    _ = starl_sim:run(Sim, 30),
    Empty = size_of(Sim),
    starl_sim:close(Sim),
    ?assert(Full > 60 * 10),
    ?assert(Empty < 200, Empty).

size_of(Sim) ->
    #{geocast := #{data := Data}} = starl_sim:inspect(Sim, 2),
    erts_debug:flat_size(Data).

%% Beyond the limit no message is taken: the sender is told, a relay says so in the trace.
memory_is_bounded(_) ->
    {[First | _], Trace} = line(
        2,
        fun(R) ->
            [starl_geocast:send(R, everywhere(), news, K, #{}) || K <- [1, 2, 3], starl:id(R) =:= 1]
        end,
        #{},
        #{limit => 2}
    ),
    ?assertEqual({done, [ok, ok, {error, full}]}, First),
    ?assertEqual(2, length([Id || {_, _, geocast, {sent, Id, _, _, _}} <- Trace])).

%% Who comes into the area while the message lives gets it then.
late_comer_gets_it(_) ->
    Area = {circle, {1000.0, 1000.0}, 900.0},
    {[_, Second], Trace} = line(
        2,
        fun(R) ->
            ok = starl_geocast:listen(R, news),
            case starl:id(R) of
                1 ->
                    starl_geocast:send(R, Area, news, hello, #{lifetime_ms => 20000});
                2 ->
                    ok = starl:sleep(R, 2000),
                    Before = starl:await(R, news, 0),
                    ok = starl:go_to(R, {1500.0, 1000.0}),
                    {Before, starl:await(R, news, 1000)}
            end
        end,
        #{}
    ),
    ?assertEqual({done, {timeout, {ok, 1, hello}}}, Second),
    ?assertEqual([1, 2], [R || {_, R, geocast, {delivered, _, _}} <- Trace]).

%% The robots stand in a square; one of the two ways round dies at once.
dead_relay_is_gone_around(_) ->
    Poses = #{
        1 => {0.0, 0.0, 0.0},
        2 => {2000.0, 0.0, 0.0},
        3 => {0.0, 2000.0, 0.0},
        4 => {2000.0, 2000.0, 0.0}
    },
    {Results, _} = play(
        4,
        fun(R) ->
            ok = starl_geocast:listen(R, news),
            starl:sleep(R, 100),
            _ = [starl_geocast:send(R, everywhere(), news, hello, #{}) || starl:id(R) =:= 1],
            starl:await(R, news, 5000)
        end,
        #{range => 2100, faults => [{die, 50, 50, kill_robot, 2, #{}}]},
        #{},
        #{poses => Poses}
    ),
    ?assertEqual(
        [{done, {ok, 1, hello}}, died, {done, {ok, 1, hello}}, {done, {ok, 1, hello}}],
        Results
    ).

%% A machine that restarts while a message lives does not deliver it again.
not_again_after_a_restart(_) ->
    {_, Trace} = line(
        2,
        fun(R) ->
            ok = starl_geocast:listen(R, news),
            _ = [starl_geocast:send(R, everywhere(), news, hello, #{}) || starl:id(R) =:= 1],
            starl:sleep(R, 10000)
        end,
        #{faults => [{k, 1000, 1000, kill_machine, {2, geocast}, #{}}]},
        #{listeners => #{news => app}}
    ),
    ?assertEqual([1, 2], [R || {_, R, geocast, {delivered, _, _}} <- Trace]).

%% The source's clock stands still while the message lives, so that it lives on when the other robot
%% has long forgotten it. That one holds it again and does not deliver it again. A robot that comes
%% late, too, gets it too late, and the clock is why.
not_again_by_a_clock(_) ->
    Script = fun(R) ->
        ok = starl_geocast:listen(R, news),
        Options = #{lifetime_ms => 1000},
        _ = [starl_geocast:send(R, everywhere(), news, hello, Options) || starl:id(R) =:= 1],
        starl:sleep(R, 10000)
    end,
    Faults = [{stands, 500, 6000, clock_freeze, 1, #{}}, {down, 0, 5000, reboot, 3, #{}}],
    {_, Trace} = line(3, Script, #{faults => Faults}, #{listeners => #{news => app}}),
    Held = [{R, T > 6000000} || {T, R, geocast, {held, _, _}} <- Trace],
    ?assertEqual([{2, false}, {2, true}], [H || {2, _} = H <- Held]),
    Delivered = [{R, T > 6000000} || {T, R, geocast, {delivered, _, _}} <- Trace],
    ?assertEqual([{1, false}, {2, false}, {3, true}], Delivered).

%% A clock that is set back after the restart: until it shows again what it showed then, no message
%% is surely a later one. Nothing is owed before that; afterwards all is as ever.
not_before_the_clock_is_back(_) ->
    Script = fun(R) ->
        Send = fun(Ms) ->
            ok = starl:sleep(R, Ms),
            starl_geocast:send(R, everywhere(), news, hello, #{lifetime_ms => 500})
        end,
        _ = [Send(Ms) || starl:id(R) =:= 1, Ms <- [4000, 4000]],
        starl:sleep(R, 10000)
    end,
    Faults = [
        {k, 1000, 1000, kill_machine, {2, geocast}, #{}},
        {back, 3500, 3500, clock_step, 2, #{ms => -4000}}
    ],
    {_, Trace} = line(2, Script, #{faults => Faults}, #{listeners => #{news => app}}, progress()),
    Delivered = [{R, N} || {_, R, geocast, {delivered, {1, 1, N}, _}} <- Trace],
    ?assertEqual([{1, 1}, {1, 2}, {2, 2}], Delivered).

%% Where no packet takes longer than a time, each message that lives as long as that needs comes to
%% all that hear it.
lives_long_enough(_) ->
    Least = starl_geocast_lifetime:least_us(100000, 3000, 10000) div 1000 + 1,
    First = starl_platform_ct:seed() band 16#ffffff,
    Script = fun(R) ->
        [
            begin
                ok = starl:sleep(R, 1 + trunc(700 * starl:random(R))),
                starl_geocast:send(R, everywhere(), news, N, #{lifetime_ms => Least})
            end
         || N <- lists:seq(1, 8)
        ],
        starl:sleep(R, 2000)
    end,
    [
        begin
            Scenario = #{range => none, delay => {2, 100}, clock_drift => 9000, seed => Seed},
            {_, Trace} = line(6, Script, Scenario, #{listeners => #{news => app}}, progress()),
            Delivered = [R || {_, R, geocast, {delivered, _, _}} <- Trace],
            ?assertEqual({Seed, 6 * 8 * 6}, {Seed, length(Delivered)})
        end
     || Seed <- lists:seq(First, First + 19)
    ].

%% What is sent after the restart is delivered.
sent_after_the_restart(_) ->
    {_, Trace} = line(
        2,
        fun(R) ->
            ok = starl:sleep(R, 2000),
            _ = [starl_geocast:send(R, everywhere(), news, hello, #{}) || starl:id(R) =:= 1],
            starl:sleep(R, 10000)
        end,
        #{faults => [{k, 1000, 1000, kill_machine, {2, geocast}, #{}}]},
        #{listeners => #{news => app}}
    ),
    ?assertEqual([1, 2], [R || {_, R, geocast, {delivered, _, _}} <- Trace]).

%% A message waits for its listener as long as it lives, and not longer.
listeners_come_late(_) ->
    {[_, {done, Got}, {done, None}], _} = line(
        3,
        fun(R) ->
            _ = [starl_geocast:send(R, everywhere(), news, hello, #{}) || starl:id(R) =:= 1],
            ok = starl:sleep(R, 2000 * starl:id(R)),
            ok = starl_geocast:listen(R, news),
            starl:await(R, news, 3000)
        end,
        #{}
    ),
    ?assertEqual({{ok, 1, hello}, timeout}, {Got, None}).

hops_are_limited(_) ->
    {_, Trace} = line(
        5,
        fun(R) ->
            ok = starl_geocast:listen(R, news),
            _ = [
                starl_geocast:send(R, everywhere(), news, hello, #{hops => 2})
             || starl:id(R) =:= 1
            ],
            starl:sleep(R, 6000)
        end,
        #{}
    ),
    ?assertEqual([1, 2, 3], [R || {_, R, geocast, {delivered, _, _}} <- Trace]).

mistakes_of_the_caller(_) ->
    {[{done, Errors}], _} = line(
        1,
        fun(R) ->
            [
                try starl_geocast:send(R, Area, news, x, Options) of
                    Answer -> Answer
                catch
                    error:{bad_argument, #{argument := Which}} -> Which
                end
             || {Area, Options} <- [
                    {{circle, {0, 0}, 1}, #{}},
                    {{polygon, []}, #{}},
                    {everywhere(), #{lifetime => 1}},
                    {everywhere(), #{lifetime_ms => 0}}
                ]
            ]
        end,
        #{}
    ),
    ?assertEqual(['Area', 'Area', 'Options', lifetime_ms], Errors).

%% -- helpers --------------------------------------------------------------------------------

everywhere() -> {rectangle, {-1.0e6, -1.0e6, 1.0e6, 1.0e6}}.

line(N, Script, Scenario) -> line(N, Script, Scenario, #{}).

line(N, Script, Scenario, Config) -> line(N, Script, Scenario, Config, #{}).

%% Robots in a line two metres apart that hear their neighbours only.
line(N, Script, Scenario, Config, Judged) ->
    Poses = maps:from_list([{I, {2000.0 * I - 1000.0, 1000.0, 0.0}} || I <- lists:seq(1, N)]),
    Around = #{poses => Poses, judged => Judged},
    play(N, Script, maps:merge(#{range => 2500}, Scenario), Config, Around).

%% Progress is judged, too.
progress() -> #{progress => true}.

%% Plays; no contract may be broken. The robots' results and the trace.
play(N, Script, Scenario, Config, Around) ->
    #{around := All} = Given = scenario(N, Script, Scenario, {Config, Around}),
    Outcome = starl_blocks_script_app:play(Script, All, maps:without([app, script, around], Given)),
    ?assertEqual([], maps:get(violations, Outcome)),
    {
        [Result || {_, #{result := Result}} <- maps:get(robots, Outcome)],
        starl_blocks_script_app:trace(Outcome)
    }.

scenario(N, Script, Scenario, #{} = Around) ->
    scenario(N, Script, Scenario, {#{}, Around});
scenario(N, Script, Scenario, {Config, Around}) ->
    Default = #{robots => lists:seq(1, N), healed_us => 0, delay_us => 0},
    Judged = maps:merge(Default, maps:get(judged, Around, #{})),
    Monitors = [{starl_geocast_monitor, Judged}],
    maps:merge(
        #{
            app => starl_blocks_script_app,
            robots => N,
            script => Script,
            time => 200,
            around => (maps:remove(judged, Around))#{
                blocks => starl_geocast:machines(Config), monitors => Monitors
            }
        },
        Scenario
    ).
