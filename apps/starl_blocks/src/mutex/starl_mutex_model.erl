%% @doc The model of mutual exclusion for the exhaustive checker: one token, and all robots but its
%% home want it once. The times are the block's defaults: only their proportions matter.
%%
%% The home's clock is fast, all others are slow: so a holder's lease lasts longest and the home's
%% shortest, and only these two are compared. The home's own application wants nothing: its calls
%% of its own machine need no message.
-module(starl_mutex_model).

-export([new/2]).

%% µs that a clock gains in a tick; the ratio of the slowest to the fastest is the default bound
%% on drift, 10000 ppm.
-define(SLOW, 99).
-define(FAST, 101).
-define(TOKEN, door).
-define(LEASE_US, 8000000).
%% A patience so long that the checker decides when a call fails.
-define(PATIENCE_US, 30000000).

%% @doc The model for a team with these machines.
-spec new([starl_robot_sup:machine()], starl_block:team()) -> starl_block:model().
new(Machines, #{robots := Ids}) ->
    Home = erlang:phash2(?TOKEN, length(Ids)) + 1,
    Slow = erlang:make_tuple(length(Ids), ?SLOW),
    #{
        blocks => Machines,
        script => fun(Place) -> script(Place, Home) end,
        crash => [mutex, app],
        monitor => {starl_mutex_model_monitor, #{}},
        timed => [lease, home],
        rates => setelement(Home, Slow, ?FAST),
        grain => ?LEASE_US div (2 * ?SLOW) + 1,
        %% at most a lease is added to the time that a message carries before it is compared with
        %% the present. A machine keeps ends of leases, which are compared as they are: one that
        %% is over is over, however long
        horizon_us => ?LEASE_US,
        %% a machine that starts anew waits as the home that it is, which only one robot is
        waits => [Home],
        fixed => [Home],
        inert => fun is_inert/2
    }.

script(Home, Home) ->
    [];
script(_Place, _Home) ->
    [
        {call, mutex, {acquire, ?TOKEN, ?PATIENCE_US}}, {'try', mutex, {release, ?TOKEN}}
    ].

%% The fence of the owner known only grows.
is_inert(mutex, {owner, _, _}) -> true;
is_inert(_Type, _Body) -> false.
