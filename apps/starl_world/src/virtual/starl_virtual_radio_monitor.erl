%% @doc The contract of the radio of live robots, for the runs of {@link starl_virtual_radio}.
%% <ul>
%% <li>What is heard was sent, in the sender's name, to the robot that hears it.</li>
%% <li>A robot hears a packet at most as often as it was sent, over all its boots together. It hears no
%%   packet that is older than the seal, the clocks and the fragments allow.</li>
%% <li>What is sent in a calm network is heard, except in the first seconds, in which robots that have just
%%   started learn of each other.</li>
%% <li>The memory of an end is bounded.</li>
%% </ul>
-module(starl_virtual_radio_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

%% Datagrams are fresh for 15 s, fragments wait for 10 s.
-define(FRESH_US, 25000000).
%% All robots have met in the calm network.
-define(MET_US, 43000000).

-type packet() :: pos_integer().

-record(state, {
    oldest_us :: pos_integer(),
    %% to whom, how often, and when a packet was sent last
    sent = #{} :: #{packet() => {[starl:robot_id()], pos_integer(), AtUs :: integer()}},
    heard = #{} :: #{{packet(), starl:robot_id()} => pos_integer()}
}).

%% @doc `offset_us': what clocks differ from true time by at most.
-spec init(#{offset_us := non_neg_integer()}) -> #state{}.
init(#{offset_us := Us}) -> #state{oldest_us = ?FRESH_US + 2 * Us}.

%% @doc What the ends of the radio report.
-spec interests() -> [udp].
interests() -> [udp].

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({At, _Robot, udp, {sent, N, To}}, #state{sent = Sent} = State) ->
    {_, Times, _} = maps:get(N, Sent, {To, 0, At}),
    {ok, State#state{sent = Sent#{N => {To, Times + 1, At}}}};
step({At, Robot, udp, {heard, N}}, #state{heard = Heard} = State) ->
    Times = maps:get({N, Robot}, Heard, 0) + 1,
    Noted = State#state{heard = Heard#{{N, Robot} => Times}},
    case wrong(At, Robot, N, Times, Noted) of
        none -> {ok, Noted};
        What -> {violation, violation(At, Robot, What, #{packet => N, times => Times}), Noted}
    end;
step({At, Robot, udp, {memory, Bytes}}, State) ->
    {violation, violation(At, Robot, memory, #{bytes => Bytes}), State};
step(_Event, State) ->
    {ok, State}.

wrong(At, Robot, N, Times, #state{sent = Sent, oldest_us = Oldest}) ->
    case Sent of
        #{N := {To, Most, SentAt}} ->
            case {lists:member(Robot, To), Times =< Most, At - SentAt =< Oldest} of
                {true, true, true} -> none;
                {false, _, _} -> heard_by_another;
                {true, false, _} -> heard_twice;
                {true, true, false} -> heard_late
            end;
        #{} ->
            never_sent
    end.

%% @doc Everything that was sent in the calm network, when all had met, has been heard.
-spec finish(integer(), #state{}) -> {ok | {violation, [starl_monitor:violation(), ...]}, #{}}.
finish(EndUs, #state{sent = Sent, heard = Heard}) ->
    Missing = [
        {N, Robot}
     || {N, {To, _, At}} <- lists:sort(maps:to_list(Sent)),
        At >= ?MET_US,
        Robot <- To,
        not is_map_key({N, Robot}, Heard)
    ],
    case Missing of
        [] -> {ok, #{}};
        [{N, Robot} | _] -> {{violation, [violation(EndUs, Robot, not_heard, #{packet => N})]}, #{}}
    end.

violation(At, Robot, What, Details) ->
    #{contract => virtual_radio, what => What, at_us => At, robots => [Robot], details => Details}.
