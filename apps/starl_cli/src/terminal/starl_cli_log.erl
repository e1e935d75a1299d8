%% @doc A logger handler that keeps OTP's log of a run off the terminal and stores its lines for
%% `run.log'. Crashes from the same cause are one line, with their number.
-module(starl_cli_log).

-export([install/0, filter/0, lines/0, node/3]).
-export([log/2, of_robots/2]).

%% Further lines are dropped.
-define(MOST_LINES, 1000).
%% A line of a robot names it.
-define(TEMPLATE, [time, " ", level, ": ", {robot, ["robot ", robot, ": "], []}, msg, "\n"]).
-define(FORMAT, #{
    template => ?TEMPLATE, single_line => false, depth => 30, chars_limit => 4000
}).

%% @doc Replaces the handler that writes to the terminal. The calling process keeps the lines.
-spec install() -> ok.
install() ->
    _ = logger:remove_handler(default),
    _ = logger:remove_handler(?MODULE),
    Table = ets:new(?MODULE, [set, public]),
    Config = #{config => Table, filter_default => log, filters => [filter()]},
    ok = logger:add_handler(?MODULE, ?MODULE, Config).

%% @doc A filter for a handler of the logger (`logger:add_handler_filter/3'). A robot's crash and its end are
%% one line each; OTP's own reports say the same again in dozens, one for each process of the robot.
-spec filter() -> {logger:filter_id(), {fun(), []}}.
filter() -> {?MODULE, {fun ?MODULE:of_robots/2, []}}.

%% @private
-spec of_robots(logger:log_event(), []) -> stop | ignore.
of_robots(#{meta := #{domain := [otp | _], robot := _}}, []) -> stop;
of_robots(_Event, []) -> ignore.

%% @doc The logged lines, in order.
-spec lines() -> [unicode:chardata()].
lines() ->
    case logger:get_handler_config(?MODULE) of
        {ok, #{config := Table}} ->
            Kept = [Line || {_, _, _, _} = Line <- ets:tab2list(Table)],
            [line(Line, N) || {_, _, Line, N} <- lists:keysort(2, Kept)];
        {error, _} ->
            []
    end.

%% @doc Stores a line of the log of a robot's node, and shows it if it tells of an error, the first
%% time.
-spec node(starl:robot_id(), logger:level(), binary()) -> ok.
node(Robot, Level, Line) ->
    Prefixed = named(Robot, Line),
    IsError = logger:compare_levels(Level, error) =/= lt,
    case logger:get_handler_config(?MODULE) of
        {ok, #{config := Table}} ->
            _ =
                IsError andalso first({Robot, Line}, Table) andalso
                    starl_cli_progress:note(Prefixed),
            keep(erlang:unique_integer(), fun() -> [Prefixed, "\n"] end, Table);
        {error, _} ->
            _ = IsError andalso starl_cli_progress:note(Prefixed),
            ok
    end.

%% A line that begins with the robot needs no other name.
named(Robot, Line) ->
    Name = io_lib:format("robot ~b", [Robot]),
    case string:prefix(Line, [Name, " "]) of
        nomatch -> [Name, ": ", Line];
        _ -> Line
    end.

first(Error, Table) ->
    ets:info(Table, size) =:= undefined orelse ets:insert_new(Table, {{shown, Error}}).

line(Line, 1) -> Line;
line(Line, N) -> [string:trim(Line, trailing), io_lib:format(" (~b times in all)~n", [N])].

%% @private
-spec log(logger:log_event(), logger:handler_config()) -> ok.
log(Event, #{config := Table}) ->
    ok = show(Event),
    keep(key(Event), fun() -> text(Event) end, Table).

%% What a user waits for in vain is said at once.
show(#{msg := {report, #{what := long_step, reason := Why}}, meta := #{robot := Robot}}) ->
    starl_cli_progress:note(io_lib:format("robot ~b ~ts", [Robot, Why]));
show(#{msg := {report, #{what := chassis_failed, why := Why}}, meta := #{robot := Robot}}) ->
    starl_cli_progress:note(io_lib:format("robot ~b: ~ts; the robot starts anew", [Robot, Why]));
show(#{msg := {report, #{what := badly_placed, why := Line}}}) ->
    starl_cli_progress:note(Line);
show(#{msg := {report, #{what := robot_given_up, robot := Robot}}}) ->
    Line = "robot ~b has started anew too often, and is given up",
    starl_cli_progress:note(io_lib:format(Line, [Robot]));
show(_Event) ->
    ok.

keep(Key, Text, Table) ->
    case ets:info(Table, size) of
        undefined -> ok;
        Size -> count(ets:member(Table, Key), Size, Key, Text, Table)
    end.

count(true, _Size, Key, _Text, Table) ->
    _ = ets:update_counter(Table, Key, {4, 1}),
    ok;
count(false, Size, Key, Text, Table) when Size < ?MOST_LINES ->
    Line = unicode:characters_to_binary(Text()),
    New = {Key, erlang:unique_integer([monotonic]), Line, 0},
    _ = ets:update_counter(Table, Key, {4, 1}, New),
    ok;
count(false, _Size, _Key, _Text, _Table) ->
    ok.

%% The robot and the time of a crash do not make it another one.
key(#{msg := {report, #{what := What, machine := Machine, reason := Why}}}) ->
    {What, Machine, Why};
key(_Event) ->
    erlang:unique_integer().

%% A robot's crash or end says itself at what time of the run it was.
text(#{
    msg := {report, #{what := _, machine := _, at_us := _} = Event}, meta := #{report_cb := Text}
}) ->
    {Format, Arguments} = Text(Event),
    [io_lib:format(Format, Arguments), "\n"];
text(Event) ->
    logger_formatter:format(Event, ?FORMAT).
