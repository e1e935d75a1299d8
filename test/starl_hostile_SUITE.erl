%% The machines that take messages bear any body whatever in messages of their types: none crashes,
%% and afterwards the block serves the team as it should.
-module(starl_hostile_SUITE).
-include_lib("proper/include/proper.hrl").
-include_lib("stdlib/include/assert.hrl").

-export([all/0]).
-export([election/1, bully/1, mutex/1, barrier/1, registers/1, geocast/1, dpp/1]).
-export([number_to_come/1, each_leaves_a_trace/1]).

all() ->
    [election, bully, mutex, barrier, registers, geocast, dpp, number_to_come, each_leaves_a_trace].

election(_) -> holds(election, 60).
bully(_) -> holds(bully, 60).
mutex(_) -> holds(mutex, 60).
barrier(_) -> holds(barrier, 60).
registers(_) -> holds(registers, 60).
geocast(_) -> holds(geocast, 60).
dpp(_) -> holds(dpp, 25).

%% A request of robot 1 with a number that it has not come to does not keep its true ones out.
%% Holds: A request of path planning with a number that its robot has not come to keeps nobody out
%% Red: 1f37ea8, run
number_to_come(_) ->
    %% the second message comes when a coordinator leads
    [
        ?assert(
            bears(dpp, [{dpp_request, 0}, {dpp_request, {{1, 3, 1}, Id, {500.0, 500.0}, [], 5000}}]),
            Id
        )
     || Id <- [{9, 9}, {1, 1000}, {1 bsl 60, 1 bsl 60}]
    ].

holds(Block, Cases) ->
    Prop = ?FORALL(
        Messages,
        resize(20, non_empty(list(message(Block)))),
        starl_platform_ct:safely(fun() -> bears(Block, Messages) end)
    ),
    starl_platform_ct:property(Prop, Cases).

bears(Block, Messages) ->
    Robots = run(Block, Messages),
    Crashes = [{R, M, Why} || {R, #{crashes := Crashes}} <- Robots, {M, Why} <- Crashes],
    Results = lists:usort([Result || {_, #{result := Result}} <- Robots]),
    Crashes =:= [] andalso Results =:= expected(Block) orelse
        begin
            io:format("crashes ~p~nresults ~p~n", [Crashes, Results]),
            false
        end.

run(Block, Messages) ->
    Given = #{
        app => starl_hostile_planted,
        block => Block,
        messages => Messages,
        robots => 3,
        seed => 7,
        time => 900
    },
    Picture =
        case Block of
            dpp -> #{picture => "apart"};
            _ -> #{}
        end,
    starl_platform_ct:quietly(fun() ->
        {ok, Sim} = starl_sim:start(maps:merge(Given, Picture)),
        _ = starl_sim:run(Sim),
        {#{robots := Robots}, _} = starl_sim:finish(Sim),
        Robots
    end).

expected(Block) when Block =:= election; Block =:= bully -> [{done, {elected, ok}}];
expected(dpp) -> [{done, complete}];
expected(_Block) -> [{done, ok}].

%% A body that no machine takes is traced where it comes, and nothing else happens.
each_leaves_a_trace(_) ->
    Odd = [x, {}, {1, 2, 3, 4, 5, 6}, [1 | 2], #{a => b}, 1.5, fun erlang:node/0],
    Machines = [
        {election, starl_election_ballots, #{}, [ballot, leader]},
        {election, starl_election_bully, #{}, [bully_leader, ballot]},
        {mutex, starl_mutex_tokens, #{}, [mutex]},
        {barrier, starl_barrier_rounds, #{}, [barrier]},
        {registers, starl_registers_lww, #{}, [registers]},
        {geocast, starl_geocast_flood, #{}, [geocast]}
    ],
    [
        ?assertEqual({[{trace, {malformed, 2, Type, Body}}], Machine}, told(Type, Body, Machine))
     || {Name, Module, Config, Types} <- Machines,
        {_, Machine} <- [starl_machine:new(Module, Config, base(Name))],
        Type <- Types,
        Body <- Odd
    ].

told(Type, Body, Machine) ->
    starl_machine:step(cast, {message, 2, Type, Body}, #{now => 1, robot => 1}, Machine).

base(Name) ->
    #{
        robot => 1,
        participants => [1, 2, 3],
        name => Name,
        incarnation => 1,
        stored => none,
        random => rand:seed_s(exsss, 1),
        team_seed => 1,
        now => 0
    }.

%% -- bodies ---------------------------------------------------------------------------------

message(Block) ->
    %% whatever the radio carries
    ?SUCHTHAT({_Type, Body}, drawn(Block), starl_payload:check(message, Body) =:= ok).

drawn(Block) ->
    frequency([
        {1, {oneof([Type || {Type, _} <- bodies(Block)]), resize(8, any())}},
        {6,
            ?LET(
                {{Type, Body}, Seed},
                {oneof(bodies(Block)), range(1, 1000000)},
                {Type, mutated(Body, Seed)}
            )}
    ]).

%% True ones.
bodies(Block) when Block =:= election; Block =:= bully ->
    case Block of
        election ->
            [{ballot, {honest, {17, 2}}}, {leader, {other, 2}}];
        bully ->
            [{bully_challenge, other}, {bully_alive, other}, {bully_leader, {other, 2, majority}}]
    end;
bodies(mutex) ->
    [
        {mutex, Body}
     || Body <- [
            {request, t, {2, 1}, 0, none},
            {request, t, {2, 1}, 0, home},
            {token, t, 1048577, [{2, 1}, {3, 1}]},
            {granted, t, 1048577, {1, 5000}},
            {refused, t, 1048577, {1, 5000}},
            {owner, t, 1048577},
            {ask, claim, t, 1048577, {1, 5000}},
            {ask, renew, t, 1048577, {1, 5000}},
            {return, t, 1048577, [{1, 1}]}
        ]
    ];
bodies(barrier) ->
    [
        {barrier, Body}
     || Body <- [
            {reached, t, 1, 0, true},
            {reached, t, 1, 1, false},
            {who, 2},
            {told, 1, true, [{t, 1, 1, 0}]}
        ]
    ];
bodies(registers) ->
    Stamp = {5000000, 1, 2},
    [
        {registers, Body}
     || Body <- [
            {write, t, 5, Stamp},
            {entries, [{t, 5, Stamp}, {s, 6, Stamp}]},
            {sync, 99},
            {digest, [{t, Stamp}]},
            {want, [t]}
        ]
    ];
bodies(geocast) ->
    Id = {2, 1, 1},
    Parcel = {Id, {circle, {0.0, 0.0}, 9000.0}, news, 1, 5000000, 4000000, 32},
    [
        {geocast, Body}
     || Body <- [
            {offer, Id, 5000000, 4000000, 32},
            {ask, Id, {1, 5000}},
            {give, Parcel, [{1, {1, 5000}}, {2, {1, 5000}}]}
        ]
    ];
bodies(dpp) ->
    Term = {1, 3, 1},
    Id = {1, 9},
    Path = [{{100.0, 200.0}, up}, {{300.0, 400.0}, {down, 1}}],
    Ballot = {1, 5000, true},
    [
        {dpp_request, {Term, Id, {500.0, 500.0}, [], 5000}},
        {dpp_passed, {Term, Id, 1}},
        {dpp_state, {Term, Id, {standing, {500.0, 500.0}}, [], Ballot}},
        {dpp_state, {Term, Id, {moving, 1, {500.0, 500.0}, Path}, [], Ballot}},
        {dpp_here, {Term, Ballot}},
        {dpp_refused, Term},
        {dpp_recover, {Term, 1, true}},
        {dpp_answer, {Term, Id, {assign, {500.0, 500.0}, Path}, [1]}},
        {dpp_answer, {Term, Id, again, []}},
        {dpp_beat, {Term, 1, [{1, 5000}, {2, 5000}]}}
    ].

%% One of its parts, at any depth, is something else; a function of the seed.
mutated(Body, Seed) ->
    Paths = paths(Body, []),
    Path = lists:nth(1 + erlang:phash2({Seed, path}, length(Paths)), Paths),
    Odd = odd(),
    replace(lists:reverse(Path), Body, lists:nth(1 + erlang:phash2({Seed, odd}, length(Odd)), Odd)).

paths(Term, Path) when is_tuple(Term) ->
    [
        Path
        | lists:append([paths(element(N, Term), [N | Path]) || N <- lists:seq(1, tuple_size(Term))])
    ];
paths([Head | Tail], Path) ->
    [Path | paths(Head, [head | Path]) ++ paths(Tail, [tail | Path])];
paths(_Term, Path) ->
    [Path].

replace([], _Term, Odd) -> Odd;
replace([head | Path], [Head | Tail], Odd) -> [replace(Path, Head, Odd) | Tail];
replace([tail | Path], [Head | Tail], Odd) -> [Head | replace(Path, Tail, Odd)];
replace([N | Path], Term, Odd) -> setelement(N, Term, replace(Path, element(N, Term), Odd)).

odd() ->
    [
        0,
        -1,
        1,
        2,
        9,
        77,
        1 bsl 60,
        1 bsl 200,
        -(1 bsl 200),
        1.5,
        1.0e300,
        x,
        none,
        home,
        true,
        [],
        [1 | 2],
        [x],
        {},
        {1, 2},
        {1, 2, 3},
        {a, {b, c}},
        #{},
        #{1 => 2},
        <<"x">>,
        fun erlang:node/0
    ].
