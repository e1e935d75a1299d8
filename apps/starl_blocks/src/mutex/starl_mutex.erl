%% @doc The interface of mutual exclusion: at most one robot holds a token at a time.
%%
%% A token is any small term but a list. There may be any number of tokens, and none is declared.
%% Tokens are compared by `==', so `1' and `1.0' are the same token. A set of tokens is acquired all
%% or none, one token after the other in the order of terms, so that no two sets wait for each
%% other.
%%
%% Guarantee: no two robots hold one token at once, under every fault, as long as no clock is set,
%% stops or drifts by more than the stated bound. Every hold has a fencing number that is larger
%% than those of all earlier holds of the token. No number is used twice, even if clocks are wrong.
%%
%% A hold ends with its release, with a crash of the robot's mutex machine, or with its lease, if
%% the token's home cannot be reached until then. A robot that is late by no more than `lag_ms'
%% notices the end before any other robot gets the token. A robot that stalls for longer notices it
%% as soon as it goes on. So if an action must not happen after the end of a hold, let its receiver
%% check the fencing number.
-module(starl_mutex).
-behaviour(starl_block).

-export([
    options/0,
    machines/1,
    monitors/2,
    guarantees/0,
    propositions/0,
    contract/0,
    exercise/0,
    models/0,
    history/0,
    benchmark/0
]).
-export([acquire/2, acquire/3, release/2, owner/2, with_token/3, home/2]).

-export_type([token/0, fence/0]).

%% The name of a token: any small term but a list.
-type token() :: term().

%% The number of a hold; it grows from hold to hold of a token, over all robots.
-type fence() :: pos_integer().

-define(PATIENCE_MS, 30000).

%% µs that a clock gains in a tick; the ratio of the slowest to the fastest is the default bound
%% on drift, 10000 ppm.
-define(SLOW, 99).
-define(FAST, 101).
-define(TOKEN, door).
%% A patience so long that the checker decides when a call fails.
-define(PATIENCE_US, 30000000).

%% @doc Acquires a token or a list of tokens, and waits for at most 30 s.
-spec acquire(starl:robot(), token() | [token()]) ->
    {ok, fence() | [{token(), fence()}]} | {error, timeout | restarted | late}.
acquire(Robot, Tokens) -> acquire(Robot, Tokens, ?PATIENCE_MS).

%% @doc Acquires a token or all tokens of a list. It fails after `Ms' milliseconds, and then holds
%% none of them. For a list it returns the tokens with their fences. A call for a token that the
%% caller holds waits for its release. `late': the computer stalled while the answer was on its way,
%% until the lease was over; the tokens that it still holds are released.
-spec acquire(starl:robot(), token() | [token()], Ms :: pos_integer()) ->
    {ok, fence() | [{token(), fence()}]} | {error, timeout | restarted | late}.
acquire(Robot, Tokens, Ms) ->
    ok = tokens({?MODULE, acquire, 3}, Tokens),
    ok = starl_caller:check({?MODULE, acquire, 3}, 'Ms', positive_ms, Ms),
    case starl:call(Robot, mutex, {acquire, Tokens, Ms * 1000}, infinity) of
        {ok, late} ->
            _ = starl:call(Robot, mutex, {forgo, Tokens}, infinity),
            {error, late};
        {ok, Answer} ->
            Answer;
        {error, restarted} ->
            {error, restarted}
    end.

%% @doc Releases a token, or all tokens of a list. `lost': the robot no longer held at least one of
%% them, so another robot may have held it meanwhile. The others are released.
-spec release(starl:robot(), token() | [token()]) -> ok | {error, lost | restarted}.
release(Robot, Tokens) ->
    ok = tokens({?MODULE, release, 2}, Tokens),
    case starl:call(Robot, mutex, {release, Tokens}, infinity) of
        {ok, Answer} -> Answer;
        {error, restarted} -> {error, restarted}
    end.

%% @doc Returns the robot that was last announced as the token's owner. An owner that has released
%% the token remains its owner until it hands the token over.
-spec owner(starl:robot(), token()) -> {ok, starl:robot_id() | none} | {error, restarted}.
owner(Robot, Token) ->
    ok = token({?MODULE, owner, 2}, Token),
    case starl:call(Robot, mutex, {owner, Token}, infinity) of
        {ok, Answer} -> {ok, Answer};
        {error, restarted} -> {error, restarted}
    end.

%% @doc Acquires the tokens, calls the function with the fence (or the list of fences), and releases
%% the tokens. `{error, {Lost, Result}}': the hold ended before the function returned.
-spec with_token(starl:robot(), token() | [token()], Fun) ->
    {ok, Result} | {error, timeout | restarted | late | {lost | restarted, Result}}
when
    Fun :: fun((fence() | [{token(), fence()}]) -> Result).
with_token(Robot, Tokens, Fun) ->
    is_function(Fun, 1) orelse
        starl_caller:mistake({?MODULE, with_token, 3}, 'Fun', Fun, "a function of the fence"),
    case acquire(Robot, Tokens) of
        {ok, Fence} -> released(Fun(Fence), release(Robot, Tokens));
        {error, _} = Error -> Error
    end.

tokens(Function, Tokens) when is_list(Tokens) ->
    is_list_of_tokens(Tokens) orelse
        starl_caller:mistake(
            Function, 'Tokens', Tokens, "a token that is no list, or a list of them"
        ),
    lists:foreach(fun(Token) -> label(Function, 'Tokens', Token) end, Tokens);
tokens(Function, Token) ->
    label(Function, 'Tokens', Token).

is_list_of_tokens([]) -> true;
is_list_of_tokens([Token | Tokens]) when not is_list(Token) -> is_list_of_tokens(Tokens);
is_list_of_tokens(_) -> false.

token(Function, Token) ->
    is_list(Token) andalso
        starl_caller:mistake(Function, 'Token', Token, "a token, which is no list"),
    label(Function, 'Token', Token).

label(Function, Argument, Token) -> starl_caller:payload(Function, Argument, label, Token).

%% @doc Returns the home of a token in a team, by a hash of its name. The token can be acquired as
%% long as its home lives.
-spec home(token(), [starl:robot_id(), ...]) -> starl:robot_id().
home(Token, Team) -> lists:nth(erlang:phash2(Token, length(Team)) + 1, Team).

released(Result, ok) -> {ok, Result};
released(Result, {error, Why}) -> {error, {Why, Result}}.

%% -- the block ------------------------------------------------------------------------------

-spec options() -> [starl_options:option()].
options() ->
    [
        {lease_ms, {integer, 1, 1000000000}, 8000,
            "the time that a hold outlives the last answer of the token's home, ms"},
        {drift_ppm, {integer, 0, 100000}, 10000,
            "no clock is faster or slower than real time by more, ppm"},
        {lag_ms, {integer, 0, 1000000}, 250,
            "no robot handles an event later than this after it is due, ms"},
        {retry_ms, {integer, 1, 1000000000}, 3000, "a robot that waits asks again after this, ms"}
    ].

-spec machines(starl_block:options()) -> [starl_robot_sup:machine()].
machines(Options) -> [{mutex, starl_mutex_tokens, Options}].

-spec monitors(starl_block:options(), starl_block:context()) -> [{module(), map()}].
monitors(Options, #{robots := Robots}) ->
    #{lease_ms := Lease, drift_ppm := Ppm, lag_ms := Lag, retry_ms := Retry} = Options,
    [
        {starl_mutex_monitor, #{
            robots => Robots,
            lease_us => 1000 * Lease,
            drift_ppm => Ppm,
            lag_us => 1000 * Lag,
            retry_us => 1000 * Retry
        }}
    ].

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {exclusion, safety, "no two robots hold one token at once", [clock_rate, clock_set, prompt]},
        {fences, safety, "no fencing number is given twice, whatever clocks do", []},
        {owned, progress, "all know the owner that has announced itself last, and who holds has", [
            alive, prompt, {sap, delivered}
        ]},
        {granted, progress, "holders release: every request is granted", [
            alive, clock_rate, clock_set, prompt, {sap, delivered}
        ]}
    ].

-spec propositions() -> [starl_guarantee:proposition()].
propositions() ->
    [
        {"Proposition 2(a)", exclusion, [two_holders]},
        {"Proposition 2(b)", granted, [lies_idle, no_grant_in_time]},
        {"Proposition 2(c), an owner announces itself", owned, [owner_not_announced, false_owner]},
        {"Proposition 2(c), all know it", owned, [not_as_promised]}
    ].

-spec contract() -> string().
contract() -> "no two robots hold one token at once; no fencing number is given twice".

-spec exercise() -> module().
exercise() -> starl_mutex_exercise.

-spec history() -> module().
history() -> starl_mutex_history.

-spec models() -> [starl_block:model_entry()].
models() ->
    New = fun(Team) -> model(machines(#{}), Team) end,
    [{mutex, "mutual exclusion, with leases and drifting clocks", New}].

-spec benchmark() -> starl_block:benchmark().
benchmark() ->
    #{
        workload => #{tokens => 1, hold => 50, pause => 100, work => 60},
        operations => acquired,
        packets => fun(N) -> N + 8 end,
        formula => "N + 8"
    }.

%% -- the model --------------------------------------------------------------------------------

%% The model of mutual exclusion for the exhaustive checker: one token, and all robots but its
%% home want it once. The times are the block's defaults: only their proportions matter.
%%
%% The home's clock is fast, all others are slow: so a holder's lease lasts longest and the home's
%% shortest, and only these two are compared. The home's own application wants nothing: its calls
%% of its own machine need no message.

%% The model for a team with these machines.
-spec model([starl_robot_sup:machine()], starl_block:team()) -> starl_block:model().
model(Machines, #{robots := Ids}) ->
    Home = home(?TOKEN, lists:seq(1, length(Ids))),
    #{lease_ms := LeaseMs} = starl_options:defaults(options()),
    LeaseUs = 1000 * LeaseMs,
    Slow = erlang:make_tuple(length(Ids), ?SLOW),
    #{
        blocks => Machines,
        script => fun(Place) -> script(Place, Home) end,
        crash => [mutex, app],
        monitor => {starl_mutex_model_monitor, #{}},
        timed => [lease, home],
        rates => setelement(Home, Slow, ?FAST),
        grain => LeaseUs div (2 * ?SLOW) + 1,
        %% at most a lease is added to the time that a message carries before it is compared with
        %% the present. A machine keeps ends of leases, which are compared as they are: one that
        %% is over is over, however long
        horizon_us => LeaseUs,
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
