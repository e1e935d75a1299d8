%% Durations by clocks that run too fast or too slow, as far as `--drift' allows: a hold or a gap of a
%% known length, by the true time, against one that is asked for. The truth is a comparison of two
%% numbers.
-module(starl_debug_drift_tests).

-include_lib("eunit/include/eunit.hrl").

-define(SEEDS, 60).
%% Times are recorded in whole microseconds.
-define(ROUNDED_US, 5).

no_duration_is_judged_wrong_test_() ->
    [
        {lists:concat([Kind, ", ", Ppm, " ppm"]), {timeout, 60, fun() -> tried(Kind, Ppm) end}}
     || Kind <- [holds, gap, both, either], Ppm <- [0, 100, 1000, 10000]
    ].

tried(Kind, Ppm) ->
    Wrong = [
        {seed, Seed, Found}
     || Seed <- lists:seq(1, ?SEEDS), Found <- [wrong(Kind, Ppm, Seed)], Found =/= right
    ],
    ?assertEqual([], Wrong).

%% It lasts for `Length' by the true time; asked is whether it lasts for `Asked'.
wrong(Kind, Ppm, Seed) ->
    _ = rand:seed(exsss, Seed),
    Asked = 1000 * (500 + rand:uniform(9500)),
    Length = round(Asked * (1 + 4.0e-6 * Ppm * uniform())) + rand:uniform(40) - 20,
    Clocks = [{rand:uniform(1000000000), 1.0e-6 * Ppm * uniform()} || _ <- [1, 2]],
    Verdict = verdict(Kind, Ppm, Asked, Length, Clocks),
    Margin = 3.0e-6 * Ppm * Asked + ?ROUNDED_US,
    case {Length - Asked, Verdict} of
        {More, never} when More > ?ROUNDED_US -> {Asked, Length, Verdict};
        {More, certainly} when More < -?ROUNDED_US -> {Asked, Length, Verdict};
        %% far from the border one robot alone leaves no doubt
        {More, possibly} when abs(More) > Margin, Kind =/= either -> {Asked, Length, Verdict};
        _ -> right
    end.

uniform() -> 2 * rand:uniform() - 1.

%% Both robots' clocks show the same at the beginning; only their rates differ.
verdict(Kind, Ppm, Asked, Length, [{Begun, First}, {_, Second}]) ->
    Clock = fun(Rate) -> fun(T) -> Begun + round(T * (1 + Rate)) end end,
    Extent = {Begun, Begun + 40000000},
    Own = fun(R, Rate, Holds) ->
        {R, starl_debug_state:new(R, #{mutex => events(Holds, Clock(Rate))}, Extent, exact)}
    end,
    {Text, One, Two} = case_of(Kind, Asked, Length),
    States = maps:from_list([Own(1, First, One), Own(2, Second, Two)]),
    Recording = starl_debug_truth:recording(Extent, States, #{}),
    {ok, Predicate} = starl_debug:predicate(Text),
    {ok, Formula} = starl_debug:formula(Predicate, Recording),
    Go = fun(_Done) -> continue end,
    Options = #{sigma => 80 * Ppm, drift_ppm => Ppm},
    maps:get(verdict, starl_debug_check:run(Formula, Recording, Options, Go)).

events(Holds, Clock) ->
    lists:append([
        [{Clock(From), {acquired, Token, 1}}, {Clock(To), {released, Token, 1}}]
     || {Token, From, To} <- Holds
    ]).

-define(FROM, 4321000).

%% The end of a hold is the first time at which it is over.
case_of(holds, Asked, Length) ->
    Text = io_lib:format("owner(r1, t) for ~b us", [Asked]),
    {Text, [{t, ?FROM, ?FROM + Length + 1}], []};
case_of(gap, Asked, Length) ->
    Text = io_lib:format("not (owner(r1, a) within ~b us after owner(r1, b))", [Asked]),
    After = ?FROM + Length,
    {Text, [{b, ?FROM, ?FROM + Asked div 20 + 100}, {a, After, After + 20000000}], []};
case_of(both, Asked, Length) ->
    Text = io_lib:format("(owner(r1, t) and owner(r2, t)) for ~b us", [Asked]),
    {Text, [{t, ?FROM, ?FROM + Length + 1}], [{t, 1000000, 35000000}]};
%% One after the other, and for some time both.
case_of(either, Asked, Length) ->
    Text = io_lib:format("(owner(r1, t) or owner(r2, t)) for ~b us", [Asked]),
    Half = ?FROM + Length div 2,
    {Text, [{t, ?FROM, Half}], [{t, ?FROM + Length div 20, ?FROM + Length + 1}]}.
