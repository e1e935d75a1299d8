%% @doc The coordinator of distributed path planning (the paper's Subroutine 3): messages around
%% {@link starl_dpp_plan}, which does the planning.
%% ```
%%   idle -- first request of anybody --> coordinating
%% '''
%% A coordinator that begins, for the first time or after a crash, knows nothing of the robots:
%% it asks all of them where they are and what they hold (`dpp_recover'), and assigns nothing
%% until it knows of every robot. Robots that wait are served again when something has become
%% free. When nobody moves and all wait, the plan resolves the deadlock. A robot that has not
%% been heard of for long is `silent': it keeps all that it holds, but nobody waits for it. If
%% only silent robots stand between the team and the rest of the picture, those who wait are
%% told `incomplete'.
%%
%% Trace: `{coordinator, Epoch}', `{reserved, Robot, Segments}',
%% `{assigned, Robot, Id, Segments}', `{deadlock_resolved, Robots}', `{silent, Robot}'.
-module(starl_dpp_coordinator).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

%% Waiters are served again so long after something became free.
-define(SERVE_US, 200000).
%% Robots whose place is not known are asked again after so long.
-define(RECOVER_US, 3000000).
%% A robot is silent when it is so much later than its drive would take; and if only silent
%% robots are left to wait for, they have so long to be heard again.
-define(SILENT_US, 30000000).
-define(GIVE_UP_US, 60000000).

-record(coordinator, {
    self :: starl:robot_id(),
    team :: [starl:robot_id()],
    epoch :: pos_integer(),
    config :: starl_dpp:config(),
    plan :: starl_dpp_plan:t() | none,
    %% the latest request of each robot; the ones that wait for an answer, in order of arrival
    latest = #{} :: #{starl:robot_id() => starl_dpp:request_id()},
    waiting = [] :: [starl:robot_id()],
    %% who is on its way, and at which waypoint of its path the plan's view of it begins
    moving = #{} :: #{starl:robot_id() => Offset :: non_neg_integer()},
    silent = [] :: [starl:robot_id()],
    %% nobody moves and nothing can be assigned
    stuck = false :: boolean()
}).

-type state() :: idle | coordinating.
-type transition() :: {#coordinator{}, [starl_machine:action()]}.

-spec init(starl_machine:config()) -> {idle, #coordinator{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Epoch} = Config) ->
    Plan = maps:without([robot, participants, incarnation, name, random, now], Config),
    Members = starl_team:members(Team),
    Data = #coordinator{self = Self, team = Members, epoch = Epoch, config = Plan, plan = none},
    {idle, Data, listen()}.

-spec handle_event(
    starl_machine:event_type(), term(), state(), #coordinator{}, starl_machine:meta()
) -> starl_machine:result().
handle_event(cast, {message, Robot, Type, Body}, State, Data, _Meta) ->
    message(Robot, Type, Body, State, Data);
handle_event({timeout, serve}, _, coordinating, Data, _Meta) ->
    keep(serve(Data));
handle_event({timeout, recover}, _, coordinating, Data, _Meta) ->
    keep(ask_unknown(Data));
handle_event({timeout, {silent, Robot}}, _, coordinating, Data, _Meta) ->
    keep(silent(Robot, Data));
handle_event({timeout, give_up}, _, coordinating, Data, _Meta) ->
    keep(give_up(Data));
handle_event({reply, {answered, Robot}}, {error, _}, coordinating, Data, _Meta) ->
    keep(silent(Robot, Data));
handle_event({reply, {answered, _}}, ok, _State, _Data, _Meta) ->
    keep_state_and_data;
handle_event(info, {restarted, sap}, _State, _Data, _Meta) ->
    {keep_state_and_data, listen()};
handle_event(info, {restarted, _}, _State, _Data, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

listen() ->
    [
        starl_sap:listen(Type, dpp_coordinator)
     || Type <- [dpp_request, dpp_passed, dpp_state]
    ].

keep({Data, Actions}) -> {keep_state, Data, Actions}.

message(Robot, Type, Body, idle, Data) ->
    {Begun, Actions} = start(Data),
    {Next, More} = heard(Robot, Type, Body, Begun),
    {next_state, coordinating, Next, Actions ++ More};
message(Robot, Type, Body, coordinating, Data) ->
    keep(heard(Robot, Type, Body, Data)).

start(#coordinator{config = Config, team = Team, epoch = Epoch, self = Self} = Data) ->
    {ok, Plan} = starl_dpp_plan:new((maps:remove(speed, Config))#{robots => Team}),
    {Asked, Actions} = ask_unknown(Data#coordinator{plan = Plan}),
    Own = starl_sap:post(Self, dpp_recover, Epoch),
    {Asked, [{trace, {coordinator, Epoch}}, Own | Actions]}.

%% One packet for all at first; those that have not answered are asked again one by one.
ask_unknown(#coordinator{plan = Plan, epoch = Epoch, team = Team} = Data) ->
    Unknown = starl_dpp_plan:unknown(Plan),
    Messages =
        if
            Unknown =:= [] -> [];
            Unknown =:= Team -> [{cast, sap, {broadcast, dpp_recover, Epoch}}];
            true -> [starl_sap:post(Robot, dpp_recover, Epoch) || Robot <- Unknown]
        end,
    {Data, Messages ++ [{{timeout, recover}, ?RECOVER_US, recover} || Messages =/= []]}.

%% -- what robots say ------------------------------------------------------------------------

-spec heard(starl:robot_id(), atom(), term(), #coordinator{}) -> transition().
heard(Robot, dpp_request, {Id, At, Painted}, Data) ->
    case newer(Robot, Id, Data) of
        true -> requested(Robot, Id, At, Painted, alive(Robot, Data));
        false -> {Data, []}
    end;
heard(Robot, dpp_passed, {Id, N}, #coordinator{latest = Latest, moving = Moving} = Data) ->
    case {Latest, Moving} of
        {#{Robot := Id}, #{Robot := Offset}} when N > Offset ->
            Plan = starl_dpp_plan:passed(Robot, N - Offset, Data#coordinator.plan),
            freed(Robot, (alive(Robot, Data))#coordinator{plan = Plan});
        _ ->
            {Data, []}
    end;
heard(Robot, dpp_state, {Epoch, Id, Where, Painted}, #coordinator{epoch = Epoch} = Data) ->
    case newer(Robot, Id, Data) of
        true -> located(Robot, Id, Where, Painted, alive(Robot, Data));
        false -> {Data, []}
    end;
heard(_Robot, dpp_state, _Earlier, Data) ->
    {Data, []}.

%% Robots number their requests; an old one says nothing of where the robot is now.
newer(Robot, Id, #coordinator{latest = Latest}) -> Id > maps:get(Robot, Latest, {0, 0}).

alive(Robot, #coordinator{silent = Silent} = Data) ->
    Data#coordinator{silent = lists:delete(Robot, Silent)}.

requested(Robot, Id, At, Painted, #coordinator{waiting = Waiting} = Data) ->
    Asking = lists:delete(Robot, Waiting) ++ [Robot],
    {Freed, Actions} = stands(Robot, Id, At, Painted, Data#coordinator{waiting = Asking}),
    {Served, Answers} = serve_robot(Robot, Freed),
    {Settled, More} = settle(Served),
    {Settled, Actions ++ Answers ++ More}.

located(Robot, Id, {standing, At}, Painted, Data) ->
    stands(Robot, Id, At, Painted, Data);
located(Robot, Id, {moving, Offset, From, Path}, Painted, Data) ->
    #coordinator{plan = Plan0, latest = Latest, moving = Moving} = Data,
    Marked = starl_dpp_plan:mark_painted(Painted, Plan0),
    Plan =
        case Path of
            [] -> starl_dpp_plan:standing(Robot, From, Marked);
            _ -> starl_dpp_plan:adopt(Robot, From, Path, Marked)
        end,
    freed(Robot, Data#coordinator{
        plan = Plan, latest = Latest#{Robot => Id}, moving = Moving#{Robot => Offset}
    }).

stands(Robot, Id, At, Painted, #coordinator{plan = Plan, latest = Latest} = Data) ->
    Marked = starl_dpp_plan:mark_painted(Painted, Plan),
    freed(Robot, Data#coordinator{
        plan = starl_dpp_plan:standing(Robot, At, Marked),
        latest = Latest#{Robot => Id},
        moving = maps:remove(Robot, Data#coordinator.moving)
    }).

%% The robot holds less than before.
freed(Robot, #coordinator{plan = Plan} = Data) ->
    Timers =
        watch(Robot, Data) ++
            [{{timeout, serve}, ?SERVE_US, serve} || Data#coordinator.waiting =/= []],
    {Data, [{trace, {reserved, Robot, held(Robot, Plan)}} | Timers]}.

held(Robot, Plan) ->
    {Robot, Segments} = lists:keyfind(Robot, 1, starl_dpp_plan:unsafe(Plan)),
    Segments.

%% -- serving those who wait -----------------------------------------------------------------

serve(#coordinator{waiting = Waiting} = Data) ->
    {Served, Actions} = lists:foldl(
        fun(Robot, {D, As}) ->
            {Next, More} = serve_robot(Robot, D),
            {Next, As ++ More}
        end,
        {Data, []},
        Waiting
    ),
    {Settled, More} = settle(Served),
    {Settled, Actions ++ More}.

-spec serve_robot(starl:robot_id(), #coordinator{}) -> transition().
serve_robot(Robot, #coordinator{plan = Plan} = Data) ->
    case starl_dpp_assign:request(Robot, Plan) of
        {{assign, Path}, Next} ->
            assign(Robot, Path, Data#coordinator{plan = Next});
        {complete, Next} ->
            answer(Robot, complete, Data#coordinator{plan = Next});
        {none, Next} ->
            case starl_dpp_assign:make_way(Robot, Next) of
                {{assign, Path}, Last} -> assign(Robot, Path, Data#coordinator{plan = Last});
                {none, Last} -> {Data#coordinator{plan = Last}, []}
            end
    end.

assign(Robot, Path, #coordinator{plan = Plan, moving = Moving, latest = Latest} = Data) ->
    Trace = {trace, {assigned, Robot, maps:get(Robot, Latest), held(Robot, Plan)}},
    Sent = Data#coordinator{moving = Moving#{Robot => 0}, stuck = false},
    {Answered, Actions} = answer(Robot, {assign, Path}, Sent),
    Timers = [{{timeout, give_up}, cancel} | watch(Robot, Answered)],
    {Answered, [Trace | Actions] ++ Timers}.

answer(Robot, Answer, #coordinator{waiting = Waiting, latest = Latest, epoch = Epoch} = Data) ->
    Body = {Epoch, maps:get(Robot, Latest), Answer},
    {Data#coordinator{waiting = lists:delete(Robot, Waiting)}, [
        starl_sap:send(Robot, dpp_answer, Body, {answered, Robot})
    ]}.

%% When all wait and nobody moves, somebody must make way; when the picture is complete, all
%% are told.
settle(#coordinator{waiting = []} = Data) ->
    {Data, []};
settle(#coordinator{plan = Plan, waiting = Waiting, moving = Moving, silent = Silent} = Data) ->
    Active = maps:keys(Moving) -- Silent,
    case starl_dpp_plan:unknown(Plan) of
        [] when Active =:= [] ->
            {Paths, Next} = starl_dpp_assign:resolve(Waiting, Plan),
            resolve(Paths, Data#coordinator{plan = Next});
        [] ->
            {Data, []};
        _Unknown ->
            %% nothing can be assigned before all are known
            resolve([], Data)
    end.

resolve([], #coordinator{stuck = true} = Data) ->
    {Data, []};
resolve([], Data) ->
    {Data#coordinator{stuck = true}, [{{timeout, give_up}, ?GIVE_UP_US, give_up}]};
resolve(Paths, Data) ->
    Trace = {trace, {deadlock_resolved, [Robot || {Robot, _} <- Paths]}},
    lists:foldl(
        fun({Robot, Path}, {D, Actions}) ->
            {Next, More} = assign(Robot, Path, D),
            {Next, Actions ++ More}
        end,
        {Data, [Trace]},
        Paths
    ).

%% -- silent robots --------------------------------------------------------------------------

%% How long until a robot on its way counts as silent.
watch(Robot, #coordinator{moving = Moving, plan = Plan, config = #{speed := Speed}}) ->
    case Moving of
        #{Robot := _} ->
            Length = lists:sum([starl_geometry:length(S) || S <- held(Robot, Plan)]),
            Us = ?SILENT_US + round(4.0e6 * Length / Speed),
            [{{timeout, {silent, Robot}}, Us, silent}];
        #{} ->
            [{{timeout, {silent, Robot}}, cancel}]
    end.

silent(Robot, #coordinator{silent = Silent, waiting = Waiting} = Data) ->
    Known = Data#coordinator{
        silent = lists:usort([Robot | Silent]), waiting = lists:delete(Robot, Waiting)
    },
    {Settled, Actions} = settle(Known),
    {Settled, [{trace, {silent, Robot}} | Actions]}.

%% Nobody moves, nothing can be assigned, and the silent robots have not come back.
give_up(#coordinator{waiting = Waiting} = Data) ->
    lists:foldl(
        fun(Robot, {D, Actions}) ->
            {Next, More} = answer(Robot, incomplete, D),
            {Next, Actions ++ More}
        end,
        {Data, []},
        Waiting
    ).
