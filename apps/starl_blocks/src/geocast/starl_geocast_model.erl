%% @doc The model of geocast for the exhaustive checker: one message to an area that all robots are
%% in, its lifetime, and its window. The source's clock is the true one; the second robot's clock is
%% slow, so it holds the message for longest; the others are fast.
-module(starl_geocast_model).

-export([new/1]).

%% A message's lifetime, and a part of it that is told from the next.
-define(CAST_US, 400000).
-define(TICK_US, 50000).
%% Parts of a hundred: the ratio is the default bound on drift, 10000 ppm.
-define(SLOW, 99).
-define(FAST, 101).

%% @doc The model for a team.
-spec new(starl_block:team()) -> starl_block:model().
new(#{robots := Ids}) ->
    Config = #{
        jitter_ms => 0,
        gather_ms => 0,
        check_ms => ?CAST_US div 2000,
        listeners => #{note => app}
    },
    #{
        blocks => [{geocast, starl_geocast_flood, Config}],
        stands => [location],
        script => fun script/1,
        crash => [geocast],
        monitor => {starl_geocast_model_monitor, #{robots => Ids, lifetime_us => ?CAST_US}},
        timed => [offer, give, ask, over, forget, check, window],
        rates => list_to_tuple([rate(Place) || Place <- places(Ids)]),
        grain => 2,
        horizon_us => 2 * ?CAST_US,
        past_us => 2 * ?CAST_US,
        fixed => places(Ids)
    }.

places(Ids) -> lists:seq(1, length(Ids)).

%% All robots are inside.
script(1) ->
    Area = {circle, {0.0, 0.0}, 1.0e6},
    [{'try', geocast, {send, Area, note, hello, ?CAST_US, 8}}, {window, ?CAST_US}];
script(_) ->
    [].

rate(1) -> ?TICK_US;
rate(2) -> ?TICK_US * ?SLOW div 100;
rate(_) -> ?TICK_US * ?FAST div 100.
