%% @doc The tally of one robot's increments, as another robot knows it. It holds the counts of the
%% last lives, and the sum of all earlier ones. So it takes the same memory after any number of
%% restarts. Pure; a part of {@link starl_counter_gossip}.
%%
%% To merge two tallies: of two counts for one life the larger is kept, since it is later. A life
%% that is older than the last four is folded: its count is added to the sum, and the horizon rises
%% to that life. Of two sums with the same horizon the larger is kept. So a merged tally is never
%% less than either of the two, and never more than what the robot has counted.
%%
%% A robot stores its own tallies, each of which contains the one before; then merging loses
%% nothing. A robot that has lost its store begins with an empty tally. The others know its earlier
%% lives, and merging keeps them. It keeps them unless the robot has counted in more than four lives
%% before anybody knew of all of them.
%%
%% Anybody with the key may claim anything. A sum has a largest value. What a folded life has beyond
%% it is added to the next life. So the robot's own increments after such a claim still count when
%% its lives are folded, but the claimed counts may then be lost.
-module(starl_counter_tally).

-export([new/0, add/2, total/1, newest/1, merge/2, is_taken/3, to_term/2, of_term/1, shape/0]).

-export_type([t/0, life/0, entry/0]).

%% Counts the starts of a robot's machine.
-type life() :: pos_integer().

%% Ascending lives, all beyond the horizon; the sum of those up to it.
-type t() :: {
    Horizon :: non_neg_integer(), Sum :: non_neg_integer(), [{life(), N :: pos_integer()}]
}.

%% A robot's tally in a message.
-type entry() :: {
    starl:robot_id(),
    Horizon :: non_neg_integer(),
    Sum :: non_neg_integer(),
    [{life(), N :: pos_integer()}]
}.

%% The lives that are kept apart.
-define(LIVES, 4).
%% The largest number of a life, and of a sum: more than any robot counts to.
-define(MOST, 16#3FFFFFFFFFFFFFF).

%% @doc The robot has counted nothing.
-spec new() -> t().
new() -> {0, 0, []}.

%% @doc The robot counts one more in this life, which is its newest.
-spec add(life(), t()) -> t().
add(Life, {Horizon, Sum, Lives}) when Life > Horizon ->
    Counted = orddict:update_counter(Life, 1, Lives),
    folded({Horizon, Sum, Counted}).

%% @doc All that the robot has counted.
-spec total(t()) -> non_neg_integer().
total({_Horizon, Sum, Lives}) ->
    lists:foldl(fun({_, N}, All) when is_integer(N) -> All + N end, Sum, Lives).

%% @doc The newest life that is in the tally; 0: none.
-spec newest(t()) -> non_neg_integer().
newest({Horizon, _Sum, []}) -> Horizon;
newest({_Horizon, _Sum, Lives}) -> element(1, lists:last(Lives)).

%% @doc What is known, with what another robot claims.
-spec merge(Claimed :: t(), Known :: t()) -> t().
merge(Known, Known) ->
    Known;
merge({Horizon1, _, _} = Claimed, {Horizon2, _, _} = Known) ->
    Horizon = max(Horizon1, Horizon2),
    {_, Sum1, Lives1} = up_to(Horizon, Claimed),
    {_, Sum2, Lives2} = up_to(Horizon, Known),
    Lives = orddict:merge(fun(_, A, B) -> max(A, B) end, Lives1, Lives2),
    folded({Horizon, max(Sum1, Sum2), Lives}).

up_to(Horizon, {_, _, [{Life, _} | _]} = Tally) when Life =< Horizon ->
    up_to(Horizon, fold(Tally));
up_to(_Horizon, Tally) ->
    Tally.

folded({_, _, Lives} = Tally) when length(Lives) > ?LIVES -> folded(fold(Tally));
folded(Tally) -> Tally.

%% The oldest life is no longer kept apart.
fold({_Horizon, Sum, [{Life, N} | Lives]}) ->
    {Life, min(Sum + N, ?MOST), carry(max(0, Sum + N - ?MOST), Lives)}.

%% What is larger than that has never been counted.
carry(Over, [{Life, N} | Lives]) when N + Over =< ?MOST div 2 -> [{Life, N + Over} | Lives];
carry(_Over, Lives) -> Lives.

%% @doc Has merging made it impossible for the robot to go on counting in this life, its present one?
-spec is_taken(life(), Before :: t(), After :: t()) -> boolean().
is_taken(Life, Before, {Horizon, _Sum, _Lives} = After) ->
    Horizon >= Life orelse newest(After) > Life orelse count(Life, Before) =/= count(Life, After).

count(Life, {_Horizon, _Sum, Lives}) -> proplists:get_value(Life, Lives, 0).

%% -- messages -------------------------------------------------------------------------------

%% @doc The entry of a robot's tally.
-spec to_term(starl:robot_id(), t()) -> entry().
to_term(Robot, {Horizon, Sum, Lives}) -> {Robot, Horizon, Sum, Lives}.

%% @doc The tally of an entry of the right {@link shape/0}. `malformed': it has too many lives, or
%% they are not in order.
-spec of_term(entry()) -> {starl:robot_id(), t()} | malformed.
of_term({Robot, Horizon, Sum, Lives}) ->
    Numbers = [Life || {Life, _} <- Lives],
    case length(Lives) =< ?LIVES andalso lists:usort([Horizon | Numbers]) =:= [Horizon | Numbers] of
        true -> {Robot, {Horizon, Sum, Lives}};
        false -> malformed
    end.

%% @doc The shape of an entry.
-spec shape() -> starl_shape:t().
shape() ->
    [count, {either, [{is, 0}, serial]}, natural, {list, [serial, count]}].
