%% @doc Records a robot on a node of its own, in files such as `robot-3.mcap', with what the robot
%% itself knows ({@link starl_observer}).
%%
%% A node that restarts goes on in a new file, `robot-3.2.mcap', and never changes the former file.
%% If the former file was not closed, the new file begins with the events that the former one has
%% lost, if the record of the robot's facts still has them. A node that was killed loses none; a
%% computer that has lost its power loses those of one second. A file with a quarter of the allowed
%% bytes is closed, and the recording goes on in the next one.
-module(starl_trace_robot).
-behaviour(starl_observer).

-export([start_link/1, observer/1, files/2, order/2, continued/1, lacking/1]).
-export([log/2]).

-export_type([config/0]).

%% `dir' of the recordings; `facts' of the run; `most_bytes': the allowed bytes of the robot's files
%% in the directory, of which the oldest are deleted; without it one file grows, and all are kept.
%% With it a reserve is kept, too, which is the room of the robot's store when the disk is full.
-type config() :: #{
    robot := starl:robot_id(),
    now := fun(() -> AtUs :: integer()),
    before := [starl_monitor:trace_event()],
    dir := file:filename(),
    facts := starl_observer:facts(),
    most_bytes => pos_integer() | none
}.

%% Facts of one run.
-define(SAME, [app, kind, scenario, epoch_us, run]).
%% Files in the allowed bytes.
-define(FILES, 4).
%% Somewhat more than the largest term of a store ({@link starl_payload}), which is written beside its
%% predecessor.
-define(RESERVE, "reserve").
-define(RESERVE_BYTES, 12_000_000).

%% @doc Begins the recording of a robot.
-spec start_link(config()) -> {ok, pid()} | {error, unicode:chardata()}.
start_link(#{robot := Robot, dir := Dir} = Config) ->
    _ = filelib:ensure_path(Dir),
    Former = former(files(Robot, Dir), Config),
    case starl_trace_recorder:start_link(next(Robot, Dir, Config), live, options(Config)) of
        {ok, Recorder} ->
            ok = begin_with(Former, starl_trace_recorder:observer(Recorder), Config),
            {ok, Recorder};
        {error, Reason} ->
            {error, unicode:characters_to_binary(starl_trace_recorder:format_error(Reason))}
    end.

%% @doc The observer of the robot.
-spec observer(pid()) -> starl_observer:t().
observer(Recorder) -> starl_trace_recorder:observer(Recorder).

%% @doc The recordings of a robot in a directory, the oldest first.
-spec files(starl:robot_id(), file:filename()) -> [file:filename()].
files(Robot, Dir) ->
    Prefix = prefix(Robot),
    Names = filelib:wildcard(Prefix ++ "*.mcap", Dir),
    Numbered = [
        {N, filename:join(Dir, Name)}
     || Name <- Names, {ok, N} <- [number(lists:nthtail(length(Prefix), Name))]
    ],
    [File || {_, File} <- lists:sort(Numbered)].

prefix(Robot) -> "robot-" ++ integer_to_list(Robot).

number(".mcap") ->
    {ok, 1};
number("." ++ Rest) ->
    case string:to_integer(Rest) of
        {N, ".mcap"} when is_integer(N) -> {ok, N};
        _ -> none
    end;
number(_) ->
    none.

%% @doc The place of a recording among those of its robot: by its number, since the clock may have been set
%% back between two of them; without one, by its beginning.
-spec order(file:filename_all(), Facts) -> {Number :: non_neg_integer(), BegunUs :: integer()} when
    Facts :: #{told_by := [starl:robot_id(), ...], begun_us => integer(), atom() => term()}.
order(File, #{told_by := [Robot | _]} = Facts) ->
    Begun = maps:get(begun_us, Facts, 0),
    case number_of(File, Robot) of
        {ok, N} -> {N, Begun};
        none -> {0, Begun}
    end.

%% @doc The files of a robot whose next file has their end, if they were cut off.
-spec continued([{file:filename_all(), starl_observer:facts()}]) -> [file:filename_all()].
continued(Files) ->
    Starts = lists:sort([
        {By, order(File, Facts), maps:get(was_up, Facts, false), File}
     || {File, #{told_by := By} = Facts} <- Files
    ]),
    Pairs = lists:zip(lists:droplast([none | Starts]), Starts),
    [File || {{By, _, _, File}, {By, _, true, _}} <- Pairs].

%% @doc What is missing among these recordings of robots, with their facts: the names of the files, or
%% the robots of whom an earlier file is missing; and the files behind which something is missing
%% (`none': at the beginning), with the time until which.
-spec lacking([{file:filename_all(), starl_observer:facts()}]) ->
    {[file:filename() | starl:robot_id()], #{file:filename_all() | none => integer()}}.
lacking(Files) ->
    Ordered = lists:sort([
        {Robot, order(File, Facts), maps:get(was_up, Facts, false), File}
     || {File, #{told_by := [Robot]} = Facts} <- Files
    ]),
    Pairs = lists:zip(lists:droplast([none | Ordered]), Ordered),
    Lacking = [
        {Names, Behind, To}
     || {A, B} <- Pairs, {[_ | _] = Names, Behind, To} <- [gap(A, B)]
    ],
    Latest = fun({_, Behind, To}, Holes) ->
        maps:update_with(Behind, fun(Before) -> max(Before, To) end, To, Holes)
    end,
    {
        lists:append([Names || {Names, _, _} <- Lacking]),
        lists:foldl(Latest, #{}, Lacking)
    }.

%% What is missing between two files, or before the first of a robot.
gap({Robot, _, _, Before}, {Robot, {_, Begun}, _, File}) ->
    {between(number_of(Before, Robot), number_of(File, Robot), Robot), Before, Begun};
gap(_Other, {Robot, {_, Begun}, WasUp, File}) ->
    case between({ok, 0}, number_of(File, Robot), Robot) of
        [] when WasUp -> {[Robot], none, Begun};
        Names -> {Names, none, Begun}
    end.

between({ok, N}, {ok, M}, Robot) -> [name(Robot, K) || K <- lists:seq(N + 1, M - 1)];
between(_, _, _Robot) -> [].

number_of(File, Robot) ->
    case string:prefix(filename:basename(File), prefix(Robot)) of
        nomatch -> none;
        Rest -> number(Rest)
    end.

name(Robot, 1) -> prefix(Robot) ++ ".mcap";
name(Robot, N) -> lists:concat([prefix(Robot), ".", N, ".mcap"]).

options(#{most_bytes := Most, robot := Robot, dir := Dir} = Config) when is_integer(Most) ->
    #{
        file_bytes => Most div ?FILES,
        next => fun() -> next(Robot, Dir, Config) end,
        reserve => {filename:join(Dir, ?RESERVE), ?RESERVE_BYTES}
    };
options(_Config) ->
    #{}.

%% The next file, for which there is room now.
next(Robot, Dir, Config) ->
    Files = files(Robot, Dir),
    ok = make_room(Files, maps:get(most_bytes, Config, none)),
    filename:join(Dir, named(Robot, Files)).

named(Robot, []) ->
    name(Robot, 1);
named(Robot, Files) ->
    {ok, N} = number_of(lists:last(Files), Robot),
    name(Robot, N + 1).

make_room(_Files, none) ->
    ok;
make_room(Files, Most) ->
    Sizes = [{File, filelib:file_size(File)} || File <- Files],
    too_old(Sizes, lists:sum([Size || {_, Size} <- Sizes]), Most - Most div ?FILES).

too_old([{File, Size} | Files], Sum, Most) when Sum > Most ->
    _ = file:delete(File),
    too_old(Files, Sum - Size, Most);
too_old(_Files, _Sum, _Most) ->
    ok.

%% -- the former recording -------------------------------------------------------------------

%% The end of the former recording of this run, if that was not closed. Its last file may have begun a
%% moment before, when the one before was full, and hold no event.
former(Files, #{facts := Facts}) ->
    case [tail(File, Facts) || File <- lists:sublist(lists:reverse(Files), 2)] of
        [#{ended := Ended, trace := []} = Tail, #{ended := closed, trace := Full}] when
            Ended =/= closed
        ->
            Tail#{trace := Full};
        [#{ended := Ended} = Tail | _] when Ended =/= closed ->
            Tail;
        _ ->
            none
    end.

tail(File, Facts) ->
    case starl_trace_reader:tail(File) of
        {ok, #{scenario := Scenario} = Tail} ->
            case maps:with(?SAME, Scenario) =:= maps:with(?SAME, Facts) of
                true -> Tail;
                false -> none
            end;
        {error, _} ->
            none
    end.

begin_with(none, Observer, #{now := Now} = Config) ->
    begun(#{begun_us => Now()}, [], Observer, Config);
begin_with(#{trace := Trace, until_us := Until}, Observer, #{before := Before} = Config) ->
    #{now := Now} = Config,
    At = Now(),
    Lost = [no_later(At, Event) || Event <- starl_trace_lost_facts:lost(Trace, Before)],
    begun(#{begun_us => min(Until, At), was_up => true}, Lost, Observer, Config).

%% If the clock was set back, what was lost is told at the beginning: no message of a file is earlier than
%% the one before, so the new life would have the last time of the old one.
no_later(At, {Us, Robot, Machine, What}) -> {min(Us, At), Robot, Machine, What}.

begun(How, Lost, Observer, #{robot := Robot, facts := Facts, now := Now}) ->
    Told = maps:merge(Facts#{told_by => [Robot]}, How),
    ok = starl_observer:tell({begun, Told}, Observer),
    ok = starl_observer:tell({judged, Lost, []}, Observer),
    logs(#{observer => Observer, robot => Robot, now => Now}).

%% -- the log --------------------------------------------------------------------------------

logs(Config) ->
    _ = logger:remove_handler(?MODULE),
    Formatter = {logger_formatter, #{single_line => true, template => [msg]}},
    logger:add_handler(?MODULE, ?MODULE, #{
        config => Config, formatter => Formatter, level => notice
    }).

%% @private
-spec log(logger:log_event(), logger:handler_config()) -> ok.
log(#{level := Level} = Event, #{config := Config, formatter := {Module, Formatting}}) ->
    #{observer := Observer, robot := Robot, now := Now} = Config,
    Line = unicode:characters_to_binary(Module:format(Event, Formatting)),
    starl_observer:tell({logged, Now(), Robot, level(Level), Line}, Observer).

level(notice) -> info;
level(warning) -> warning;
level(_Error) -> error.
