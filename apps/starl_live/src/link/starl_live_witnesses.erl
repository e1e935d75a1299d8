%% @doc Passes the trace events of a live robot's steps on, batch by batch, to up to three
%% witnesses. They are the sink of its run ({@link starl_live_link:told()}), the record on its own
%% disk ({@link starl_live_record}), and the observer of its node.
-module(starl_live_witnesses).

-export([new/1, started/3, seen/3, tell/4, has_heard/2]).

-export_type([t/0, config/0, result/0, fact/0]).

%% The result of the robot's application.
-type result() :: running | given_up | {done, term()}.

%% A fact, or one that leaves before this time or not at all.
-type fact() ::
    starl_monitor:trace_event()
    | {until, Us :: integer(), starl_monitor:trace_event(), owner()}.

-type owner() :: {starl_machine:name(), Mark :: term()}.

-type config() :: #{
    robot := starl:robot_id(),
    sink := pid() | none,
    record := starl_live_record:t() | none,
    observe => starl_observer:t(),
    atom() => term()
}.

-record(witnesses, {
    id :: starl:robot_id(),
    sink :: pid() | none,
    record :: starl_live_record:t() | none,
    observer :: starl_observer:t(),
    %% the number of the next batch of facts
    batch = 1 :: pos_integer(),
    %% the result that was told last
    result = running :: result()
}).

-opaque t() :: #witnesses{}.

%% @doc The witnesses of a robot.
-spec new(config()) -> t().
new(#{robot := Id, sink := Sink, record := Record} = Config) ->
    Observer = maps:get(observe, Config, none),
    #witnesses{id = Id, sink = Sink, record = Record, observer = Observer}.

%% @doc Notifies the observer of this node that the robot starts, with these machines.
-spec started(NowUs :: integer(), [starl_machine:name()], t()) -> ok.
started(Now, Names, #witnesses{id = Id, observer = Observer}) ->
    starl_observer:tell({started, Now, Id, Names}, Observer).

%% @doc Reports the robot's own place, at the time of the picture, to the observer of this node, if
%% these events show it.
-spec seen([starl_robot:local()] | unknown, starl_live_clock:t(), t()) -> ok.
seen([{_Name, info, {located, _Tag, Seen}}], Clock, #witnesses{id = Id, observer = Observer}) when
    Observer =/= none
->
    case lists:keyfind(Id, 1, Seen) of
        {Id, Pose, Age} ->
            starl_observer:tell({seen, starl_live_clock:now_us(Clock) - Age, Id, Pose}, Observer);
        false ->
            ok
    end;
seen(_Events, _Clock, _Witnesses) ->
    ok.

%% @doc Have the witnesses heard of this result?
-spec has_heard(result(), t()) -> boolean().
has_heard(Result, #witnesses{result = Told}) -> Result =:= Told.

%% @doc Passes on the trace events of a step (newest first) that may leave now, and the result so
%% far. Returns the owners of the events that were late.
-spec tell([fact()], NowUs :: integer(), result(), t()) -> {Late :: [owner()], t()}.
tell(Facts, Now, Result, #witnesses{batch = N} = Witnesses) ->
    {Events, Late} = leaving(lists:reverse(Facts), Now, [], []),
    Batch = {N, Now, Events},
    Record = recorded(Batch, Witnesses),
    ok = sunk(Batch, Result, Witnesses),
    ok = observed(Events, Witnesses),
    {lists:uniq(Late), Witnesses#witnesses{batch = N + 1, result = Result, record = Record}}.

leaving([{until, Us, Fact, _Owner} | Facts], Now, Left, Late) when Now =< Us ->
    leaving(Facts, Now, [Fact | Left], Late);
leaving([{until, _Us, _Fact, Owner} | Facts], Now, Left, Late) ->
    leaving(Facts, Now, Left, [Owner | Late]);
leaving([Fact | Facts], Now, Left, Late) ->
    leaving(Facts, Now, [Fact | Left], Late);
leaving([], _Now, Left, Late) ->
    {lists:reverse(Left), lists:reverse(Late)}.

recorded(_Batch, #witnesses{record = none}) -> none;
recorded(Batch, #witnesses{record = Record}) -> starl_live_record:write(Batch, Record).

sunk(_Batch, _Result, #witnesses{sink = none}) ->
    ok;
sunk({_, _, Events} = Batch, Result, #witnesses{id = Id, sink = Sink, result = Told}) ->
    _ = Events =/= [] andalso (Sink ! {starl_traced, Id, self(), Batch}),
    _ = Result =/= Told andalso (Sink ! {starl_ended, Id, self(), Result}),
    ok.

observed([], _Witnesses) ->
    ok;
observed(Events, #witnesses{observer = Observer}) ->
    starl_observer:tell({judged, Events, []}, Observer).
