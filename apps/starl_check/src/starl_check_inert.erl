%% @doc Finds inert messages, which the search may leave out: a message whose arrival changes
%% nothing, now or later, may be treated as already arrived.
%%
%% Whether a message changes anything now is tried out. That it will never change anything is first
%% assumed, for messages of the kinds named by the model ({@link starl_check_model:may_be_inert/3}),
%% and proved at the end of the search. {@link is_proved/3} tries each omitted message on every
%% state that its receiver can have reached since, by all steps observed at robots (a superset of
%% the possible steps, because it ignores when a step can happen) and by all permutations of robots
%% that the search uses. If a message changes anything, the search must be repeated without
%% omissions.
%%
%% Messages are left out only when no machine can crash any more, because a restarted machine has
%% forgotten, and while no robot is stalled, because nothing arrives at a stalled robot.
-module(starl_check_inert).

-export([without/3, is_proved/3]).

-type store() :: starl_check_store:t().
-type model() :: starl_check_model:t().
-type ref() :: starl_check_part:ref().
%% An omitted message, and the state of the robot that would receive it.
-type claim() :: {Item :: ref(), Robot :: ref()}.

%% @doc The state without its inert messages.
-spec without(starl_check_state:t(), model(), store()) -> starl_check_state:t().
without(#{crash := 0, sap := 0, reboot := 0} = State, #{leave_out := true} = Model, Store) ->
    #{items := Items, robots := Robots} = State,
    Conditions = [starl_check_part:condition(R, Store) || R <- tuple_to_list(Robots)],
    case
        lists:any(fun(Condition) -> Condition =:= down orelse Condition =:= stands end, Conditions)
    of
        false -> State#{items := [I || I <- Items, not is_inert(I, State, Model, Store)]};
        true -> State
    end;
without(State, _Model, _Store) ->
    State.

is_inert(I, #{robots := Robots}, Model, Store) ->
    Robot = element(starl_check_part:receiver(I), Robots),
    starl_check_store:memo(
        {inert, I, Robot},
        fun() -> may_be_inert(I, Model, Store) andalso is_idle({I, Robot}, Model, Store) end,
        Store
    ).

may_be_inert(I, Model, Store) ->
    case starl_check_part:item(I, Store) of
        {message, _, _, Type, Body, none, _} ->
            starl_check_model:may_be_inert(Type, Body, Model);
        _ ->
            false
    end.

is_idle({I, Robot}, Model, Store) ->
    To = starl_check_part:receiver(I),
    starl_check_part:condition(Robot, Store) =:= stands orelse
        {Robot, [], none, none} =:= starl_check_part:event(To, Robot, I, Model, Store).

%% @doc Whether none of the omitted messages would have changed anything at any later time.
-spec is_proved([starl_check_term:permutation()], model(), store()) -> boolean().
is_proved(Permutations, Model, Store) ->
    Claims = starl_check_store:fold(fun claim/3, [], Store),
    Steps = starl_check_store:fold(fun step/3, #{}, Store),
    hold(Claims, maps:from_keys(Claims, []), Steps, {Permutations, Model, Store}).

claim({inert, I, Robot}, true, Claims) -> [{I, Robot} | Claims];
claim(_, _, Claims) -> Claims.

%% Adds the successor of a remembered step, if it is a step of a robot.
step({Robot, {crash, _}}, _, Steps) when is_integer(Robot) -> Steps;
step({Robot, Event}, _, Steps) when is_integer(Robot), is_atom(Event), Event =/= go_on -> Steps;
step({Robot, _Event}, {Next, _, _, _}, Steps) when is_integer(Robot) -> add(Robot, Next, Steps);
step({later, Robot, _Ticks}, Next, Steps) -> add(Robot, Next, Steps);
step(_, _, Steps) -> Steps.

add(Robot, Robot, Steps) ->
    Steps;
add(Robot, Next, Steps) ->
    maps:update_with(Robot, fun(Others) -> [Next | Others] end, [Next], Steps).

hold([], _Known, _Steps, _Context) ->
    true;
hold([Claim | Claims], Known, Steps, {_, Model, Store} = Context) ->
    is_idle(Claim, Model, Store) andalso
        begin
            More = [New || New <- follow(Claim, Steps, Context), not is_map_key(New, Known)],
            hold(More ++ Claims, lists:foldl(fun note/2, Known, More), Steps, Context)
        end.

note(Claim, Known) -> Known#{Claim => []}.

-spec follow(claim(), #{ref() => [ref()]}, tuple()) -> [claim()].
follow({I, Robot}, Steps, {Permutations, _Model, Store}) ->
    [{I, Next} || Next <- lists:usort(maps:get(Robot, Steps, []))] ++
        [
            {
                starl_check_part:renamed_item(Permutation, I, Store),
                starl_check_part:renamed_robot(Permutation, Robot, Store)
            }
         || Permutation <- Permutations
        ].
