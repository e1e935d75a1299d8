%% What a robot knows of the sources of messages: incarnations, and the numbers that were taken.
-module(starl_sap_peers_tests).
-include_lib("eunit/include/eunit.hrl").

-define(WINDOW, 8).

new() -> starl_sap_peers:new().

take(Number, Peers) -> starl_sap_peers:take(2, Number, ?WINDOW, Peers).

%% The answer, and what is known then.
taken(Number, Peers) ->
    case take(Number, Peers) of
        {How, Next} -> {How, Next};
        No -> {No, Peers}
    end.

%% What becomes of these numbers, one after the other.
takes(Numbers) -> takes(Numbers, new()).

takes(Numbers, Peers) -> element(1, lists:mapfoldl(fun taken/2, Peers, Numbers)).

after_taking(Numbers) -> element(2, lists:mapfoldl(fun taken/2, new(), Numbers)).

told(Incarnation, Nonce, Lows, Peers) -> starl_sap_peers:told(2, Incarnation, Nonce, Lows, Peers).

asked(Peers) -> element(2, starl_sap_peers:ask(2, 77, Peers)).

%% -- incarnations ----------------------------------------------------------------------------

heard(Incarnation, Peers) -> starl_sap_peers:heard(2, Incarnation, Peers).

%% Who has not been heard is in its first incarnation, and not known.
nobody_test() ->
    ?assertEqual(1, starl_sap_peers:incarnation(2, new())),
    ?assertNot(starl_sap_peers:is_known(2, new())),
    ?assertEqual({present, new()}, heard(1, new())).

%% A restart makes it known, and another robot stays what it is.
restart_test() ->
    {present, Peers} = heard(2, new()),
    ?assertEqual(2, starl_sap_peers:incarnation(2, Peers)),
    ?assert(starl_sap_peers:is_known(2, Peers)),
    ?assertNot(starl_sap_peers:is_known(3, Peers)),
    ?assertEqual({present, Peers}, heard(2, Peers)),
    ?assertEqual({earlier, Peers}, heard(1, Peers)).

%% At most 16 later is believed, from any incarnation.
leap_test() ->
    ?assertMatch({present, _}, heard(17, new())),
    ?assertEqual({far, new()}, heard(18, new())),
    {present, Peers} = heard(17, new()),
    {present, Later} = heard(33, Peers),
    ?assertEqual(33, starl_sap_peers:incarnation(2, Later)),
    ?assertEqual({far, Peers}, heard(34, Peers)).

%% A later incarnation counts its numbers from 1 again.
restart_begins_anew_test() ->
    {present, Peers} = heard(2, after_taking([1, 2, {all, 1}])),
    ?assertEqual([new, new, new, seen], takes([1, 2, {all, 1}, 1], Peers)).

%% Only incarnations other than the first are told.
later_test() ->
    {present, One} = heard(2, new()),
    {present, Two} = starl_sap_peers:heard(4, 3, element(2, taken(1, One))),
    Peers = element(2, starl_sap_peers:take(5, 1, ?WINDOW, Two)),
    ?assertEqual(#{}, starl_sap_peers:later([], Peers)),
    ?assertEqual(#{2 => 2}, starl_sap_peers:later([2], Peers)),
    ?assertEqual(#{}, starl_sap_peers:later([3], Peers)),
    ?assertEqual(#{}, starl_sap_peers:later([5], Peers)),
    ?assertEqual(#{2 => 2, 4 => 3}, starl_sap_peers:later([2, 3, 4, 5], Peers)).

%% -- numbers ---------------------------------------------------------------------------------

once_test() ->
    ?assertEqual([new, new, seen, seen], takes([1, 2, 1, 2])),
    ?assertEqual([new, new, new, seen, seen, seen], takes([2, 3, 1, 1, 2, 3])).

%% Messages to a robot and broadcasts are counted apart; sources too.
apart_test() ->
    ?assertEqual([new, new, seen, seen], takes([1, {all, 1}, 1, {all, 1}])),
    ?assertMatch({new, _}, starl_sap_peers:take(3, 1, ?WINDOW, after_taking([1, {all, 1}]))).

%% The window lies above the floor, which rises with what is taken one after the other.
window_test() ->
    [
        begin
            ?assertEqual([far], takes([Kind(9)])),
            ?assertEqual([wide], takes([Kind(8)])),
            ?assertEqual([new, wide], takes([Kind(1), Kind(9)])),
            ?assertEqual([new, far], takes([Kind(1), Kind(10)])),
            ?assertEqual([new, new, far], takes([Kind(3), Kind(2), Kind(9)])),
            ?assertEqual([new, new, new, wide], takes([Kind(3), Kind(2), Kind(1), Kind(9)]))
        end
     || Kind <- [fun(N) -> N end, fun(N) -> {all, N} end]
    ].

%% Gaps that use up half of the window are wide.
wide_test() ->
    ?assertEqual([new], takes([4])),
    ?assertEqual([wide], takes([5])),
    ?assertEqual([wide, new, seen], takes([5, 2, 5])),
    ?assertEqual([new, new, new], takes([1, 2, 5])),
    ?assertEqual([new, wide], takes([1, 6])).

%% The floor is 1 above the lowest numbers that were all taken, and stays there after a gap.
gap_test() ->
    ?assertEqual(
        [new, new, new, new, new, far, wide],
        takes([2, 1, 3, 5, 6, 12, 11])
    ).

%% -- questions -------------------------------------------------------------------------------

%% A question is open until it is answered; asked again meanwhile, it has the same nonce.
ask_test() ->
    {77, Asked} = starl_sap_peers:ask(2, 77, new()),
    ?assertEqual({77, Asked}, starl_sap_peers:ask(2, 78, Asked)),
    {78, _} = starl_sap_peers:ask(3, 78, Asked),
    {ok, Answered} = told(1, 77, {1, 1}, Asked),
    ?assertMatch({79, _}, starl_sap_peers:ask(2, 79, Answered)).

%% An answer counts with the nonce of the open question alone, and once.
nonce_test() ->
    ?assertEqual(not_asked, told(5, 77, {1, 1}, new())),
    ?assertEqual(not_asked, told(5, 78, {1, 1}, asked(new()))),
    {ok, Answered} = told(5, 77, {1, 1}, asked(new())),
    ?assertEqual(not_asked, told(6, 77, {1, 1}, Answered)).

%% What a robot has told of its lives is kept when a later incarnation of it is heard: a robot that has
%% forgotten a life is still not believed.
lives_outlast_what_is_heard_test() ->
    Asked = fun(Nonce, Peers) ->
        {Nonce, Open} = starl_sap_peers:ask(2, Nonce, Peers),
        Open
    end,
    Told = fun(Life, Nonce, Peers) ->
        {ok, Next} = starl_sap_peers:told(2, Life, Nonce, {1, 1}, Asked(Nonce, Peers)),
        Next
    end,
    Lived = Told(5000, 2, Told(1000, 1, new())),
    {present, Later} = heard(5001, Lived),
    ?assertEqual({1000, 5000}, starl_sap_peers:lives(2, Later)),
    ?assertMatch({outlived, _}, starl_sap_peers:told(2, 4999, 3, {1, 1}, Asked(3, Later))).

%% The answer is believed, however far it is from what was heard: later or earlier.
answer_counts_test() ->
    {ok, Far} = told(1000, 77, {1, 1}, asked(new())),
    ?assertEqual(1000, starl_sap_peers:incarnation(2, Far)),
    {present, Heard} = heard(17, new()),
    {ok, Back} = told(3, 77, {1, 1}, asked(Heard)),
    ?assertEqual(3, starl_sap_peers:incarnation(2, Back)).

%% What the robot itself has told is not undone by less.
a_life_that_was_told_is_not_undone_test() ->
    {ok, Far} = told(1000, 77, {1, 1}, asked(new())),
    {outlived, Same} = told(999, 77, {1, 1}, asked(Far)),
    ?assertEqual(1000, starl_sap_peers:incarnation(2, Same)),
    ?assertEqual(not_asked, told(1001, 77, {1, 1}, Same)),
    ?assertEqual({0, 1000}, starl_sap_peers:lives(2, Same)),
    {ok, Later} = told(5000, 77, {1, 1}, asked(Same)),
    ?assertEqual({1000, 5000}, starl_sap_peers:lives(2, Later)).

%% The floor rises to what the source still waits for, over the gaps, in both kinds.
lows_test() ->
    {ok, Peers} = told(1, 77, {4, 3}, asked(after_taking([5, {all, 2}]))),
    ?assertEqual([seen, new, seen, new, far], takes([3, 4, 5, 6, 15], Peers)),
    ?assertEqual([seen, new, far], takes([{all, 2}, {all, 3}, {all, 12}], Peers)).

%% A floor that was told rises over what was taken above it.
lows_at_a_taken_number_test() ->
    {ok, Peers} = told(1, 77, {3, 1}, asked(after_taking([3, 4]))),
    ?assertEqual([seen, far], takes([4, 13], Peers)),
    ?assertEqual([wide], takes([12], Peers)).

%% No answer lowers a floor: what was taken is not taken again.
lows_below_the_floor_test() ->
    {ok, Peers} = told(1, 77, {1, 2}, asked(after_taking([1, 2, {all, 1}, {all, 2}]))),
    ?assertEqual([seen, seen, seen, seen], takes([1, 2, {all, 1}, {all, 2}], Peers)).

%% A present incarnation keeps what was taken; another one begins anew, at what it tells.
taken_of_the_present_test() ->
    {ok, Same} = told(1, 77, {1, 1}, asked(after_taking([1, 3]))),
    ?assertEqual([seen, seen, new], takes([1, 3, 2], Same)),
    {ok, Other} = told(2, 77, {2, 1}, asked(after_taking([1, 3]))),
    ?assertEqual([seen, new, new], takes([1, 3, 2], Other)).
