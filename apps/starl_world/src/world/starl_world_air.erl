%% @doc The air of the simulated world, between robots in one VM: passes packets on with the loss and
%% the delays of the scenario.
-module(starl_world_air).
-behaviour(starl_live_transport).

-export([open/1, transmit/3, hear/2, figures/1, close/1]).

-record(air, {
    robot :: starl:robot_id(),
    others :: [starl:robot_id()],
    clock :: starl_live_clock:t(),
    loss :: float(),
    delay_us :: {pos_integer(), pos_integer()},
    sent = 0 :: non_neg_integer(),
    heard = 0 :: non_neg_integer()
}).

-spec open(starl_live_transport:config()) -> {ok, #air{}}.
open(#{robot := Robot, participants := Team, clock := Clock, loss := Loss, delay_us := Delay}) ->
    true = register(name(Robot), self()),
    Others = starl_team:others(Robot, Team),
    {ok, #air{robot = Robot, others = Others, clock = Clock, loss = Loss, delay_us = Delay}}.

name(Robot) -> list_to_atom("starl_world_air_" ++ integer_to_list(Robot)).

-spec transmit(starl:robot_id() | all, starl_packet:t(), #air{}) -> {ok, #air{}}.
transmit(all, Packet, #air{others = Others} = Air) ->
    {ok, lists:foldl(fun(To, A) -> pass(To, Packet, A) end, Air, Others)};
transmit(To, Packet, Air) ->
    {ok, pass(To, Packet, Air)}.

pass(To, Packet, #air{clock = Clock, loss = Loss, delay_us = {Least, Most}, sent = N} = Air) ->
    case {rand:uniform() < Loss, whereis(name(To))} of
        {false, Pid} when is_pid(Pid) ->
            Us = Least + rand:uniform(Most - Least + 1) - 1,
            Now = starl_live_clock:now_us(Clock),
            At = starl_live_clock:monotonic_ms(Now + Us, Clock),
            _ = erlang:send_after(At, Pid, {packet, Packet}, [{abs, true}]),
            ok;
        _ ->
            ok
    end,
    Air#air{sent = N + 1}.

-spec hear(term(), #air{}) -> {[starl_packet:t()], #air{}} | unknown.
hear({packet, Packet}, #air{heard = N} = Air) -> {[Packet], Air#air{heard = N + 1}};
hear(_Message, _Air) -> unknown.

-spec figures(#air{}) -> starl_live_transport:figures().
figures(#air{sent = Sent, heard = Heard}) -> #{sent => Sent, heard => Heard}.

-spec close(#air{}) -> ok.
close(_Air) -> ok.
