%% Facts that a robot has written to its record, and that have not come: those of a node that hangs, or waits for its
%% processor.
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
            {'$gen_call', From, figures} -> gen_server:reply(From, #{events => 0, packets => 0})
        end,
        Answers()
    end),
    World ! {starl_started, Robot, Link, {[], File}},
    Link.

told() ->
    receive
        {news, {judged, _Events, Found}} -> Found ++ told();
        {news, _} -> told()
    after 0 -> []
    end.
