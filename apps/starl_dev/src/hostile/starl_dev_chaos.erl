%% @doc `./starl chaos': disturbs runs of `./starl cluster', one after the other. It kills and halts nodes, cuts links
%% and fills disks, while it sends commands from another terminal. Whatever becomes of the robots, each run
%% has to end with its report, and each command with an answer.
%%
%% The seed draws the disturbances, the commands and the gaps between them; the computer's clock decides when.
-module(starl_dev_chaos).
-behaviour(starl_cli_command).

-export([command/0]).

%% One run: its exit status; whether its report is there; the commands by what came of them, and the
%% slowest one.
-type found() :: #{
    status := starl_cli_terminal:status() | crashed,
    report := boolean(),
    commands := sent()
}.
-type sent() :: #{
    done := non_neg_integer(),
    refused := non_neg_integer(),
    unanswered := non_neg_integer(),
    slowest_ms := non_neg_integer(),
    slowest := string()
}.

%% Between two commands, of the computer.
-define(GAP_MS, {300, 3000}).
%% No answer within this time: the command hangs. A reload waits 15 s for nodes, its trial takes 5 s.
-define(ANSWER_MS, 60_000).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "chaos",
        synopsis => "batter clusters; does each run end with a report?",
        about => [
            "Runs a team on a cluster again and again (./starl cluster), each time with --chaos and "
            "further halts and full disks, while commands come as from another terminal: status, heal, "
            "cut, freeze, fill, pause, kill, reload. Each run has a directory with its report. A line "
            "for each run tells how it ended, and how its commands were answered.",
            "A run may end in any way but without a report; a broken contract is told, and its recording "
            "is in the run's directory."
        ],
        flags => fun flags/1,
        statuses => [
            {0, "each run has ended with its report, and each command with an answer"},
            {1, "one has not"},
            {3, "they have, and a contract is broken"},
            {130, "interrupted"}
        ],
        run => fun run/1
    }.

flags(_Subject) ->
    Transports = [Name || {Name, _} <- starl_world_setup:transports()],
    [
        {"Flags", [
            {runs, {integer, 1, 10000}, 20, "runs"},
            {target, string, "painting", "what the team does, as of ./starl cluster"},
            {robots, {integer, 1, 50}, 5, "robots of the team"},
            {transport, {one_of, Transports}, udp, "how packets travel"},
            {speed, {number, 0.1, 20}, 2, "how many times as fast as real time"},
            {seed, {integer, 0, 1 bsl 32}, 1, "of the first run; each has the next"},
            {out, string, "chaos", "the directory of the runs' directories"}
        ]}
    ].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := #{runs := Runs} = Values}) ->
    Found = runs(1, Runs, [], Values),
    summary(Found),
    status(Found, Runs).

runs(N, Runs, Found, _Values) when N > Runs -> lists:reverse(Found);
runs(N, Runs, Found, Values) ->
    One = one(N, Values),
    told(N, One, Values),
    case One of
        #{status := Status} when Status =:= 2; Status =:= 130 -> lists:reverse([One | Found]);
        #{} -> runs(N + 1, Runs, [One | Found], Values)
    end.

status(Found, Runs) ->
    Statuses = [Status || #{status := Status} <- Found],
    Whole = length([x || One <- Found, is_whole(One)]),
    case {lists:last(Statuses), lists:member(3, Statuses)} of
        {Own, _} when Own =:= 2; Own =:= 130 -> Own;
        _ when Whole < Runs -> 1;
        {_, true} -> 3;
        {_, false} -> 0
    end.

is_whole(#{report := Report, commands := #{unanswered := Unanswered}}) ->
    Report andalso Unanswered =:= 0.

%% -- a run ----------------------------------------------------------------------------------

-spec one(pos_integer(), map()) -> found().
one(N, Values) ->
    Dir = dir(N, Values),
    _ = file:del_dir_r(Dir),
    Args = args(N, Values),
    Caller = self(),
    {Runner, Monitor} = spawn_monitor(fun() -> Caller ! {self(), starl_cli:command(Args)} end),
    Commander = commander(N, Values),
    Status =
        receive
            {Runner, Ended} ->
                true = demonitor(Monitor, [flush]),
                Ended;
            {'DOWN', Monitor, process, Runner, Reason} ->
                crashed(Reason)
        end,
    #{
        status => Status,
        report => filelib:file_size(filename:join(Dir, "report.json")) > 0,
        commands => sent(Commander)
    }.

crashed(Reason) ->
    starl_cli_terminal:complain(io_lib:format("the run crashed: ~0tP", [Reason, 30])),
    crashed.

dir(N, #{out := Dir}) -> filename:join(Dir, integer_to_list(N)).

args(N, #{target := Target, seed := Seed, robots := Robots} = Values) ->
    #{transport := Transport, speed := Speed} = Values,
    ["cluster", Target, "--chaos", "--halts", "3", "--full-disks", "3", "--quiet"] ++
        lists:append([
            [Flag, lists:flatten(io_lib:format("~tp", [Value]))]
         || {Flag, Value} <- [
                {"--robots", Robots},
                {"--transport", Transport},
                {"--speed", Speed},
                {"--seed", Seed + N - 1}
            ]
        ]) ++ ["--out", dir(N, Values)].

%% -- commands -------------------------------------------------------------------------------

commander(N, #{seed := Seed} = Values) ->
    Caller = self(),
    None = #{done => 0, refused => 0, unanswered => 0, slowest_ms => 0, slowest => ""},
    Random = rand:seed_s(exsss, {Seed, N, 0}),
    {Commander, _} = spawn_monitor(fun() -> commands(None, Random, Caller, Values) end),
    Commander.

%% The run has ended: a command that is under way is still waited for.
sent(Commander) ->
    Commander ! over,
    receive
        {sent, Commander, Sent} -> Sent;
        {'DOWN', _, process, Commander, Reason} -> error({commands, Reason})
    end.

commands(Sent, Random0, Caller, Values) ->
    {Gap, Random1} = between(?GAP_MS, Random0),
    receive
        over -> Caller ! {sent, self(), Sent}
    after Gap ->
        {Words, Random} = words(Values, Random1),
        commands(counted(Words, Sent), Random, Caller, Values)
    end.

%% A command, with its words.
-spec words(#{robots := pos_integer(), target := string(), _ => _}, rand:state()) ->
    {[string(), ...], rand:state()}.
words(#{robots := Robots, target := Target}, Random0) ->
    {Kind, Random1} = between({1, 10}, Random0),
    {A, Random2} = between({1, Robots}, Random1),
    {B, Random3} = between({1, Robots}, Random2),
    {words(Kind, integer_to_list(A), integer_to_list(B), Target), Random3}.

words(1, _, _, _) -> ["status"];
words(2, A, _, _) -> ["kill", A];
words(3, A, _, _) -> ["pause", A, "2.5"];
words(4, A, A, _) -> ["status"];
words(4, A, B, _) -> ["cut", A, B];
words(5, A, _, _) -> ["freeze", A];
words(6, A, _, _) -> ["fill", A];
words(7, _, _, Target) -> ["reload", Target];
words(_, _, _, _) -> ["heal"].

%% Before the run has begun, and after its end, there is nobody who could answer.
counted(Words, Sent) ->
    Begun = erlang:monotonic_time(millisecond),
    Answer = starl_cluster_command:ask(Words, list_to_integer(os:getpid())),
    Ms = erlang:monotonic_time(millisecond) - Begun,
    counted(is_answer(Answer), Words, Ms, Sent).

is_answer({ok, _}) -> done;
is_answer({error, "no cluster runs" ++ _}) -> nobody;
is_answer({error, "the cluster has ended"}) -> nobody;
is_answer({error, _}) -> refused.

counted(nobody, _Words, Ms, Sent) when Ms < ?ANSWER_MS -> Sent;
counted(What, Words, Ms, #{slowest_ms := Slowest} = Sent) ->
    Kind =
        case Ms < ?ANSWER_MS of
            true -> What;
            false -> unanswered
        end,
    Counted = maps:update_with(Kind, fun(Number) -> Number + 1 end, Sent),
    case Ms > Slowest of
        true -> Counted#{slowest_ms := Ms, slowest := lists:flatten(lists:join(" ", Words))};
        false -> Counted
    end.

between({From, To}, Random0) ->
    {N, Random} = rand:uniform_s(To - From + 1, Random0),
    {From + N - 1, Random}.

%% -- what is told ---------------------------------------------------------------------------

told(N, #{status := Status, report := Report, commands := Commands}, #{seed := Seed}) ->
    #{done := Done, refused := Refused, unanswered := Unanswered} = Commands,
    #{slowest_ms := Ms, slowest := Slowest} = Commands,
    starl_cli_terminal:out(
        "run ~b, seed ~b: ~ts, ~ts; ~b commands done, ~b refused, ~b unanswered, slowest ~.1f s "
        "(~ts)~n",
        [
            N,
            Seed + N - 1,
            ended(Status),
            report(Report),
            Done,
            Refused,
            Unanswered,
            Ms / 1000,
            Slowest
        ]
    ).

ended(0) -> "complete";
ended(3) -> "a contract is broken";
ended(4) -> "not complete";
ended(5) -> "not judged to the end";
ended(crashed) -> "crashed";
ended(Status) -> io_lib:format("status ~b", [Status]).

report(true) -> "with a report";
report(false) -> "NO report".

summary(Found) ->
    Sent = [Commands || #{commands := Commands} <- Found],
    Sum = fun(Key) -> lists:sum([maps:get(Key, Commands) || Commands <- Sent]) end,
    starl_cli_terminal:out(
        "~b runs, ~b with a report, ~b of them complete; ~b commands, ~b unanswered, slowest "
        "~.1f s~n",
        [
            length(Found),
            length([x || #{report := true} <- Found]),
            length([x || #{report := true, status := 0} <- Found]),
            Sum(done) + Sum(refused) + Sum(unanswered),
            Sum(unanswered),
            lists:max([0 | [Ms || #{slowest_ms := Ms} <- Sent]]) / 1000
        ]
    ).
