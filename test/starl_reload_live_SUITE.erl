%% Reloads at random instants of a painting cluster of two nodes, of the application and of machines:
%% the picture is complete, no contract is broken, the answer says what was rolled back and why.
%% STARL_LIVE_RELOADS=20 makes it 20 runs.
-module(starl_reload_live_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1, painted/1]).
%% called in the conductor
-export([play/3]).

-define(RUNS, 1).
-define(SPEED, 10).

suite() -> [{timetrap, {minutes, 9}}].

all() -> [painted].

%% The cluster makes its VM a distributed node: it has a VM of its own.
init_per_suite(Config) ->
    Own = [Dir || Dir <- code:get_path(), not lists:prefix(code:lib_dir(), Dir)],
    Paths = lists:append([["-pa", filename:absname(D)] || D <- Own, filelib:is_dir(D)]),
    Quiet = ["-nocookie", "-kernel", "logger_level", "none"],
    Whole = ["-kernel", "prevent_overlapping_partitions", "false"],
    {ok, Conductor, _} = peer:start(#{
        connection => standard_io,
        shutdown => close,
        wait_boot => 60000,
        args => Quiet ++ Whole ++ Paths
    }),
    %% held by this process otherwise, which ends
    true = unlink(Conductor),
    [{conductor, Conductor} | Config].

end_per_suite(Config) -> peer:stop(proplists:get_value(conductor, Config)).

painted(Config) ->
    Runs = list_to_integer(os:getenv("STARL_LIVE_RELOADS", integer_to_list(?RUNS))),
    Conductor = proplists:get_value(conductor, Config),
    Dir = proplists:get_value(priv_dir, Config),
    [
        begin
            {Variant, Module, At} = drawn(Seed),
            Played = peer:call(
                Conductor, ?MODULE, play, [Seed, Variant, {Module, At, Dir}], 300000
            ),
            ct:pal("seed ~b, ~p of ~p at ~b us:~n~ts", [
                Seed, Variant, Module, At, element(2, Played)
            ]),
            judged(starl_reload_code:fails(Variant), Played)
        end
     || Seed <- lists:seq(1, Runs)
    ].

judged(Fails, {Answer, Text, Violations, Complete}) ->
    ?assertEqual({[], true}, {Violations, Complete}),
    case {Fails, Answer} of
        {false, ok} ->
            ok;
        {true, error} ->
            Lines = string:lexemes(Text, "\n"),
            ?assert(lists:all(fun(L) -> string:find(L, "rolled back") =/= nomatch end, Lines)),
            ?assertMatch([_, _], Lines);
        {true, ok} ->
            %% the applications were done before the code had anything to do
            ok
    end.

%% The first run has code that fails, in the application.
drawn(1) ->
    {crashes_at_once, starl_painting, 3000000};
drawn(Seed) ->
    _ = rand:seed(exsss, {Seed, 2, 2}),
    Machines = [starl_sap, starl_motion, starl_dpp_participant, starl_dpp_coordinator],
    Module = one_of([starl_painting, one_of(Machines)]),
    Variants = [no_migration, crashes_at_once, good, converts],
    {one_of(Variants), Module, 2000000 + rand:uniform(8000000)}.

one_of(Choices) -> lists:nth(rand:uniform(length(Choices)), Choices).

%% -- in the conductor -----------------------------------------------------------------------

play(Seed, Variant, {Module, At, Dir}) ->
    Caller = self(),
    _ = spawn(fun() -> Caller ! {played, run(Seed, Variant, Module, At, Dir)} end),
    receive
        {played, Played} -> Played
    end.

run(Seed, Variant, Module, At, Dir) ->
    {module, Module} = code:ensure_loaded(Module),
    Code = starl_reload_code:make(Module, Variant),
    Picture = filename:join(Dir, "lines.svg"),
    ok = file:write_file(Picture, picture()),
    {ok, Cluster} = starl_cluster:start(
        #{app => starl_painting, robots => 2, picture => Picture, seed => Seed},
        #{dir => filename:join(Dir, integer_to_list(Seed)), transport => udp, speed => ?SPEED}
    ),
    ok = starl_cluster:until(Cluster, At),
    {Answer, Text} = starl_cluster:reload(Cluster, [Code]),
    _ = starl_cluster:await(Cluster),
    {#{violations := Violations}, #{complete := Complete}} = starl_cluster:finish(Cluster),
    Lines = [lists:flatten(starl_monitor:format_violation(V)) || V <- Violations],
    {Answer, unicode:characters_to_list(Text), Lines, Complete}.

picture() ->
    [
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 100 100'>",
        [
            io_lib:format("<path stroke='red' d='M 10 ~b L 40 ~b'/>", [Y, Y])
         || Y <- [10, 30, 50, 70, 90]
        ],
        "</svg>"
    ].
