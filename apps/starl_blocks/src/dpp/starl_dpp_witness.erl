%% @doc Other robots' clocks as witnesses against the own one: a coordinator whose clock stands still
%% would count its votes for ever. Pure.
%%
%% A message bears its sender's clock. It was sent before it is heard, so the sender's clock is ahead
%% of the own one by at most the difference of the two, and by just that if the message took no time.
%% What matters is how that grows: by more than clocks may drift, and be set, while so much time shows
%% on the own clock, only if the own clock has lost time. (A message that took long shows less.)
-module(starl_dpp_witness).

-export([new/0, hear/5]).
-export_type([t/0]).

%% How far each robot's clock was seen to be ahead (us), the most of it, and when.
-opaque t() :: #{starl:robot_id() => {AheadUs :: integer(), AtUs :: integer()}}.

%% @doc Nobody was heard yet.
-spec new() -> t().
new() -> #{}.

%% @doc A message of the robot bears this stamp. `lags': the own clock has lost more than `MostUs'
%% against the robot's, and the drift of both, since others were heard; what it lost is taken as
%% known then.
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
