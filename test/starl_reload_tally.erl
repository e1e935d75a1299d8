%% A block for the tests of reloads: a machine of each robot that counts, for its application, in
%% memory only. What it has forgotten, its application sees.
%%
%% Its data are the shapes through which versions have carried it, the present one first, and the
%% number. The versions are made by {@link starl_reload_schedule}.
-module(starl_reload_tally).
-behaviour(starl_block).
-behaviour(starl_machine).

-export([options/0, machines/1, monitors/2, contract/0]).
-export([init/1, handle_event/5, count/2]).

-define(STEPS, 150).
-define(STEP_MS, 200).

options() -> [].

machines(_Options) -> [{tally, ?MODULE, #{}}].

monitors(_Options, _Team) -> [].

contract() -> "the number grows by one with each call".

%% The step of the application, which all its versions share.
count(_Robot, ?STEPS) ->
    {done, ?STEPS};
count(Robot, N) ->
    ok = starl:sleep(Robot, ?STEP_MS),
    case starl:call(Robot, tally, add, infinity) of
        {ok, Tally} ->
            ok = starl:trace(Robot, {counted, N + 1, Tally}),
            N + 1;
        {error, restarted} ->
            N
    end.

init(_Config) -> {ready, {[first], 0}, []}.

handle_event({call, From}, add, ready, {[first], N}, _Meta) ->
    {keep_state, {[first], N + 1}, [{reply, From, N + 1}]};
handle_event(_, _, _, _, _) ->
    unknown_event.
