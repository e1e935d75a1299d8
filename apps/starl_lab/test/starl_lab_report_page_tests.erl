%% The page of the report (doc/report.md) explains every key of report.json, and no other.
-module(starl_lab_report_page_tests).
-include_lib("eunit/include/eunit.hrl").

-define(BLOCKS, [
    starl_sap_block,
    starl_election,
    starl_bully,
    starl_mutex,
    starl_barrier,
    starl_geocast,
    starl_registers,
    starl_counter
]).

page_test_() ->
    {timeout, 60, fun() ->
        ?assertEqual(page(), lists:usort(made(#{}) ++ made(given_up()) ++ exercised() ++ painted()))
    end}.

%% The keys in the first columns of the page's tables.
page() ->
    Root = hd(string:split(code:which(starl_cli), "/_build/")),
    {ok, Page} = file:read_file(filename:join([Root, "doc", "report.md"])),
    [_, Keys] = string:split(Page, "## The keys of report.json"),
    {match, Found} = re:run(Keys, "^\\| `([a-z_.]+)`", [multiline, global, {capture, [1], list}]),
    ?assertEqual(lists:usort(Found), lists:sort(Found)),
    lists:usort([Key || [Key] <- Found]).

keys(Report) ->
    Read = read(starl_lab_report:json(Report)),
    [
        Path
     || {Key, Value} <- maps:to_list(Read), Path <- [binary_to_list(Key) | under(Key, Value)]
    ].

read(Json) ->
    {ok, Value} = starl_json:decode(iolist_to_binary(Json)),
    Value.

under(Key, [Object | _] = Objects) when is_map(Object) ->
    [binary_to_list(<<Key/binary, ".", K/binary>>) || O <- Objects, K <- maps:keys(O)];
under(_Key, _Value) ->
    [].

given_up() ->
    Left = #{edges => 2, in_the_way => [{2, 1, 1}], cut_off => 1},
    #{starl_dpp_monitor => #{left => Left}}.

%% A run in which all went wrong that can, with these monitors, too.
made(More) ->
    Mail = #{from => 1, type => t, at_us => 1, count => 1},
    Crash = {1, 1, app, {"on purpose", []}},
    Off = starl_trajectory:standing(0, {-1.0, 0.0}, 0.0),
    Ways = #{pieces => [{1, Off}, {2, Off}], until_us => 1, is_whole => true},
    Outcome = #{
        end_us => 1,
        ending => done,
        unjudged => [starl_unjudged:mistake("my", 1, "my_monitor.erl:1: step/2: badarg")],
        violations => [
            #{contract => sap, what => lost, at_us => 1, robots => [1, 2], details => #{}}
        ],
        monitors => More#{
            starl_sap_monitor => #{sent => 1},
            starl_crash_monitor =>
                #{crashes => 1, causes => 1, first_crash => Crash, given_up => []},
            starl_run_mail_monitor => #{
                strangers => [Mail#{to => 7}],
                unheard => [Mail#{robot => 2}],
                overloads => [Mail#{robot => 1}],
                refused => [Mail#{robot => 3}]
            },
            starl_mutex_waits => #{
                kept => [#{robot => 1, token => door, asked => [2]}],
                circles => [#{at_us => 1, waits => [{1, left}, {2, right}]}]
            },
            starl_reload_monitor => #{
                reloads => [
                    #{number => 1, machines => [app], taken => [1], back => [], why => none}
                ]
            }
        },
        robots => [
            {1, #{result => {done, 1}}},
            {2, #{result => running, waits => {time, [{my_app, step, 2, "my_app.erl", 7}]}}}
        ],
        digest => <<1>>,
        late_computers => [{2, 1, 300000}],
        hung => {60000, [{2, app, [{my_app, step, 2, "my_app.erl", 7}]}]},
        events => 5,
        packets => 2
    },
    keys(
        starl_lab_report:make(#{
            name => "my_app",
            scenario => #{seed => 7, robots => 2},
            ending => done,
            wall_s => 1.0,
            outcome => Outcome,
            code => "0123456789ab",
            app => #{figures => []},
            notes => starl_lab_findings:make(Outcome, starl_lab_ways:new(Ways, {1, 1}), [])
        })
    ).

exercised() ->
    lists:append([
        run(#{app => starl_exercise, block => Block, robots => 2, work => 1})
     || Block <- ?BLOCKS
    ]).

painted() -> run(#{app => starl_painting, picture => "lines", robots => 1, time => 1}).

run(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario),
    _ = starl_sim:run(Sim),
    {Outcome, App} = starl_sim:finish(Sim),
    keys(
        starl_lab_report:make(#{
            name => "app",
            scenario => starl_sim:scenario(Sim),
            ending => done,
            wall_s => 1.0,
            outcome => Outcome,
            app => App
        })
    ).
