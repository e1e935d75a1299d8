%% The lines that a transport logs while it sends packets, for tests.
-module(starl_live_log_ct).

-export([lines/2]).
%% called by logger
-export([log/2]).

lines(Transport, Packets) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, error),
    Filters = #{config => #{pid => self()}, level => error},
    ok = logger:add_handler(?MODULE, ?MODULE, Filters),
    Others = [{Id, silenced(Id)} || Id <- logger:get_handler_ids(), Id =/= ?MODULE],
    [starl_live_transport:transmit(Transport, 2, Packet) || Packet <- Packets],
    _ = starl_live_transport:figures(Transport),
    ok = logger:remove_handler(?MODULE),
    [ok = logger:set_handler_config(Id, level, Before) || {Id, Before} <- Others],
    ok = logger:set_primary_config(level, Level),
    logged().

silenced(Id) ->
    {ok, #{level := Before}} = logger:get_handler_config(Id),
    ok = logger:set_handler_config(Id, level, none),
    Before.

log(#{msg := {report, #{what := packet_refused, why := Line}}}, #{config := #{pid := Pid}}) ->
    Pid ! {logged, Line};
log(_Event, _Config) ->
    ok.

logged() ->
    receive
        {logged, Line} -> [Line | logged()]
    after 0 -> []
    end.
