%% @doc Compares the own clock with those of other robots, to notice when it has lost time: a
%% coordinator whose clock stands still would count its votes for ever. Pure.
%%
%% A message bears a stamp: the sender's clock when it was sent. The sender's clock is ahead of the
%% own one by at least the stamp minus the own clock at receipt, and by just that if the message
%% took no time. If this difference grows by more than drift and clock jumps allow for the time that
%% has passed on the own clock, the own clock has lost time. (A long delay makes it smaller.)
-module(starl_dpp_clock_check).

-export([new/0, hear/5]).
-export_type([t/0, limits/0]).

%% The greatest lead over the own clock that was seen of a robot's clock (us), and when.
-type lead() :: {AheadUs :: integer(), AtUs :: integer()}.

%% Of each robot: the lead that it is held to, and the one since a time, which will be in its place a
%% window of the own clock later. So a clock that loses little from message to message, and much in all,
%% is found; and one that stands still gets to no other lead.
-opaque t() :: #{starl:robot_id() => {Held :: lead(), Seen :: lead(), SinceUs :: integer()}}.

%% How far a clock is set at most (us), the greatest drift of a clock (ppm), and the window (us).
-type limits() :: {
    MostUs :: non_neg_integer(), Ppm :: non_neg_integer(), WindowUs :: non_neg_integer()
}.

%% @doc No robot was heard yet.
-spec new() -> t().
new() -> #{}.

%% @doc Takes note of a message of the robot with this stamp. `lags': since that robot was heard,
%% the own clock has lost more than `MostUs' against its clock, beside the drift of both; the loss
%% is taken as known from then on, for all robots.
-spec hear(starl:robot_id(), starl_dpp_lease:stamp() | none, Now :: integer(), limits(), t()) ->
    {agrees | lags, t()}.
hear(_Robot, none, _Now, _Limits, Witnesses) ->
    {agrees, Witnesses};
hear(Robot, Stamp, Now, {Most, Ppm, Window}, Witnesses) ->
    Ahead = Stamp - Now,
    case Witnesses of
        #{Robot := {{Before, At} = Held, Seen, Since}} ->
            Drift = drift_us(max(0, Now - At), Ppm),
            case Ahead - Before - Drift of
                Lost when Lost > Most ->
                    {lags, later(Lost, Witnesses)};
                _ when Now - Since >= Window ->
                    Next = larger(Seen, {Before - Drift, Now}),
                    {agrees, Witnesses#{Robot := {Next, {Ahead, Now}, Now}}};
                _ ->
                    {agrees, Witnesses#{Robot := {Held, larger({Ahead, Now}, Seen), Since}}}
            end;
        #{} ->
            {agrees, Witnesses#{Robot => {{Ahead, Now}, {Ahead, Now}, Now}}}
    end.

%% What the fastest clock gains on the slowest within this time of the slowest, rounded up. The own clock may
%% be the slowest.
drift_us(Us, Ppm) -> (2 * Ppm * Us + 999999 - Ppm) div (1000000 - Ppm).

larger({A, _} = One, {B, _}) when A > B -> One;
larger(_One, Other) -> Other.

later(Us, Witnesses) ->
    maps:map(
        fun(_, {{Held, At}, {Seen, Then}, Since}) ->
            {{Held + Us, At}, {Seen + Us, Then}, Since}
        end,
        Witnesses
    ).
