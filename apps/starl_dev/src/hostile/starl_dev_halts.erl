%% @doc `./starl halts': the nodes of a cluster are halted in the middle of a step, again and again,
%% while their robots paint or hold tokens. The run's own monitors judge.
%%
%% A step takes no time in the simulator; on a computer it may take as long as a lease. The robots,
%% gaps and lengths are drawn from the seed, the moments are those of the computer.
-module(starl_dev_halts).
-behaviour(starl_cli_command).

-export([command/0]).

-type block() :: mutex | painting.

%% What has been found for a block. `halts': those that found the node in the midst of something;
%% `idle': the others;
%% `violations': the first of each run that ended with one, since others may follow from it.
-type found() :: #{
    runs := non_neg_integer(),
    halts := non_neg_integer(),
    idle := non_neg_integer(),
    violations := [{starl_monitor:violation(), Recording :: file:filename()}]
}.

%% Of the halts of a painting two thirds hit the robot that leads.
-define(LEADERS, 0.67).
%% A run has begun after this time of the run (us): who leads is known.
-define(BEGUN_US, 12000000).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "halts",
        synopsis => "halt robots' nodes in the middle of a step",
        about => [
            "A team works on a cluster, by UDP, four times as fast as real time, and its nodes are halted "
            "(SIGSTOP), one after the other, each in the middle of what it does: a team of four that "
            "asks for tokens for 1 to 2 s, a team of five that paints for 3.5 to 6 s, longer than the "
            "lease of the robot that leads. A run that is over is followed by another one. The run's "
            "own monitors judge; the recording of a run with a violation stays in the directory.",
            "On a computer with much other work a robot is late without a halt; it says so, and is "
            "excused as a robot that is halted. --speed 1 allows it four times the time."
        ],
        flags => [
            {"Flags", [
                {block, {one_of, [both, mutex, painting]}, both, "what the team does"},
                {halts, {integer, 1, 10000}, 200, "halts of each block"},
                {speed, {number, 0.1, 20}, 4, "how many times as fast as real time"},
                {seed, {integer, 0, 1 bsl 32}, 1, "of the robots, the gaps and the lengths"},
                {out, string, "halts", "the directory of the recordings"}
            ]}
        ],
        statuses => [{0, "borne"}, {3, "a contract is broken"}, {130, "interrupted"}],
        run => fun run/1
    }.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := #{block := Block, seed := Seed, out := Dir} = Values}) ->
    ok = starl_cli_log:install(),
    _ = process_flag(trap_exit, true),
    ok = filelib:ensure_path(Dir),
    starl_cli_terminal:out("seed ~b~n", [Seed]),
    all(blocks(Block), [], Values).

blocks(both) -> [mutex, painting];
blocks(Block) -> [Block].

all([], Found, _Values) ->
    table(lists:reverse(Found));
all([Block | Blocks], Found, #{seed := Seed} = Values) ->
    None = #{runs => 0, halts => 0, idle => 0, violations => []},
    case runs(Block, None, rand:seed_s(exsss, Seed), Values) of
        {error, _} = Error -> Error;
        Halted -> all(Blocks, [{Block, Halted} | Found], Values)
    end.

%% -- runs -----------------------------------------------------------------------------------

-spec runs(block(), found(), rand:state(), map()) -> found() | {error, [unicode:chardata()]}.
runs(_Block, #{halts := Halts} = Found, _Random, #{halts := Wanted}) when Halts >= Wanted ->
    Found;
runs(Block, #{runs := Runs} = Found, Random, #{out := Dir} = Values) ->
    File = filename:join(Dir, io_lib:format("~s-~b.mcap", [Block, Runs + 1])),
    Recorded = starl_lab_recording:into(File, live, fun(Observer) ->
        recorded(Block, Found, Random, Observer, Values)
    end),
    case Recorded of
        {ok, Violations, Halted, Next} ->
            ok = kept(Violations, File),
            runs(Block, judged(Violations, File, Halted), Next, Values);
        {error, _} = Error ->
            Error
    end.

recorded(Block, Found, Random, Observer, #{out := Dir} = Values) ->
    Stores = filename:join(Dir, "stores"),
    _ = file:del_dir_r(Stores),
    Options = #{
        dir => Stores,
        transport => udp,
        speed => maps:get(speed, Values),
        observe => Observer,
        log => fun starl_cli_log:node/3
    },
    case starl_world_run:start(scenario(Block, Found, Values), Options) of
        {ok, Cluster} ->
            %% all nodes end with this VM, halted or not
            starl_cli_signal:on_interrupt(fun interrupted/0),
            {Halted, Next} = halted(Block, Cluster, ended(Cluster), Found, Random, Values),
            {#{violations := Violations}, _} = starl_world_run:finish(Cluster),
            _ = file:del_dir_r(Stores),
            {ok, Violations, Halted, Next};
        {error, Reason} ->
            {error, [starl_world_run:format_error(Reason)]}
    end.

scenario(mutex, #{runs := Runs}, #{seed := Seed}) ->
    #{app => starl_exercise, block => mutex, work => 240, robots => 4, seed => Seed + Runs};
scenario(painting, #{runs := Runs}, #{seed := Seed}) ->
    Picture = filename:join([code:priv_dir(starl_apps), "pictures", "text.svg"]),
    #{app => starl_painting, picture => Picture, robots => 5, seed => Seed + Runs}.

%% The end of the run is a message.
ended(Cluster) ->
    Caller = self(),
    spawn_link(fun() -> Caller ! {ended, self(), starl_world_run:await(Cluster)} end).

halted(Block, Cluster, Waiter, #{runs := Runs} = Found, Random, #{halts := Wanted} = Values) ->
    ok = starl_world_run:until(Cluster, ?BEGUN_US),
    halts(Block, Cluster, Waiter, Found#{runs := Runs + 1}, Random, Wanted, Values).

%% Halt after halt, until the run ends. The last one gets time to show what it has done.
halts(Block, Cluster, Waiter, #{halts := Wanted} = Found, Random, Wanted, _Values) ->
    {Gap, Next} = gap(Block, Random),
    _ = is_over(Waiter, 4 * Gap),
    ok = starl_world_run:stop(Cluster),
    {Found, Next};
halts(Block, Cluster, Waiter, Found, Random0, Wanted, Values) ->
    {Gap, Random1} = gap(Block, Random0),
    {Length, Random2} = between(length_ms(Block), Random1),
    {Robot, Random} = robot(Block, Cluster, Random2),
    case is_over(Waiter, Gap) of
        true ->
            {Found, Random};
        false ->
            Next = counted(starl_world_run:halt_at_work(Cluster, Robot, Length / 1000), Found),
            starl_cli_progress:note(io_lib:format("~s: ~b halts", [Block, maps:get(halts, Next)])),
            halts(Block, Cluster, Waiter, Next, Random, Wanted, Values)
    end.

%% A node may be down for a moment.
counted({ok, at_work}, #{halts := N} = Found) -> Found#{halts := N + 1};
counted({ok, idle}, #{idle := N} = Found) -> Found#{idle := N + 1};
counted({error, _}, Found) -> Found.

is_over(Waiter, Ms) ->
    receive
        {ended, Waiter, _} -> true
    after Ms -> false
    end.

gap(Block, Random) -> between(gap_ms(Block), Random).

gap_ms(mutex) -> {300, 1500};
gap_ms(painting) -> {2000, 4000}.

length_ms(mutex) -> {1000, 2000};
length_ms(painting) -> {3500, 6000}.

between({From, To}, Random0) ->
    {N, Random} = rand:uniform_s(To - From + 1, Random0),
    {From + N - 1, Random}.

robot(Block, Cluster, Random0) ->
    #{leader := Leader, restarts := Robots} = starl_world_run:status(Cluster),
    {N, Random1} = rand:uniform_s(map_size(Robots), Random0),
    {Luck, Random} = rand:uniform_s(Random1),
    case Block =:= painting andalso Leader =/= none andalso Luck < ?LEADERS of
        true -> {Leader, Random};
        false -> {N, Random}
    end.

kept([], File) ->
    _ = file:delete(File),
    ok;
kept([_ | _], _File) ->
    ok.

judged(Violations, File, #{violations := Before} = Found) ->
    _ = [starl_cli_terminal:out("~ts~n", [starl_violation:format(V)]) || V <- Violations],
    _ = [starl_cli_terminal:out("  ~ts~n", [File]) || Violations =/= []],
    Found#{violations := Before ++ [{V, File} || V <- lists:sublist(Violations, 1)]}.

%% -- the table ------------------------------------------------------------------------------

table(Found) ->
    starl_cli_terminal:out("~-10s ~6s ~6s ~6s  ~ts~n", [
        "block", "runs", "halts", "idle", "violations"
    ]),
    lists:foreach(fun row/1, Found),
    case [x || {_, #{violations := [_ | _]}} <- Found] of
        [] -> 0;
        _ -> 3
    end.

row({Block, #{runs := Runs, halts := Halts, idle := Idle, violations := Violations}}) ->
    Kinds = lists:usort([kind(V) || {V, _} <- Violations]),
    Counted = [
        io_lib:format("~ts ~b", [Kind, length([V || {V, _} <- Violations, kind(V) =:= Kind])])
     || Kind <- Kinds
    ],
    Said =
        case Counted of
            [] -> "none";
            _ -> lists:join(", ", Counted)
        end,
    starl_cli_terminal:out("~-10s ~6b ~6b ~6b  ~ts~n", [Block, Runs, Halts, Idle, Said]).

kind(#{contract := Contract, what := What}) ->
    lists:flatten(
        io_lib:format("~s: ~s", [Contract, string:replace(atom_to_list(What), "_", " ", all)])
    ).

-spec interrupted() -> no_return().
interrupted() -> halt(130).
