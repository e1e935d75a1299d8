%% The block of path planning on robots whose stores hold a term that nobody can have come to, as an earlier version
%% stored it; for tests ({@link starl_dpp_insider}). In their first life they find it, later what they have stored.
-module(starl_dpp_attacked).
-behaviour(starl_block).
-behaviour(starl_machine).

-export([options/0, check/1, machines/1, monitors/2, contract/0, guarantees/0]).
-export([init/1, handle_event/5, accepts/2]).

options() -> starl_dpp:options().

check(Options) -> starl_dpp:check(Options).

machines(Options) ->
    [{dpp, _, Config} | Others] = starl_dpp:machines(Options),
    [{dpp, ?MODULE, Config} | Others].

monitors(Options, Context) -> starl_dpp:monitors(Options, Context).

contract() -> starl_dpp:contract().

guarantees() -> starl_dpp:guarantees().

init(#{stored := none, robot := Robot} = Config) ->
    Most = starl_dpp_insider:most(),
    starl_dpp_participant:init(Config#{stored := {stored, {Most, 3 - Robot rem 2, 1 bsl 57}}});
init(Config) ->
    starl_dpp_participant:init(Config).

handle_event(Type, Content, State, Data, Meta) ->
    starl_dpp_participant:handle_event(Type, Content, State, Data, Meta).

accepts(Type, Body) -> starl_dpp_participant:accepts(Type, Body).
