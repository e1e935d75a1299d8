%% @doc Compares the own clock with those of other robots, to notice when it has lost time: a
%% coordinator whose clock stands still would count its votes for ever. Pure.
%%
%% A message bears a stamp: the sender's clock when it was sent. The sender's clock is ahead of the
%% own one by at least the stamp minus the own clock at receipt, and by just that if the message
%% took no time. If this difference grows by more than drift and clock jumps allow for the time that
%% has passed on the own clock, the own clock has lost time. (A long delay makes it smaller.)
-module(starl_dpp_witness).

-export([new/0, hear/5]).
-export_type([t/0]).

%% The greatest lead over the own clock that was seen of each robot's clock (us), and when.
-opaque t() :: #{starl:robot_id() => {AheadUs :: integer(), AtUs :: integer()}}.

%% @doc No robot was heard yet.
-spec new() -> t().
new() -> #{}.

%% @doc Takes note of a message of the robot with this stamp. `lags': since that robot was heard,
%% the own clock has lost more than `MostUs' against its clock, beside the drift of both; the loss
%% is taken as known from then on, for all robots.
-spec hear(starl:robot_id(), Stamp | none, Now :: integer(), {MostUs, Ppm}, t()) ->
    {agrees | lags, t()}
when
    Stamp :: starl_dpp_lease:stamp(), MostUs :: non_neg_integer(), Ppm :: non_neg_integer().
hear(_Robot, none, _Now, _Bounds, Witnesses) ->
    {agrees, Witnesses};
hear(Robot, Stamp, Now, {Most, Ppm}, Witnesses) ->
    Ahead = Stamp - Now,
    case Witnesses of
        #{Robot := {Before, At}} ->
            Drifted = Before + 2 * Ppm * max(0, Now - At) div 1000000,
            if
                Ahead > Drifted + Most -> {lags, later(Ahead - Drifted, Witnesses)};
                Ahead > Drifted -> {agrees, Witnesses#{Robot := {Ahead, Now}}};
                true -> {agrees, Witnesses}
            end;
        #{} ->
            {agrees, Witnesses#{Robot => {Ahead, Now}}}
    end.

later(Us, Witnesses) -> maps:map(fun(_, {Ahead, At}) -> {Ahead + Us, At} end, Witnesses).
