%% @doc Launches a live robot: opens its store, its record and its ports, and starts its machines.
-module(starl_live_launch).

-export([open/1, machines/1]).

-export_type([opened/0]).

%% A specification whose lines are processes, with the store and the record.
-type opened() :: #{store := starl_live_store:t(), atom() => term()}.

%% @doc Opens what is to be open before the machines start. The lines are linked to this process.
-spec open(starl_live_link:spec()) -> {ok, opened()} | {stop, Reason :: term()}.
open(#{dir := Dir} = Spec) ->
    case starl_live_store:open(Dir) of
        {ok, Store} -> recording(Spec#{store => Store});
        {error, Why} -> {stop, {shutdown, {store, unicode:characters_to_binary(Why)}}}
    end.

recording(#{record := true, dir := Dir} = Spec) ->
    case starl_live_record:open(Dir) of
        {ok, Record} -> lines([transport, positioning, chassis], Spec#{record := Record});
        {error, Why} -> {stop, {shutdown, {record, unicode:characters_to_binary(Why)}}}
    end;
recording(Spec) ->
    lines([transport, positioning, chassis], Spec#{record => none}).

lines([], Spec) ->
    senses(maps:to_list(maps:get(senses, Spec, #{})), Spec#{senses => #{}});
lines([Line | Lines], Spec) when is_pid(map_get(Line, Spec)) ->
    lines(Lines, Spec);
lines([Line | Lines], Spec) ->
    #{Line := {Module, Own}, robot := Robot, clock := Clock, tree := Tree, profile := P} = Spec,
    #{participants := Team} = Tree,
    Known = Own#{robot => Robot, participants => Team, clock => Clock, profile => P},
    Config = with_radio(Line, Known, Spec),
    case (process(Line)):start_link(Module, Config, self()) of
        {ok, Pid} -> lines(Lines, Spec#{Line => Pid});
        {error, Reason} -> {stop, Reason}
    end.

senses([], Spec) ->
    {ok, Spec};
senses([{Kind, {Module, Own}} | Others], #{robot := Robot, clock := Clock, senses := Open} = Spec) ->
    case starl_live_sense:start_link(Module, Own#{robot => Robot, clock => Clock}, self()) of
        {ok, Pid} -> senses(Others, Spec#{senses := Open#{Kind => Pid}});
        {error, Reason} -> {stop, Reason}
    end.

with_radio(transport, Config, Spec) -> Config#{tell => starl_live_packet_reports:teller(Spec)};
with_radio(_Line, Config, _Spec) -> Config.

process(transport) -> starl_live_transport;
process(positioning) -> starl_live_positioning;
process(chassis) -> starl_live_chassis.

%% @doc Starts the machines, makes the numbers of their starts durable, and notifies the observer of
%% the start. Returns the robot, which has not run yet.
-spec machines(opened()) -> {ok, starl_robot:t(), starl_robot_tree:t()} | {stop, Reason :: term()}.
machines(#{robot := Id, robot_sup := Sup, tree := Tree, store := Store} = Spec) ->
    Body = starl_live_body:new(Spec#{
        participants => maps:get(participants, Tree), parts => starl_robot_services:parts(Tree)
    }),
    {Left, Inline} = inline(Tree#{services := services(Tree)}, Spec),
    Moment = starl_live_body:moment(Body),
    Start = start(Left, Id, Sup),
    Before = starl_live_store:starts(Store),
    {Processes, Machines} = starl_robot_tree:resume(Id, Start, Inline, Moment, Before),
    case starl_live_store:started(starl_robot_machines:starts(Machines), Store) of
        ok -> {ok, started(Spec, Body, Machines), Processes};
        {error, Why} -> {stop, {shutdown, {store, unicode:characters_to_binary(Why)}}}
    end.

inline(Tree, #{inline := true}) -> starl_robot_services:inline(Tree);
inline(Tree, _Spec) -> {Tree, #{}}.

%% Starts the machines that are processes.
start(none, _Id, _Sup) ->
    none;
start(Tree, Id, Sup) ->
    Robot = Tree#{id => Id, driver => self()},
    fun() ->
        {ok, Machines} = starl_live_robot:start_machines(Sup, Robot),
        _ = erlang:monitor(process, Machines),
        {Machines, starl_robot_sup:parts(Machines)}
    end.

%% The positioning process itself finds a source that is stuck ({@link starl_live_positioning}); a
%% rounded pose of a robot that stands repeats itself rightly.
services(#{services := Services}) ->
    [
        case Service of
            {location, Module, Config} -> {location, Module, Config#{exact => true}};
            _ -> Service
        end
     || Service <- Services
    ].

started(#{robot := Id, store := Store} = Spec, Body, Machines) ->
    Names = starl_robot_machines:names(Machines),
    ok = tell_start(Names, Spec),
    ok = starl_live_body:tell_start(Names, Body),
    %% a robot that has run before comes up after a reboot
    Up =
        case starl_live_store:life(Store) of
            first -> Body;
            later -> starl_live_body:trace(robot, up, Body)
        end,
    starl_robot:new(Id, starl_live_body, Up, Machines).

tell_start(_Names, #{sink := none}) ->
    ok;
tell_start(Names, #{robot := Id, sink := Sink, record := Record}) ->
    File =
        case Record of
            none -> none;
            _ -> starl_live_record:file(Record)
        end,
    Sink ! {starl_started, Id, self(), {Names, File}},
    ok.
