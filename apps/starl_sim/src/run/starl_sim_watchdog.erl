%% @doc Detects that a run makes no progress in real time, and finds the processes that are at work.
%% The usual cause is an endless loop in an application, which stops virtual time for the whole
%% team. The watchdog only reports: it changes nothing in the run.
%% ```
%%   watch                         run                      shards that are late
%%     | -- progress -------------->|                             |
%%     |<-- windows judged, late -- |                             |
%%     | -- who, Ref ------------------------------------------>  |   only if it stands still, twice
%%     |<-- at_work, Ref, processes ------------------------------|
%% '''
%% A robot that has had events between the two answers is in a loop that lets no time pass. The
%% watchdog then names its application, and not the machine that the application has just called.
%%
%% A shard that does not answer is itself at work: in a machine without a process, or in the
%% simulator's own code, as happens with very many robots. A run that does not answer is at work in
%% a monitor or on its results.
-module(starl_sim_watchdog).

-export([start_link/2, stop/1, at_work/1, named/1]).
-export([format_hang/1, format_work/1]).

-export_type([config/0, news/0, cause/0, work/0]).

%% `tell' is called with the news, in the watch's own process: when the run has stood still for
%% `patience_ms', again after each further `period_ms', and when it goes on. `reductions': the work that
%% no step of a sound program takes; a computer that is slow, or has other work, takes longer for it.
-type config() :: #{
    patience_ms => non_neg_integer(),
    period_ms => pos_integer(),
    reductions => pos_integer(),
    tell := fun((news()) -> term())
}.

-type news() :: {stands, Ms :: non_neg_integer(), cause(), [work()]} | goes_on.

%% Why a run stands still: `loop', more work than a sound step takes, on this node; `slow', so far.
-type cause() :: loop | slow.

%% A robot's machine that is at work, `unknown' for one without a process; a monitor; or the
%% simulator itself. With the part of its stack that is its own.
-type work() ::
    {starl:robot_id() | unknown, starl_machine:name(), [starl_crash:frame()]}
    | {monitor, [starl_crash:frame()]}
    | simulator.

-define(PATIENCE_MS, 3000).
-define(PERIOD_MS, 1000).
%% Some ten seconds of a fast processor; a tight loop spends them in one or two.
-define(REDUCTIONS, 300_000_000).
%% The time in which one who is not at work answers.
-define(ANSWER_MS, 200).
%% The time between two looks at the same robots.
-define(APART_MS, 50).

-record(watch, {
    run :: pid(),
    period_ms :: pos_integer(),
    patience_ms :: non_neg_integer(),
    reductions :: pos_integer(),
    tell :: fun((news()) -> term()),
    %% the progress seen last, and since when it is the same: the time, and this node's reductions
    seen = none :: term(),
    since_ms :: integer(),
    since :: non_neg_integer(),
    told = false :: boolean()
}).

%% @doc Watches a run until {@link stop/1}.
-spec start_link(Run :: pid(), config()) -> pid().
start_link(Run, #{tell := Tell} = Config) ->
    Watch = #watch{
        run = Run,
        period_ms = maps:get(period_ms, Config, ?PERIOD_MS),
        patience_ms = maps:get(patience_ms, Config, ?PATIENCE_MS),
        reductions = maps:get(reductions, Config, ?REDUCTIONS),
        tell = Tell,
        since_ms = now_ms(),
        since = spent()
    },
    spawn_link(fun() -> watch(Watch) end).

%% @doc Ends the watch; nothing is reported afterwards.
-spec stop(pid()) -> ok.
stop(Pid) ->
    Ref = erlang:monitor(process, Pid),
    true = unlink(Pid),
    Pid ! stop,
    receive
        {'DOWN', Ref, process, Pid, _} -> ok
    end.

watch(#watch{period_ms = Period} = Watch) ->
    receive
        stop -> ok
    after Period -> watch(look(progress(Watch), Watch))
    end.

%% A run at rest waits for nobody.
look({_, _, []} = Progress, Watch) ->
    moved(Progress, Watch);
look(Same, #watch{seen = Same, since_ms = Since, patience_ms = Patience} = Watch) ->
    case now_ms() - Since of
        Ms when Ms >= Patience -> stands(Ms, Same, Watch);
        _ -> Watch
    end;
look(Progress, Watch) ->
    moved(Progress, Watch).

moved(Progress, #watch{told = Told, tell = Tell} = Watch) ->
    _ = Told andalso Tell(goes_on),
    Watch#watch{seen = Progress, since_ms = now_ms(), since = spent(), told = false}.

stands(Ms, Progress, #watch{tell = Tell, run = Run} = Watch) ->
    AtWork = who(Progress, Run),
    _ = AtWork =/= [] andalso Tell({stands, Ms, cause(Watch), AtWork}),
    Watch#watch{told = true}.

%% Whoever does not stand still beside the run does little.
cause(#watch{since = Since, reductions = Most}) ->
    case spent() - Since >= Most of
        true -> loop;
        false -> slow
    end.

spent() ->
    {Reductions, _} = erlang:statistics(reductions),
    Reductions.

%% @doc The processes that are at work in a run without progress.
-spec at_work(Run :: pid()) -> [work()].
at_work(Run) ->
    case is_process_alive(Run) andalso ask(Run) of
        false -> [];
        {_, _, []} -> [];
        Progress -> who(Progress, Run)
    end.

progress(#watch{run = Run}) -> ask(Run).

ask(Run) ->
    ok = forget(),
    Run ! {progress, self()},
    receive
        {progress, Progress} -> Progress
    after ?ANSWER_MS -> no_answer
    end.

%% An answer that came too late.
forget() ->
    receive
        {progress, _} -> forget()
    after 0 -> ok
    end.

%% Without a monitor, the run itself is busy, for example with its results.
who(no_answer, Run) ->
    [{monitor, Frames} || [_ | _] = Frames <- [own(starl_monitor, Run)]];
who({_Judged, _Resting, Late}, _Run) ->
    First = answers(Late),
    Again = [Shard || {Shard, {robots, [_ | _]}} <- First],
    Second = maps:from_list(later(Again)),
    lists:append([named(Answer, maps:get(Shard, Second, Answer)) || {Shard, Answer} <- First]).

later([]) ->
    [];
later(Shards) ->
    receive
    after ?APART_MS -> answers(Shards)
    end.

%% What each of these shards answers.
answers(Shards) ->
    Ref = make_ref(),
    _ = [Shard ! {who, self(), Ref} || Shard <- Shards],
    Deadline = now_ms() + ?ANSWER_MS,
    [{Shard, answer(Ref, Shard, Deadline)} || Shard <- Shards].

answer(Ref, Shard, Deadline) ->
    receive
        {at_work, Ref, Shard, AtWork} -> {robots, AtWork}
    after max(0, Deadline - now_ms()) -> {inline, own(starl_machine_runner, Shard)}
    end.

named(_Before, {inline, []}) ->
    [simulator];
named(_Before, {inline, Frames}) ->
    [{unknown, machine, Frames}];
named({robots, Before}, {robots, Now}) ->
    named([in_loop(Work, Before) || Work <- Now]).

%% @doc The processes at work, with their own part of their stacks.
-spec named([starl_sim_robot:work()]) -> [work()].
named(AtWork) ->
    [
        {Robot, Name, frames(Pid)}
     || #{robot := Robot, machine := Name, process := Pid} <- AtWork
    ].

%% @doc One line on a robot that did not end its step; the innermost call of its own comes with it.
-spec format_hang(starl_sim_window:hang()) -> unicode:chardata().
format_hang({Ms, AtWork}) ->
    io_lib:format("~ts did not end a step within ~b s", [format_work(AtWork), Ms div 1000]).

%% @doc Robots that are at work, each with the innermost call of its own.
-spec format_work([work()]) -> unicode:chardata().
format_work(AtWork) -> lists:join(", ", [[who(Work), at(Work)] || Work <- AtWork]).

who({Robot, app, _Frames}) -> io_lib:format("robot ~w", [Robot]);
who({Robot, Name, _Frames}) -> io_lib:format("~ts of robot ~w", [Name, Robot]).

at({_Robot, _Name, Frames}) ->
    case starl_crash:place(Frames) of
        none -> "";
        Frame -> [" at ", starl_crash:format_frame(Frame)]
    end.

in_loop(#{robot := Robot, events := N, application := App} = Work, Before) when is_pid(App) ->
    case [M || #{robot := R, events := M} <- Before, R =:= Robot] of
        [M] when M < N -> Work#{machine := app, process := App};
        _ -> Work
    end;
in_loop(Work, _Before) ->
    Work.

%% The calls above an interpreter; none if the process is not in it.
own(Interpreter, Pid) ->
    Stack = stack(Pid),
    case lists:splitwith(fun({M, _, _, _}) -> M =/= Interpreter end, Stack) of
        {_, []} -> [];
        {Own, _} -> starl_crash:frames(Own)
    end.

frames(Pid) -> starl_crash:frames(stack(Pid)).

%% The process may be on another node, or gone.
stack(Pid) when node(Pid) =:= node() ->
    case erlang:process_info(Pid, current_stacktrace) of
        {current_stacktrace, Stack} -> Stack;
        undefined -> []
    end;
stack(Pid) ->
    try erpc:call(node(Pid), erlang, process_info, [Pid, current_stacktrace], 2 * ?ANSWER_MS) of
        {current_stacktrace, Stack} -> Stack;
        undefined -> []
    catch
        error:{erpc, _} -> []
    end.

now_ms() -> erlang:monotonic_time(millisecond).
