%% The faults of a run in real time, with robots that only report what is done to them.
-module(starl_world_run_tests).
-include_lib("eunit/include/eunit.hrl").
-behaviour(starl_world_host).

-export([world/0, open/2, await/1, start/3, is_running/2, kill/2, halt/4, disk/3, notify/3]).
-export([check/3, release/1, info/2, call/3, status/1, close/2, stop/1]).

%% The disk of robot 1 cannot be filled. The fault has begun by then, and is over at once: it excuses nobody until the
%% end of the run.
a_fault_that_cannot_be_carried_out_is_over_test_() ->
    in_run(fun(Run) ->
        Full = [{store_full, Robot, #{}, lasting} || Robot <- [2, 1]],
        ?assertEqual({error, "full already"}, starl_world_run:inject(Run, Full)),
        ?assertEqual([{began, 2}, {began, 1}, {ended, 1}], [faulty() || _ <- [1, 2, 3]])
    end).

%% Nothing is done if one of the robots does not exist, or the run cannot play the kind.
a_fault_that_is_refused_does_nothing_test_() ->
    in_run(fun(Run) ->
        Kill = {reboot, 1, #{}, 0},
        [
            ?assertMatch({error, _}, starl_world_run:inject(Run, [Kill, Fault]))
         || Fault <- [{reboot, 3, #{}, 0}, {clock_step, 1, #{ms => 5}, 0}]
        ],
        ?assertEqual([], done())
    end).

%% A robot that is killed starts again, and a robot that reboots starts after its time.
a_robot_that_is_killed_starts_again_when_it_may_test_() ->
    in_run(fun(Run) ->
        ok = starl_world_run:inject(Run, [{reboot, 2, #{}, 0}]),
        ?assertEqual([{kill, 2}, {start, 2, clear}], done()),
        ok = starl_world_run:inject(Run, [{reboot, 2, #{}, 300}, {store_lost, 1, #{}, 0}]),
        ?assertEqual([{kill, 2}, {kill, 1}, {start, 1, clear}], done()),
        receive
            {done, {start, 2, clear}} -> ok
        end
    end).

%% A robot starts with the faults that last, and is notified of their ends.
a_robot_starts_with_the_faults_that_last_test_() ->
    in_run(fun(Run) ->
        Cut = starl_run_manual_fault:cut(1, 2, lasting),
        ok = starl_world_run:inject(Run, [{store_full, 2, #{}, lasting} | Cut]),
        ok = starl_world_run:inject(Run, [{reboot, 2, #{}, 0}]),
        ?assertEqual(
            [{fill, 2}, {cut, 1, [2]}, {cut, 2, [1]}, {kill, 2}, {start, 2, fill}, {cut, 2, [1]}],
            done()
        ),
        ok = starl_world_run:heal(Run, all),
        ?assertEqual([{clear, 2}], done())
    end).

in_run(Test) ->
    {timeout, 60, fun() ->
        Name = ["starl-run-", os:getpid(), $-, integer_to_list(erlang:unique_integer([positive]))],
        Dir = filename:join(os:getenv("TMPDIR", "/tmp"), lists:flatten(Name)),
        Self = self(),
        Observe = fun
            ({fault, _, {Is, {_, _, _, _, Robot, _}}}) ->
                Self ! {faulty, {Is, Robot}},
                ok;
            (_) ->
                ok
        end,
        _ = done(),
        {ok, Run} = starl_world_run:start(
            #{app => starl_world_app, robots => 2, play => #{}},
            #{
                dir => Dir,
                host => ?MODULE,
                observe => Observe,
                log => fun(_, _, Done) -> Self ! {done, Done} end
            }
        ),
        [{start, 1, clear}, {start, 2, clear}] = done(),
        try
            Test(Run)
        after
            _ = starl_world_run:finish(Run),
            file:del_dir_r(Dir)
        end
    end}.

faulty() ->
    receive
        {faulty, Fault} -> Fault
    end.

done() ->
    receive
        {done, Done} -> [Done | done()]
    after 0 -> []
    end.

%% -- the host -------------------------------------------------------------------------------

world() -> nodes.

open(_Plan, #{log := Log}) -> {ok, #{}, {fun(Done) -> Log(0, info, Done) end, []}}.

await(State) -> {ok, [], State}.

start(Id, #{disk := Disk}, {Log, Up}) ->
    _ = Log({start, Id, Disk}),
    {ok, [{up, Id}], {Log, [Id | Up]}}.

is_running(Id, {_Log, Up}) -> lists:member(Id, Up).

kill(Id, {Log, Up}) ->
    _ = Log({kill, Id}),
    {Log, lists:delete(Id, Up)}.

halt(_Id, _Ms, _Moment, State) -> State.

disk(fill, 1, _State) ->
    {error, "full already"};
disk(Change, Id, {Log, _Up}) ->
    _ = Log({Change, Id}),
    ok.

notify(Notices, Done, {Log, _Up} = State) ->
    _ = [Log({cut, Id, Cut}) || {Id, {conditions, #{cut := [_ | _] = Cut}, _}} <- Notices],
    _ = Done([]),
    State.

check(_Fault, _RealMs, _State) -> ok.

release(State) -> {[], State}.

info(_Message, State) -> {[], State}.

call(_Request, _From, State) -> {reply, none, State}.

status(_State) -> #{}.

close(Done, State) ->
    _ = Done([]),
    {[], State}.

stop(_State) -> ok.
