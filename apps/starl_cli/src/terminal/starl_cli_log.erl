%% @doc A logger handler that keeps OTP's log of a run off the terminal and stores its lines for
%% `run.log'. Faults that kill machines cause many crash reports.
-module(starl_cli_log).

-export([install/0, lines/0, node/3]).
-export([log/2]).

%% Further lines are dropped.
-define(MOST_LINES, 1000).
-define(FORMAT, #{single_line => false, depth => 30, chars_limit => 4000}).

%% @doc Replaces the handler that writes to the terminal. The calling process keeps the lines.
-spec install() -> ok.
install() ->
    _ = logger:remove_handler(default),
    _ = logger:remove_handler(?MODULE),
    Table = ets:new(?MODULE, [ordered_set, public]),
    ok = logger:add_handler(?MODULE, ?MODULE, #{config => Table}).

%% @doc The logged lines, in order.
-spec lines() -> [unicode:chardata()].
lines() ->
    case logger:get_handler_config(?MODULE) of
        {ok, #{config := Table}} -> [Line || {_, Line} <- ets:tab2list(Table)];
        {error, _} -> []
    end.

%% @doc Stores a line of the log of a robot's node, and shows it if it tells of an error.
-spec node(starl:robot_id(), logger:level(), binary()) -> ok.
node(Robot, Level, Line) ->
    Prefixed = io_lib:format("robot ~b: ~ts", [Robot, Line]),
    _ =
        logger:compare_levels(Level, error) =/= lt andalso
            begin
                starl_cli_progress:erase(),
                starl_cli_terminal:complain(Prefixed)
            end,
    case logger:get_handler_config(?MODULE) of
        {ok, #{config := Table}} -> keep(unicode:characters_to_binary([Prefixed, "\n"]), Table);
        {error, _} -> ok
    end.

%% @private
-spec log(logger:log_event(), logger:handler_config()) -> ok.
log(Event, #{config := Table}) ->
    keep(unicode:characters_to_binary(logger_formatter:format(Event, ?FORMAT)), Table).

keep(Line, Table) ->
    case ets:info(Table, size) of
        Size when is_integer(Size), Size < ?MOST_LINES ->
            true = ets:insert(Table, {erlang:unique_integer([monotonic]), Line}),
            ok;
        _ ->
            ok
    end.
