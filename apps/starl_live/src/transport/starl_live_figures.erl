%% @doc Counters of a transport, by name.
-module(starl_live_figures).

-export([count/2, count/3, refused/3]).

-export_type([t/0]).

-type t() :: #{atom() => non_neg_integer()}.

%% @doc One more.
-spec count(atom(), t()) -> t().
count(Name, Figures) -> count(Name, 1, Figures).

%% @doc So many more.
-spec count(atom(), non_neg_integer(), t()) -> t().
count(Name, Number, Figures) ->
    maps:update_with(Name, fun(Before) -> Before + Number end, Number, Figures).

%% @doc One more packet of a robot that was not taken, for this reason. What points to a mistake in the
%% set-up is said when it comes for the first time.
-spec refused(starl_live_codec:refusal(), From :: starl:robot_id(), t()) -> t().
refused(unknown_atom, From, Figures) when not is_map_key(unknown_atom, Figures) ->
    Line =
        "a packet of robot ~b bears an atom that is unknown here and is not taken; "
        "is the same code loaded on both computers?",
    logger:warning(#{what => unknown_atom, why => iolist_to_binary(io_lib:format(Line, [From]))}),
    count(unknown_atom, Figures);
refused(Why, _From, Figures) ->
    count(Why, Figures).
