%% @doc Decides one part of a predicate in one slice of time: for which errors of the clocks it is
%% true at some moment.
%%
%% All errors within the windows are tried at once. If that leaves the part open, the widest window
%% is halved and both halves are tried, only at the times that are left. The part is
%% <em>certain</em> if each piece of the windows has a moment at which it must be true. The moments
%% may differ. It is <em>never</em> true if no piece has a moment at which it may be true.
%%
%% Clocks run apart by a little during a slice, so each piece of the windows is widened by that.
-module(starl_debug_search).

-export([decide/4]).

-export_type([outcome/0, witness/0, verdict/0, limits/0]).

-type verdict() :: never | possibly | certainly.

%% A time, and what the clocks of the robots show then, less that time.
-type witness() :: {AtUs :: integer(), #{starl:robot_id() => OffsetUs :: integer()}}.

%% `is_open': the part may be decided more sharply than is said here. `times': all those at which it
%% may be true. The witness of what is open may not exist.
-type outcome() :: #{
    verdict := verdict(),
    witness := none | witness(),
    is_shown := boolean(),
    is_open := boolean(),
    times := starl_debug_set:t(),
    looks := pos_integer()
}.

%% The drift during the slice, the width that is not halved any more (us), and the number of looks.
-type limits() :: #{drift := non_neg_integer(), fine := pos_integer(), looks := pos_integer()}.

-record(search, {
    formula :: starl_debug_ground:t(),
    facts :: starl_debug_eval:facts(),
    windows :: starl_debug_eval:windows(),
    limits :: limits(),
    witness = none :: none | witness(),
    left = none :: none | witness(),
    is_refuted = false :: boolean(),
    looks = 0 :: non_neg_integer()
}).

%% @doc Decides a formula within a range of the time line, for clocks within windows.
-spec decide(
    starl_debug_ground:t(),
    {starl_debug_set:interval(), starl_debug_eval:windows()},
    starl_debug_eval:facts(),
    limits()
) -> outcome().
decide(Formula, {Range, Windows} = When, Facts, Limits) ->
    Search = #search{
        formula = Formula, facts = Facts, windows = Windows, limits = Limits, looks = 1
    },
    case starl_debug_eval:sets(Formula, When, Facts) of
        {[], _} ->
            outcome([], Search#search{is_refuted = true});
        {May, [_ | _] = Must} ->
            outcome(May, shown(Must, Windows, Search));
        {May, []} ->
            outcome(
                May,
                each(halves(Windows, May, Range, Limits), Search#search{
                    left = witness(May, Windows)
                })
            )
    end.

outcome(May, #search{witness = Witness, left = Left, is_refuted = Refuted} = Search) ->
    Verdict = verdict(Witness, Left, Refuted),
    #{
        verdict => Verdict,
        witness => first(Witness, Left),
        is_shown => Witness =/= none,
        is_open => Verdict =:= possibly andalso (Witness =:= none orelse not Refuted),
        times => [Time || Time <- May, Verdict =/= never],
        looks => Search#search.looks
    }.

verdict(none, none, _Refuted) -> never;
verdict(none, _Left, _Refuted) -> possibly;
verdict(_Witness, none, false) -> certainly;
verdict(_Witness, _Left, _Refuted) -> possibly.

first(none, Left) -> Left;
first(Witness, _Left) -> Witness.

%% -- pieces of the windows ------------------------------------------------------------------

%% What was left by a piece is now left to its halves.
each(none, Search) -> Search;
each(Halves, Search) -> pieces(queue:from_list(Halves), Search#search{left = none}).

pieces(Queue, #search{witness = Witness, is_refuted = Refuted, left = Left} = Search) ->
    IsKnown = Witness =/= none andalso (Refuted orelse Left =/= none),
    case queue:out(Queue) of
        {empty, _} -> Search;
        {{value, {Windows, May}}, _} when IsKnown -> left(May, Windows, Search);
        {{value, Piece}, Rest} -> piece(Piece, Rest, Search)
    end.

piece({Windows, May}, Rest, #search{looks = Looks, limits = #{looks := Most}} = Search) when
    Looks >= Most
->
    pieces(Rest, left(May, Windows, Search));
piece({Windows, Within}, Rest, #search{formula = Formula, facts = Facts} = Search0) ->
    Search = Search0#search{looks = Search0#search.looks + 1},
    Hull = {element(1, hd(Within)), element(2, lists:last(Within))},
    case starl_debug_eval:sets(Formula, {Hull, widened(Windows, Search)}, Facts) of
        {[], _} ->
            pieces(Rest, Search#search{is_refuted = true});
        {_, [_ | _] = Must} ->
            pieces(Rest, shown(Must, Windows, Search));
        {May, []} ->
            halved(halves(Windows, May, Hull, Search#search.limits), {Windows, May}, Rest, Search)
    end.

halved(none, {Windows, May}, Rest, Search) ->
    pieces(Rest, left(May, Windows, Search));
halved(Halves, _Piece, Rest, Search) ->
    pieces(lists:foldl(fun queue:in/2, Rest, Halves), Search).

left(May, Windows, #search{left = none} = Search) -> Search#search{left = witness(May, Windows)};
left(_May, _Windows, Search) -> Search.

shown(Must, Windows, #search{witness = none} = Search) ->
    Search#search{witness = witness(Must, Windows)};
shown(_Must, _Windows, Search) ->
    Search.

%% A window that is halved less than the drift would be widened to what it was.
halves(Windows, May, _Range, #{fine := Fine, drift := Drift}) ->
    {Width, R} = lists:max([{Hi - Lo, R} || {R, {Lo, Hi}} <- maps:to_list(Windows)]),
    case Width > max(Fine, Drift) of
        true ->
            #{R := {Lo, Hi}} = Windows,
            Middle = (Lo + Hi) div 2,
            [{Windows#{R := {Lo, Middle}}, May}, {Windows#{R := {min(Middle + 1, Hi), Hi}}, May}];
        false ->
            none
    end.

widened(Windows, #search{windows = Whole, limits = #{drift := Drift}}) ->
    maps:map(
        fun(R, {Lo, Hi}) ->
            #{R := {Least, Most}} = Whole,
            {max(Least, Lo - Drift), min(Most, Hi + Drift)}
        end,
        Windows
    ).

witness(Times, Windows) ->
    {starl_debug_set:middle(Times), maps:map(fun(_R, {Lo, Hi}) -> (Lo + Hi) div 2 end, Windows)}.
