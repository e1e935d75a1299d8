%% @doc Records the paths of all robots, as motion segments. It judges nothing. It records only a
%% limited number of segments; its result says until when.
-module(starl_run_paths_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

-export_type([paths/0]).

%% The motion segments of each robot's path, in the order of time, and the time until which they are known.
-type paths() :: #{
    pieces := [{starl:robot_id(), starl_trajectory:piece()}],
    until_us := non_neg_integer(),
    is_whole := boolean()
}.

-record(state, {
    pieces = [] :: [{starl:robot_id(), starl_trajectory:piece()}],
    room :: non_neg_integer(),
    %% the time of the first piece without room
    full = no :: non_neg_integer() | no
}).

%% @doc `most': the number of pieces that are recorded.
-spec init(#{most := non_neg_integer()}) -> #state{}.
init(#{most := Most}) -> #state{room = Most}.

-spec interests() -> [atom()].
interests() -> [chassis].

-spec step(starl_monitor:trace_event(), #state{}) -> {ok, #state{}}.
step({T, _, chassis, {motion, _}}, #state{room = 0, full = no} = State) ->
    {ok, State#state{full = T}};
step({_, Robot, chassis, {motion, Piece}}, #state{pieces = Pieces, room = Room} = State) when
    Room > 0
->
    {ok, State#state{pieces = [{Robot, Piece} | Pieces], room = Room - 1}};
step(_, State) ->
    {ok, State}.

-spec finish(integer(), #state{}) -> {ok, paths()}.
finish(EndUs, #state{pieces = Pieces, full = Full}) ->
    Until = min(EndUs, Full),
    {ok, #{pieces => lists:reverse(Pieces), until_us => Until, is_whole => Full =:= no}}.
