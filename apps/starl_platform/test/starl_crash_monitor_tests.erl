%% No machine crashes by itself: which crashes are violations, which are excused, and what is told.
-module(starl_crash_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(STACK, [{starl_door, open, 2, "starl_door.erl", 7}]).

cause(Reason) -> {Reason, ?STACK}.

crashed(T, Robot, Machine) -> crashed(T, Robot, Machine, "badarg").

crashed(T, Robot, Machine, Reason) ->
    {T, Robot, supervisor, {crashed, Machine, cause(Reason)}}.

given_up(Robot, Machine) -> {9, Robot, supervisor, {given_up, Machine}}.

%% The violations of a trace, and the results.
run(Config, Events) ->
    M0 = starl_monitor:new([{starl_crash_monitor, Config}]),
    {Found, M} = lists:foldl(
        fun(Event, {Acc, Monitor}) ->
            case starl_monitor:step(Event, Monitor) of
                {ok, Next} -> {Acc, Next};
                {violation, V, Next} -> {Acc ++ [V], Next}
            end
        end,
        {[], M0},
        Events
    ),
    {[], #{starl_crash_monitor := Results}} = starl_monitor:finish(100, M),
    {Found, Results}.

none() -> #{crashes => 0, causes => 0, first_crash => none, given_up => []}.

no_crash_test() ->
    ?assertEqual({[], none()}, run(#{}, [])).

%% The contract is the machine's; the reason and the place are told.
crash_test() ->
    {[Violation], Results} = run(#{}, [crashed(5, 2, door)]),
    ?assertEqual(none(), Results),
    #{details := #{reason := "badarg", stack := Stack} = Details} = Violation,
    ?assertEqual(
        #{contract => door, what => crashed, at_us => 5, robots => [2], details => Details},
        Violation
    ),
    ?assertEqual([reason, stack], maps:keys(Details)),
    ?assertMatch({match, _}, re:run(Stack, "starl_door:open/2.*starl_door.erl:7")),
    ?assertEqual(string:trim(Stack), Stack).

%% What is one robot's is not another's: each crash is a violation.
each_crash_test() ->
    {Found, _} = run(#{}, [crashed(5, 2, door), crashed(6, 3, door), crashed(7, 2, bell)]),
    ?assertEqual(
        [{5, [2], door}, {6, [3], door}, {7, [2], bell}],
        [{At, R, C} || #{at_us := At, robots := R, contract := C} <- Found]
    ).

%% The crashes of machines that may crash are counted, and the first is kept.
excused_test() ->
    Config = #{excused => [app, bell]},
    Crashed = [{5, 2, app, "one"}, {6, 1, bell, "two"}, {7, 2, app, "three"}, {8, 2, app, "one"}],
    Events = [crashed(T, Robot, Machine, Reason) || {T, Robot, Machine, Reason} <- Crashed],
    {[], Results} = run(Config, Events),
    First = {5, 2, app, cause("one")},
    ?assertEqual((none())#{crashes := 4, causes := 3, first_crash := First}, Results),
    {[#{contract := door}], Mixed} = run(Config, [crashed(4, 1, door) | Events]),
    ?assertEqual(Results, Mixed).

%% Who is not started any more is told, in order.
given_up_test() ->
    Events = [given_up(3, app), given_up(1, door), given_up(2, app)],
    ?assertEqual(
        {[], (none())#{given_up := [{1, door}, {2, app}, {3, app}]}}, run(#{}, Events)
    ).
