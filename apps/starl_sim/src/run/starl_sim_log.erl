%% @doc What the simulator logs of its robots: one event for each crash and each end of a robot, with
%% a text of one line.
-module(starl_sim_log).

-export([tell/1]).

-export_type([event/0]).

%% A machine has crashed, it is given up, or its robot was killed.
-type event() :: #{
    what := crashed | given_up | killed,
    robot := starl:robot_id(),
    machine := starl_machine:name() | robot,
    at_us := starl_sim_queue:time(),
    reason := binary()
}.

%% @doc Logs an event.
-spec tell(event()) -> ok.
tell(#{what := What, robot := Robot, machine := Machine} = Event) ->
    Meta = #{
        domain => [starl, robot], robot => Robot, machine => Machine, report_cb => fun report/1
    },
    logger:log(level(What), Event, Meta).

level(killed) -> notice;
level(_) -> error.

report(Event) -> {"~ts", [text(Event)]}.

%% The text of an event, in one line.
text(#{what := What, robot := Robot, machine := Machine, at_us := AtUs, reason := Why}) ->
    io_lib:format("robot ~b, ~.6f s: ~ts: ~ts", [Robot, AtUs / 1.0e6, words(What, Machine), Why]).

words(killed, _Robot) -> "killed";
words(crashed, Machine) -> io_lib:format("~tp crashed", [Machine]);
words(given_up, Machine) -> io_lib:format("~tp is given up and not started again", [Machine]).
