%% @doc The simulated radio: what happens to the N-th packet from one robot to another.
-module(starl_sim_radio).

-export([lost/2, delays/2]).

-export_type([link/0]).

%% The seed, the source, the destination, and the packet's number among those that went this way,
%% or among those for all.
-type link() ::
    {integer(), starl:robot_id(), starl:robot_id(), pos_integer() | {all, pos_integer()}}.

%% @doc Is the packet lost?
-spec lost(link(), starl_sim_platform:world()) -> boolean().
lost(_Link, #{loss := Loss}) when Loss == 0 -> false;
lost(Link, #{loss := Loss}) -> starl_sim_draw:uniform({Link, loss}) < Loss.

%% @doc The delays, in microseconds, of the one or two copies that arrive.
-spec delays(link(), starl_sim_platform:world()) -> [pos_integer(), ...].
delays(Link, #{duplicate := Duplicate} = World) ->
    case Duplicate > 0 andalso starl_sim_draw:uniform({Link, duplicate}) < Duplicate of
        true -> [delay({Link, delay}, World), delay({Link, again}, World)];
        false -> [delay({Link, delay}, World)]
    end.

%% Whole milliseconds where both bounds are, as in the paper's and our benchmarks' workloads.
delay(Key, #{delay_us := {Min, Max}}) when Min rem 1000 =:= 0, Max rem 1000 =:= 0 ->
    1000 * starl_sim_draw:between(Key, Min div 1000, Max div 1000);
delay(Key, #{delay_us := {Min, Max}}) ->
    starl_sim_draw:between(Key, Min, Max).
