%% @doc Computes how much of a message's lifetime is surely left, with clocks that drift but do not
%% jump.
%%
%% A clock shows between (1 - d) t and (1 + d) t while a true time t passes. All answers err on
%% the safe side: a deadline is never after the true end of the lifetime.
%%
%% No clock is compared with another. A robot notes when it asks (`asked', by its own clock). The
%% answer carries the rest of the lifetime (`left') at the time it was sent, which was after the
%% asking. So the end is not before asked + left, for any delay of question and answer. (Cristian,
%% "Probabilistic clock synchronization", 1989, uses the round trip in the same way.)
-module(starl_geocast_lifetime).

-export([longest_us/0, deadline/3, left/3, is_sent_after/5, memory_us/2, least_us/3]).
-export([offers/3, missed/2]).

-define(MILLION, 1000000).
-define(DAY_US, (24 * 3600 * ?MILLION)).

-type us() :: integer().
%% The greatest drift of any clock, in millionths.
-type ppm() :: non_neg_integer().

%% @doc The longest lifetime of a message: a day. A longer lifetime that others claim is not
%% believed.
-spec longest_us() -> us().
longest_us() -> ?DAY_US.

%% @doc The own clock's time until which the message surely lives, when the question was asked at
%% `AskedUs' and the answer says that `LeftUs' is left.
-spec deadline(AskedUs :: us(), LeftUs :: us(), ppm()) -> us().
deadline(Asked, Left, Ppm) when is_integer(Asked) -> Asked + shortest(Left, Ppm).

%% @doc The rest, in true time, of the lifetime of a message that surely lives until a deadline.
%% Since the asking the clock has lost no more than the deadline allows for.
-spec left(DeadlineUs :: us(), NowUs :: us(), ppm()) -> us().
left(Deadline, Now, Ppm) -> max(0, Deadline - Now) * ?MILLION div (?MILLION - Ppm).

%% @doc Was a message surely sent after `SinceUs', if `LeftUs' of its lifetime was left when the
%% question asked at `AskedUs' was answered? (Times of the own clock.)
-spec is_sent_after(
    SinceUs :: us(), AskedUs :: us(), LifetimeUs :: us(), LeftUs :: us(), ppm()
) -> boolean().
is_sent_after(Since, Asked, Lifetime, Left, Ppm) ->
    Lifetime - Left < shortest(Asked - Since, Ppm).

%% @doc The time, by the own clock, after which the window of a message is surely over everywhere,
%% counted from when the message was first heard.
-spec memory_us(LifetimeUs :: us(), ppm()) -> us().
memory_us(Lifetime, Ppm) -> Lifetime * (?MILLION + Ppm) div ?MILLION + 1.

%% @doc The least lifetime with which a message comes in time to all robots that hear the source, if
%% no packet takes longer than `DelayUs' and a giver waits `GatherUs' for others that ask.
%%
%% A robot asks when it hears the first offer, `a' after the sending, `DelayUs' at most. The robot
%% that offers may itself have lost `a' of the lifetime. The question takes `q', the answer `d':
%% ```
%%   sent     asks             is answered              holds it       its deadline
%%     |--------|-- question -->|-- gather --|-- answer -->| ... |
%%     0        a             a + q        a + q + g    a + q + g + d  L - a - q - g
%% '''
%% So it is held in time if L is more than 2 a + 2 q + 2 g + d. Two clocks drift, each against a
%% deadline that the other's drift has shortened.
-spec least_us(DelayUs :: us(), GatherUs :: us(), ppm()) -> us().
least_us(Delay, Gather, Ppm) ->
    (5 * Delay + 2 * Gather) * ?MILLION div (?MILLION - 4 * Ppm) + 1.

%% @doc The least number of offers that a holder makes of a message in `Us', by its first and its
%% longest wait. It offers at once, and again after waits each of which is twice as long as the one
%% before. The last offer leaves time to ask and to answer, if no packet takes longer than
%% `DelayUs'.
-spec offers(Us :: us(), DelayUs :: us(), {FirstUs :: us(), LongestUs :: us()}) ->
    non_neg_integer().
offers(Us, Delay, {First, Longest}) -> offers_from(0, First, Longest, Us - 4 * Delay).

offers_from(At, _Wait, _Longest, Us) when At > Us -> 0;
offers_from(At, Wait, Longest, Us) ->
    1 + offers_from(At + Wait, min(2 * Wait, Longest), Longest, Us).

%% @doc The probability that a robot which hears the holder misses the message in all `Offers'
%% offers. An offer, the question and the answer are a packet each, and the radio loses the fraction
%% `Loss' of packets. That a robot asks more than once for one offer is left out.
-spec missed(Loss :: number(), Offers :: non_neg_integer()) -> float().
missed(_Loss, 0) -> 1.0;
missed(Loss, Offers) -> math:pow(1 - math:pow(1 - Loss, 3), Offers).

%% The time that surely shows on a clock while `Us' passes; also the true time that surely passes
%% while `Us' shows.
shortest(Us, Ppm) -> Us * (?MILLION - Ppm) div ?MILLION.
