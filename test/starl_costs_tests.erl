%% No run that ships costs more than it did in the last version without anybody noticing: the counts of
%% `costs.term' are exact, and no clock is asked.
%%
%% When a count has fallen: write the new one into the file. When it has risen: find out why; if
%% what it buys is worth it, write the new one into the file, and the reason into CHANGELOG.md.
%%
%% Holds: The counts of a run do not change unnoticed
%% Red: an event less in `test/costs.term`
-module(starl_costs_tests).
-include_lib("eunit/include/eunit.hrl").

counts_are_those_of_the_last_version_test_() ->
    [
        {title(Scenario), {timeout, 120, fun() -> is_as_before(Scenario, Before) end}}
     || {Scenario, Before} <- known()
    ].

is_as_before(Scenario, Before) ->
    case counts(Scenario) of
        Before -> ok;
        Now -> error({"update test/costs.term, as starl_costs_tests says", {Scenario, Now}})
    end.

title(Scenario) -> lists:flatten(io_lib:format("~0p", [Scenario])).

%% The default run is among them.
the_default_run_is_counted_test() -> ?assert(lists:keymember(#{app => painting}, 1, known())).

known() ->
    {ok, Known} = file:consult(filename:join([root(), "test", "costs.term"])),
    Known.

%% Where the checkout is: above the build that this module was compiled into.
root() -> hd(string:split(code:which(?MODULE), "/_build/")).

counts(Scenario) ->
    Told = counters:new(2, []),
    {ok, Sim} = starl_sim:start(Scenario#{mode => inline, shards => 1}, #{
        observe => fun(News) -> count(News, Told) end
    }),
    #{ending := done} = starl_sim:run(Sim),
    {#{events := Events, packets := Packets}, _} = starl_sim:finish(Sim),
    #{
        events => Events,
        packets => Packets,
        facts => counters:get(Told, 1),
        windows => counters:get(Told, 2)
    }.

count({judged, Facts, _}, Told) ->
    ok = counters:add(Told, 1, length(Facts)),
    counters:add(Told, 2, 1);
count(_News, _Told) ->
    ok.
