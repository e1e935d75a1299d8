%% @doc New code for the nodes of a cluster, in two phases, with a trial time.
%% ```
%%   prepared on every node --> every robot switches at its next step --> trial --> done
%%        | a node cannot            | a state cannot be carried over      | a crash
%%        v                          v                                     v
%%     nothing has changed         the former code is back on every robot
%% '''
%% The new code lies beside the former one under a name of its own ({@link starl_version}), so that
%% neither phase ends a process, and the way back is always there. The crash or the state that failed
%% is known on that robot at once; the others hear of it here. A node that was down starts with the
%% present code.
-module(starl_cluster_reload).

-export([new/1, codes/1, code/1, start/5, hear/2, lost/2, rejoined/3]).

-export_type([t/0, node_of/0, answer/0, options/0]).

%% A robot whose node is up: its node and its link.
-type node_of() :: {starl:robot_id(), node(), Link :: pid()}.

%% `trial_ms': the trial time of the run (5,000).
-type options() :: #{trial_ms => non_neg_integer()}.

-type answer() :: {ok, unicode:chardata()} | {error, unicode:chardata()}.

-record(rollout, {
    order :: starl_reload:order(),
    from :: gen_server:from(),
    links :: #{starl:robot_id() => pid()},
    %% robots that have yet to switch, with their machines
    waiting :: all | [{starl:robot_id(), starl_machine:name()}],
    %% of the trial time
    timer = none :: reference() | none,
    %% whether the caller has been told already
    told = false :: boolean()
}).

-record(reloads, {
    speed :: number(),
    count = 0 :: non_neg_integer(),
    codes = #{} :: starl_reload:codes(),
    code = [] :: [starl_version:code()],
    now = none :: #rollout{} | none
}).

-opaque t() :: #reloads{}.

-define(TRIAL_MS, 5000).
%% The time after which the caller is told that some steps last long.
-define(PATIENCE_MS, 30000).
-define(NODE_MS, 30000).

%% @doc No reload yet; the run is this often as fast as real time.
-spec new(Speed :: number()) -> t().
new(Speed) -> #reloads{speed = Speed}.

%% @doc The present code of a robot whose node starts now; it may be on trial.
-spec codes(t()) -> starl_reload:codes().
codes(#reloads{codes = Codes, now = none}) ->
    Codes;
codes(#reloads{codes = Codes, now = #rollout{order = #{number := N, trial_us := Us}}}) ->
    maps:map(
        fun
            (_, {M, Now, Before, _}) when M =:= N -> {M, Now, Before, {from_start, Us}};
            (_, Code) -> Code
        end,
        Codes
    ).

%% @doc The code of all versions.
-spec code(t()) -> [starl_version:code()].
code(#reloads{code = Code}) -> Code.

%% @doc Phase one on all nodes, and phase two if all can. Otherwise says why not.
-spec start([starl_version:source()], options(), {Parts, [node_of()]}, gen_server:from(), t()) ->
    {ok, t()} | {error, unicode:chardata()}
when
    Parts :: #{starl_machine:name() => module()}.
start(_Sources, _Options, _Robots, _From, #reloads{now = #rollout{told = false}}) ->
    {error, "another reload is on trial; try again when it has ended"};
start(Sources, Options, {Parts, Nodes}, From, #reloads{count = Count} = Reloads) ->
    case starl_version:make(Sources) of
        {ok, #{versions := Versions, code := Code}} ->
            Order = #{
                number => Count + 1,
                versions => Versions,
                trial_us => 1000 * maps:get(trial_ms, Options, ?TRIAL_MS)
            },
            prepared(
                problems(Versions, Code, Parts, Nodes), Order, Code, {Parts, Nodes}, From, Reloads
            );
        {error, Lines} ->
            {error, lists:join("\n", Lines)}
    end.

problems(Versions, Code, Parts, Nodes) ->
    case [M || M <- maps:values(Parts), is_map_key(M, Versions)] of
        [] -> [nobody(maps:keys(Versions))];
        _ -> [Line || {Robot, Node, _} <- Nodes, Line <- problem(Robot, Node, Code)]
    end.

nobody(Modules) ->
    Names = lists:join(", ", [atom_to_list(M) || M <- Modules]),
    [Names, ": neither the application nor a machine of the robots; reload it together with one"].

%% A node that does not answer is about to be started anew.
problem(Robot, Node, Code) ->
    try erpc:call(Node, starl_version, load, [Code], ?NODE_MS) of
        ok -> [];
        {error, Why} -> [io_lib:format("robot ~b: ~ts; nothing was reloaded", [Robot, Why])]
    catch
        error:{erpc, _} -> []
    end.

prepared([], Order, Code, {Parts, Nodes}, From, #reloads{codes = Codes} = Reloads) ->
    {Words, Next} = starl_reload:take(Order, 0, Parts, Codes),
    Links = maps:from_list([{Robot, Link} || {Robot, _, Link} <- Nodes]),
    ok = lists:foreach(
        fun(Link) -> starl_live_link:reload(Link, Order, self()) end, maps:values(Links)
    ),
    #{number := N} = Order,
    _ = erlang:send_after(?PATIENCE_MS, self(), {reload_patience, N}),
    Rollout = #rollout{
        order = Order,
        from = From,
        links = Links,
        waiting = all
    },
    Waiting = [{Robot, Name} || {Robot, _, _} <- Nodes, {Name, _} <- Words],
    {ok,
        switched(Waiting, Reloads#reloads{
            count = N, codes = Next, code = Code ++ Reloads#reloads.code, now = Rollout
        })};
prepared(Problems, _Order, _Code, _Robots, _From, _Reloads) ->
    {error, lists:join("\n", Problems)}.

%% @doc Handles a message to the process that reloads: a machine has told how it has heeded a reload; the
%% trial time, or the caller's patience, is over.
-spec hear(Message :: term(), t()) -> t().
hear({starl_reloaded, Robot, Name, #{number := N, outcome := Outcome} = Told}, Reloads) ->
    case Reloads of
        #reloads{now = #rollout{order = #{number := N}}} ->
            heard(starl_reload:is_failure(Outcome), Robot, Name, Told, Reloads);
        #reloads{} ->
            Reloads
    end;
hear({timeout, Timer, reload_trial}, #reloads{now = #rollout{timer = Timer}} = Reloads) ->
    tried(Reloads);
hear({reload_patience, N}, #reloads{now = #rollout{order = #{number := N}} = Now} = Reloads) ->
    _ = answered({ok, impatient(Now)}, Now),
    Reloads#reloads{now = Now#rollout{told = true}};
hear(_Message, Reloads) ->
    Reloads.

heard(false, Robot, Name, _Told, #reloads{now = Rollout} = Reloads) ->
    #rollout{waiting = Waiting} = Rollout,
    switched(lists:delete({Robot, Name}, Waiting), Reloads);
heard(
    true, Robot, Name, #{outcome := Outcome, module := Module}, #reloads{now = Rollout} = Reloads
) ->
    #rollout{order = #{number := N}, links = Links} = Rollout,
    {_, Codes} = starl_reload:back(N, Reloads#reloads.codes),
    ok = lists:foreach(
        fun(Link) -> starl_live_link:take_back(Link, N, Robot) end, maps:values(Links)
    ),
    Others = [
        io_lib:format("robot ~b: rolled back, since the reload failed on robot ~b", [R, Robot])
     || R <- lists:sort(maps:keys(Links)), R =/= Robot
    ],
    Lines = [starl_reload:format(Robot, Name, Module, Outcome) | Others],
    _ = answered({error, lists:join("\n", Lines)}, Rollout),
    Reloads#reloads{codes = Codes, now = none}.

%% The trial begins on each robot when it switches: it is over for all when it is for the last.
switched([], #reloads{now = #rollout{waiting = Before} = Rollout} = Reloads) when Before =/= [] ->
    on_trial(Reloads#reloads{now = Rollout#rollout{waiting = []}});
switched(Waiting, #reloads{now = Rollout} = Reloads) ->
    Reloads#reloads{now = Rollout#rollout{waiting = Waiting}}.

on_trial(#reloads{now = #rollout{order = #{trial_us := Us}} = Rollout, speed = Speed} = Reloads) ->
    Timer = erlang:start_timer(ceil(Us / 1000 / Speed) + 1, self(), reload_trial),
    Reloads#reloads{now = Rollout#rollout{timer = Timer}}.

%% @doc The node of a robot has ended: it starts with the present code.
-spec lost(starl:robot_id(), t()) -> t().
lost(_Robot, #reloads{now = none} = Reloads) ->
    Reloads;
lost(Robot, #reloads{now = #rollout{waiting = Waiting, links = Links} = Rollout} = Reloads) ->
    Left = Rollout#rollout{links = maps:remove(Robot, Links)},
    switched([W || {R, _} = W <- Waiting, R =/= Robot], Reloads#reloads{now = Left}).

%% @doc The node of a robot is up again: its trial begins.
-spec rejoined(starl:robot_id(), [Link :: pid()], t()) -> t().
rejoined(Robot, [Link], #reloads{now = #rollout{links = Links} = Rollout} = Reloads) ->
    Joined = Reloads#reloads{now = Rollout#rollout{links = Links#{Robot => Link}}},
    case Rollout of
        #rollout{waiting = []} -> on_trial(Joined);
        #rollout{} -> Joined
    end;
rejoined(_Robot, _Links, Reloads) ->
    Reloads.

tried(#reloads{now = #rollout{links = Links, order = #{versions := Versions}} = Now} = Reloads) ->
    Names = lists:join(", ", [atom_to_list(M) || M <- lists:sort(maps:keys(Versions))]),
    Line = io_lib:format("~ts: reloaded on ~b robots; the trial time is over\n", [
        Names, map_size(Links)
    ]),
    _ = answered({ok, Line}, Now),
    Reloads#reloads{now = none}.

impatient(#rollout{waiting = []}) ->
    "all robots run the new code; it is on trial\n";
impatient(#rollout{waiting = Waiting}) ->
    Robots = lists:join(", ", [integer_to_list(R) || R <- lists:usort([R || {R, _} <- Waiting])]),
    ["these robots are still in a step, and take the new code after it: ", Robots, "\n"].

%% A caller that was told already finds the rest in the log.
answered({_, Text}, #rollout{told = true}) ->
    logger:notice(#{what => reload, outcome => unicode:characters_to_binary(Text)});
answered(Answer, #rollout{from = From}) ->
    gen_server:reply(From, Answer).
