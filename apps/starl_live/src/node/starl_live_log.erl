%% @doc A handler of OTP's logger that sends each line to a process. A cluster gathers the logs of
%% its nodes in this way. The link logs a crash of a machine in one line. OTP's own reports of the
%% machine's process and of its supervisor repeat it, so they are left out. When a robot starts
%% anew, or can no longer start, as on a full disk, its supervisors log long reports. The handler
%% reduces each to one line with the reason.
-module(starl_live_log).

-export([install/2, of_machine/4, log/2, again/2]).

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
        config => #{robot => Robot, sink => Sink},
        formatter => Formatter,
        level => notice,
        filter_default => log,
        filters => [{?MODULE, {fun ?MODULE:again/2, []}}]
    }).

%% @doc Logs an event of a machine, with a text for handlers that show it.
-spec of_machine(error | warning, What :: atom(), starl_machine:name() | robot, Why) -> ok when
    Why :: unicode:chardata().
of_machine(Level, What, Name, Text) ->
    Why = unicode:characters_to_binary(Text),
    Report = #{what => What, machine => Name, reason => Why},
    logger:log(Level, Report, #{report_cb => fun report/1}).

report(#{what := crashed, machine := Name, reason := Why}) -> {"~tp crashed: ~ts", [Name, Why]};
report(#{what := _, reason := Why}) -> {"~ts", [Why]}.

%% @private Stops what the link logs, too. Who ends a process from outside does not crash it: only its
%% supervisor reports that, and it becomes one line.
-spec again(logger:log_event(), []) -> stop | ignore | logger:log_event().
again(#{meta := #{domain := [otp | _], machine := _}}, []) ->
    stop;
again(#{msg := {report, #{label := {supervisor, What}, report := Report}}} = Event, []) ->
    case {proplists:get_value(supervisor, Report), What, proplists:get_value(reason, Report)} of
        {{_Pid, starl_robot_sup}, child_terminated, Reason} ->
            ended(starl_crash:cause(Reason), Report, Event);
        %% the chassis has logged it
        {{_Pid, starl_live_robot}, child_terminated, {shutdown, {chassis, _}}} ->
            stop;
        {{_Pid, starl_live_robot}, Ended, {shutdown, Why}} when
            Ended =:= child_terminated; Ended =:= start_error
        ->
            logs(starts_anew(Why), Event);
        {{_Pid, starl_live_robot}, shutdown, Why} ->
            logs(#{what => node_ends, why => Why}, Event);
        {{local, starl_live_sup}, _, Why} when
            Why =:= shutdown; Why =:= reached_max_restart_intensity
        ->
            stop;
        _ ->
            ignore
    end;
again(_Event, []) ->
    ignore.

%% The text is no more the supervisor's.
logs(Report, #{meta := Meta} = Event) ->
    Event#{msg := {report, Report}, meta := Meta#{report_cb => fun text/1}}.

text(#{what := store_unwritable, why := Why}) ->
    {"its store cannot be written: ~ts; it starts anew", [Why]};
text(#{what := robot_starts_anew, why := gave_up}) ->
    {"it starts anew: its machines have ended too often", []};
text(#{what := robot_starts_anew, why := outlived}) ->
    {"it starts anew: its store is older than what others have heard of it", []};
text(#{what := robot_starts_anew, why := {Port, Why}}) when is_binary(Why) ->
    {"it starts anew: its ~ts: ~ts", [Port, Why]};
text(#{what := robot_starts_anew, why := Why}) ->
    {"it starts anew: ~0tp", [Why]};
text(#{what := node_ends, why := reached_max_restart_intensity}) ->
    {"its node ends: it has started anew too often", []};
text(#{what := node_ends, why := Why}) ->
    {"its node ends: ~0tp", [Why]};
text(#{what := machine_ended, machine := Machine, why := Why}) ->
    {"its machine ~ts has ended: ~0tp", [Machine, Why]}.

starts_anew({store, Why}) -> #{what => store_unwritable, why => Why};
starts_anew(Why) -> #{what => robot_starts_anew, why => Why}.

ended(none, Report, Event) ->
    Machine = proplists:get_value(id, proplists:get_value(offender, Report)),
    Why = proplists:get_value(reason, Report),
    logs(#{what => machine_ended, machine => Machine, why => Why}, Event);
ended(_Cause, _Report, _Event) ->
    stop.

%% @private
-spec log(logger:log_event(), logger:handler_config()) -> ok.
log(#{level := Level} = Event, #{config := Config, formatter := {Module, Formatting}}) ->
    #{robot := Robot, sink := Sink} = Config,
    Sink !
        {starl_log, Robot, Level, unicode:characters_to_binary(Module:format(Event, Formatting))},
    ok.
