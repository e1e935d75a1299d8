%% What comes over the radio and is a message of path planning, and what is none, for each part.
-module(starl_dpp_message_tests).
-include_lib("eunit/include/eunit.hrl").

-define(T, {1, 2, 3}).
-define(P, {1.0, 2.0}).
-define(BALLOT, {7, -8, true}).

-define(WAY, [{?P, up}, {?P, {down, 4}}]).

messages() ->
    [
        {dpp_request, {?T, {1, 0}, ?P, [3], -9}},
        {dpp_passed, {?T, {1, 0}, 0}},
        {dpp_state, {?T, {1, 0}, {standing, ?P}, [], ?BALLOT}},
        {dpp_state, {?T, {1, 0}, {moving, 0, ?P, ?WAY}, [3], ?BALLOT}},
        {dpp_here, {?T, ?BALLOT}},
        {dpp_refused, {0, 0, 0}},
        {dpp_refused, {doubted, ?T}},
        {dpp_prevoted, ?T},
        {dpp_answer, {?T, {1, 0}, {assign, ?P, ?WAY}, [3]}},
        {dpp_answer, {?T, {1, 0}, again, []}},
        {dpp_answer, {?T, {1, 0}, complete, []}},
        {dpp_answer, {?T, {1, 0}, incomplete, []}},
        {dpp_recover, {?T, -7, false}},
        {dpp_beat, {?T, -7, [{1, -5}]}}
    ].

taken_test() ->
    [?assert(starl_dpp_message:accepts(dpp_prevote, N)) || N <- [0, 7]],
    [?assertNot(starl_dpp_message:accepts(dpp_prevote, N)) || N <- [-1, 0.5, nothing]],
    [?assert(starl_dpp_message:accepts(Type, Body), {Type, Body}) || {Type, Body} <- messages()].

%% Of each message: one element less, one more, and each element of another kind.
spoilt_test() ->
    [
        ?assertNot(starl_dpp_message:accepts(Type, Spoilt), {Type, Spoilt})
     || {Type, Body} <- messages(),
        Spoilt <-
            [erlang:delete_element(1, Body), erlang:append_element(Body, 1), nothing] ++
                [setelement(N, Body, nothing) || N <- lists:seq(1, tuple_size(Body))]
    ].

%% Numbers that are too small, places that are none.
parts_test() ->
    [
        ?assertNot(starl_dpp_message:accepts(Type, Body), {Type, Body})
     || {Type, Body} <- [
            {dpp_passed, {?T, {0, 0}, 1}},
            {dpp_passed, {?T, {1, -1}, 1}},
            {dpp_passed, {?T, {1, 0}, -1}},
            {dpp_refused, {-1, 0, 0}},
            {dpp_refused, {0, 0, -1}},
            {dpp_refused, {believed, ?T}},
            {dpp_beat, {?T, 7, [{0, 5}]}},
            {dpp_request, {?T, {1, 0}, ?P, [0], 9}},
            {dpp_request, {?T, {1, 0}, {1, 2}, [], 9}},
            {dpp_state, {?T, {1, 0}, {asking, ?P}, [], ?BALLOT}},
            {dpp_state, {?T, {1, 0}, {moving, -1, ?P, ?WAY}, [], ?BALLOT}},
            {dpp_state, {?T, {1, 0}, {moving, 0, ?P, [{?P, down}]}, [], ?BALLOT}},
            {dpp_state, {?T, {1, 0}, {moving, 0, ?P, [{?P, {down, 0}}]}, [], ?BALLOT}},
            {dpp_here, {?T, {7, 8, yes}}},
            {dpp_answer, {?T, {1, 0}, {assign, ?P}, []}},
            {dpp_answer, {?T, {1, 0}, never, []}},
            {dpp_other, {?T, ?BALLOT}}
        ]
    ].
