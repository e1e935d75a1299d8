%% @doc Bounds how far the clocks of robots are ahead of the time line: a window for each clock.
-module(starl_debug_clocks).

-export([windows/3, widest/1]).

-export_type([bounds/0]).

%% Bounds of pairs of clocks, from messages ({@link starl_debug_envelope}).
-type bounds() :: starl_debug_envelope:t().

%% @doc The windows of these robots' clocks in a slice of time. Of two robots the time line is the
%% clock of the first. Of more it is a common time from which no clock is farther than half of
%% sigma, which exists if any two clocks agree to within sigma; or, by messages, the clock of the
%% robot that the others are known best by.
-spec windows([starl:robot_id()], starl_debug_set:interval(), non_neg_integer() | bounds()) ->
    starl_debug_eval:windows().
windows([], _Slice, _Sigma) ->
    #{};
windows([R], _Slice, _Sigma) ->
    #{R => {0, 0}};
windows([R, Q], _Slice, Sigma) when is_integer(Sigma) ->
    #{R => {0, 0}, Q => {-Sigma, Sigma}};
windows(Robots, _Slice, Sigma) when is_integer(Sigma) ->
    Half = (Sigma + 1) div 2,
    maps:from_keys(Robots, {-Half, Half});
windows(Robots, Slice, Bounds) ->
    Each = [
        maps:from_list([{Q, starl_debug_envelope:offset(R, Q, Slice, Bounds)} || Q <- Robots])
     || R <- first([Robots])
    ],
    {_, Best} = lists:min([
        {lists:sum([Hi - Lo || {Lo, Hi} <- maps:values(Windows)]), Windows}
     || Windows <- Each
    ]),
    Best.

%% Of two robots the first is as good as the second.
first([[R, _]]) -> [R];
first([Robots]) -> Robots.

%% @doc The greatest difference of two clocks (us).
-spec widest(non_neg_integer() | bounds()) -> non_neg_integer().
widest(Sigma) when is_integer(Sigma) -> Sigma;
widest(Bounds) -> starl_debug_envelope:widest(Bounds).
