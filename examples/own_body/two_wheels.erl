%% A robot with two wheels behind UDP: a chassis of one's own in one file. The robot hears the speeds of its
%% wheels, "LEFT RIGHT MS" (mm/s, and how long), stands when that time is over, and answers each line, and each
%% empty one, with where it is and how long it still drives: "X Y HEADING MS".
%%
%%     ./starl chassis check examples/own_body/two_wheels.erl
-module(two_wheels).
-behaviour(starl_live_chassis).

-export([options/0, open/1, drive/4, actuate/4, stop/1, hear/2, close/1, look/1]).

options() ->
    [
        {port, {integer, 0, 65535}, 0, "the robot's UDP port on this computer; 0: emulate one"}
    ].

open(#{clock := Clock, port := Port} = Config) ->
    At = maps:get(at, Config, {0.0, 0.0, 0.0}),
    {ok, Socket} = gen_udp:open(0, [binary, {ip, {127, 0, 0, 1}}, {active, true}]),
    {ok, look(#{socket => Socket, port => robot(Port, At), clock => Clock, job => none})}.

%% One leg at a time. The robot's own time ends it: when it should be over, the robot is asked whether it is.
drive({starl_chassis_differential, Legs}, _Until, Mark, #{clock := Clock} = Bot) ->
    leg(Legs, Bot#{job := {Mark, starl_live_clock:now_us(Clock), none}});
drive({_Other, Commands}, _Until, Mark, Bot) ->
    {[{Mark, {not_understood, Commands}}], Bot}.

leg([{Left, Right, Us} | Legs], Bot) ->
    {[], say("~w ~w ~w", [Left, Right, Us / 1000], later(Us / 1000, Legs, Bot))};
leg([], #{job := {Mark, Heard, _}} = Bot) ->
    {[{Mark, {driven, Heard}}], stop(Bot)}.

later(Ms, Legs, #{job := {Mark, Heard, _}} = Bot) ->
    Ref = make_ref(),
    _ = erlang:send_after(ceil(Ms), self(), {over, Ref, Legs}),
    Bot#{job := {Mark, Heard, Ref}}.

drives(Ms, #{job := {_, _, {asked, Legs}}} = Bot) when Ms > 0 -> {[], later(Ms, Legs, Bot)};
drives(_Ms, #{job := {_, _, {asked, Legs}}} = Bot) -> leg(Legs, Bot);
drives(_Ms, Bot) -> {[], Bot}.

actuate(_Device, _Value, _Mark, Bot) -> {[], Bot}.

stop(Bot) -> say("0 0 0", [], Bot#{job := none}).

look(Bot) -> say("", [], Bot).

hear({udp, Socket, _, _, Text}, #{socket := Socket, clock := Clock} = Bot) ->
    [X, Y, Heading, Ms] = [binary_to_float(N) || N <- binary:split(Text, <<" ">>, [global])],
    {Answers, Next} = drives(Ms, Bot),
    {[{posed, starl_live_clock:now_us(Clock), {X, Y, Heading}} | Answers], Next};
hear({over, Ref, Legs}, #{job := {Mark, Heard, Ref}} = Bot) ->
    {[], look(Bot#{job := {Mark, Heard, {asked, Legs}}})};
hear({over, _, _}, Bot) ->
    {[], Bot};
hear(_Message, _Bot) ->
    unknown.

close(#{socket := Socket}) -> gen_udp:close(Socket).

say(Format, Values, #{socket := Socket, port := Port} = Bot) ->
    ok = gen_udp:send(Socket, {127, 0, 0, 1}, Port, io_lib:format(Format, Values)),
    Bot.

robot(0, At) -> two_wheels_robot:start(At);
robot(Port, _At) -> Port.
