%% Facts that a robot has written to its record, and that have not come: those of a node that hangs, or waits for its
%% processor.
%%
%% Holds: A fact that a node has written and not told is looked for before anybody is accused, and
%% at the end of a run
%% Red: the world without it: *delivered but not sent*
-module(starl_world_record_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ID, {1, 1, 7}).

%% A message is delivered, as its receiver has told; its sender has written that it was sent before it left, or has not.
%% The judge looks while the run goes on, or at its end.
what_was_written_before_a_message_left_is_judged_test_() ->
    {inparallel, [
        {Name,
            {timeout, 60, fun() ->
                ?assertEqual({Violations, Violations}, found(Written, UntilUs))
            end}}
     || {Name, Written, UntilUs, Violations} <- [
            {"while it runs", [sent], 2_500_000, []},
            {"at its end", [sent], 0, []},
            {"not written", [], 2_500_000, [delivered_but_not_sent]},
            {"not written, at its end", [], 0, [delivered_but_not_sent]}
        ]
    ]}.

%% The violations of a run of two robots, and those that its observer was told of; the first robot has told nothing.
found(Written, UntilUs) ->
    {ok, {_, _, Plan} = Planned} = starl_run:plan(
        #{app => starl_world_app, robots => 2, play => #{}, mode => process},
        #{slack_us => starl_world:slack_us()}
    ),
    Clock = starl_live_clock:new(erlang:system_time(microsecond), 1),
    Self = self(),
    Observe = fun(News) ->
        Self ! {news, News},
        ok
    end,
    {ok, World} = starl_world:start_link(#{
        plan => Plan,
        clock => Clock,
        observe => Observe,
        facts => starl_run_plan:facts(Planned, [])
    }),
    {Dir, Record} = record(),
    Now = starl_live_clock:now_us(Clock),
    Sent = {1, Now, [{Now, 1, sap, {sent, ?ID, [2], note, 9}}]},
    _ = [starl_live_record:write(Sent, Record) || sent <- Written],
    [_, Second] = [
        started(World, Robot, File)
     || {Robot, File} <- [{1, starl_live_record:file(Record)}, {2, none}]
    ],
    Delivered = {1, Now, [{Now + 1, 2, sap, {delivered, ?ID, note, 9}}]},
    World ! {starl_traced, 2, Second, Delivered},
    ok = starl_world:until(World, UntilUs),
    {#{violations := Found}, Told} = {starl_world:finish(World), told()},
    ok = file:del_dir_r(Dir),
    {[What || #{what := What} <- Found], [What || #{what := What} <- Told]}.

record() ->
    Name = ["starl-record-", os:getpid(), $-, integer_to_list(erlang:unique_integer([positive]))],
    Dir = filename:join(os:getenv("TMPDIR", "/tmp"), lists:flatten(Name)),
    ok = filelib:ensure_path(Dir),
    {ok, Record} = starl_live_record:open(Dir),
    {Dir, Record}.

%% A robot without machines.
started(World, Robot, File) ->
    Link = spawn_link(fun Answers() ->
        receive
            {'$gen_cast', {mark, From, Mark}} -> From ! {starl_marked, Robot, self(), Mark};
            {'$gen_call', From, figures} -> gen_server:reply(From, #{events => 0, packets => 0});
            {stand, Caller} -> stands(Caller);
            {tell, Batch} -> World ! {starl_traced, Robot, self(), Batch}
        end,
        Answers()
    end),
    World ! {starl_started, Robot, Link, {[], File}},
    Link.

stands(Caller) ->
    Caller ! {stands, self()},
    receive
        go_on -> ok
    end.

%% A node stands still, and nobody has halted it. Its last fact comes seconds afterwards, and is judged at its time;
%% what comes later is judged to the end.
%% Holds: A node that stands still, whoever halts it, costs no verdict; one late fact is judged at
%% its time, and what followed anew
%% Red: 961f67c9, run
a_node_that_stood_still_costs_no_verdict_test_() ->
    [
        {Name, {timeout, 60, fun() -> ?assertEqual({Found, []}, after_standing(Facts)) end}}
     || {Name, Facts, Found} <- [
            {"its fact explains another", [sent], []},
            {"a later mistake is found", [sent, alien], [delivered_but_not_sent]}
        ]
    ].

%% The violations, and what is not judged, of a run that passes ten times as fast as real time.
after_standing(Facts) ->
    {ok, {_, _, Plan}} = starl_run:plan(
        #{app => starl_world_app, robots => 2, play => #{}, mode => process},
        #{slack_us => starl_world:slack_us()}
    ),
    Clock = starl_live_clock:new(erlang:system_time(microsecond), 10),
    {ok, World} = starl_world:start_link(#{plan => Plan, clock => Clock}),
    [First, Second] = [started(World, Robot, none) || Robot <- [1, 2]],
    ok = starl_world:until(World, 1_000_000),
    First ! {stand, self()},
    receive
        {stands, First} -> ok
    end,
    Now = starl_live_clock:now_us(Clock),
    Second ! {tell, {1, Now, [{Now + 1, 2, sap, {delivered, ?ID, note, 9}}]}},
    ok = starl_world:until(World, Now + 8_000_000),
    First ! {tell, {1, Now, [{Now, 1, sap, {sent, ?ID, [2], note, 9}}]}},
    First ! go_on,
    Later = Now + 9_000_000,
    ok = starl_world:until(World, Later),
    Alien = {delivered, {1, 1, 8}, note, 9},
    Second ! {tell, {2, Later, [{Later, 2, sap, Alien} || alien <- Facts]}},
    ok = starl_world:until(World, Later + 8_000_000),
    #{violations := Found, unjudged := Parts} = starl_world:finish(World),
    {[What || #{what := What} <- Found], Parts}.

told() ->
    receive
        {news, {judged, _Events, Found}} -> Found ++ told();
        {news, _} -> told()
    after 0 -> []
    end.
