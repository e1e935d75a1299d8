%% Mistakes in the monitor of a model: found before the search, or ending it, each with its place.
-module(starl_check_judge_tests).
-include_lib("eunit/include/eunit.hrl").

-export([init/1, step/2, finish/2]).

%% A monitor of which nothing is loaded yet is none with a mistake.
shipped_monitors_need_not_be_loaded_test() ->
    _ = code:purge(starl_mutex_model_monitor),
    _ = code:delete(starl_mutex_model_monitor),
    ?assertEqual(ok, starl_check_judge:check({starl_mutex_model_monitor, #{}}, [mutex])).

%% This module is a monitor that the checker cannot use.
timeless_is_missing_test() ->
    {error, Line} = starl_check_judge:check({?MODULE, #{}}, [relay]),
    ?assertMatch({match, _}, re:run(Line, "timeless/1 is missing")).

absent_test() ->
    {error, Line} = starl_check_judge:check({no_such_monitor, #{}}, [relay]),
    ?assertEqual("there is no module no_such_monitor", unicode:characters_to_list(Line)).

%% What is no answer ends the search; the first violation is one.
read_test() ->
    Told = [{0, 1, relay, Event} || Event <- [said, said]],
    ?assertEqual({ok, 2}, starl_check_judge:read(Told, ?MODULE, 0)),
    Broken = [{0, 1, relay, broken} | Told],
    ?assertMatch({violation, #{what := w}}, starl_check_judge:read(Broken, ?MODULE, 0)),
    [
        ?assertMatch(
            {Event, {'EXIT', {mistake, <<_/binary>>}}},
            {Event, catch starl_check_judge:read([{0, 1, relay, Event}], ?MODULE, 0)}
        )
     || Event <- [no_answer, no_violation, crash]
    ],
    ?assertExit({mistake, _}, starl_check_judge:timeless(?MODULE, 0)).

init(#{}) -> 0.

step({_, _, _, said}, N) ->
    {ok, N + 1};
step({_, _, _, no_answer}, N) ->
    {violation, N};
step({_, _, _, no_violation}, N) ->
    {violation, #{what => w}, N};
step({_, _, _, crash}, N) ->
    {ok, hd(N)};
step({T, R, _, broken}, N) ->
    {violation, #{contract => c, what => w, at_us => T, robots => [R], details => #{}}, N}.

finish(_EndUs, _N) -> {ok, #{}}.
