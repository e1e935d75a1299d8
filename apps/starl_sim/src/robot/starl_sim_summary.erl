%% @doc A summary of a simulated robot, for reports and outcomes.
-module(starl_sim_summary).

-export([of_robot/3, of_body/3]).

-export_type([t/0, result/0]).

%% The time of the robot's last work (us), its digest chain with checkpoints, the
%% numbers of its events and packets, its application's result, its latest crashes, newest
%% first, and what its application waits for while it runs.
-type t() :: #{
    at_us := starl_sim_queue:time(),
    chain := non_neg_integer(),
    checkpoints := [starl_sim_ledger:checkpoint()],
    events := non_neg_integer(),
    packets := non_neg_integer(),
    result := result(),
    pose := starl:pose(),
    crashes := [{starl_machine:name(), Reason :: term()}],
    waits := starl_robot_tree:waiting()
}.

-type result() :: running | died | given_up | {done, term()}.

%% @doc The summary of a robot, whose world is its body ({@link starl_sim_platform}), at a time, with its
%% latest crashes.
-spec of_robot(starl_sim_queue:time(), Crashes, starl_robot:t()) -> t() when
    Crashes :: [{starl_machine:name(), Reason :: term()}].
of_robot(Time, Crashes, Robot) ->
    Result = result(Robot),
    of_body(Time, starl_robot:world(Robot), #{
        result => Result, crashes => Crashes, waits => waits(Result, Robot)
    }).

%% @doc The same of its body, with what the body does not know.
-spec of_body(starl_sim_queue:time(), starl_sim_platform:t(), #{
    result := result(),
    crashes := [{starl_machine:name(), Reason :: term()}],
    waits := starl_robot_tree:waiting()
}) -> t().
of_body(Time, Body, Known) ->
    Chain = starl_sim_platform:chain(Body),
    At = starl_sim_platform:now(Body),
    Known#{
        at_us => At,
        chain => starl_sim_chain:value(Chain),
        checkpoints => starl_sim_ledger:checkpoints(starl_sim_chain:ledger(Chain)),
        events => starl_sim_chain:events(Chain),
        packets => starl_sim_platform:packets(Body),
        %% while another robot is held, this one may be at a later time
        pose => starl_trajectory:pose(max(At, Time), starl_sim_platform:piece(Body))
    }.

waits(running, Robot) -> starl_robot_tree:waiting(starl_robot:machines(Robot));
waits(_Ended, _Robot) -> none.

result(Robot) ->
    case starl_robot:condition(Robot) of
        dead -> died;
        _ -> starl_sim_platform:result(starl_robot:world(Robot))
    end.
