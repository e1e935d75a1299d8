%% @doc A window: the robots of a shard at work, until none has anything left to do in it.
%%
%% A robot's machine is stepped by one message and answers with its actions (see
%% {@link starl_machine_proc}); nothing else of that robot runs meanwhile, but other robots do:
%% what a robot does reaches the others in a later window only, so within one they cannot
%% disturb each other ({@link starl_sim_robot}).
-module(starl_sim_window).

-export([be_patient/1, run/3, crashed/3]).

-export_type([robots/0, yields/0]).

%% The robots of a shard.
-type robots() :: #{starl:robot_id() => starl_sim_robot:t()}.

%% What came of a window: events for later ones, the trace in the order of time, then robot, the
%% pieces of motion that robots are newly in, and how many applications have ended.
-type yields() :: #{
    later := [starl_sim_queue:event()],
    trace := [starl_monitor:trace_event()],
    moved := [{starl:robot_id(), starl_trajectory:piece()}],
    ended := non_neg_integer()
}.

%% How long, in wall time, the robots may take before the run is given up.
-define(PATIENCE_MS, 60000).

%% @doc Gives the robots so long from now. One timer serves many windows: one in each receive
%% would cost as much as the event.
-spec be_patient(starl_sim_robot:window()) -> reference().
be_patient(Window) -> erlang:send_after(?PATIENCE_MS, self(), {out_of_patience, Window}).

%% @doc Runs a window with these events, which come by robot and in each robot's order.
-spec run(starl_sim_robot:window(), [starl_sim_queue:event()], robots()) -> {yields(), robots()}.
run(Window, Events, Robots) ->
    {Ids, Active, Begun} = begin_robots(agenda(Window, Events, Robots), Window, [], 0, Robots),
    Done = collect(Active, Begun, Window),
    {Closed, {Later, Trace, Moved, Ended}} = close_robots(Ids, Done, {[], [], [], 0}),
    %% keysort is stable
    {#{later => Later, trace => lists:keysort(1, Trace), moved => Moved, ended => Ended}, Closed}.

%% @doc A process has gone down between two windows: the robot, if it is one of these, that has
%% to go on in the next window.
-spec crashed(pid(), Reason :: term(), robots()) -> {starl:robot_id(), robots()} | none.
crashed(Pid, Reason, Robots) ->
    case owner(Pid, Robots) of
        {Id, Robot} -> {Id, Robots#{Id := starl_sim_robot:crashed(Pid, Reason, Robot)}};
        none -> none
    end.

%% In the first window every robot boots.
agenda({0, _Until}, Events, Robots) ->
    lists:sort([{Id, 0, 0, 0, 0, wake} || Id <- maps:keys(Robots)] ++ Events);
agenda(_Window, Events, _Robots) ->
    Events.

%% Events come by robot, and in the robot's order.
begin_robots([], _Window, Ids, Active, Robots) ->
    {Ids, Active, Robots};
begin_robots([{Id, _, _, _, _, _} = Event | Events], Window, Ids, Active, Robots) ->
    {Own, Rest} = take_own(Id, Events, [Event]),
    #{Id := Robot} = Robots,
    case starl_sim_robot:open(Own, Window, Robot) of
        {busy, Next} ->
            begin_robots(Rest, Window, [Id | Ids], Active + 1, Robots#{Id := Next});
        {idle, Next} ->
            begin_robots(Rest, Window, [Id | Ids], Active, Robots#{Id := Next})
    end.

take_own(Id, [{Id, _, _, _, _, _} = Event | Events], Own) -> take_own(Id, Events, [Event | Own]);
take_own(_Id, Events, [_] = Own) -> {Own, Events};
take_own(_Id, Events, Own) -> {lists:reverse(Own), Events}.

collect(0, Robots, _Window) ->
    Robots;
collect(Active, Robots, Window) ->
    receive
        {starl_done, Id, Actions} ->
            #{Id := Robot} = Robots,
            Answered = starl_sim_robot:answered(Actions, Robot),
            case starl_sim_robot:proceed(Window, Answered) of
                {busy, Next} -> collect(Active, Robots#{Id := Next}, Window);
                {idle, Next} -> collect(Active - 1, Robots#{Id := Next}, Window)
            end;
        {'DOWN', _, process, Pid, Reason} ->
            {Change, Next} = interrupted(Pid, Reason, Robots, Window),
            collect(Active + Change, Next, Window);
        {out_of_patience, Window} ->
            exit({no_answer, [B || R <- maps:values(Robots), B <- starl_sim_robot:busy(R)]});
        {out_of_patience, _Earlier} ->
            _ = be_patient(Window),
            collect(Active, Robots, Window)
    end.

%% A crash of a robot at work: it goes on when its supervisor has restarted what crashed. The
%% processes of the others are left for later.
interrupted(Pid, Reason, Robots, Window) ->
    case owner(Pid, Robots) of
        {Id, Robot} ->
            Crashed = starl_sim_robot:crashed(Pid, Reason, Robot),
            case {starl_sim_robot:busy(Robot), starl_sim_robot:busy(Crashed)} of
                {[_], []} ->
                    go_on(Id, starl_sim_robot:proceed(Window, Crashed), Robots);
                {[_], [_]} ->
                    {0, Robots#{Id := Crashed}};
                {[], []} ->
                    self() ! {wake, Id},
                    {0, Robots#{Id := Crashed}}
            end;
        none ->
            {0, Robots}
    end.

go_on(Id, {busy, Robot}, Robots) -> {0, Robots#{Id := Robot}};
go_on(Id, {idle, Robot}, Robots) -> {-1, Robots#{Id := Robot}}.

owner(Pid, Robots) ->
    case [{Id, R} || {Id, R} <- maps:to_list(Robots), starl_sim_robot:owns(Pid, R)] of
        [Owner] -> Owner;
        [] -> none
    end.

%% Robots are closed in descending order, so that what they yield comes in ascending order.
close_robots([], Robots, Yields) ->
    {Robots, Yields};
close_robots([Id | Ids], Robots, {Later, Trace, Moved, Ended}) ->
    #{Id := Robot} = Robots,
    {{New, Traced, Changes}, Closed} = starl_sim_robot:close(Robot),
    Yields = {New ++ Later, lists:reverse(Traced, Trace), Moved, Ended},
    close_robots(Ids, Robots#{Id := Closed}, changes(Changes, Id, Closed, Yields)).

changes([], _Id, _Robot, Yields) ->
    Yields;
changes(Changes, Id, Robot, {Later, Trace, Moved, Ended}) ->
    {
        Later,
        Trace,
        [{Id, starl_sim_robot:piece(Robot)} || lists:member(moved, Changes)] ++ Moved,
        Ended + length([ended || lists:member(ended, Changes)])
    }.
