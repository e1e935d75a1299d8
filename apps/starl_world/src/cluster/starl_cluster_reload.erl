%% @doc Reloads code on the nodes of a cluster, in two phases, with a trial time.
%% ```
%%   loaded on every node --> every robot switches at its next step --> trial --> done
%%        | a node cannot,         | a state cannot be carried over      | a crash
%%        | or does not answer     v                                     v
%%        v                      the former code is back on every robot
%%     nothing has changed
%% '''
%% The new code lies beside the former code under a name of its own ({@link starl_version}), so
%% neither phase ends a process, and going back is always possible. The robot on which code crashes,
%% or a state cannot be converted, knows this at once; the others learn it from here, at any time. A
%% node that was down starts with the present code. A caller that was informed that steps last long
%% may reload again: then two reloads are under way.
-module(starl_cluster_reload).

-export([new/1, codes/1, code/1, start/5, loaded/2, hear/2, lost/2, rejoined/3]).

-export_type([t/0, answer/0, options/0]).

%% `trial_ms': the trial time of the run (5,000).
-type options() :: #{trial_ms => non_neg_integer()}.

-type answer() :: {ok, unicode:chardata()} | {error, unicode:chardata()}.

%% A reload whose code is being loaded on the nodes.
-record(loading, {
    order :: starl_reload:order(),
    code :: [starl_version:code()],
    parts :: #{starl_machine:name() => module()},
    from :: gen_server:from()
}).

-record(rollout, {
    order :: starl_reload:order(),
    from :: gen_server:from(),
    links :: #{starl:robot_id() => pid()},
    %% robots that have yet to switch, with their machines
    waiting :: [{starl:robot_id(), starl_machine:name()}],
    %% of the trial time
    timer = none :: reference() | none,
    %% has the caller had an answer?
    is_answered = false :: boolean()
}).

-record(reloads, {
    speed :: number(),
    count = 0 :: non_neg_integer(),
    codes = #{} :: starl_reload:codes(),
    code = [] :: [starl_version:code()],
    %% the links of the robots that are up
    links = #{} :: #{starl:robot_id() => pid()},
    loading = none :: #loading{} | none,
    %% the reloads that are under way
    rollouts = #{} :: #{starl_reload:count() => #rollout{}}
}).

-opaque t() :: #reloads{}.

%% The time after which the caller gets the answer that some steps last long.
-define(PATIENCE_MS, 30000).

%% @doc No reload yet; the run is this often as fast as real time.
-spec new(Speed :: number()) -> t().
new(Speed) -> #reloads{speed = Speed}.

%% @doc The present code of a robot whose node starts now; it may be on trial.
-spec codes(t()) -> starl_reload:codes().
codes(#reloads{codes = Codes}) -> Codes.

%% @doc The code of all versions.
-spec code(t()) -> [starl_version:code()].
code(#reloads{code = Code}) -> Code.

%% @doc Makes the code for all nodes, or returns why it cannot.
-spec start([starl_version:source()], options(), Parts, gen_server:from(), t()) ->
    {ok, [starl_version:code()], t()} | {error, unicode:chardata()}
when
    Parts :: #{starl_machine:name() => module()}.
start(Sources, Options, Parts, From, #reloads{rollouts = Rollouts, loading = none} = Reloads) ->
    case [N || {N, #rollout{is_answered = false}} <- maps:to_list(Rollouts)] of
        [_ | _] -> another();
        [] -> made(ordered(Sources, Options, Parts, Reloads), Parts, From, Reloads)
    end;
start(_Sources, _Options, _Parts, _From, _Reloads) ->
    another().

another() -> {error, "another reload is on trial; try again when it has ended"}.

ordered(Sources, Options, Parts, #reloads{count = Count}) ->
    TrialMs = maps:get(trial_ms, Options, starl_reload:trial_ms()),
    starl_reload:order(Count + 1, Sources, Parts, TrialMs).

made({ok, Order, Code}, Parts, From, Reloads) ->
    Loading = #loading{order = Order, code = Code, parts = Parts, from = From},
    {ok, Code, Reloads#reloads{loading = Loading}};
made({error, Reason}, _Parts, _From, _Reloads) ->
    {error, lists:join("\n", starl_reload:format_error(Reason))}.

%% @doc The nodes have loaded the code, as {@link starl_cluster_node:load/2} answers, or not: phase two if
%% all have. A node that has ended starts with the present code.
-spec loaded(starl_cluster_calls:answers(), t()) -> t().
loaded(Answers, #reloads{loading = #loading{from = From} = Loading} = Before) ->
    Reloads = Before#reloads{loading = none},
    case
        [
            Line
         || {Robot, Answer} <- lists:sort(maps:to_list(Answers)), Line <- problem(Robot, Answer)
        ]
    of
        [] ->
            switching(
                [{Robot, Link} || {Robot, {ok, {ok, [Link]}}} <- maps:to_list(Answers)],
                Loading,
                Reloads
            );
        Problems ->
            ok = gen_server:reply(From, {error, lists:join("\n", Problems)}),
            Reloads
    end.

problem(_Robot, down) ->
    [];
problem(_Robot, {ok, {ok, _Links}}) ->
    [];
problem(Robot, {ok, {error, Why}}) ->
    [io_lib:format("robot ~b: ~ts; nothing was reloaded", [Robot, Why])];
problem(Robot, silent) ->
    [io_lib:format("the node of robot ~b has not answered; nothing was reloaded", [Robot])].

switching(Robots, #loading{order = #{number := N} = Order} = Loading, Reloads) ->
    #loading{code = Code, parts = Parts, from = From} = Loading,
    {Switches, Codes} = starl_reload:take(Order, Parts, Reloads#reloads.codes),
    Links = maps:from_list(Robots),
    ok = lists:foreach(
        fun(Link) -> starl_live_link:reload(Link, Order, self()) end, maps:values(Links)
    ),
    _ = erlang:send_after(?PATIENCE_MS, self(), {reload_patience, N}),
    Waiting = [{Robot, Name} || {Robot, _} <- Robots, {Name, _} <- Switches],
    Rollout = #rollout{order = Order, from = From, links = Links, waiting = Waiting},
    Begun = Reloads#reloads{
        count = N,
        codes = Codes,
        code = Code ++ Reloads#reloads.code,
        links = maps:merge(Reloads#reloads.links, Links)
    },
    rollout(N, begun(Rollout, Begun), Begun).

rollout(N, Rollout, #reloads{rollouts = Rollouts} = Reloads) ->
    Reloads#reloads{rollouts = Rollouts#{N => Rollout}}.

%% The trial begins on each robot when it switches: it is over for all when it is for the last.
begun(#rollout{waiting = []} = Rollout, Reloads) -> on_trial(Rollout, Reloads);
begun(Rollout, _Reloads) -> Rollout.

on_trial(#rollout{order = #{trial_us := Us}} = Rollout, #reloads{speed = Speed}) ->
    Rollout#rollout{
        timer = erlang:start_timer(ceil(Us / 1000 / Speed) + 1, self(), reload_trial)
    }.

%% @doc Handles a message to the process that reloads: a machine has reported its result, or the
%% trial time, or the caller's patience, is over.
-spec hear(Message :: term(), t()) -> t().
hear({starl_reloaded, Robot, Name, #{number := N, outcome := Outcome} = Report}, Reloads) ->
    case starl_reload:is_failure(Outcome) of
        true ->
            failed(
                N,
                Robot,
                starl_reload:format(Robot, Name, maps:get(module, Report), Outcome),
                Reloads
            );
        false ->
            switched(N, [{Robot, Name}], Reloads)
    end;
hear({timeout, Timer, reload_trial}, #reloads{rollouts = Rollouts} = Reloads) ->
    case [Rollout || {_, #rollout{timer = T} = Rollout} <- maps:to_list(Rollouts), T =:= Timer] of
        [Rollout] -> tried(Rollout, Reloads);
        [] -> Reloads
    end;
hear({reload_patience, N}, #reloads{rollouts = Rollouts} = Reloads) ->
    case Rollouts of
        #{N := #rollout{is_answered = false} = Rollout} ->
            _ = answered({ok, impatient(Rollout)}, Rollout),
            rollout(N, Rollout#rollout{is_answered = true}, Reloads);
        #{} ->
            Reloads
    end;
hear(_Message, Reloads) ->
    Reloads.

switched(N, Done, #reloads{rollouts = Rollouts} = Reloads) ->
    case Rollouts of
        #{N := #rollout{waiting = [_ | _] = Waiting} = Rollout} ->
            rollout(N, begun(Rollout#rollout{waiting = Waiting -- Done}, Reloads), Reloads);
        #{} ->
            Reloads
    end.

%% A reload may fail on a robot when it has long been over on others: they go back all the same.
failed(N, Robot, Line, #reloads{rollouts = Rollouts, codes = Codes, links = Links} = Reloads) ->
    ok = lists:foreach(
        fun(Link) -> starl_live_link:take_back(Link, N, Robot) end, maps:values(Links)
    ),
    _ = [answered({error, lines(Robot, Line, Rollout)}, Rollout) || #{N := Rollout} <- [Rollouts]],
    Reloads#reloads{
        codes = starl_reload:without(N, Codes), rollouts = maps:remove(N, Rollouts)
    }.

lines(Failed, Line, #rollout{links = Links}) ->
    Others = [
        io_lib:format("robot ~b: rolled back, since the reload failed on robot ~b", [R, Failed])
     || R <- lists:sort(maps:keys(Links)), R =/= Failed
    ],
    lists:join("\n", [Line | Others]).

%% @doc The node of a robot has ended: it starts with the present code.
-spec lost(starl:robot_id(), t()) -> t().
lost(Robot, #reloads{rollouts = Rollouts, links = Links} = Reloads) ->
    Left = Reloads#reloads{
        links = maps:remove(Robot, Links),
        rollouts = maps:map(
            fun(_, #rollout{links = L} = R) -> R#rollout{links = maps:remove(Robot, L)} end,
            Rollouts
        )
    },
    maps:fold(
        fun(N, #rollout{waiting = Waiting}, R) ->
            switched(N, [W || {Id, _} = W <- Waiting, Id =:= Robot], R)
        end,
        Left,
        Rollouts
    ).

%% @doc The node of a robot is up again: its trial begins.
-spec rejoined(starl:robot_id(), [Link :: pid()], t()) -> t().
rejoined(Robot, [Link], #reloads{links = Links, rollouts = Rollouts} = Reloads) ->
    Reloads#reloads{
        links = Links#{Robot => Link},
        rollouts = maps:map(fun(_, Rollout) -> joined(Robot, Link, Rollout, Reloads) end, Rollouts)
    };
rejoined(_Robot, _Links, Reloads) ->
    Reloads.

joined(Robot, Link, #rollout{links = Links} = Rollout, Reloads) ->
    begun(Rollout#rollout{links = Links#{Robot => Link}}, Reloads).

tried(#rollout{order = #{number := N, versions := Versions}, links = Links} = Rollout, Reloads) ->
    Names = lists:join(", ", [atom_to_list(M) || M <- lists:sort(maps:keys(Versions))]),
    Line = io_lib:format("~ts: reloaded on ~b robots; the trial time is over\n", [
        Names, map_size(Links)
    ]),
    _ = answered({ok, Line}, Rollout),
    #reloads{codes = Codes, rollouts = Rollouts} = Reloads,
    Reloads#reloads{codes = starl_reload:passed(N, Codes), rollouts = maps:remove(N, Rollouts)}.

impatient(#rollout{waiting = []}) ->
    "all robots run the new code; it is on trial\n";
impatient(#rollout{waiting = Waiting}) ->
    Robots = lists:join(", ", [integer_to_list(R) || R <- lists:usort([R || {R, _} <- Waiting])]),
    ["these robots are still in a step, and take the new code after it: ", Robots, "\n"].

%% A caller that has had an answer finds the rest in the log.
answered({_, Text}, #rollout{is_answered = true}) ->
    logger:notice(#{what => reload, outcome => unicode:characters_to_binary(Text)});
answered(Answer, #rollout{from = From}) ->
    gen_server:reply(From, Answer).
