%% @doc The fraction of trials with a certain result, with its confidence interval.
-module(starl_sim_proportion).

-export([fraction/1, interval/1, are_apart/2]).

-export_type([count/0]).

-type count() :: {Hits :: non_neg_integer(), Trials :: pos_integer()}.

%% The normal quantile for 95 %.
-define(Z, 1.959964).

%% @doc The fraction itself.
-spec fraction(count()) -> float().
fraction({Hits, Trials}) -> Hits / Trials.

%% @doc Wilson's interval at 95 %. It holds the true fraction in at least 91 of 100 cases for any
%% fraction and 20 trials or more.
-spec interval(count()) -> {Low :: float(), High :: float()}.
interval({Hits, Trials}) ->
    P = Hits / Trials,
    Square = ?Z * ?Z,
    Centre = P + Square / (2 * Trials),
    Half = ?Z * math:sqrt(P * (1 - P) / Trials + Square / (4 * Trials * Trials)),
    Whole = 1 + Square / Trials,
    {max(0.0, (Centre - Half) / Whole), min(1.0, (Centre + Half) / Whole)}.

%% @doc Is the second fraction above the first beyond both intervals?
-spec are_apart(count(), count()) -> boolean().
are_apart(Low, High) -> element(2, interval(Low)) < element(1, interval(High)).
