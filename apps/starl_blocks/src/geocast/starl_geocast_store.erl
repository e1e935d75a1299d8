%% @doc Stores the geocasts that a robot knows. It holds the messages that are alive, the robots
%% that have asked for them, the ids of expired messages, and the delivered messages. Pure; a part
%% of {@link starl_geocast_flood}, which handles packets and timers.
-module(starl_geocast_store).

-export([new/2, takes/2, look/2, is_worth/3, hold/5, prolong/4, over/2, forget/2]).
-export([offer/4, ask/4, give/3, waiting/3, delivered/2, undelivered/2, until/2]).

-export_type([t/0, id/0, parcel/0, offer/0, asker/0]).

%% Source, incarnation, sequence number.
-type id() :: {starl:robot_id(), Incarnation :: pos_integer(), N :: pos_integer()}.

%% A message as it is given: the content, the whole lifetime and its rest, the hops left.
-type parcel() :: {
    id(),
    starl_geocast:area(),
    Type :: atom(),
    Body :: term(),
    LifetimeUs :: pos_integer(),
    LeftUs :: integer(),
    Hops :: non_neg_integer()
}.

%% An offer: the lifetime, the rest of it, the hops left.
-type offer() :: {id(), LifetimeUs :: pos_integer(), LeftUs :: integer(), Hops :: integer()}.

%% A robot that asked, with the life of its machine and the time by its clock.
-type asker() :: {starl:robot_id(), {Incarnation :: pos_integer(), Us :: integer()}}.

%% An offer is better than the message held if its rest is longer by this part of the lifetime.
-define(BETTER, 8).
%% The most robots that are given a message with one packet.
-define(AT_ONCE, 50).
%% The number of ranges of delivered messages that are remembered of each source.
-define(RANGES, 256).

%% A message that is alive until a time of the own clock, and the robots that have asked for it.
-record(held, {
    area :: starl_geocast:area(),
    type :: atom(),
    body :: term(),
    lifetime_us :: pos_integer(),
    until :: integer(),
    hops :: non_neg_integer(),
    wait_us :: pos_integer(),
    deliverable :: boolean(),
    askers = [] :: [asker()]
}).

-record(store, {
    limit :: pos_integer(),
    ppm :: non_neg_integer(),
    %% the ids held or held once
    known = #{} :: #{id() => #held{} | over},
    delivered = starl_geocast_memory:new(?RANGES) :: starl_geocast_memory:t()
}).

-opaque t() :: #store{}.

%% @doc An empty store for at most `Limit' ids; a clock drifts by at most `Ppm' millionths.
-spec new(Limit :: pos_integer(), Ppm :: non_neg_integer()) -> t().
new(Limit, Ppm) -> #store{limit = Limit, ppm = Ppm}.

%% @doc Is the message known, or is there room for one more?
-spec takes(id(), t()) -> boolean().
takes(Id, #store{known = Known, limit = Limit}) ->
    map_size(Known) < Limit orelse is_map_key(Id, Known).

%% @doc Is the message held, or was it once?
-spec look(id(), t()) -> held | over | unknown.
look(Id, #store{known = Known}) ->
    case Known of
        #{Id := over} -> over;
        #{Id := #held{}} -> held;
        #{} -> unknown
    end.

%% @doc Is the offered message unknown, or better than the one held?
-spec is_worth(offer(), Now :: integer(), t()) -> boolean().
is_worth({Id, Lifetime, Left, Hops}, Now, #store{known = Known}) ->
    case Known of
        #{Id := over} ->
            false;
        #{Id := #held{hops = Own, until = Until}} when
            Hops - 1 =< Own, Left - (Until - Now) =< Lifetime div ?BETTER
        ->
            false;
        #{} ->
            Left > 0 andalso Hops > 0
    end.

%% @doc Holds a message from now on. `IsDeliverable': it may also be delivered here; `WaitUs': the
%% first wait before its offer is repeated.
-spec hold(
    parcel(),
    UntilUs :: integer(),
    IsDeliverable :: boolean(),
    WaitUs :: pos_integer(),
    t()
) -> t().
hold({Id, Area, Type, Body, Lifetime, _, Hops}, Until, Deliverable, Wait, Store) ->
    put_held(
        Id,
        #held{
            area = Area,
            type = Type,
            body = Body,
            lifetime_us = Lifetime,
            hops = Hops,
            until = Until,
            wait_us = Wait,
            deliverable = Deliverable andalso not is_delivered(Id, Store)
        },
        Store
    ).

%% Counts also if the message was forgotten meanwhile.
is_delivered(Id, #store{delivered = Memory}) -> starl_geocast_memory:is_member(Id, Memory).

%% @doc A held message is given once more: the longer deadline and the larger number of hops count.
%% Returns the deadline, and whether it is the giver's.
-spec prolong(id(), UntilUs :: integer(), Hops :: integer(), t()) ->
    {UntilUs :: integer(), IsTheirs :: boolean(), t()}.
prolong(Id, Theirs, TheirHops, #store{known = Known} = Store) ->
    #{Id := #held{until = Until, hops = Hops} = Held} = Known,
    Longer = max(Until, Theirs),
    Better = put_held(Id, Held#held{until = Longer, hops = max(Hops, TheirHops)}, Store),
    {Longer, Theirs > Until, Better}.

%% @doc The message has ended; only its id is kept, unless it is forgotten already, as when the
%% clock was set back after the message was asked for.
-spec over(id(), t()) -> t().
over(Id, #store{known = Known} = Store) when is_map_key(Id, Known) ->
    Store#store{known = Known#{Id := over}};
over(_Id, Store) ->
    Store.

%% @doc No robot gives the message any more: it need not be known.
-spec forget(id(), t()) -> t().
forget(Id, #store{known = Known} = Store) -> Store#store{known = maps:remove(Id, Known)}.

%% @doc The offer of a message, if it can travel on, and the time of the next one; the wait doubles
%% each time, up to the longest.
-spec offer(id(), Now :: integer(), LongestUs :: pos_integer(), t()) ->
    {offer(), WaitUs :: pos_integer(), t()} | none.
offer(Id, Now, Longest, #store{known = Known} = Store) ->
    case Known of
        #{Id := #held{hops = Hops, until = Until, wait_us = Wait} = Held} when
            Hops > 0, Now < Until
        ->
            Offer = {Id, Held#held.lifetime_us, left(Held, Now, Store), Hops},
            {Offer, Wait, put_held(Id, Held#held{wait_us = min(2 * Wait, Longest)}, Store)};
        #{} ->
            none
    end.

%% @doc A robot asks for a message; is it the first one?
-spec ask(id(), asker(), Now :: integer(), t()) -> {IsFirst :: boolean(), t()} | none.
ask(Id, Asker, Now, #store{known = Known} = Store) ->
    case Known of
        #{Id := #held{hops = Hops, until = Until, askers = Askers} = Held} when
            Hops > 0, Now < Until
        ->
            {Askers =:= [], put_held(Id, Held#held{askers = Askers ++ [Asker]}, Store)};
        #{} ->
            none
    end.

%% @doc The message to give, the robots that asked and get it now, and whether others still wait.
-spec give(id(), Now :: integer(), t()) ->
    {parcel(), [asker(), ...], AreMore :: boolean(), t()} | none.
give(Id, Now, #store{known = Known} = Store) ->
    case Known of
        #{Id := #held{askers = [_ | _] = Askers, until = Until} = Held} when Now < Until ->
            {Some, Rest} = lists:split(min(?AT_ONCE, length(Askers)), Askers),
            {
                parcel(Id, Held, left(Held, Now, Store)),
                Some,
                Rest =/= [],
                put_held(Id, Held#held{askers = Rest}, Store)
            };
        #{} ->
            none
    end.

parcel(Id, #held{area = Area, type = Type, body = Body, hops = Hops} = Held, Left) ->
    {Id, Area, Type, Body, Held#held.lifetime_us, Left, Hops}.

left(#held{until = Until}, Now, #store{ppm = Ppm}) ->
    starl_geocast_lifetime:left(Until, Now, Ppm).

%% @doc The messages that are alive, not delivered yet, and listened to, in the order of their
%% ids.
-spec waiting(Now :: integer(), #{Type :: atom() => starl_machine:name()}, t()) ->
    [{id(), starl_geocast:area(), Type :: atom(), Body :: term()}].
waiting(Now, Listeners, #store{known = Known}) ->
    lists:sort([
        {Id, Held#held.area, Type, Held#held.body}
     || {Id, #held{deliverable = true, until = Until, type = Type} = Held} <- maps:to_list(Known),
        Now < Until,
        is_map_key(Type, Listeners)
    ]).

%% @doc These messages have been delivered.
-spec delivered([id()], t()) -> t().
delivered(Ids, Store) ->
    lists:foldl(
        fun(Id, #store{known = Known, delivered = Memory} = S) ->
            #{Id := #held{} = Held} = Known,
            Remembered = S#store{delivered = starl_geocast_memory:add(Id, Memory)},
            put_held(Id, Held#held{deliverable = false}, Remembered)
        end,
        Store,
        Ids
    ).

%% @doc This message was to be delivered, but too late: it waits again.
-spec undelivered(id(), t()) -> t().
undelivered(Id, #store{known = Known} = Store) ->
    case Known of
        #{Id := #held{} = Held} -> put_held(Id, Held#held{deliverable = true}, Store);
        #{} -> Store
    end.

%% @doc The deadline of a message that is held.
-spec until(id(), t()) -> UntilUs :: integer().
until(Id, #store{known = Known}) ->
    #{Id := #held{until = Until}} = Known,
    Until.

put_held(Id, Held, #store{known = Known} = Store) -> Store#store{known = Known#{Id => Held}}.
