%% @doc Runs a window: the robots of a shard work until no robot has anything left to do in it.
%%
%% A robot's machine is stepped by one message and answers with its actions (see
%% {@link starl_driver}). Meanwhile nothing else of that robot runs, but other robots do:
%% a robot's actions reach other robots only in a later window, so within one they cannot
%% disturb each other ({@link starl_sim_robot}).
%%
%% The shard's robots lie in its process dictionary, under their numbers: they are put back at
%% every event, and a map of many robots would be copied along its branches each time, a tenth
%% of the whole work.
-module(starl_sim_window).

-export([hold/1, robots/0, robot/1, be_patient/2, patient/0, run/2, yields/1, crashed/3]).
-export([halt_after/2, resume/2, tell_at_work/2]).

-export_type([yields/0, hang/0]).

%% The yields of a window: events for later ones, the trace ordered by time, then robot, new
%% pieces of motion by robot, and the number of applications that have ended.
-type yields() :: #{
    later := [starl_sim_queue:event()],
    trace := [starl_monitor:trace_event()],
    moved := [{starl:robot_id(), starl_trajectory:piece()}],
    ended := non_neg_integer()
}.

%% A robot's machines that did not end their step within the patience, with that time.
-type hang() :: {Ms :: non_neg_integer(), [starl_sim_watchdog:work()]}.

%% The period of a look at the wall time that a window takes, and its key in the process dictionary.
-define(LOOK_MS, 1000).
-define(PATIENCE, patience).

%% @doc Puts these robots into the shard.
-spec hold([{starl:robot_id(), starl_sim_robot:t()}]) -> ok.
hold(Robots) -> lists:foreach(fun({Id, Robot}) -> put(Id, Robot) end, Robots).

%% @doc All robots of the shard, ascending.
-spec robots() -> [{starl:robot_id(), starl_sim_robot:t()}].
robots() -> lists:sort([{Id, Robot} || {Id, Robot} <- get(), is_integer(Id)]).

%% @doc A robot of the shard.
-spec robot(starl:robot_id()) -> starl_sim_robot:t() | undefined.
robot(Id) -> get(Id).

%% @doc From now on a window is given up when it takes this wall time (ms). One timer serves
%% many windows: a timer in each receive would cost as much as the event.
-spec be_patient(starl_sim_queue:window(), Ms :: pos_integer()) -> ok.
be_patient(Window, Ms) -> look_later({Window, now_ms(), Ms}).

look_later({_Window, _SinceMs, Ms} = Patience) ->
    Timer = erlang:start_timer(min(?LOOK_MS, Ms), self(), {?PATIENCE, Patience}),
    _ = put(?PATIENCE, Timer),
    ok.

%% @doc The shard rests: time does not matter.
-spec patient() -> ok.
patient() ->
    _ = erlang:cancel_timer(erase(?PATIENCE)),
    ok.

%% @doc Runs a window with these events, which are ordered by robot, then in each robot's order.
%% Returns the robots that were at work, in descending order, or the robot that did not end a step.
-spec run(starl_sim_queue:window(), [starl_sim_queue:event()]) ->
    [starl:robot_id()] | {hung, hang()}.
run(Window, Events) ->
    {Ids, Active} = begin_robots(agenda(Window, Events), Window, [], 0),
    case collect(Active, Window) of
        ok -> Ids;
        {hung, _} = Hung -> Hung
    end.

%% @doc Tells a process ({@link starl_sim_watchdog}) which machines' processes are at work.
-spec tell_at_work(pid(), reference()) -> ok.
tell_at_work(From, Ref) ->
    From ! {at_work, Ref, self(), at_work()},
    ok.

at_work() -> lists:append([starl_sim_robot:at_work(Robot) || {_, Robot} <- robots()]).

%% @doc The yields of the window, from the robots that were at work in it.
-spec yields([starl:robot_id()]) -> yields().
yields(Ids) -> yields(Ids, [], [], [], 0).

%% @doc Makes a robot halt just after its N-th event; `none': it does not halt any more.
-spec halt_after(starl:robot_id(), N :: pos_integer() | none) -> ok.
halt_after(Id, N) ->
    _ = put(Id, starl_sim_robot:halt_after(N, get(Id))),
    ok.

%% @doc Goes on with a window in which one robot was held.
-spec resume(starl_sim_queue:window(), starl:robot_id()) -> ok | {hung, hang()}.
resume(Window, Id) -> collect(keep(Id, starl_sim_robot:resume(get(Id))), Window).

%% @doc A process has gone down between two windows. Returns its robot, if it is one of these; the
%% robot has to go on in the next window.
-spec crashed(pid(), Reason :: term(), Now :: starl_sim_queue:time()) ->
    {ok, starl:robot_id()} | none.
crashed(Pid, Reason, Now) ->
    case owner(Pid) of
        {Id, Robot} ->
            {_, Crashed} = starl_sim_robot:down(Pid, Reason, rest, starl_sim_robot:at(Now, Robot)),
            _ = put(Id, Crashed),
            {ok, Id};
        none ->
            none
    end.

%% In the first window every robot boots.
agenda({0, _Until}, Events) ->
    lists:sort([{Id, 0, 0, 0, 0, wake} || {Id, _} <- robots()] ++ Events);
agenda(_Window, Events) ->
    Events.

%% Events come by robot, and in the robot's order.
begin_robots([], _Window, Ids, Active) ->
    {Ids, Active};
begin_robots([{Id, _, _, _, _, _} = Event | Events], Window, Ids, Active) ->
    {Own, Rest} = take_own(Id, Events, [Event]),
    Count = keep(Id, starl_sim_robot:open(Own, Window, get(Id))),
    begin_robots(Rest, Window, [Id | Ids], Active + Count).

take_own(Id, [{Id, _, _, _, _, _} = Event | Events], Own) -> take_own(Id, Events, [Event | Own]);
take_own(_Id, Events, [_] = Own) -> {Own, Events};
take_own(_Id, Events, Own) -> {lists:reverse(Own), Events}.

%% The number of the robot's machines at work: one or none.
keep(Id, {busy, Robot}) ->
    _ = put(Id, Robot),
    1;
keep(Id, {_IdleOrHeld, Robot}) ->
    _ = put(Id, Robot),
    0.

collect(0, _Window) ->
    ok;
collect(Active, Window) ->
    receive
        {starl_done, Id, Process, Actions} ->
            case starl_sim_robot:answered(Process, Actions, get(Id)) of
                ignored -> collect(Active, Window);
                Answered -> collect(Active - 1 + keep(Id, Answered), Window)
            end;
        {'DOWN', _, process, Pid, Reason} ->
            collect(Active + interrupted(Pid, Reason), Window);
        {timeout, Timer, {?PATIENCE, Patience}} ->
            case look(get(?PATIENCE) =:= Timer, Patience, Window) of
                ok -> collect(Active, Window);
                {hung, _} = Hung -> Hung
            end;
        {who, From, Ref} ->
            ok = tell_at_work(From, Ref),
            collect(Active, Window)
    end.

%% The timer of an earlier run has no say.
look(false, _Patience, _Window) ->
    ok;
look(true, {Window, SinceMs, Ms} = Patience, Window) ->
    case now_ms() - SinceMs of
        Took when Took < Ms -> look_later(Patience);
        Took -> {hung, {Took, starl_sim_watchdog:named(at_work())}}
    end;
look(true, {_Earlier, _SinceMs, Ms}, Window) ->
    be_patient(Window, Ms).

now_ms() -> erlang:monotonic_time(millisecond).

%% A crash of a robot at work: the robot goes on when its supervisor has restarted the machine.
%% Other robots' processes are handled between the windows.
interrupted(Pid, Reason) ->
    case owner(Pid) of
        {Id, Robot} ->
            case starl_sim_robot:at_work(Robot) of
                [] ->
                    self() ! {down, Pid, Reason},
                    0;
                [_] ->
                    keep(Id, starl_sim_robot:down(Pid, Reason, go_on, Robot)) - 1
            end;
        none ->
            0
    end.

owner(Pid) ->
    case [{Id, R} || {Id, R} <- robots(), starl_sim_robot:owns(Pid, R)] of
        [Owner] -> Owner;
        [] -> none
    end.

%% Robots come in descending order, so their yields are in ascending order.
yields([], Later, Trace, Moved, Ended) ->
    %% keysort is stable
    #{later => Later, trace => lists:keysort(1, Trace), moved => Moved, ended => Ended};
yields([Id | Ids], Later, Trace, Moved, Ended) ->
    Robot = get(Id),
    {New, Traced, Changes} = starl_sim_robot:yield(Robot),
    Yet = lists:reverse(Traced, Trace),
    case Changes of
        [] ->
            yields(Ids, New ++ Later, Yet, Moved, Ended);
        _ ->
            Piece = [{Id, starl_sim_robot:piece(Robot)} || lists:member(moved, Changes)],
            Gone = length([ended || ended <- Changes]),
            yields(Ids, New ++ Later, Yet, Piece ++ Moved, Ended + Gone)
    end.
