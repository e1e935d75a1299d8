%% The lines that transports log, for tests.
-module(starl_live_log_ct).

-export([lines/1, lines/2]).
%% called by logger
-export([log/2]).

%% While it sends packets.
lines(Transport, Packets) ->
    lines(fun() ->
        [starl_live_transport:transmit(Transport, 2, Packet) || Packet <- Packets],
        starl_live_transport:figures(Transport)
    end).

lines(Fun) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, warning),
    ok = logger:add_handler(?MODULE, ?MODULE, #{config => #{pid => self()}, level => warning}),
    Others = [{Id, silenced(Id)} || Id <- logger:get_handler_ids(), Id =/= ?MODULE],
    _ = Fun(),
    ok = logger:remove_handler(?MODULE),
    [ok = logger:set_handler_config(Id, level, Before) || {Id, Before} <- Others],
    ok = logger:set_primary_config(level, Level),
    logged().

silenced(Id) ->
    {ok, #{level := Before}} = logger:get_handler_config(Id),
    ok = logger:set_handler_config(Id, level, none),
    Before.

log(#{msg := {report, #{what := _, why := Line}}}, #{config := #{pid := Pid}}) ->
    Pid ! {logged, Line};
log(_Event, _Config) ->
    ok.

logged() ->
    receive
        {logged, Line} -> [Line | logged()]
    after 0 -> []
    end.
