%% Follow the leader with an insider, for tests: the first robot says beats of any kind to all others, once, and
%% drives on. The option `attack' is when (ms after its start), and what it says, one beat after the other.
-module(starl_leadership_insider).
-behaviour(starl_app).

-export([init/2, step/2]).
-export([options/0, blocks/0, monitors/1]).

-define(FOLLOW, starl_follow).

init(Robot, #{attack := {AtMs, Beats}} = Options) ->
    Attack =
        case {starl:id(Robot), starl:stored(Robot)} of
            {1, none} -> {starl:now(Robot) + AtMs, Beats};
            _ -> none
        end,
    {?FOLLOW:init(Robot, maps:remove(attack, Options)), Attack}.

step(Robot, {Follow, {At, Beats} = Attack}) ->
    case starl:now(Robot) >= At of
        true ->
            ok = starl:store(Robot, has_attacked),
            _ = [
                starl:send(Robot, To, beat, Beat)
             || Beat <- Beats, To <- starl:participants(Robot), To =/= starl:id(Robot)
            ],
            {continue, {Follow, none}};
        false ->
            followed(?FOLLOW:step(Robot, Follow), Attack)
    end;
step(Robot, {Follow, none}) ->
    followed(?FOLLOW:step(Robot, Follow), none).

followed({continue, Follow}, Attack) -> {continue, {Follow, Attack}};
followed({done, Result}, _Attack) -> {done, Result}.

options() ->
    [{attack, {term, "{Ms, Beats}", fun is_tuple/1}, {0, []}, ""} | ?FOLLOW:options()].

blocks() -> ?FOLLOW:blocks().

monitors(Context) -> ?FOLLOW:monitors(Context).
