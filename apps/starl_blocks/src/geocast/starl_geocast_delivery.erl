%% @doc Delivers geocasts to the machines of the robot that listen for them. It asks for the robot's
%% position only while a message waits for it. Pure; a part of {@link starl_geocast_flood}, which
%% holds the messages in a {@link starl_geocast_store}.
-module(starl_geocast_delivery).

-export([new/2, listen/3, check/3, check_again/3, located/5]).

-export_type([t/0, config/0]).

%% `position_error_mm': the greatest error of a reported position; `check_us': the time between two
%% checks whether the robot has come into an area.
-type config() :: #{
    position_error_mm := float(),
    check_us := pos_integer(),
    listeners := #{Type :: atom() => starl_machine:name()}
}.

%% A position that took longer to come is out of date.
-define(FRESH_US, 100000).

-record(delivery, {
    self :: starl:robot_id(),
    error_mm :: float(),
    check_us :: pos_integer(),
    listeners :: #{atom() => starl_machine:name()},
    asked = {0, 0} :: {N :: non_neg_integer(), AtUs :: integer()},
    %% is the timer set?
    checking = false :: boolean()
}).

-opaque t() :: #delivery{}.

%% @doc The deliveries of a robot.
-spec new(starl:robot_id(), config()) -> t().
new(Self, #{position_error_mm := Error, check_us := Us, listeners := Listeners}) ->
    #delivery{self = Self, error_mm = Error, check_us = Us, listeners = Listeners}.

%% @doc A machine listens to messages of a type from now on.
-spec listen(Type :: atom(), starl_machine:name(), t()) -> t().
listen(Type, Machine, #delivery{listeners = Listeners} = Delivery) ->
    Delivery#delivery{listeners = Listeners#{Type => Machine}}.

%% @doc Asks for the own position if a message waits for it, now and again from time to time.
-spec check(Now :: integer(), starl_geocast_store:t(), t()) -> {[starl_machine:action()], t()}.
check(Now, Store, #delivery{listeners = Listeners} = Delivery) ->
    case starl_geocast_store:waiting(Now, Listeners, Store) of
        [] -> {[], Delivery};
        [_ | _] -> ask(Now, Delivery)
    end.

ask(Now, #delivery{self = Self, asked = {N, _}, checking = Checking, check_us = Us} = Delivery) ->
    Ask = starl_location:pose(Self, {where, N + 1}),
    Timer = [{{timeout, check}, Us, check} || not Checking],
    {[Ask | Timer], Delivery#delivery{asked = {N + 1, Now}, checking = true}}.

%% @doc The same when the timer has run out.
-spec check_again(Now :: integer(), starl_geocast_store:t(), t()) ->
    {[starl_machine:action()], t()}.
check_again(Now, Store, Delivery) -> check(Now, Store, Delivery#delivery{checking = false}).

%% @doc Handles the answer to the N-th question for the position: delivers the waiting messages in
%% whose areas the robot surely is. A delivery leaves while the position is fresh and the message
%% lives, or not at all, since a computer may stall in mid-step while its robot drives on.
-spec located(
    N :: pos_integer(),
    Answer :: term(),
    Now :: integer(),
    starl_geocast_store:t(),
    t()
) -> {[starl_machine:action()], starl_geocast_store:t()} | stale.
located(N, {ok, {X, Y, _}}, Now, Store, #delivery{asked = {N, At}} = Delivery) when
    Now - At =< ?FRESH_US
->
    #delivery{error_mm = Error, listeners = Listeners} = Delivery,
    Mine = [
        Message
     || {_, Area, _, _} = Message <- starl_geocast_store:waiting(Now, Listeners, Store),
        starl_geocast_area:depth({X, Y}, Area) >= Error
    ],
    Delivered = starl_geocast_store:delivered([Id || {Id, _, _, _} <- Mine], Store),
    Until = fun(Id) -> min(At + ?FRESH_US, starl_geocast_store:until(Id, Store) - 1) end,
    {
        [
            {until, Until(Id), deliver(Message, Listeners), {delivered, Id}}
         || {Id, _, _, _} = Message <- Mine
        ],
        Delivered
    };
located(_N, _Answer, _Now, _Store, _Delivery) ->
    stale.

deliver({{Source, _, _} = Id, Area, Type, Body}, Listeners) ->
    [
        {trace, {delivered, Id, erlang:phash2({Area, Type, Body})}},
        {cast, maps:get(Type, Listeners), {message, Source, Type, Body}}
    ].
