%% @doc Messages that can be left out: those that change nothing when they arrive, now and for
%% ever, may as well have arrived already.
%%
%% Now is tried out. For ever is at first taken for granted, of messages whose kind the model names
%% ({@link starl_check_model:may_be_inert/3}), and proved in the end: {@link is_proved/3} tries
%% each message that was left out on everything that its receiver can have become since, by
%% the steps that robots were seen to make (more than were possible, as it does not ask when a
%% step could be made), and by the changes of places that states are told apart by. If one of them
%% changes anything, the search must be done again without leaving out.
%%
%% Only when no machine can crash any more: a machine that starts anew has forgotten.
-module(starl_check_inert).

-export([without/3, is_proved/3]).

-type store() :: starl_check_store:t().
-type model() :: starl_check_model:t().
-type ref() :: starl_check_part:ref().
%% A message that has been left out, and a robot that it would come to.
-type claim() :: {Item :: ref(), Robot :: ref()}.

%% @doc The state without those messages.
-spec without(starl_check_state:t(), model(), store()) -> starl_check_state:t().
without(#{crash := 0, sap := 0, reboot := 0} = State, #{leave_out := true} = Model, Store) ->
    #{items := Items, robots := Robots} = State,
    Conditions = [starl_check_part:condition(R, Store) || R <- tuple_to_list(Robots)],
    case lists:member(down, Conditions) of
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
    {Robot, [], none, none} =:= starl_check_part:event(To, Robot, I, Model, Store).

%% @doc Would all messages that were left out have changed nothing at any time since?
-spec is_proved([starl_check_term:permutation()], model(), store()) -> boolean().
is_proved(Permutations, Model, Store) ->
    Claims = starl_check_store:fold(fun claim/3, [], Store),
    Steps = starl_check_store:fold(fun step/3, #{}, Store),
    hold(Claims, maps:from_keys(Claims, []), Steps, {Permutations, Model, Store}).

claim({inert, I, Robot}, true, Claims) -> [{I, Robot} | Claims];
claim(_, _, Claims) -> Claims.

%% Where a step leads to, if it is one of a robot.
step({Robot, {crash, _}}, _, Steps) when is_integer(Robot) -> Steps;
step({Robot, Event}, _, Steps) when is_integer(Robot), is_atom(Event) -> Steps;
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
