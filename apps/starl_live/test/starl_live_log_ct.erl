%% What live robots log, for tests.
-module(starl_live_log_ct).

-export([lines/1, lines/2, reports/1, words/1]).
%% called by logger
-export([log/2]).

%% The lines of a transport while it sends packets.
lines(Transport, Packets) ->
    lines(fun() ->
        [starl_live_transport:transmit(Transport, 2, Packet) || Packet <- Packets],
        starl_live_transport:figures(Transport)
    end).

%% The lines of warnings and errors.
lines(Fun) -> logged(warning, fun line/1, Fun).

line(#{msg := {report, #{what := _, why := Line}}}) -> {ok, Line};
line(_Event) -> none.

%% All reports that say what they are about: with their level, and what the process that logs says of itself.
reports(Fun) -> logged(notice, fun report/1, Fun).

report(#{level := Level, msg := {report, #{what := _} = Report}, meta := Meta}) ->
    {ok, {Level, Report, Meta}};
report(_Event) ->
    none.

%% A report as a handler shows it.
words({_Level, Report, #{report_cb := Words}}) ->
    {Format, Terms} = Words(Report),
    unicode:characters_to_list(io_lib:format(Format, Terms)).

logged(Least, Of, Fun) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, Least),
    Handler = #{config => #{pid => self(), 'of' => Of}, level => Least},
    ok = logger:add_handler(?MODULE, ?MODULE, Handler),
    Others = [{Id, silenced(Id)} || Id <- logger:get_handler_ids(), Id =/= ?MODULE],
    try
        _ = Fun()
    after
        ok = logger:remove_handler(?MODULE),
        [ok = logger:set_handler_config(Id, level, Before) || {Id, Before} <- Others],
        ok = logger:set_primary_config(level, Level)
    end,
    heard().

silenced(Id) ->
    {ok, #{level := Before}} = logger:get_handler_config(Id),
    ok = logger:set_handler_config(Id, level, none),
    Before.

log(Event, #{config := #{pid := Pid, 'of' := Of}}) ->
    case Of(Event) of
        {ok, Told} -> Pid ! {logged, Told};
        none -> ok
    end.

heard() ->
    receive
        {logged, Told} -> [Told | heard()]
    after 0 -> []
    end.
