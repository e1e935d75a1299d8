%% What a robot knows of where it stands and drives, and of what is painted.
-module(starl_dpp_progress_tests).
-include_lib("eunit/include/eunit.hrl").

-define(PATH, [{{100.0, 0.0}, up}, {{100.0, 300.0}, {down, 7}}]).

moving() -> {moving, {1, 1}, {0.0, 0.0}, ?PATH}.

begun() -> starl_dpp_progress:begins({0.0, 0.0}, starl_dpp_progress:new(10.0)).

%% Stopped, and seen at a point.
stopped(At, Track) -> starl_dpp_progress:stands(At, starl_dpp_progress:halted(moving(), Track)).

%% Where it counts as standing.
nominal(Track) ->
    {standing, At} = starl_dpp_progress:place(standing, Track),
    At.

%% Its own painted edges that it has to tell, and all that it knows of.
painted(Track) ->
    Request = starl_dpp_progress:request({1, 1}, {1, 1}, 0, Track),
    {element(4, Request), starl_dpp_progress:painted(Track)}.

%% Near its path a robot counts as standing on it; that is what it holds from then on.
near_its_path_it_counts_as_on_it_test() ->
    ?assertEqual({50.0, 0.0}, nominal(stopped({50.0, 9.0}, begun()))),
    ?assertEqual({50.0, 11.0}, nominal(stopped({50.0, 11.0}, begun()))),
    Stands = stopped({50.0, 0.0}, begun()),
    Again = fun(At) ->
        nominal(starl_dpp_progress:stands(At, starl_dpp_progress:halted(asking, Stands)))
    end,
    ?assertEqual({50.0, 0.0}, Again({55.0, 0.0})),
    ?assertEqual({70.0, 5.0}, Again({70.0, 5.0})).

%% The waypoints that it has reached are behind it.
waypoints_reached_are_behind_it_test() ->
    ?assertEqual({moving, 0, {0.0, 0.0}, ?PATH}, starl_dpp_progress:place(moving(), begun())),
    One = starl_dpp_progress:reached(1, hd(?PATH), begun()),
    ?assertEqual({moving, 1, {100.0, 0.0}, tl(?PATH)}, starl_dpp_progress:place(moving(), One)),
    ?assertEqual({100.0, 3.0}, starl_dpp_progress:at(stopped({100.0, 3.0}, One))),
    ?assertEqual({50.0, 5.0}, nominal(stopped({50.0, 5.0}, One))),
    Two = starl_dpp_progress:reached(2, lists:last(?PATH), One),
    ?assertEqual({moving, 2, {100.0, 300.0}, []}, starl_dpp_progress:place(moving(), Two)),
    ?assertEqual({100.0, 300.0}, nominal(stopped({100.0, 295.0}, Two))).

%% The space behind it is free after 400 mm.
it_reports_what_it_has_driven_test() ->
    One = starl_dpp_progress:reached(1, hd(?PATH), begun()),
    Two = starl_dpp_progress:reached(2, lists:last(?PATH), One),
    ?assertNot(starl_dpp_progress:is_report_due(One)),
    ?assert(starl_dpp_progress:is_report_due(Two)),
    ?assertNot(starl_dpp_progress:is_report_due(starl_dpp_progress:reported(Two))),
    ?assertNot(starl_dpp_progress:is_report_due(starl_dpp_progress:begins({7.0, 7.0}, Two))).

%% What it has painted is fresh until a request that told of it is answered.
painted_edges_are_fresh_until_an_answer_test() ->
    Two = starl_dpp_progress:reached(2, lists:last(?PATH), begun()),
    ?assertEqual({[7], [7]}, painted(Two)),
    Answered = starl_dpp_progress:answered([3, 9], Two),
    ?assertEqual({[], [3, 7, 9]}, painted(Answered)),
    ?assertEqual({[], [3, 7, 9]}, painted(starl_dpp_progress:answered([], Answered))).

%% What was in its way is told with its requests until one is answered, wherever it stands meanwhile.
what_was_in_its_way_is_told_until_an_answer_test() ->
    Request = fun(Track) -> starl_dpp_progress:request(term, {1, 2}, 9, Track) end,
    Stands = stopped({50.0, 0.0}, begun()),
    ?assertEqual({term, {1, 2}, {50.0, 0.0}, [], 9}, Request(Stands)),
    Blocked = starl_dpp_progress:blocked({100.0, 0.0}, Stands),
    ?assertEqual({term, {1, 2}, {50.0, 0.0}, [], 9, {100.0, 0.0}}, Request(Blocked)),
    Again = stopped({40.0, 0.0}, starl_dpp_progress:begins({50.0, 0.0}, Blocked)),
    ?assertEqual({term, {1, 2}, {40.0, 0.0}, [], 9, {100.0, 0.0}}, Request(Again)),
    ?assertEqual(
        {term, {1, 2}, {40.0, 0.0}, [], 9}, Request(starl_dpp_progress:answered([], Again))
    ).

%% Another path begins with nothing behind it.
another_path_begins_with_nothing_behind_it_test() ->
    One = starl_dpp_progress:reached(1, hd(?PATH), begun()),
    Again = starl_dpp_progress:begins({7.0, 7.0}, One),
    ?assertEqual(
        {{7.0, 7.0}, {moving, 0, {0.0, 0.0}, ?PATH}},
        {starl_dpp_progress:last(Again), starl_dpp_progress:place(moving(), Again)}
    ).

%% Where it stands is looked at again, and stays what it counts as until then.
lost_place_is_looked_at_again_test() ->
    Stands = stopped({50.0, 9.0}, begun()),
    Lost = starl_dpp_progress:lost(Stands),
    ?assertEqual({{50.0, 9.0}, unknown}, {
        starl_dpp_progress:at(Stands), starl_dpp_progress:at(Lost)
    }),
    ?assertEqual(unknown, starl_dpp_progress:at(starl_dpp_progress:halted(standing, Stands))),
    [
        ?assertEqual({standing, {50.0, 0.0}}, starl_dpp_progress:place(Where, Track))
     || Where <- [standing, asking], Track <- [Stands, Lost]
    ],
    ?assertError(function_clause, starl_dpp_progress:place(standing, begun())).
