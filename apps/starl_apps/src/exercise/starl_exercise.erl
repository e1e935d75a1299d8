%% @doc The application `exercise': it uses one building block all the time, under the monitors of
%% the block's contract. An example is `./starl run exercise --block mutex --random-faults
%% [network]'. With `final' each robot makes some more calls after its work. Another monitor
%% ({@link starl_exercise_monitor}) then finds calls that should have succeeded and did not.
%%
%% The block itself declares how it is used ({@link starl_block_exercise}). This application is the
%% same for all blocks, and also works for a user's own block.
-module(starl_exercise).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([options/0, scene/1, init/2, step/2, report/2]).

-export_type([state/0]).

-type use() :: starl_block_exercise:use().

%% During the work: the use, the end of the work by the robot's own clock (ms), and the number of
%% the turn. After it: the use, the number of turns made, and the number of the call.
-opaque state() ::
    {use(), Until :: integer(), Turn :: pos_integer()}
    | {final, use(), Turns :: non_neg_integer(), N :: pos_integer()}.

%% The longest time by which a call may exceed its patience.
-define(MARGIN_US, 12000000).
%% The longest delay of one robot's final calls after another's, because it may have restarted at
%% the end of the faults.
-define(APART_MS, 45000).

-spec options() -> [starl_options:option()].
options() ->
    Names = lists:join(", ", [atom_to_list(Name) || Name <- starl_block_catalogue:able(exercise)]),
    Block = {term, lists:flatten(["one of ", Names, ", or a module"]), fun is_exercised/1},
    [
        {block, Block, sap, "the building block to be used"},
        {work, {number, 0.001, 1.0e6}, 25,
            "the time for which each robot uses the block, s by its own clock"},
        {turns, {optional, {integer, 1, 1000000}}, none,
            "the most uses of the block by each robot"},
        {pause, {integer, 1, 1000000}, 400, "the longest pause between two uses, ms"},
        %% The patience lets a robot continue if its partner is dead.
        {patience, {integer, 1, 10000000}, 8000, "the longest wait for the answer of a call, ms"}
    ] ++ flags() ++
        [
            {final, {integer, 0, 1000}, 0,
                "number of calls by each robot at the end of its work; their results are judged"},
            {with, {term, "a map", fun is_map/1}, #{},
                "the block's own options, and flags of a block of your own"}
        ].

%% Two blocks may share a flag.
flags() ->
    lists:foldl(fun shared/2, [], [
        Flag
     || Name <- starl_block_catalogue:able(exercise),
        {ok, Block} <- [starl_block_catalogue:find(Name)],
        Flag <- starl_block_exercise:flags(Block:exercise())
    ]).

shared({Key, _, _, _} = Flag, Flags) ->
    case lists:keymember(Key, 1, Flags) of
        true -> Flags;
        false -> Flags ++ [Flag]
    end.

is_exercised(Name) when is_atom(Name) ->
    case starl_block_catalogue:find(Name) of
        {ok, Block} -> starl_block:can(exercise, Block);
        error -> false
    end;
is_exercised(_Name) ->
    false.

-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(#{options := #{block := Name}} = Context) ->
    {ok, Block} = starl_block_catalogue:find(Name),
    case with_own(Block, Block:exercise(), Context) of
        {ok, {Use, Options}} -> {ok, scene(Block, Use, Options, Context)};
        {error, _} = Error -> Error
    end.

scene(Block, Use, Options, #{robots := Robots}) ->
    #{
        app => {sequential, ?MODULE, Use},
        never_crashes => true,
        %% A low limit gives up dead robots soon.
        sap => #{limit => 6},
        blocks => [{Block, Options}],
        monitors => [{starl_exercise_monitor, calls(Block, Use, Robots)}]
    }.

calls(Block, #{within := Within} = Use, Robots) ->
    #{
        use => Use,
        exercise => Block:exercise(),
        robots => Robots,
        within_us => 1000 * Within,
        margin_us => ?MARGIN_US,
        bound_us => ?MARGIN_US
    }.

%% The map `with' holds options of the block and values of flags that are not this application's.
with_own(Block, Exercise, #{robots := Robots, options := #{with := Given} = Options}) ->
    Flags = starl_block_exercise:flags(Exercise),
    Known = [Key || {Key, _, _, _} <- Flags],
    Own = [O || {Key, _, _, _} = O <- Block:options(), not lists:member(Key, Known)],
    case starl_options:check(Given, Flags ++ Own) of
        {ok, _} ->
            Defaults = maps:from_list([{Key, Default} || {Key, _, Default, _} <- Flags]),
            Values = maps:merge(maps:merge(Defaults, Options), maps:with(Known, Given)),
            Use = use(Exercise, Values#{team => length(Robots)}),
            {ok, {Use, own_options(Exercise, Use, maps:without(Known, Given))}};
        {error, Problems} ->
            Lines = lists:join("; ", [starl_options:format_problem(P) || P <- Problems]),
            {error, ["with: block ", atom_to_list(Block), ": ", Lines]}
    end.

own_options(Exercise, Use, Given) ->
    maps:merge(starl_block_exercise:block_options(Exercise, Use), Given).

use(Exercise, Values) ->
    Within = starl_block_exercise:within_ms(Exercise, Values),
    Values#{
        exercise => Exercise,
        within => Within,
        last_patience => Within + ?APART_MS
    }.

-spec init(starl:robot(), use()) -> state().
init(Robot, #{exercise := Exercise, work := Seconds} = Use) ->
    _ = starl_block_exercise:prepare(Exercise, Robot, Use),
    {Use, starl:now(Robot) + round(1000 * Seconds), 1}.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, Turns :: pos_integer()}.
step(Robot, {final, #{exercise := Exercise, final := Most} = Use, Turn, N}) when N =< Most ->
    _ = starl_block_exercise:final(Exercise, Robot, N, Use),
    {continue, {final, Use, Turn, N + 1}};
step(_Robot, {final, _Use, Turn, _N}) ->
    {done, Turn};
step(Robot, {#{turns := Turns, exercise := Exercise, pause := Pause} = Use, Until, Turn}) ->
    %% An atom is greater than every number.
    case starl:now(Robot) >= Until orelse Turn > Turns of
        true ->
            {continue, {final, Use, Turn, 1}};
        false ->
            _ = Exercise:work(Robot, Turn, Use),
            ok = starl:sleep(Robot, 2 + trunc(starl:random(Robot) * Pause)),
            {continue, {Use, Until, Turn + 1}}
    end.

%% @doc The number of uses of the block, and the counts of its monitors. For the mutex: the longest
%% and the mean wait for a token, and the unfairness (the longest divided by the mean).
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(#{monitors := Monitors}, #{robots := Robots, monitors := Results}) ->
    Turns = [Turn - 1 || {_, #{result := {done, Turn}}} <- Robots],
    Counted = [
        {Key, Count}
     || {Monitor, _} <- Monitors,
        {Key, Count} <- lists:sort(maps:to_list(maps:get(Monitor, Results, #{}))),
        is_number(Count)
    ],
    #{figures => [{turns, lists:sum(Turns)}, {finished, length(Turns)} | Counted]}.
