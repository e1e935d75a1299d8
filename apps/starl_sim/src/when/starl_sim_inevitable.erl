%% @doc Finds the moment of a run at which a violation became inevitable: where the fraction of
%% failing continuations rises most.
%%
%% First it runs continuations from a grid of moments. Then it halves the largest rise of the
%% fraction between neighbours, wherever that is now, until one event lies between the two moments.
%% The fraction need not grow all the time, since luck lowers it. So the grid comes first, and other
%% rises are reported.
%%
%% This module knows continuations only as a function from questions to counts, and draws nothing.
%% The K-th continuation of each moment has the same branch seed, so the result does not change
%% between two moments if no event has changed it.
%%
%% Before a rise of less than 0.6 is halved, both its moments get five times as many continuations.
%% With few of them a rise may be chance and hide the true one; then another rise becomes the
%% largest. A moment is put on the wrong side of a rise from 0.25 to 0.5 once in 10,000 times.
-module(starl_sim_inevitable).

-export([search/1, grid/3]).

-export_type([request/0, question/0, tally/0, result/0, curve/0]).

%% Futures of a moment, from one number to another.
-type question() :: {starl_sim_moments:moment(), {From :: pos_integer(), To :: pos_integer()}}.

%% What came of the futures of a moment: how many there were, how many broke the contract, broke
%% only another one, or were not judged to their end; and the different digests among them.
-type tally() :: #{
    futures := non_neg_integer(),
    broken := non_neg_integer(),
    other := non_neg_integer(),
    unjudged := non_neg_integer(),
    digests := [binary()]
}.

-type curve() :: [{starl_sim_moments:moment(), tally()}].

%% `ask' answers with the tallies of these futures, in any order; `stopped': with those it has. `fine':
%% moments that are no farther apart are not halved any more (1).
-type request() :: #{
    grid := [starl_sim_moments:moment(), ...],
    futures := pos_integer(),
    fine => pos_integer(),
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

-type step() :: {Below :: starl_sim_moments:moment(), Above :: starl_sim_moments:moment()}.

%% A step of this height shows in few futures; for others there are more.
-define(HIGH, 0.6).
-define(MORE, 5).

-record(search, {
    ask :: fun(([question()]) -> {done | stopped, curve()}),
    futures :: pos_integer(),
    fine :: pos_integer(),
    curve = #{} :: #{starl_sim_moments:moment() => tally()},
    stopped = false :: boolean()
}).

%% @doc A grid of about N moments up to a last one: half of them even in events, half at distances
%% in time that double backwards from it.
-spec grid(N :: pos_integer(), Last, starl_sim_moments:t()) -> [Last, ...] when
    Last :: starl_sim_moments:moment().
grid(N, Last, Moments) ->
    Us = starl_sim_moments:time_us(Last, Moments),
    Half = max(1, N div 2),
    Even = [Last * I div Half || I <- lists:seq(0, Half)],
    Back = [
        starl_sim_moments:at(Us - (Us bsr I), Moments)
     || I <- lists:seq(1, N - Half)
    ],
    lists:usort([0, Last | Even ++ [min(Moment, Last) || Moment <- Back]]).

%% @doc Searches for the step.
-spec search(request()) -> result().
search(#{grid := Grid, futures := K, ask := Ask} = Request) ->
    Fine = maps:get(fine, Request, 1),
    climb(asked(Grid, K, #search{ask = Ask, futures = K, fine = Fine})).

climb(#search{stopped = true} = Search) ->
    result(steepest(Search), Search);
climb(#search{fine = Fine} = Search) ->
    case steepest(Search) of
        none ->
            result(none, Search);
        {Low, High} = Step ->
            K = enough(Step, Search),
            case [M || M <- [Low, High], known(M, Search#search.curve) < K] of
                [_ | _] = Few -> climb(asked(Few, K, Search));
                [] when High - Low =< Fine -> result(Step, Search);
                [] -> climb(asked([(Low + High) div 2], K, Search))
            end
    end.

%% The futures that the moments of a rise need.
enough({Low, High}, #search{futures = K, fine = Fine, curve = Curve}) ->
    case share(maps:get(High, Curve)) - share(maps:get(Low, Curve)) >= ?HIGH of
        true when High - Low > Fine -> K;
        _ -> ?MORE * K
    end.

%% Each of these moments has this many futures then.
asked(Moments, K, #search{ask = Ask, curve = Curve} = Search) ->
    Questions = [{M, {N + 1, K}} || M <- Moments, N <- [known(M, Curve)], N < K],
    {How, Answers} = Ask(Questions),
    Search#search{
        curve = lists:foldl(fun add/2, Curve, Answers),
        stopped = Search#search.stopped orelse How =:= stopped
    }.

known(Moment, Curve) ->
    case Curve of
        #{Moment := #{futures := N}} -> N;
        #{} -> 0
    end.

add({_Moment, #{futures := 0}}, Curve) ->
    Curve;
add({Moment, Tally}, Curve) ->
    maps:update_with(Moment, fun(Before) -> sum(Before, Tally) end, Tally, Curve).

sum(#{digests := A} = Before, #{digests := B} = Tally) ->
    Numbers = maps:without([digests], Tally),
    Summed = maps:map(fun(Key, N) -> N + maps:get(Key, Before) end, Numbers),
    Summed#{digests => lists:usort(A ++ B)}.

curve(#search{curve = Curve}) -> lists:keysort(1, maps:to_list(Curve)).

%% The neighbours between which the share rises most, the earliest of equal ones, if more futures
%% of the same shares can put them apart.
steepest(#search{futures = K} = Search) ->
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

scaled(Moment, Most, #search{curve = Curve}) ->
    case count(maps:get(Moment, Curve)) of
        {Broken, N} when N < Most -> {round(Broken * Most / N), Most};
        Count -> Count
    end.

rises(Curve) ->
    Pairs = pairs(Curve),
    lists:sort([{share(A) - share(B), {I, J}} || {{I, A}, {J, B}} <- Pairs, share(B) > share(A)]).

pairs([A, B | Rest]) -> [{A, B} | pairs([B | Rest])];
pairs(_) -> [].

share(Tally) -> starl_sim_proportion:share(count(Tally)).

count(#{broken := Broken, futures := N}) -> {Broken, N}.

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
