%% @doc What is done to a live run by hand, or by chaos: cuts, frozen positions, kills, as faults with a
%% beginning and an end, for those who watch the run. A pure module.
-module(starl_world_hands).

-export([new/0, holds/4, holds/5, struck/4]).

-export_type([t/0, told/0, fault/0, target/0]).

-type target() :: starl:robot_id() | {starl:robot_id(), starl:robot_id()}.

%% A fault as of a scenario; while it lasts, nobody knows its end.
-type fault() ::
    {
        Id :: atom(),
        FromMs :: integer(),
        ToMs :: integer() | forever,
        Kind :: atom(),
        target(),
        map()
    }.

-type told() :: {began | ended, fault()}.

-record(hands, {
    count = 0 :: non_neg_integer(),
    lasting = [] :: [fault()]
}).

-opaque t() :: #hands{}.

%% @doc Nothing has been done yet.
-spec new() -> t().
new() -> #hands{}.

%% @doc From now on faults of this kind hold for these targets and no others: what begins, what ends.
-spec holds(Kind :: atom(), [target()], AtUs :: integer(), t()) -> {[told()], t()}.
holds(Kind, Targets, At, Hands) -> holds(Kind, params(Kind), Targets, At, Hands).

%% @doc The same for faults of this kind that have these parameters.
-spec holds(Kind :: atom(), map(), [target()], AtUs :: integer(), t()) -> {[told()], t()}.
holds(Kind, Params, Targets, At, #hands{lasting = Lasting} = Hands) ->
    {Own, Others} = lists:partition(
        fun(Fault) -> {element(4, Fault), element(6, Fault)} =:= {Kind, Params} end, Lasting
    ),
    {Kept, Over} = lists:partition(fun(Fault) -> lists:member(element(5, Fault), Targets) end, Own),
    New = Targets -- [element(5, Fault) || Fault <- Kept],
    {Begun, Next} = lists:mapfoldl(
        fun(Target, H) -> begun({Kind, Params}, Target, At, forever, H) end,
        Hands#hands{lasting = Kept ++ Others},
        New
    ),
    Ended = [{ended, setelement(3, Fault, At div 1000)} || Fault <- Over],
    {Ended ++ [{began, Fault} || Fault <- Begun], Next#hands{lasting = Begun ++ Kept ++ Others}}.

%% @doc Something has happened at once, such as a kill.
-spec struck(Kind :: atom(), target(), AtUs :: integer(), t()) -> {[told()], t()}.
struck(Kind, Target, At, Hands) ->
    {Fault, Next} = begun({Kind, params(Kind)}, Target, At, At div 1000, Hands),
    {[{began, Fault}], Next}.

begun({Kind, Params}, Target, At, To, #hands{count = Count} = Hands) ->
    Id = list_to_atom("hand_" ++ integer_to_list(Count + 1)),
    {{Id, At div 1000, To, Kind, Target, Params}, Hands#hands{count = Count + 1}}.

%% A cut link loses everything.
params(loss) -> #{part => 1.0};
params(_) -> #{}.
