%% @doc Counters of a transport, by name.
-module(starl_live_figures).

-export([count/2, count/3]).

-export_type([t/0]).

-type t() :: #{atom() => non_neg_integer()}.

%% @doc One more.
-spec count(atom(), t()) -> t().
count(Name, Figures) -> count(Name, 1, Figures).

%% @doc So many more.
-spec count(atom(), non_neg_integer(), t()) -> t().
count(Name, Number, Figures) ->
    maps:update_with(Name, fun(Before) -> Before + Number end, Number, Figures).
