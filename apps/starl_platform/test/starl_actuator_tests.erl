%% An actuator is told until its sensor shows that it is as wanted: what a caller is answered, and
%% when.
-module(starl_actuator_tests).
-include_lib("eunit/include/eunit.hrl").

-define(FROM, {app, 1}).
-define(AGAIN, {timeout, pen}).

%% The answer comes with the word of the device, not with the command.
waits_for_the_device_test() ->
    {[{actuate, pen, down, N}, {?AGAIN, Us, again}], A} = set(down, ?FROM, fresh()),
    ?assert(Us > 0),
    ?assertEqual([{?AGAIN, cancel}, {reply, ?FROM, ok}], said(says(N, down, A))),
    %% said twice, it is heard once
    {_, Done} = says(N, down, A),
    ?assertEqual([], said(says(N, down, Done))),
    ?assertEqual([], said(step(?AGAIN, again, Done))).

%% A device that is not as it should be, or has not answered, is told again; what it says of an
%% earlier command is no answer to the last.
again_test() ->
    {[{actuate, pen, down, N}, _], A} = set(down, ?FROM, fresh()),
    {[], Stuck} = says(N, up, A),
    {[{actuate, pen, down, N2}, {?AGAIN, _, again}], Again} = step(?AGAIN, again, Stuck),
    ?assertNotEqual(N, N2),
    ?assertEqual([], said(says(N, down, Again))),
    ?assertMatch([_, {reply, ?FROM, ok}], said(says(N2, down, Again))).

%% Who wants something else first is served; the other one hears so.
replaced_test() ->
    {[{actuate, pen, down, N}, _], A} = set(down, ?FROM, fresh()),
    {[Replaced, {actuate, pen, up, N2}, _], B} = set(up, {app, 2}, A),
    ?assertEqual({reply, ?FROM, {error, replaced}}, Replaced),
    ?assertEqual([], said(says(N, down, B))),
    ?assertMatch([_, {reply, {app, 2}, ok}], said(says(N2, up, B))).

%% Two devices at a time.
devices_test() ->
    {[{actuate, pen, down, N}, _], A} = set(down, ?FROM, fresh()),
    {[{actuate, lamp, on, M}, {{timeout, lamp}, _, again}], B} =
        step({call, {app, 2}}, {set, lamp, on}, A),
    {[_, {reply, {app, 2}, ok}], C} = step(info, {actuated, M, lamp, on}, B),
    ?assertMatch([_, {reply, ?FROM, ok}], said(says(N, down, C))).

%% A machine that was restarted believes no answer to a command of its former life.
restarted_test() ->
    {[{actuate, pen, down, N}, _], _} = set(down, ?FROM, fresh(1)),
    {[{actuate, pen, down, M}, _], _} = set(down, ?FROM, fresh(2)),
    ?assertNotEqual(N, M).

%% However often they are repeated, the numbers of its commands are those of no other life.
repeated_commands_keep_the_numbers_of_their_life_test() ->
    {[{actuate, pen, down, First}, _], A} = set(down, ?FROM, fresh(2)),
    {Numbers, _} = lists:mapfoldl(
        fun(_, Told) ->
            {[{actuate, pen, down, N}, _], Next} = step(?AGAIN, again, Told),
            {N, Next}
        end,
        A,
        lists:seq(1, 3)
    ),
    ?assertEqual([2, 2, 2, 2], [N bsr 32 || N <- [First | Numbers]]).

%% A caller whose actuator has crashed does not know what became of its call, and is told so.
a_restart_is_an_answer_test() ->
    Set = fun(Answer) ->
        {Outcome, _} = starl_platform_ct:application(
            fun(Robot) -> starl_actuator:set(Robot, pen, down) end,
            fun(actuator, {set, pen, down}) -> Answer end,
            1
        ),
        Outcome
    end,
    ?assertEqual(
        [ok, {error, replaced}, {error, restarted}],
        [Set(Answer) || Answer <- [{reply, ok}, {reply, {error, replaced}}, restarted]]
    ).

%% What is shown rests on nothing; that a call returns, on a device that moves.
what_each_guarantee_rests_on_test() ->
    ?assertEqual(
        [{shown, []}, {set, [devices]}],
        [{Name, Needs} || {Name, _, _, Needs} <- starl_actuator:guarantees()]
    ).

unknown_event_test() ->
    ?assertEqual(unknown_event, starl_actuator:handle_event(cast, hello, ready, fresh(), meta())).

%% -- helpers --------------------------------------------------------------------------------

fresh() -> fresh(1).

fresh(Incarnation) ->
    {ready, A, []} = starl_actuator:init(#{
        robot => 1,
        participants => [1],
        name => actuator,
        incarnation => Incarnation,
        random => rand:seed_s(exsss, 1),
        now => 0
    }),
    A.

meta() -> #{now => 0, robot => 1}.

set(Value, From, A) -> step({call, From}, {set, pen, Value}, A).

says(N, State, A) -> step(info, {actuated, N, pen, State}, A).

said({Actions, _}) -> Actions.

step(Type, Content, A) ->
    case starl_actuator:handle_event(Type, Content, ready, A, meta()) of
        {keep_state, Next, Actions} -> {Actions, Next};
        keep_state_and_data -> {[], A}
    end.
