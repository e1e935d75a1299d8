%% @doc Informs the user when a run makes no progress in real time, and ends a run that does not
%% obey Ctrl-C. A slow or busy computer alone causes no lasting line.
-module(starl_lab_stall).

-export([watch/1, interrupt/1]).
-export([line/3]).

%% The time after which a line is said even of a step that has not done much: it may wait.
-define(LONG_MS, 60_000).
%% The calls of a line.
-define(CALLS, 3).

%% The time after which a line says that an interrupted run is still at work.
-define(REST_MS, 600).

%% @doc Watches a run: one line on a stall stays, a progress line follows each.
-spec watch(starl_sim:sim()) -> Watch :: pid().
watch(Sim) ->
    Told = atomics:new(1, []),
    starl_sim:watch(Sim, #{tell => fun(News) -> tell(News, Told) end}).

tell({stands, Ms, Cause, AtWork}, Told) ->
    Known = [Work || Work <- AtWork, Work =/= simulator],
    _ =
        Known =/= [] andalso (Cause =:= loop orelse Ms >= ?LONG_MS) andalso
            atomics:exchange(Told, 1, 1) =:= 0 andalso
            starl_cli_progress:note(line(Ms, Cause, Known)),
    starl_cli_progress:say(waiting(Ms, AtWork));
tell(goes_on, _Told) ->
    ok.

%% @doc Ends a run with its results so far, however long a busy computer takes for that. A run that
%% does not come to rest, because a robot is in an endless loop, ends without results.
-spec interrupt(starl_sim:sim()) -> ok.
interrupt(Sim) ->
    ok = starl_sim:stop(Sim),
    _ = spawn(fun() -> rest(Sim) end),
    ok.

rest(Sim) ->
    ok = timer:sleep(?REST_MS),
    case starl_sim:at_work(Sim) of
        %% it rests, or the results are being made
        [] ->
            ok;
        [_ | _] ->
            starl_cli_progress:note(
                "interrupted; the run ends with this step; Ctrl-C again ends it without results"
            ),
            _ = starl_sim:watch(Sim, #{tell => fun still/1}),
            receive
            after infinity -> ok
            end
    end.

still({stands, _Ms, loop, AtWork}) -> given_up(AtWork);
still(_News) -> ok.

-spec given_up([starl_sim_watchdog:work()]) -> no_return().
given_up(AtWork) ->
    starl_cli_progress:note([
        "interrupted; no results: ", lists:join("; ", [in_step(G) || G <- groups(AtWork)])
    ]),
    starl_cli_signal:leave().

in_step({"the simulator", _, _}) -> "the simulator was in the middle of its work";
in_step({Who, none, _}) -> [Who, " did not end its step"];
in_step({Who, Place, _}) -> [Who, " did not end its step at ", Place].

%% @doc One line on a stall: the place, who is there, since when, and the latest calls that lead there.
-spec line(Ms :: non_neg_integer(), starl_sim_watchdog:cause(), [starl_sim_watchdog:work()]) ->
    unicode:chardata().
line(Ms, Cause, AtWork) ->
    {Shown, Others} = lists:split(min(1, length(AtWork)), groups(AtWork)),
    [stall(Ms, Cause, Group) || Group <- Shown] ++
        [io_lib:format("; ~b more are at work", [length(Others)]) || Others =/= []].

stall(Ms, _Cause, {Who, none, _}) ->
    [Who, at_work_for(Ms)];
stall(Ms, Cause, {Who, Place, Frames}) ->
    [Place, ": ", Who, at_work_for(Ms), asked(Cause), " Calls: ", calls(Frames)].

asked(loop) -> ", is this an endless loop?";
asked(slow) -> ".".

at_work_for(Ms) -> io_lib:format(" at work for ~b s without a pause", [Ms div 1000]).

calls(Frames) ->
    Latest = [starl_crash:format_frame(Frame) || Frame <- lists:sublist(Frames, ?CALLS)],
    lists:join(", ", Latest ++ ["..." || length(Frames) > ?CALLS]).

%% The texts of the progress line: what the run waits for.
-spec waiting(Ms :: non_neg_integer(), [starl_sim_watchdog:work()]) -> [unicode:chardata()].
waiting(Ms, AtWork) ->
    For = [[Who, place(Place)] || {Who, Place, _} <- groups(AtWork)],
    [
        ["waiting for ", lists:join("; ", For)],
        io_lib:format("~b s", [Ms div 1000]),
        "Ctrl-C ends the run"
    ].

place(none) -> "";
place(Place) -> [" at ", Place].

%% Those who are in the same calls, together.
groups(AtWork) ->
    Keyed = [{key(Work), Work} || Work <- AtWork],
    Keys = lists:usort([Key || {Key, _} <- Keyed]),
    [group(Key, [Work || {K, Work} <- Keyed, K =:= Key]) || Key <- Keys].

key({_Robot, Name, Frames}) -> {Name, Frames};
key(Work) -> Work.

group({monitor, Frames}, _) ->
    {"a monitor", shown_place(Frames), Frames};
group(simulator, _) ->
    {"the simulator", none, []};
group({Name, Frames}, Works) ->
    {who(Name, [Id || {Id, _, _} <- Works]), shown_place(Frames), Frames}.

who(_Name, [unknown | _]) -> "a machine of a robot";
who(app, Ids) -> starl_lab_phrase:robots(Ids);
who(Name, Ids) -> [atom_to_list(Name), " of ", starl_lab_phrase:robots(Ids)].

shown_place(Frames) ->
    case starl_crash:place(Frames) of
        {_, _, _, File, Line} -> io_lib:format("~ts:~b", [File, Line]);
        none -> none
    end.
