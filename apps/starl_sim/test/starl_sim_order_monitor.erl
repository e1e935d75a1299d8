%% What every monitor may rely on: events come in the order of time. Its result is the trace.
-module(starl_sim_order_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2]).

init(#{}) -> {0, []}.

step({T, Robot, Machine, Event} = Traced, {Last, Trace}) ->
    Next = {max(T, Last), [Traced | Trace]},
    case T >= Last of
        true ->
            {ok, Next};
        false ->
            {violation,
                #{
                    contract => order,
                    what => time_runs_backwards,
                    at_us => T,
                    robots => [Robot],
                    details => #{machine => Machine, event => Event, last_us => Last}
                },
                Next}
    end.

finish(_End, {_, Trace}) -> {ok, #{trace => lists:reverse(Trace)}}.
