%% The order and the age of pictures: doubled, overtaken, delayed, stuck, started anew.
-module(starl_live_frames_tests).
-include_lib("eunit/include/eunit.hrl").

newer_counts_test() ->
    {[{new, [{1, here, 1000}]}, {old, []}, {new, [{1, here, 3000}]}], _} =
        play([{1000, 5, none}, {2000, 4, none}, {3000, 6, none}]).

%% The same number shows other robots, and none a second time.
parts_of_a_picture_test() ->
    F = starl_live_frames:new(),
    {new, [{1, a, 10}], F1} = starl_live_frames:picture(picture(7, none, [{1, a}]), 10, F),
    {same, [{2, b, 20}], F2} = starl_live_frames:picture(
        picture(7, none, [{1, x}, {2, b}]), 20, F1
    ),
    {same, [], _} = starl_live_frames:picture(picture(7, none, [{1, y}, {2, y}]), 30, F2).

%% A source that is stuck sends the same picture again for hours, or counts on without a new time.
stuck_test() ->
    Second = 1000000,
    {[{new, [_]} | Rest], _} = play([{N * Second, 7, 70} || N <- lists:seq(1, 100)]),
    ?assertEqual([{same, []}], lists:usort(Rest)),
    {[{new, [_]} | Later], _} = play([{N * 1000, N, 70} || N <- lists:seq(1, 500)]),
    ?assertEqual([{old, []}], lists:usort(Later)).

%% It counts from one again: after a second without anything newer, the second picture is believed.
started_anew_test() ->
    {Got, _} = play([
        {0, 500, 9000000},
        {900000, 1, 100},
        {1100000, 2, 200000},
        {1200000, 3, 300000},
        {1300000, 4, 400000}
    ]),
    ?assertMatch([{new, _}, {old, []}, {old, []}, {new, [_]}, {new, [_]}], Got),
    %% its clock counts anew, too
    ?assertMatch({new, [{1, here, 1300000}]}, lists:last(Got)).

%% An old picture that comes again and again is no source that has started anew.
old_again_test() ->
    {[_ | Rest], _} = play([{0, 500, none}] ++ [{N * 1000000, 3, none} || N <- lists:seq(2, 50)]),
    ?assertEqual([{old, []}], lists:usort(Rest)).

%% Our clock is 10 s ahead of the source's, and the fastest datagram takes 2 ms more: that is not to be
%% known. One that took 40 ms longer is 40 ms old.
delayed_test() ->
    Sent = [{N, N * 77000, way(N)} || N <- lists:seq(1, 100)],
    {Got, _} = play([{10000000 + T + Way, N, T} || {N, T, Way} <- Sent]),
    [
        ?assertEqual({new, [{1, here, 10000000 + T + 2000}]}, One)
     || {{_, T, _}, One} <- lists:nthtail(5, lists:zip(Sent, Got))
    ].

way(N) when N rem 5 =:= 0 -> 2000;
way(N) -> 2000 + (N * 7919) rem 40000.

%% A clock that goes 0.05 % too slow or too fast: the age stays right to within what it drifts in the
%% ten seconds for which the fastest datagram is remembered, and errs towards too old.
drift_test() ->
    [
        begin
            Times = [{N, round(N * 77000 * Rate)} || N <- lists:seq(1, 2000)],
            {Got, _} = play([{N * 77000, N, Time} || {N, Time} <- Times]),
            Ages = [
                N * 77000 - Taken
             || {{N, _}, {new, [{1, here, Taken}]}} <- lists:zip(Times, Got)
            ],
            ?assertEqual(2000, length(Ages)),
            ?assert(lists:min(Ages) >= 0),
            ?assert(lists:max(Ages) =< 5100, lists:max(Ages))
        end
     || Rate <- [0.9995, 1.0005]
    ].

%% The time from the cameras to the datagram is added.
latency_test() ->
    Picture = (picture(1, none, [{1, a}]))#{age_us := 8000},
    {new, [{1, a, 92000}], _} = starl_live_frames:picture(Picture, 100000, starl_live_frames:new()),
    Timed = (picture(1, 55, [{1, a}]))#{age_us := 8000},
    {new, [{1, a, 92000}], _} = starl_live_frames:picture(Timed, 100000, starl_live_frames:new()).

play(Pictures) ->
    lists:mapfoldl(
        fun({Arrived, Number, Time}, Frames) ->
            Picture = picture(Number, Time, [{1, here}]),
            {Order, Shown, Next} = starl_live_frames:picture(Picture, Arrived, Frames),
            {{Order, Shown}, Next}
        end,
        starl_live_frames:new(),
        Pictures
    ).

picture(Number, Time, Poses) ->
    #{number => Number, time_us => Time, age_us => 0, poses => Poses}.
