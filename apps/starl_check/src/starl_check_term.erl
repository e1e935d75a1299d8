%% @doc Finds and changes robots' numbers and times inside the data of machines.
%%
%% A machine's data are opaque, so the checker cannot ask the machine for the times and robots in
%% them. It recognizes them by their values: in a search that exchanges robots, robot N of the team
%% has a number that no machine uses for anything else ({@link id/1}), and each robot's clock reads
%% values in a separate range. A value in such a range is a time of that robot's clock, wherever it
%% occurs: in the data of the robot's own machine, in a message, or in the data of another robot
%% that sends it back later. The ranges lie so that the difference of two clocks is in none of them,
%% and identifies the two clocks.
%%
%% The clock of a robot always reads {@link now/1}. When time passes, the clock stays and all stored
%% times go back, each at the rate of its clock. So two states that differ only in the time of day
%% are the same term. A time further back than the `horizon' is kept at the horizon. The difference of two
%% clocks is no time: it changes by the drift between them alone, for as long as a time gets to the horizon.
-module(starl_check_term).

-export([id/1, number/1, now/1, long_ago/1, shift/4, rename/2, own/1, redrawn/1, shown/1]).

-export_type([place/0, permutation/0]).

%% A robot's place in its team, from 1.
-type place() :: pos_integer().

%% The new place of each place, from the first on.
-type permutation() :: tuple().

-define(FIRST, 900000).
%% 2^52 µs are 142 years; fencing numbers end below (starl_mutex_home: 2^44 an incarnation).
-define(CLOCK_BITS, 52).
%% A time lies within 12 days of its clock's reading.
-define(REACH, (1 bsl 40)).

%% @doc The number that no machine uses for anything but the robot at a place of the team.
-spec id(place()) -> starl:robot_id().
id(Place) when is_integer(Place) -> ?FIRST + Place.

%% @doc The place of a robot, which is its own number.
-spec number(starl:robot_id()) -> place().
number(Id) when is_integer(Id), Id > ?FIRST -> Id - ?FIRST;
number(Id) when is_integer(Id) -> Id.

%% @doc The reading of the clock of the robot at a place, in microseconds. No difference of two powers of
%% three is a power of three, or the difference of two others.
-spec now(place()) -> integer().
now(Place) -> power(Place - 1) bsl ?CLOCK_BITS.

power(0) -> 1;
power(N) -> 3 * power(N - 1).

%% @doc A time of its clock that lies further back than any duration in a model, in microseconds.
-spec long_ago(place()) -> integer().
long_ago(Place) -> now(Place) - ?REACH div 2.

%% @doc The term after this number of ticks; a clock of rate R gains R microseconds in each tick.
-spec shift(Term, Ticks :: non_neg_integer(), Rates :: tuple(), HorizonUs :: non_neg_integer()) ->
    Term.
shift(Term, Ticks, Rates, Horizon) ->
    walk(fun(I) -> back(clocks(I), I, {Ticks, Rates, Horizon}) end, Term).

back(Place, I, {Ticks, Rates, Horizon}) when is_integer(Place), Place =< tuple_size(Rates) ->
    max(I - Ticks * element(Place, Rates), now(Place) - Horizon);
back({A, B}, I, {Ticks, Rates, Horizon}) when A =< tuple_size(Rates), B =< tuple_size(Rates) ->
    {RateA, RateB} = {element(A, Rates), element(B, Rates)},
    drifted(I, now(A) - now(B), Ticks * (RateA - RateB), most(RateA, RateB, Horizon));
back(_Clocks, I, _Passed) ->
    I.

%% The drift between two clocks while a time gets to the horizon.
most(RateA, RateB, Horizon) -> Horizon * abs(RateA - RateB) div min(RateA, RateB).

drifted(I, Zero, Drift, Most) when abs(I - Zero) =< Most ->
    min(Zero + Most, max(Zero - Most, I - Drift));
drifted(I, _Zero, _Drift, _Most) ->
    I.

%% The clock of which a value is a time, or the two clocks of which it is the difference.
clocks(I) ->
    Range = (I + ?REACH) bsr ?CLOCK_BITS,
    case abs(I - (Range bsl ?CLOCK_BITS)) < ?REACH of
        true -> of_range(Range);
        false -> none
    end.

of_range(0) ->
    none;
of_range(Range) when Range < 0 ->
    case of_range(-Range) of
        {A, B} -> {B, A};
        _ -> none
    end;
of_range(Range) ->
    factored(Range, 1).

factored(1, Place) ->
    Place;
factored(N, Place) when N rem 3 =:= 0 -> factored(N div 3, Place + 1);
factored(N, _Place) when N rem 3 =:= 1 -> none;
factored(N, Place) ->
    case factored(N + 1, Place) of
        Farther when is_integer(Farther) -> {Farther, Place};
        _ -> none
    end.

%% @doc The term after a permutation of the robots and of the times of their clocks. A list that
%% contains only robots is a set, kept in order; so is a tuple of the whole team.
-spec rename(Term, permutation()) -> Term.
rename(Term, Permutation) ->
    in_order(walk(fun(I) -> renamed(I, Permutation) end, Term), Permutation).

in_order([_ | _] = List, P) when is_list(tl(List)) ->
    case lists:all(fun is_robot/1, List) of
        true -> lists:sort(List);
        false -> [in_order(E, P) || E <- List]
    end;
in_order(Tuple, P) when is_tuple(Tuple) ->
    Elements = tuple_to_list(Tuple),
    case tuple_size(Tuple) =:= tuple_size(P) andalso lists:all(fun is_robot/1, Elements) of
        true -> list_to_tuple(lists:sort(Elements));
        false -> list_to_tuple([in_order(E, P) || E <- Elements])
    end;
in_order(Map, P) when is_map(Map) -> maps:map(fun(_, V) -> in_order(V, P) end, Map);
in_order(Other, _P) ->
    Other.

is_robot(I) -> is_integer(I) andalso I > ?FIRST andalso I < ?FIRST + 100.

renamed(I, Permutation) when I > ?FIRST, I =< ?FIRST + tuple_size(Permutation) ->
    id(element(number(I), Permutation));
renamed(I, Permutation) ->
    Size = tuple_size(Permutation),
    case clocks(I) of
        Place when is_integer(Place), Place =< Size ->
            I - now(Place) + now(element(Place, Permutation));
        {A, B} when A =< Size, B =< Size ->
            Zero = now(A) - now(B),
            I - Zero + now(element(A, Permutation)) - now(element(B, Permutation));
        _ ->
            I
    end.

%% @doc The term in which each robot has its own number.
-spec own(term()) -> term().
own(Term) -> walk(fun owned/1, Term).

owned(I) when I > ?FIRST, I < ?FIRST + 100 -> number(I);
owned(I) -> I.

%% @doc The term with its streams of random numbers reset to their start.
-spec redrawn(Term) -> Term.
redrawn({#{type := exsss, next := _}, _}) -> rand:seed_s(exsss, 1);
redrawn(Tuple) when is_tuple(Tuple) -> list_to_tuple([redrawn(E) || E <- tuple_to_list(Tuple)]);
redrawn(Other) -> Other.

%% @doc The term for a human reader: robots by their places, times in milliseconds from now.
-spec shown(term()) -> term().
shown(Term) -> walk(fun readable/1, Term).

readable(I) when I > ?FIRST, I < ?FIRST + 100 ->
    number(I);
readable(I) ->
    case clocks(I) of
        %% An atom is printed without quotes. Only the times in one chart become atoms.
        Place when is_integer(Place) -> list_to_atom(lists:flatten(ago(I - now(Place))));
        _ -> I
    end.

ago(Us) -> io_lib:format("t~s~b", [[$+ || Us >= 0], Us div 1000]).

%% Every integer of a term, in tuples, lists and maps, keys included.
walk(Fun, I) when is_integer(I) -> Fun(I);
walk(Fun, [Head | Tail]) ->
    [walk(Fun, Head) | walk(Fun, Tail)];
walk(Fun, Tuple) when is_tuple(Tuple) ->
    list_to_tuple([walk(Fun, E) || E <- tuple_to_list(Tuple)]);
walk(Fun, Map) when is_map(Map) ->
    maps:from_list([{walk(Fun, K), walk(Fun, V)} || {K, V} <- maps:to_list(Map)]);
walk(_Fun, Other) ->
    Other.
