%% @doc Detects that a robot's own clock has lost time, by comparison with the clocks of other
%% robots. A coordinator whose clock has stopped would count its votes for ever. Pure.
%%
%% A message carries a stamp: the sender's clock when it was sent. The sender's clock is ahead of
%% the own clock by at least the stamp minus the own clock at receipt, and by exactly that if the
%% message took no time. This difference may grow by what drift and clock jumps allow for the time
%% that has passed on the own clock. If it grows by more, the own clock has lost time. (A long delay
%% makes the difference smaller.)
-module(starl_dpp_clock_check).

-export([new/0, hear/5]).
-export_type([t/0, limits/0]).

%% The greatest lead over the own clock that was seen of a robot's clock (us), and when.
-type lead() :: {AheadUs :: integer(), AtUs :: integer()}.

%% For each robot: the lead that it is held to, and the lead since a later time. The second replaces
%% the first after a window of the own clock. So a clock is found that loses little from message to
%% message but much in all. A clock that has stopped never gets another lead.
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
