%% @doc Computes the schedule of SAP's retransmissions, and the time bounds that follow from it.
%% Monitors use them as the time in which a message arrives or is reported lost. Pure; a part of
%% {@link starl_sap}.
-module(starl_sap_schedule).

-export([delays/1, bound_us/1, reach_us/4, tries/1, missed/4, rounds/1]).
-export([settled_us/0, is_rare/1]).

%% The time in which the others learn that a robot has begun anew.
-define(SETTLED_US, 5000000).
%% The part of the messages for which a bound in time need not hold.
-define(RARE, 1.0e-9).

%% @doc The waiting times after each transmission, in microseconds: at least one.
-spec delays(starl_sap:config() | starl_machine:config()) -> [pos_integer()].
delays(Config) ->
    First = maps:get(retransmit_ms, Config, 250) * 1000,
    Longest = maps:get(longest_ms, Config, 2000) * 1000,
    Backoff = maps:get(backoff, Config, 1.5),
    delays(First, Backoff, max(First, Longest), maps:get(limit, Config, 15) + 1).

-spec delays(pos_integer(), float(), pos_integer(), non_neg_integer()) -> [pos_integer()].
delays(_Us, _Backoff, _Longest, 0) ->
    [];
delays(Us, Backoff, Longest, N) ->
    [Us | delays(min(round(Us * Backoff), Longest), Backoff, Longest, N - 1)].

%% @doc The longest time from sending a message to the report of its outcome, in microseconds
%% of the source's clock.
-spec bound_us(starl_sap:config()) -> integer().
bound_us(Config) -> round(lists:sum(delays(Config))).

%% @doc The time in which a message reaches a robot that lives. The radio loses the fraction `Loss'
%% of the packets and takes at most `DelayUs'. The sender's machine sends its message again
%% `RetryUs' after SAP has given it up (`never': it does not). The time is exceeded at most once in
%% 10^9 messages. It counts N transmissions such that Loss^N is at most 10^-9, with all N - 1
%% waiting times before the last one, by a clock that is 1 % slow.
-spec reach_us(starl_sap:config(), Loss :: number(), DelayUs :: non_neg_integer(), RetryUs) ->
    non_neg_integer() | never
when
    RetryUs :: non_neg_integer() | never.
reach_us(Config, Loss, DelayUs, RetryUs) when is_integer(DelayUs) ->
    Delays = delays(Config),
    Before = transmissions(Loss) - 1,
    case {Before div length(Delays), RetryUs} of
        {0, _} ->
            waited(lists:sublist(Delays, Before)) + DelayUs;
        {_, never} ->
            never;
        {GivenUp, _} ->
            Last = lists:sublist(Delays, Before rem length(Delays)),
            GivenUp * waited([RetryUs | Delays]) + waited(Last) + DelayUs
    end.

waited(Delays) -> round(lists:sum(Delays)) * 101 div 100.

transmissions(Loss) when Loss == 0 -> 1;
transmissions(Loss) when Loss < 1 -> ceil(math:log(?RARE) / math:log(Loss)).

%% @doc The part of the messages that do not reach a robot that lives within this time: all transmissions that leave
%% early enough, by a clock that is 1 % slow, are lost.
-spec missed(
    starl_sap:config(), Loss :: number(), DelayUs :: non_neg_integer(), WithinUs :: integer()
) -> float().
missed(Config, Loss, DelayUs, WithinUs) ->
    math:pow(Loss, in_time(delays(Config), 0, WithinUs - DelayUs)).

in_time(_Delays, Waited, Us) when Waited * 101 div 100 > Us -> 0;
in_time([], _Waited, _Us) -> 0;
in_time([Delay | Delays], Waited, Us) -> 1 + in_time(Delays, Waited + Delay, Us).

%% @doc The number of tries, each of which fails with this probability whatever becomes of the others, after which
%% all have failed at most once in 10^9 cases; `never' if each may fail.
-spec rounds(Failure :: float()) -> pos_integer() | never.
rounds(Failure) when Failure >= 1 -> never;
rounds(Failure) when Failure =< ?RARE -> 1;
rounds(Failure) -> ceil(math:log(?RARE) / math:log(Failure)).

%% @doc Is this probability so small that no bound need allow for it?
-spec is_rare(float()) -> boolean().
is_rare(Probability) -> Probability =< ?RARE.

%% @doc The time in which the others learn that a robot has begun anew. Until then they ask it for its number before they
%% take its first message.
-spec settled_us() -> pos_integer().
settled_us() -> ?SETTLED_US.

%% @doc The number of transmissions of a message that nobody acknowledges.
-spec tries(starl_sap:config()) -> pos_integer().
tries(Config) -> length(delays(Config)).
