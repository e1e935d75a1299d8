%% @doc The computer of a simulated robot and the processes of its machines. Faults take it down,
%% bring it up or kill it, and damage its store. It restarts machines that have crashed, or gives
%% them up.
-module(starl_sim_computer).

-export([strike/2, crashed/4, give_up/1]).

-export_type([t/0, fault/0]).

%% The robot, whose world is its body ({@link starl_sim_platform}), and its processes.
-type t() :: {starl_robot:t(), starl_robot_tree:t()}.

%% Faults of the whole robot; `{outdate, N}': its store is known to be old, since it has lived N times.
-type fault() ::
    kill_robot
    | go_down
    | come_up
    | {outdate, N :: pos_integer()}
    | starl_sim_store:strike()
    | starl_sim_codes:order().

%% @doc A fault strikes the robot, if it can in its condition.
-spec strike(fault(), t()) -> t().
strike(Fault, {Robot, _Tree} = Computer) ->
    strike(Fault, starl_robot:condition(Robot), Computer).

strike(kill_robot, Condition, {Robot, _} = Computer) when Condition =/= dead ->
    told(killed, robot, "by a fault", Robot),
    gone(killed, Computer);
strike(go_down, up, {Robot, Tree}) ->
    {starl_robot:go_down(Robot), starl_robot_tree:down(Tree)};
strike(come_up, down, {Robot, Tree}) ->
    Moment = starl_sim_platform:moment(starl_robot:world(Robot)),
    Waiting = starl_robot_machines:up(Moment, starl_robot:machines(Robot)),
    {Launched, Machines} = starl_robot_tree:launch(Tree, Waiting),
    {starl_robot:come_up(Machines, Robot), Launched};
%% Its machines get words on new code; a robot that is down starts with it.
strike({reload, _} = Order, _Condition, Computer) ->
    heed(Order, Computer);
strike({reload_failed, _, _} = Order, _Condition, Computer) ->
    heed(Order, Computer);
strike({outdate, N}, down, {Robot, _} = Computer) ->
    strike_store(outdate, maps:map(fun(_, Start) -> max(N, Start) end, starts(Robot)), Computer);
strike(lose_store, down, {Robot, _} = Computer) ->
    strike_store(lose_store, starts(Robot), Computer);
strike({Kind, _} = Strike, down, {Robot, _} = Computer) when
    Kind =:= save_store; Kind =:= set_back_store
->
    strike_store(Strike, starts(Robot), Computer);
strike(_Fault, _Condition, Computer) ->
    Computer.

heed(Order, {Robot, Tree}) ->
    {Words, Body} = starl_sim_platform:reload(Order, starl_robot:world(Robot)),
    Machines = starl_robot:machines(Robot),
    Local = [{Name, code, Word} || {Name, Word} <- Words, starl_robot_machines:has(Name, Machines)],
    {starl_robot:then(Local, starl_robot:world(Body, Robot)), Tree}.

strike_store(Strike, Starts, {Robot, Tree}) ->
    {Next, Body} = starl_sim_platform:strike_store(Strike, Starts, starl_robot:world(Robot)),
    Counted = starl_robot_machines:starts(Next, starl_robot:machines(Robot)),
    {starl_robot:machines(Counted, starl_robot:world(Body, Robot)), Tree}.

starts(Robot) -> starl_robot_machines:starts(starl_robot:machines(Robot)).

%% @doc The supervision of its processes has ended: the robot is dead.
-spec give_up(t()) -> t().
give_up(Computer) -> gone(gave_up, Computer).

%% @doc A machine has ended. Virtual time waits until it has been restarted, or the robot has died of it.
-spec crashed(starl_machine:name(), Reason :: term(), starl_sim_crash_loop:t(), t()) ->
    {starl_sim_crash_loop:t(), t()}.
crashed(Name, Reason, Before, {Robot, Tree}) ->
    Body = starl_robot:world(Robot),
    Cause = starl_crash:cause(Reason),
    {Hope, Despair} = hope(Name, Cause, Reason, Body, Before),
    Fallen = starl_sim_platform:fallen(Name, Cause, Body),
    Bare = starl_robot:lost(Name, Reason, starl_robot:world(Fallen, Robot)),
    Restarted = starl_robot_tree:restart(Name, starl_robot:machines(Bare), Tree),
    case starl_robot_tree:give_up(Hope, Name, Restarted, Tree) of
        {ok, #{back := Back, given_up := GivenUp, lost := Lost}, Machines} ->
            ok = tell(lists:member(Name, GivenUp), Name, Cause, Robot),
            Left = lists:foldr(fun({N, R}, B) -> starl_robot:lost(N, R, B) end, Bare, Lost),
            With = starl_robot:machines(Machines, Left),
            {Despair, {starl_robot:back(Back, GivenUp, With), Tree}};
        gave_up ->
            ok = tell(true, Name, Cause, Robot),
            {Despair, gone(gave_up, {Bare, Tree})}
    end.

%% Is it worthwhile to restart this machine? Only an application may be hopeless.
hope(app, {_, _} = Cause, Reason, Body, Despair) ->
    Now = starl_sim_platform:now(Body),
    Crash = #{
        cause => Cause,
        endless => starl_crash:is_endless(Reason),
        steps => starl_crash:steps(Reason),
        at_us => Now,
        pose => starl_trajectory:pose(Now, starl_sim_platform:piece(Body)),
        stored => starl_sim_platform:stored(app, Body)
    },
    starl_sim_crash_loop:crashed(Crash, Despair);
hope(_Name, _Cause, _Reason, _Body, Despair) ->
    {goes_on, Despair}.

%% The log has one line for each crash that no fault caused, in every mode.
tell(false, _Name, none, _Robot) ->
    ok;
tell(true, Name, none, Robot) ->
    told(given_up, Name, "it was killed too often", Robot);
tell(IsGivenUp, Name, Cause, Robot) ->
    told(crashed, Name, starl_crash:format(Cause), Robot),
    _ = IsGivenUp andalso told(given_up, Name, "it crashed again and again", Robot),
    ok.

told(What, Name, Why, Robot) ->
    Id = starl_robot:id(Robot),
    Event = #{
        what => What,
        robot => Id,
        machine => Name,
        at_us => starl_sim_platform:now(starl_robot:world(Robot)),
        reason => unicode:characters_to_binary(Why)
    },
    logger:log(level(What), Event, #{
        domain => [starl, robot], robot => Id, machine => Name, report_cb => fun report/1
    }).

level(killed) -> notice;
level(_) -> error.

report(#{what := What, robot := Robot, machine := Machine, at_us := AtUs, reason := Why}) ->
    Seconds = AtUs / 1.0e6,
    {"robot ~b, ~.6f s: ~ts: ~ts", [Robot, Seconds, words(What, Machine), Why]}.

words(killed, _Robot) -> "killed";
words(crashed, Machine) -> io_lib:format("~tp crashed", [Machine]);
words(given_up, Machine) -> io_lib:format("~tp is given up and not started again", [Machine]).

gone(Reason, {Robot, Tree}) ->
    Body = starl_sim_platform:planned(starl_robot:world(Robot)),
    {starl_robot:die(Reason, starl_robot:world(Body, Robot)), starl_robot_tree:down(Tree)}.
