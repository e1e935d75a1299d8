%% @doc The service of a path planning coordinator. It takes requests and reports of robots, keeps
%% the plan ({@link starl_dpp_plan}) and answers. Pure. {@link starl_dpp_coordinator} decides
%% whether the coordinator may assign at all.
%%
%% At first no robot's place is known. The service is open once its coordinator leads and every
%% robot's place is known; before that nothing is assigned and nothing is traced. Robots that wait
%% are served again when space or edges have become free. When no robot moves and all wait, the plan
%% resolves the deadlock. If only robots that no longer answer block the rest of the picture, the
%% robots that wait are answered `incomplete'.
%%
%% A silent robot may still hear the coordinator, but the coordinator does not send it away. A robot
%% drives under a lease that counts from a message of its own, and its messages do not arrive. So
%% its body stays in place and closes the edges that come within 2R of it.
%%
%% Trace: {@link event()}.
-module(starl_dpp_dispatcher).
-behaviour(starl_dpp_service).

-export([prepare/1, new/2, lead/1, unknown/1, knows/2, silent/2]).
-export([requested/4, reported/4, passed/4, rests/3, serve/1, give_up/1, answered/3]).
-export([blocked/3, reopen/1]).
-export_type([t/0, turn/0, event/0]).

%% The trace of the service. Segments (mm) are the centre lines of the tubes that the robot holds.
-type event() ::
    %% the service is open: all robots' places are known
    {coordinator, starl_dpp:term_id()}
    | {reserved, starl:robot_id(), [starl_geometry:segment()]}
    | {assigned, starl:robot_id(), starl_dpp:request_id(), [starl_geometry:segment()]}
    %% these robots were sent out of the way of others
    | {deadlock_resolved, [starl:robot_id(), ...]}
    %% the robot was silent until its lease had ended
    | {silent, starl:robot_id()}
    %% the silent robot stands less than 2R from these lines, which are given up
    | {in_the_way, starl:robot_id(), [starl_geometry:segment(), ...]}
    %% only robots that are silent stand between the team and the rest of the picture
    | {unreachable, [starl_dpp_graph:edge_id()]}
    %% robots keep away from these segments, as something is in the way there; perhaps no more
    | {closed, [starl_geometry:segment(), ...]}
    | reopened
    %% the robot reports painted lines that are not in the picture
    | {malformed, starl:robot_id(), {edges, term()}}.

%% The time after which waiting robots are served again when something became free.
-define(SERVE_US, 200000).
%% The time that silent robots have to be heard again when only they are in the way.
-define(GIVE_UP_US, 60000000).
%% The time after which what was closed is tried again, and how often without any line painted meanwhile.
-define(REOPEN_US, 20000000).
-define(MOST_TRIES, 15).

-record(serve, {
    plan :: starl_dpp_plan:t(),
    term :: starl_dpp:term_id(),
    %% does the coordinator lead, and is every robot's place known?
    leads = false :: boolean(),
    open = false :: boolean(),
    %% the latest request of each robot; the robots that wait for an answer, in order of arrival
    latest = #{} :: #{starl:robot_id() => starl_dpp:request_id()},
    waiting = [] :: [starl:robot_id()],
    %% the robots on their way, each with the waypoint of its path at which the plan's view begins
    moving = #{} :: #{starl:robot_id() => Offset :: non_neg_integer()},
    %% the robots that were silent until their lease had ended
    silent = [] :: [starl:robot_id()],
    %% the number of painted edges that each robot has been told, or is being told
    told = #{} :: #{starl:robot_id() => non_neg_integer()},
    telling = #{} :: #{starl:robot_id() => non_neg_integer()},
    %% no robot moves and nothing can be assigned
    stuck = false :: boolean(),
    %% something is closed; how often that was tried again, and the number of painted edges then
    closed = false :: boolean(),
    tries = {0, 0} :: {Tries :: non_neg_integer(), Painted :: non_neg_integer()}
}).
-opaque t() :: #serve{}.
-type turn() :: {t(), [starl_machine:action()]}.

%% @doc The plan in which nothing is known.
-spec prepare(starl_dpp_settings:t()) -> starl_dpp_plan:t().
prepare(Settings) ->
    {ok, Plan} = starl_dpp_plan:new(Settings),
    Plan.

%% @doc No robot's place is known.
-spec new(starl_dpp_plan:t(), starl_dpp:term_id()) -> t().
new(Plan, Term) -> #serve{plan = Plan, term = Term}.

%% @doc The coordinator leads from now on.
-spec lead(t()) -> turn().
lead(S) -> open(S#serve{leads = true}).

%% @doc The robots whose place is not known.
-spec unknown(t()) -> [starl:robot_id()].
unknown(#serve{plan = Plan}) -> starl_dpp_plan:unknown(Plan).

%% @doc Is the robot's place known?
-spec knows(starl:robot_id(), t()) -> boolean().
knows(Robot, #serve{plan = Plan}) -> starl_dpp_plan:held(Robot, Plan) =/= [].

%% @doc Was the robot silent until its lease had ended?
-spec silent(starl:robot_id(), t()) -> boolean().
silent(Robot, #serve{silent = Silent}) -> lists:member(Robot, Silent).

%% -- requests and reports of robots ---------------------------------------------------------

%% @doc The robot stands at a point and wants a path.
-spec requested(starl:robot_id(), starl_dpp:request_id(), {Where, [Edge]}, t()) -> turn() when
    Where :: starl_geometry:point(), Edge :: starl_dpp_graph:edge_id().
requested(Robot, Id, {At, Painted}, #serve{waiting = Waiting, plan = Plan} = S) ->
    case newer(Robot, Id, S) andalso starl_dpp_plan:are_targets(Painted, Plan) of
        true ->
            Asking = S#serve{waiting = lists:delete(Robot, Waiting) ++ [Robot]},
            chain(
                [
                    fun(S1) -> stands(Robot, Id, At, Painted, S1) end,
                    fun(S1) -> serve_robot(Robot, S1) end,
                    fun settle/1
                ],
                Asking
            );
        false ->
            {nearer(Robot, Id, S), stray(Robot, Painted, Plan) ++ outnumbered(Robot, Id, S)}
    end.

%% @doc The robot's report to a new coordinator: where it stands, or the rest of its path.
-spec reported(starl:robot_id(), starl_dpp:request_id(), {starl_dpp:place(), [Edge]}, t()) ->
    turn()
when
    Edge :: starl_dpp_graph:edge_id().
reported(Robot, Id, {Place, Painted}, #serve{plan = Plan} = S) ->
    Silent = silent(Robot, S),
    Named = pens(Place) ++ Painted,
    case {newer(Robot, Id, S) andalso starl_dpp_plan:are_targets(Named, Plan), Place} of
        {false, _} -> {nearer(Robot, Id, S), stray(Robot, Named, Plan)};
        %% its lease has ended since the report
        {true, {moving, _, _, _}} when Silent -> {S, []};
        {true, {standing, At}} -> stands(Robot, Id, At, Painted, S);
        {true, {moving, _, From, []}} -> stands(Robot, Id, From, Painted, S);
        {true, {moving, N, From, Path}} -> moves(Robot, Id, {N, From, Path}, Painted, S)
    end.

%% No robot of the team has painted a line that is not in the picture.
stray(Robot, Edges, Plan) ->
    [
        {trace, {malformed, Robot, {edges, Edges}}}
     || not starl_dpp_plan:are_targets(Edges, Plan)
    ].

pens({moving, _, _, Path}) -> [Edge || {_, {down, Edge}} <- Path];
pens({standing, _}) -> [].

%% @doc The paper's Clear: the robot has reached waypoint N of the path that it got for this
%% request.
-spec passed(starl:robot_id(), starl_dpp:request_id(), N :: pos_integer(), t()) -> turn().
passed(Robot, Id, N, #serve{latest = Latest, moving = Moving, plan = Plan} = S) ->
    case {Latest, Moving} of
        {#{Robot := Id}, #{Robot := Offset}} when N > Offset ->
            freed(Robot, S#serve{plan = starl_dpp_plan:passed(Robot, N - Offset, Plan)});
        _ ->
            {S, []}
    end.

%% @doc The robot's lease has ended, and it was seen at this point: it stands there. The rest of its
%% reservation becomes free, and so do its edges that are not painted.
-spec rests(starl:robot_id(), starl_geometry:point(), t()) -> turn().
rests(Robot, At, #serve{plan = Plan, silent = Silent, waiting = Waiting} = S) ->
    Known = S#serve{
        plan = starl_dpp_plan:silent(Robot, At, Plan),
        silent = lists:usort([Robot | Silent]),
        waiting = lists:delete(Robot, Waiting),
        moving = maps:remove(Robot, S#serve.moving)
    },
    {Freed, Actions} = freed(Robot, Known),
    {Settled, More} = settle(Freed),
    {Settled, [{trace, {silent, Robot}} | Actions ++ More]}.

%% @doc The answer to the robot has arrived, or is perhaps lost.
-spec answered(starl:robot_id(), ok | lost, t()) -> t().
answered(Robot, ok, #serve{told = Told, telling = Telling} = S) ->
    Count = max(maps:get(Robot, Telling, 0), maps:get(Robot, Told, 0)),
    S#serve{told = Told#{Robot => Count}};
answered(_Robot, lost, S) ->
    S.

%% Robots number their requests; an old one does not tell where the robot is now. A number that is too far above
%% is not believed ({@link starl_term}), so that the robot has room for more.
newer(Robot, {_, N} = Id, S) ->
    {_, Latest} = latest(Robot, S),
    Id > latest(Robot, S) andalso starl_term:toward(N, Latest) =:= N.

%% Each time that the robot says so it is nearer.
nearer(Robot, {_, N}, #serve{latest = Latest} = S) ->
    {Series, Known} = latest(Robot, S),
    case starl_term:toward(N, Known) of
        Nearer when Nearer < N -> S#serve{latest = Latest#{Robot => {Series, Nearer}}};
        N -> S
    end.

latest(Robot, #serve{latest = Latest}) -> maps:get(Robot, Latest, {0, 0}).

%% A number that the robot has not come to yet, from a broken computer, would keep its requests out
%% for ever: it is told to go on above it. To a late copy of a request this answer is a stale one.
outnumbered(Robot, Id, #serve{term = Term} = S) ->
    case latest(Robot, S) of
        Latest when Id < Latest ->
            [starl_sap:post(Robot, dpp_answer, {Term, Id, {above, Latest}, []})];
        _ ->
            []
    end.

stands(Robot, Id, At, Painted, #serve{plan = Plan, latest = Latest} = S) ->
    Marked = starl_dpp_plan:mark_painted(Painted, Plan),
    freed(
        Robot,
        alive(Robot, S#serve{
            plan = starl_dpp_plan:standing(Robot, At, Marked),
            latest = Latest#{Robot => Id},
            moving = maps:remove(Robot, S#serve.moving)
        })
    ).

moves(Robot, Id, {N, From, Path}, Painted, #serve{plan = Plan, latest = Latest} = S) ->
    Marked = starl_dpp_plan:mark_painted(Painted, Plan),
    freed(
        Robot,
        alive(Robot, S#serve{
            plan = starl_dpp_plan:adopt(Robot, From, Path, Marked),
            latest = Latest#{Robot => Id},
            moving = (S#serve.moving)#{Robot => N}
        })
    ).

alive(Robot, #serve{silent = Silent} = S) -> S#serve{silent = lists:delete(Robot, Silent)}.

%% The robot holds less than before.
freed(Robot, #serve{open = true, plan = Plan} = S) ->
    Timer = [{{timeout, serve}, ?SERVE_US, serve} || S#serve.waiting =/= []],
    {S, [{trace, {reserved, Robot, starl_dpp_plan:held(Robot, Plan)}} | Timer]};
freed(_Robot, S) ->
    open(S).

open(#serve{leads = true, plan = Plan, term = Term} = S) ->
    case starl_dpp_plan:unknown(Plan) of
        [] ->
            Apart = starl_dpp_plan:apart(Plan),
            Traces = [{trace, {reserved, R, Held}} || {R, Held} <- starl_dpp_plan:unsafe(Apart)],
            {
                S#serve{open = true, stuck = false, plan = Apart},
                [{trace, {coordinator, Term}} | Traces] ++
                    [{{timeout, give_up}, cancel}, {{timeout, serve}, ?SERVE_US, serve}]
            };
        _Unknown ->
            {S, []}
    end;
open(S) ->
    {S, []}.

%% -- serving the robots that wait -----------------------------------------------------------

%% @doc Serves all robots that wait.
-spec serve(t()) -> turn().
serve(#serve{waiting = Waiting} = S) ->
    chain([fun(S1) -> serve_each(Waiting, S1) end, fun settle/1], S).

serve_each(Robots, S) -> chain([fun(S1) -> serve_robot(Robot, S1) end || Robot <- Robots], S).

serve_robot(_Robot, #serve{open = false} = S) ->
    {S, []};
serve_robot(Robot, #serve{plan = Plan} = S) ->
    case starl_dpp_assign:request(Robot, Plan) of
        {{assign, Path}, Next} ->
            assign(Robot, Path, S#serve{plan = Next});
        {complete, Next} ->
            answer(Robot, complete, S#serve{plan = Next});
        {none, Next} ->
            case starl_dpp_assign:make_way(Robot, Next) of
                {{assign, Path}, Last} -> assign(Robot, Path, S#serve{plan = Last});
                {none, Last} -> {S#serve{plan = Last}, []}
            end
    end.

assign(Robot, Path, #serve{plan = Plan, moving = Moving, latest = Latest} = S) ->
    [{From, _} | _] = Held = starl_dpp_plan:held(Robot, Plan),
    Trace = {trace, {assigned, Robot, maps:get(Robot, Latest), Held}},
    Sent = S#serve{moving = Moving#{Robot => 0}, stuck = false},
    {Answered, Actions} = answer(Robot, {assign, From, Path}, Sent),
    {Answered, [Trace | Actions] ++ [{{timeout, give_up}, cancel}]}.

%% The answer carries the painted edges that the robot was not told yet.
answer(Robot, Answer, #serve{waiting = Waiting, latest = Latest, term = Term} = S) ->
    #serve{plan = Plan, told = Told, telling = Telling} = S,
    #{painted := Count} = starl_dpp_plan:counts(Plan),
    News = starl_dpp_plan:painted_since(maps:get(Robot, Told, 0), Plan),
    Body = {Term, maps:get(Robot, Latest), Answer, News},
    Next = S#serve{waiting = lists:delete(Robot, Waiting), telling = Telling#{Robot => Count}},
    {Next, [starl_sap:send(Robot, dpp_answer, Body, {answered, Term, Robot})]}.

%% When the picture is complete, all waiting robots are told. When all wait and no robot moves, some
%% robot must make way.
settle(#serve{waiting = []} = S) ->
    {S, []};
settle(#serve{open = true, plan = Plan, waiting = Waiting} = S) ->
    case starl_dpp_plan:counts(Plan) of
        #{free := 0, assigned := 0} -> serve_each(Waiting, S);
        #{} -> unblock(S)
    end;
settle(S) ->
    %% a robot that cannot be found does not keep the others waiting for ever
    resolve([], S).

unblock(#serve{moving = Moving, waiting = Waiting, plan = Plan} = S) when map_size(Moving) =:= 0 ->
    {Paths, Next} = starl_dpp_assign:resolve(Waiting, Plan),
    resolve(Paths, S#serve{plan = Next});
unblock(S) ->
    {S, []}.

resolve([], #serve{stuck = true} = S) ->
    {S, []};
resolve([], S) ->
    {S#serve{stuck = true}, [{{timeout, give_up}, ?GIVE_UP_US, give_up}]};
resolve(Paths, S) ->
    %% A robot that gets work only had to wait for moving robots: that was no deadlock.
    Away = [Robot || {Robot, Path} <- Paths, not lists:any(fun paints/1, Path)],
    Each = [fun(S1) -> assign(Robot, Path, S1) end || {Robot, Path} <- Paths],
    {Assigned, Actions} = chain(Each, S),
    {Assigned, [{trace, {deadlock_resolved, Away}} || Away =/= []] ++ Actions}.

paints({_Point, Pen}) -> Pen =/= up.

%% @doc A robot at a point could not go on towards another one. All keep away from there for a while.
-spec blocked(At, Towards, t()) -> turn() when
    At :: starl_geometry:point(), Towards :: starl_geometry:point().
blocked(At, Towards, #serve{plan = Plan, closed = Before} = S) ->
    {Segments, Closed} = starl_dpp_plan:close(At, Towards, Plan),
    {Timer, Counted} = try_again(Before, S),
    {Counted#serve{plan = Closed, closed = true}, [{trace, {closed, Segments}} | Timer]}.

%% It is not tried for ever.
try_again(true, S) ->
    {[], S};
try_again(false, #serve{plan = Plan, tries = {N, Then}} = S) ->
    #{painted := Painted} = starl_dpp_plan:counts(Plan),
    Tries =
        case Painted of
            Then -> N + 1;
            _ -> 1
        end,
    {
        [{{timeout, reopen}, ?REOPEN_US, reopen} || Tries =< ?MOST_TRIES],
        S#serve{tries = {Tries, Painted}}
    }.

%% @doc What was closed is perhaps open.
-spec reopen(t()) -> turn().
reopen(#serve{plan = Plan} = S) ->
    Open = S#serve{plan = starl_dpp_plan:reopen(Plan), closed = false},
    {Served, Actions} = serve(Open),
    {Served, [{trace, reopened} | Actions]}.

%% @doc Gives up: no robot moves, nothing can be assigned, and the silent robots have not come back.
-spec give_up(t()) -> turn().
give_up(#serve{waiting = Waiting, plan = Plan} = S) ->
    Left = starl_dpp_free:edges(starl_dpp_plan:free(Plan)),
    {Told, Actions} = chain([fun(S1) -> answer(R, incomplete, S1) end || R <- Waiting], S),
    %% a robot that asks later is told later
    {Told#serve{stuck = false}, in_the_way(S) ++ [{trace, {unreachable, Left}} | Actions]}.

in_the_way(#serve{silent = Silent, plan = Plan}) ->
    [
        {trace, {in_the_way, Robot, [starl_dpp_plan:target(E, Plan) || E <- Edges]}}
     || Robot <- Silent, [_ | _] = Edges <- [starl_dpp_plan:closes(Robot, Plan)]
    ].

chain(Steps, S) ->
    lists:foldl(
        fun(Step, {S1, Actions}) ->
            {Next, More} = Step(S1),
            {Next, Actions ++ More}
        end,
        {S, []},
        Steps
    ).
