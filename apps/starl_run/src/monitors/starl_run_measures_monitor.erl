%% @doc Collects what applications measure (`starl:measure/3'); it judges nothing. It keeps only a
%% limited number of values; its result says until when.
-module(starl_run_measures_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

-export_type([measures/0, value/0]).

-type value() :: {AtUs :: integer(), starl:robot_id(), Key :: atom(), Value :: number()}.

%% In the order of time. `until_us': until when the values are whole.
-type measures() :: #{
    values := [value()],
    until_us := non_neg_integer(),
    is_whole := boolean()
}.

-record(state, {
    values = [] :: [value()],
    room :: non_neg_integer(),
    %% the time of the first value without room
    full = no :: non_neg_integer() | no
}).

%% @doc `most': the number of values that are kept.
-spec init(#{most := non_neg_integer()}) -> #state{}.
init(#{most := Most}) -> #state{room = Most}.

-spec interests() -> [atom()].
interests() -> [app].

-spec step(starl_monitor:trace_event(), #state{}) -> {ok, #state{}}.
step({T, _, app, {measure, _, _}}, #state{room = 0, full = no} = State) ->
    {ok, State#state{full = T}};
step({T, Robot, app, {measure, Key, Value}}, #state{values = Values, room = Room} = State) when
    Room > 0, is_atom(Key), is_number(Value)
->
    {ok, State#state{values = [{T, Robot, Key, Value} | Values], room = Room - 1}};
step(_, State) ->
    {ok, State}.

-spec finish(integer(), #state{}) -> {ok, measures()}.
finish(EndUs, #state{values = Values, full = Full}) ->
    %% an atom is greater than every number
    {ok, #{
        values => lists:reverse(Values), until_us => min(EndUs, Full), is_whole => Full =:= no
    }}.
