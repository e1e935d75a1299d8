%% @doc The second part of `./starl hostile --insider': the same attack on a cluster by UDP, all blocks
%% of a team at once.
%% ```
%%     turn 0   turns 1, 2   turn 3   turns 4, 5     turn 6, 7, ...       later
%%     honest   attack       quiet    judged       | restart   judged   | restart         judged
%%                                                 | of all nodes       | of the team, with a new key
%% '''
%% The contracts of services (SAP, motion) judge all the time, those of the blocks only in the simulator: a
%% violation would end the run. All nodes are killed by SIGKILL. The team with the new key has the stores, and the clock goes on.
%% Without an attack all must be the same. Two turns are judged each time, of which one must succeed, since the
%% computer may have other work, too.
-module(starl_dev_insider_cluster).

-export([run/3, teams/0, format/1, is_borne/1]).

-export_type([row/0, options/0]).

-type options() :: #{
    robots := pos_integer(),
    seed := integer(),
    speed := number(),
    attack := boolean(),
    %% of each block, at most
    messages := pos_integer(),
    log => fun((starl:robot_id(), logger:level(), binary()) -> term())
}.

%% `bytes': the memory of the honest node that has most, when all code has been used and after the attack.
-type row() :: #{
    blocks := [atom()],
    attack := boolean(),
    sent := non_neg_integer(),
    works => [{atom(), [{atom(), true | {false, term()}}]}],
    crashes => [{starl:robot_id(), atom()}],
    violations => [starl_monitor:violation()],
    bytes => {non_neg_integer(), non_neg_integer()},
    error => unicode:chardata()
}.

%% The longest time for all nodes to start anew, of the computer. Meanwhile killed robots' machines count as
%% crashed.
-define(LOOKS, 600).
-define(LOOK_MS, 100).
%% What is sent to the machines of a block, at most.
-define(BLOCK_BYTES, 1_000_000).
-define(MOST_BYTES, 64_000_000).
-define(CALL_MS, 60_000).

%% @doc The blocks that one team can use together.
-spec teams() -> [[atom()]].
teams() ->
    [starl_dev_insider:blocks() -- [bully, dpp], [bully], [dpp]].

%% @doc Attacks a team that uses these blocks.
-spec run([atom()], options(), Dir :: file:filename()) -> row().
run(Blocks, #{attack := Attack} = Options, Dir) ->
    Messages = messages(Blocks, Options),
    Epoch = erlang:system_time(microsecond),
    Row = #{blocks => Blocks, attack => Attack, sent => length(Messages)},
    case life(Blocks, Messages, Dir, Epoch, fun attacked/3, Options) of
        #{} = First ->
            Second = life(Blocks, [], Dir, Epoch, fun anew/3, Options),
            maps:merge(Row, seen(Blocks, First, Second, Options));
        {error, Text} ->
            Row#{error => Text}
    end.

seen(_Blocks, _First, {error, Text}, _Options) ->
    #{error => Text};
seen(Blocks, First, Second, #{robots := Robots}) ->
    #{events := Before, turns := Turns, restarted_us := {Us, Up}, bytes := Bytes} = First,
    #{events := Later, turns := [Last]} = Second,
    Honest = lists:seq(1, Robots - 1),
    Works = fun(Block, Turn, Events) ->
        Is = [
            starl_dev_insider:works(Block, T, Honest, Events, period_ms(Blocks))
         || T <- [Turn, Turn + 1]
        ],
        case lists:member(true, Is) of
            true -> true;
            false -> lists:last(Is)
        end
    end,
    #{
        works => [
            {Block,
                [{Part, Works(Block, Turn, Before)} || {Part, Turn} <- Turns] ++
                    [{Part, Works(Block, Turn, Later)} || {Part, Turn} <- [Last]]}
         || Block <- Blocks
        ],
        crashes => lists:usort([
            {R, M}
         || {T, R, M, crashed} <- Before ++ Later, T < Us orelse T > Up
        ]),
        violations => maps:get(violations, First) ++ maps:get(violations, Second),
        bytes => Bytes
    }.

messages(_Blocks, #{attack := false}) ->
    [];
messages(Blocks, #{messages := Most} = Options) ->
    lists:append([
        bounded(lists:sublist(Messages, Most), ?BLOCK_BYTES)
     || Block <- Blocks, {_, _, Messages} <- [starl_dev_insider:plan(Block, Options)]
    ]).

%% A flood is another attack.
bounded([Message | Messages], Left) when Left > 0 ->
    [Message | bounded(Messages, Left - erlang:external_size(Message))];
bounded(_Messages, _Left) ->
    [].

life(Blocks, Messages, Dir, Epoch, Do, #{speed := Speed} = Options) ->
    Self = self(),
    Ref = make_ref(),
    Observe = fun
        ({judged, Events, Violations}) ->
            Self ! {Ref, [E || E <- Events, starl_dev_insider:is_of_interest(E)], Violations},
            ok;
        (_News) ->
            ok
    end,
    Cluster = maps:merge(maps:with([log], Options), #{
        dir => Dir, transport => udp, speed => Speed, epoch_us => Epoch, observe => Observe
    }),
    case starl_world_run:start(scenario(Blocks, Messages, Options), Cluster) of
        {ok, Started} ->
            Seen = Do(Started, Blocks, Options),
            ok = starl_world_run:stop(Started),
            _ = starl_world_run:finish(Started),
            News = news(Ref),
            Seen#{
                events => lists:append([Events || {Events, _} <- News]),
                violations => lists:append([Violations || {_, Violations} <- News])
            };
        {error, Reason} ->
            {error, [starl_world_run:format_error(Reason)]}
    end.

%% Long enough for all blocks in turn; the picture lasts for seven short turns.
period_ms([_]) -> 30_000;
period_ms(Blocks) -> 10_000 + 5_000 * length(Blocks).

scenario(Blocks, Messages, #{robots := Robots, seed := Seed}) ->
    Period = period_ms(Blocks),
    Picture = filename:join([code:priv_dir(starl_apps), "pictures", "hatch.svg"]),
    Common = #{
        app => starl_hostile_insider,
        blocks => Blocks,
        messages => Messages,
        insider => Robots,
        window => {Period, Period * 11 div 4},
        period => Period,
        contracts => false,
        robots => Robots,
        seed => Seed,
        time => 40000
    },
    case Blocks of
        [dpp] -> Common#{picture => Picture};
        _ -> Common
    end.

attacked(Cluster, Blocks, #{robots := Robots}) ->
    %% all code has been used
    ok = starl_world_run:until(Cluster, turn_us(1, Blocks) - 1_000_000),
    Before = most_bytes(Cluster, Robots),
    ok = starl_world_run:until(Cluster, turn_us(6, Blocks) - 1_000_000),
    Later = most_bytes(Cluster, Robots),
    ok = starl_world_run:until(Cluster, turn_us(6, Blocks)),
    #{now_us := Now} = starl_world_run:status(Cluster),
    ok = starl_world_run:inject(Cluster, [{reboot, R, #{}, 0} || R <- lists:seq(1, Robots)]),
    ok = up(?LOOKS, Cluster, Robots),
    #{now_us := Up} = starl_world_run:status(Cluster),
    Turn = next_turn(Cluster, Blocks),
    #{
        bytes => {Before, Later},
        restarted_us => {Now, Up},
        turns => [{after_attack, 4}, {after_restart, Turn}]
    }.

anew(Cluster, Blocks, _Options) -> #{turns => [{after_new_key, next_turn(Cluster, Blocks)}]}.

%% Waits for the end of two turns, before which all robots have been up for a turn. Returns the first.
next_turn(Cluster, Blocks) ->
    #{now_us := Now} = starl_world_run:status(Cluster),
    Turn = Now div turn_us(1, Blocks) + 2,
    ok = starl_world_run:until(Cluster, turn_us(Turn + 2, Blocks)),
    Turn.

%% A node that was killed may still count as up.
up(0, _Cluster, _Robots) ->
    ok;
up(Left, Cluster, Robots) ->
    #{up := Up, restarts := Restarts} = starl_world_run:status(Cluster),
    case length(Up) =:= Robots andalso lists:sum(maps:values(Restarts)) >= Robots of
        true ->
            ok;
        false ->
            receive
            after ?LOOK_MS -> up(Left - 1, Cluster, Robots)
            end
    end.

turn_us(Turn, Blocks) -> 1000 * period_ms(Blocks) * Turn.

most_bytes(Cluster, Robots) ->
    lists:max([
        Bytes
     || R <- lists:seq(1, Robots - 1),
        {ok, #{node := Node}} <- [starl_world_run:place(Cluster, R)],
        Node =/= none,
        {_, Bytes, _} <- [erpc:call(Node, starl_dev_hostile_flood, vitals, [], ?CALL_MS)]
    ]).

news(Ref) ->
    receive
        {Ref, Events, Violations} -> [{Events, Violations} | news(Ref)]
    after 0 -> []
    end.

%% @doc Did the team bear it?
-spec is_borne(row()) -> boolean().
is_borne(#{error := _Why}) ->
    false;
is_borne(#{works := Works, crashes := Crashes, violations := Violations, bytes := Bytes}) ->
    {Before, Later} = Bytes,
    Violations =:= [] andalso Crashes =:= [] andalso Later - Before =< ?MOST_BYTES andalso
        lists:all(fun({_, Parts}) -> lists:all(fun({_, Is}) -> Is =:= true end, Parts) end, Works).

%% @doc The rows of a team as text.
-spec format(row()) -> unicode:chardata().
format(#{error := Why}) ->
    ["the cluster does not start: ", Why, "\n"];
format(#{works := Works, crashes := Crashes, bytes := {Before, Later}} = Row) ->
    #{blocks := Blocks, sent := Sent, attack := Attack} = Row,
    [
        io_lib:format("~ts: ~b messages~ts; memory ~.1f MB, later ~.1f MB~ts~n", [
            lists:join(", ", [atom_to_list(Block) || Block <- Blocks]),
            Sent,
            [" (no attack)" || not Attack],
            Before / 1.0e6,
            Later / 1.0e6,
            [io_lib:format("; crashed: ~0tp", [Crashes]) || Crashes =/= []]
        ])
        | [["  ", starl_violation:format(V), "\n"] || V <- maps:get(violations, Row)]
    ] ++ [io_lib:format("  ~-10ts ~ts~n", [Block, parts(Parts)]) || {Block, Parts} <- Works].

parts(Parts) ->
    lists:join("  ", [part(Part, Is) || {Part, Is} <- Parts]).

part(Part, true) -> [words(Part), ": yes"];
part(Part, {false, Why}) -> io_lib:format("~ts: NO ~0tP", [words(Part), Why, 30]).

words(Part) -> string:replace(atom_to_list(Part), "_", " ", all).
