%% @doc Finds the event of a run by which a violation became inevitable: where the fraction of
%% failing continuations rises most.
%%
%% First it runs continuations from a grid of indices. Then it halves the largest rise of the
%% fraction between neighbours, wherever that is now, until one event lies between the two.
%% The fraction need not grow all the time, since luck lowers it. So the grid comes first, and other
%% rises are reported.
%%
%% This module knows continuations only as a function from questions to counts, and draws nothing.
%% The K-th continuation of each index has the same branch seed, so the result does not change
%% between two indices if no event has changed it.
%%
%% Before a rise of less than 0.6 is halved, both its indices get five times as many continuations.
%% With few of them a rise may be chance and hide the true one; then another rise becomes the
%% largest. An index is put on the wrong side of a rise from 0.25 to 0.5 once in 10,000 times.
-module(starl_sim_inevitable).

-export([search/1, grid/3]).

-export_type([request/0, question/0, tally/0, result/0, curve/0]).

%% Continuations of an index, from one number to another.
-type question() :: {starl_sim_timeline:index(), {From :: pos_integer(), To :: pos_integer()}}.

%% The results of the continuations of an index: how many there were, how many broke the contract, broke
%% only another one, or were not judged to their end; and the different digests among them.
-type tally() :: #{
    draws := non_neg_integer(),
    broken := non_neg_integer(),
    other := non_neg_integer(),
    unjudged := non_neg_integer(),
    digests := [binary()]
}.

-type curve() :: [{starl_sim_timeline:index(), tally()}].

%% `ask' answers with the tallies of these continuations, in any order; `stopped': with those it has.
-type request() :: #{
    grid := [starl_sim_timeline:index(), ...],
    draws := pos_integer(),
    ask := fun(([question()]) -> {done | stopped, curve()})
}.

%% The curve, ascending; the step, between two neighbours if the search was completed, `none' if no
%% rise between neighbours is beyond its intervals; the other rises that are, largest first.
-type result() :: #{
    curve := curve(),
    step := step() | none,
    others := [step()],
    complete := boolean()
}.

-type step() :: {Below :: starl_sim_timeline:index(), Above :: starl_sim_timeline:index()}.

%% A step of this height shows in few continuations; for others there are more.
-define(HIGH, 0.6).
-define(MORE, 5).

-record(search, {
    ask :: fun(([question()]) -> {done | stopped, curve()}),
    draws :: pos_integer(),
    curve = #{} :: #{starl_sim_timeline:index() => tally()},
    stopped = false :: boolean()
}).

%% @doc A grid of about N indices up to a last one: half of them even in events, half at distances
%% in time that double backwards from it.
-spec grid(N :: pos_integer(), Last, starl_sim_timeline:t()) -> [Last, ...] when
    Last :: starl_sim_timeline:index().
grid(N, Last, Timeline) ->
    Us = starl_sim_timeline:time_us(Last, Timeline),
    Half = max(1, N div 2),
    Even = [Last * I div Half || I <- lists:seq(0, Half)],
    Back = [
        starl_sim_timeline:at(Us - (Us bsr I), Timeline)
     || I <- lists:seq(1, N - Half)
    ],
    lists:usort([0, Last | Even ++ [min(Index, Last) || Index <- Back]]).

%% @doc Searches for the step.
-spec search(request()) -> result().
search(#{grid := Grid, draws := K, ask := Ask}) ->
    climb(asked(Grid, K, #search{ask = Ask, draws = K})).

climb(#search{stopped = true} = Search) ->
    result(steepest(Search), Search);
climb(#search{} = Search) ->
    case steepest(Search) of
        none ->
            result(none, Search);
        {Low, High} = Step ->
            K = enough(Step, Search),
            case [M || M <- [Low, High], known(M, Search#search.curve) < K] of
                [_ | _] = Few -> climb(asked(Few, K, Search));
                [] when High - Low =:= 1 -> result(Step, Search);
                [] -> climb(asked([(Low + High) div 2], K, Search))
            end
    end.

%% The continuations that the indices of a rise need.
enough({Low, High}, #search{draws = K, curve = Curve}) ->
    case fraction(maps:get(High, Curve)) - fraction(maps:get(Low, Curve)) >= ?HIGH of
        true when High - Low > 1 -> K;
        _ -> ?MORE * K
    end.

%% Each of these indices has this many continuations then.
asked(Indices, K, #search{ask = Ask, curve = Curve} = Search) ->
    Questions = [{M, {N + 1, K}} || M <- Indices, N <- [known(M, Curve)], N < K],
    {How, Answers} = Ask(Questions),
    Search#search{
        curve = lists:foldl(fun add/2, Curve, Answers),
        stopped = Search#search.stopped orelse How =:= stopped
    }.

known(Index, Curve) ->
    case Curve of
        #{Index := #{draws := N}} -> N;
        #{} -> 0
    end.

add({_Index, #{draws := 0}}, Curve) ->
    Curve;
add({Index, Tally}, Curve) ->
    maps:update_with(Index, fun(Before) -> sum(Before, Tally) end, Tally, Curve).

sum(#{digests := A} = Before, #{digests := B} = Tally) ->
    Numbers = maps:without([digests], Tally),
    Summed = maps:map(fun(Key, N) -> N + maps:get(Key, Before) end, Numbers),
    Summed#{digests => lists:usort(A ++ B)}.

curve(#search{curve = Curve}) -> lists:keysort(1, maps:to_list(Curve)).

%% The neighbours between which the fraction rises most, the earliest of equal ones, if more
%% continuations of the same fractions can put them apart.
steepest(#search{draws = K} = Search) ->
    Known = curve(Search),
    Likely = [
        Step
     || {_, {Low, High} = Step} <- rises(Known),
        starl_sim_proportion:are_apart(
            scaled(Low, ?MORE * K, Search), scaled(High, ?MORE * K, Search)
        )
    ],
    case Likely of
        [Step | _] -> Step;
        [] -> none
    end.

scaled(Index, Most, #search{curve = Curve}) ->
    case count(maps:get(Index, Curve)) of
        {Broken, N} when N < Most -> {round(Broken * Most / N), Most};
        Count -> Count
    end.

rises(Curve) ->
    Pairs = pairs(Curve),
    lists:sort([
        {fraction(A) - fraction(B), {I, J}}
     || {{I, A}, {J, B}} <- Pairs, fraction(B) > fraction(A)
    ]).

pairs([A, B | Rest]) -> [{A, B} | pairs([B | Rest])];
pairs(_) -> [].

fraction(Tally) -> starl_sim_proportion:fraction(count(Tally)).

count(#{broken := Broken, draws := N}) -> {Broken, N}.

result(Step, #search{curve = Curve, stopped = Stopped} = Search) ->
    Sure = Step =/= none andalso is_sure(Step, Curve),
    #{
        curve => curve(Search),
        step =>
            case Sure of
                true -> Step;
                false -> none
            end,
        others => [S || {_, S} <- rises(curve(Search)), S =/= Step, is_sure(S, Curve)],
        complete => not Stopped
    }.

is_sure({Low, High}, Curve) ->
    starl_sim_proportion:are_apart(count(maps:get(Low, Curve)), count(maps:get(High, Curve))).
