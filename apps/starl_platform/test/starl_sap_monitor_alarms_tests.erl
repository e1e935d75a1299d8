%% Alarms: first in, first out, and thrown out when their messages are closed.
-module(starl_sap_monitor_alarms_tests).
-include_lib("eunit/include/eunit.hrl").

id(N) -> {1, 1, N}.

%% Messages of these numbers are outstanding.
sources(Numbers) ->
    lists:foldl(
        fun(N, Sources) ->
            {ok, More} = starl_sap_monitor_sources:add(id(N), message(N), Sources),
            More
        end,
        starl_sap_monitor_sources:new(),
        Numbers
    ).

message(N) -> starl_sap_monitor_message:new(t, N, N, [2]).

%% An alarm for each number, due then; the sources are the same all the time.
pushed(Numbers, Sources, Alarms) ->
    lists:foldl(
        fun(N, A) -> starl_sap_monitor_alarms:push(N, id(N), Sources, A) end, Alarms, Numbers
    ).

pushed(Numbers, Sources) -> pushed(Numbers, Sources, starl_sap_monitor_alarms:new()).

%% The alarms that are due before a time, and those left.
popped(T, Alarms) ->
    case starl_sap_monitor_alarms:pop(T, Alarms) of
        {none, Left} ->
            {[], Left};
        {{Due, {1, 1, Due}}, Left} ->
            {More, Last} = popped(T, Left),
            {[Due | More], Last}
    end.

all(Alarms) -> element(1, popped(1 bsl 60, Alarms)).

none_test() ->
    ?assertEqual(infinity, starl_sap_monitor_alarms:due(starl_sap_monitor_alarms:new())),
    ?assertEqual([], all(starl_sap_monitor_alarms:new())).

%% In the order in which they came, those that were due before the time; at the time is not before.
order_test() ->
    Alarms = pushed([3, 5, 7], sources([3, 5, 7])),
    ?assertEqual(3, starl_sap_monitor_alarms:due(Alarms)),
    {[], Three} = popped(3, Alarms),
    {[3, 5], One} = popped(7, Three),
    ?assertEqual(7, starl_sap_monitor_alarms:due(One)),
    Two = pushed([9], sources([9]), One),
    ?assertEqual(7, starl_sap_monitor_alarms:due(Two)),
    ?assertEqual([7, 9], all(Two)),
    {[7, 9], None} = popped(10, Two),
    ?assertEqual(infinity, starl_sap_monitor_alarms:due(None)).

%% A short queue keeps what is closed.
short_test() ->
    Alarms = pushed(lists:seq(1, 1025), sources([])),
    ?assertEqual(1025, length(all(Alarms))),
    ?assertEqual([2000], all(pushed([2000], sources([]), Alarms))).

%% A longer one does until they outnumber the others; then the others are left, in their order.
outnumbered_test() ->
    Open = lists:seq(1, 2200, 2),
    Sources = sources(Open),
    Even = pushed(lists:seq(1, 2200), Sources),
    ?assertEqual(2200, length(all(Even))),
    Odd = pushed([2201], Sources, Even),
    ?assertEqual(2201, length(all(Odd))),
    ?assertEqual(Open ++ [2202], all(pushed([2202], Sources, Odd))),
    %% also those that have come to the front of the queue
    {[1], Fronted} = popped(2, Odd),
    ?assertEqual(tl(Open) ++ [2203], all(pushed([2202, 2203], Sources, Fronted))).
