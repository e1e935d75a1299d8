%% @doc A handler of OTP's logger that sends each line to a process: a cluster gathers the logs of its
%% nodes.
-module(starl_live_log).

-export([install/2, log/2]).

-export_type([line/0]).

%% The message to the process.
-type line() :: {starl_log, starl:robot_id(), logger:level(), unicode:chardata()}.

-define(TEMPLATE, [msg]).

%% @doc Sends the log of this node to a process, and to nobody else.
-spec install(starl:robot_id(), pid()) -> ok | {error, term()}.
install(Robot, Sink) ->
    _ = logger:remove_handler(default),
    Formatter = {logger_formatter, #{single_line => true, template => ?TEMPLATE}},
    logger:add_handler(?MODULE, ?MODULE, #{
        config => #{robot => Robot, sink => Sink}, formatter => Formatter, level => notice
    }).

%% @private
-spec log(logger:log_event(), logger:handler_config()) -> ok.
log(#{level := Level} = Event, #{config := Config, formatter := {Module, Formatting}}) ->
    #{robot := Robot, sink := Sink} = Config,
    Sink !
        {starl_log, Robot, Level, unicode:characters_to_binary(Module:format(Event, Formatting))},
    ok.
