%% @doc The behaviour of a host, which runs the robots of a run in real time. It runs all in this VM
%% ({@link starl_world_here}), or each on a node of its own ({@link starl_cluster}). The process of
%% the run ({@link starl_world_run}) owns the host's state and calls it. A host is not a process: its
%% messages come to the process of the run, which passes them to `info/2'.
%% ```
%%     starl_world_run --- start, kill, halt, disk, notify --> host
%%                    <--- up, renewed, down, halted, ... ----
%% '''
-module(starl_world_host).

-export_type([state/0, launch/0, notice/0, done/0, event/0, status/0]).

%% The host's own state.
-type state() :: term().

%% A robot that starts: its parameters, whether its disk is full, its link conditions, and the
%% faults of its senses.
-type launch() :: #{
    spec := starl_live_robot:spec(),
    disk := fill | clear,
    air := starl_live_conditions:settings(),
    senses := starl_live_sense_fault:faults()
}.

%% What a running robot is notified of: what it hears and senses from now on, or the end of one of its
%% machines, as in a crash.
-type notice() ::
    {
        starl:robot_id(),
        {conditions, starl_live_conditions:settings(), starl_live_sense_fault:faults()}
    }
    | {starl:robot_id(), {kill_machine, starl_machine:name()}}.

%% Called when all robots have been notified, with those that have not confirmed it in time.
-type done() :: fun((Unheard :: [starl:robot_id()]) -> term()).

%% `up': a robot has started. `renewed': its link has started anew and knows no fault. `down': it has
%% ended, and should start again. `given_up': it has restarted too often. `halted': it has stopped at
%% a halt. `hangs': it stands still without a halt. `resumed': it goes on.
-type event() ::
    {up | renewed | down | given_up | halted | hangs | resumed, starl:robot_id()}.

-type status() :: #{
    restarts => #{starl:robot_id() => non_neg_integer()},
    os_pids => #{starl:robot_id() => string()}
}.

%% Where its robots are.
-callback world() -> one_vm | nodes.
%% Makes the host ready for robots, before the time of the run begins; the robots' nodes.
-callback open(starl_run_plan:t(), starl_world_run:options()) ->
    {ok, Nodes :: #{starl:robot_id() => node()}, state()} | {error, Reason :: term()}.
%% Waits until the first start of each robot has succeeded.
-callback await(state()) -> {ok, [event()], state()} | {error, Reason :: term()}.

%% Starts a robot that is not running.
-callback start(starl:robot_id(), launch(), state()) ->
    {ok | {error, unicode:chardata()}, [event()], state()}.
-callback is_running(starl:robot_id(), state()) -> boolean().
%% Ends all processes of a robot, as a power cut does.
-callback kill(starl:robot_id(), state()) -> state().
%% Halts a robot for a time of the computer, at once or in the middle of its work.
-callback halt(starl:robot_id(), Ms :: pos_integer(), now | at_work, state()) -> state().
%% Fills the disk of a robot, or clears it.
-callback disk(fill | clear, starl:robot_id(), state()) -> ok | {error, unicode:chardata()}.
%% Notifies robots that run.
-callback notify([notice()], done(), state()) -> state().

%% Can this fault be injected now? A pause has this length by the clock of the computer.
-callback check(starl_world_faults:fault(), RealMs :: number(), state()) ->
    ok | {error, unicode:chardata()}.
%% Lets all robots that are halted go on.
-callback release(state()) -> {[event()], state()}.
%% Handles a message to the process of the run.
-callback info(Message :: term(), state()) -> {[event()], state()} | {stop, Reason :: term()}.
%% Handles a request that only this host knows.
-callback call(Request :: term(), gen_server:from(), state()) ->
    {reply, Answer :: term(), state()} | {noreply, state()}.
-callback status(state()) -> status().
%% Ends recordings before the run ends.
-callback close(done(), state()) -> {[event()], state()}.
%% Ends all robots.
-callback stop(state()) -> ok.

-optional_callbacks([halt/4, disk/3]).
