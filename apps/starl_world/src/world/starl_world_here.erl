%% @doc Runs the robots of a run in this VM. Like a node of a cluster, a robot is killed and
%% restarted as a whole. A link that its supervisor restarts knows no fault, so it is reported as
%% renewed. Robots here cannot be halted, and their disk cannot be filled.
-module(starl_world_here).
-behaviour(starl_world_host).

-export([world/0, open/2, await/1, start/3, is_running/2, kill/2, notify/3]).
-export([check/3, release/1, info/2, call/3, status/1, close/2, stop/1]).

-record(here, {
    %% the robots that run
    sups = #{} :: #{starl:robot_id() => pid()},
    %% the monitors of their links
    watched = #{} :: #{reference() => starl:robot_id()}
}).

%% A robot whose link starts anew is asked for it until it has one.
-define(AGAIN_MS, 20).

-spec world() -> one_vm.
world() -> one_vm.

-spec open(starl_run_plan:t(), starl_world_run:options()) -> {ok, #{}, #here{}}.
open(_Plan, _Options) -> {ok, #{}, #here{}}.

-spec await(#here{}) -> {ok, [], #here{}}.
await(Here) -> {ok, [], Here}.

-spec start(starl:robot_id(), starl_world_host:launch(), #here{}) ->
    {ok | {error, unicode:chardata()}, [starl_world_host:event()], #here{}}.
start(Id, #{spec := Spec, air := Air}, #here{sups = Sups} = Here) ->
    case starl_live_robot:start_link(starl_world_setup:with_links(Air, Spec)) of
        {ok, Sup} ->
            {Events, Next} = watch(Id, Here#here{sups = Sups#{Id => Sup}}),
            {ok, [{up, Id} | Events], Next};
        {error, Reason} ->
            {{error, starl_live_sup:format_error(Reason)}, [], Here}
    end.

-spec is_running(starl:robot_id(), #here{}) -> boolean().
is_running(Id, #here{sups = Sups}) -> is_map_key(Id, Sups).

-spec kill(starl:robot_id(), #here{}) -> #here{}.
kill(Id, #here{sups = Sups} = Here) ->
    case maps:take(Id, Sups) of
        {Sup, Left} ->
            ok = killed(Sup, [P || P <- [Sup, link_of_sup(Sup)], is_pid(P)]),
            unwatched(Id, Here#here{sups = Left});
        error ->
            Here
    end.

killed(Sup, Processes) ->
    true = unlink(Sup),
    Ends = [erlang:monitor(process, Process) || Process <- Processes],
    true = exit(Sup, kill),
    lists:foreach(fun await_end/1, Ends).

await_end(Monitor) ->
    receive
        {'DOWN', Monitor, process, _, _} -> ok
    end.

unwatched(Id, #here{watched = Watched} = Here) ->
    {Own, Others} = lists:partition(fun({_, Robot}) -> Robot =:= Id end, maps:to_list(Watched)),
    _ = [erlang:demonitor(Ref, [flush]) || {Ref, _} <- Own],
    Here#here{watched = maps:from_list(Others)}.

-spec notify([starl_world_host:notice()], starl_world_host:done(), #here{}) -> #here{}.
notify(Notices, Done, Here) ->
    ok = lists:foreach(fun({Id, Notice}) -> notify_link(link_of(Id, Here), Notice) end, Notices),
    _ = Done([]),
    Here.

notify_link(none, _Notice) ->
    ok;
notify_link(Link, {kill_machine, Name}) ->
    starl_live_link:kill(Link, Name);
notify_link(Link, {conditions, Air, Senses}) ->
    ok = starl_live_link:sense_faults(Link, Senses),
    try
        Transport = starl_live_link:port(Link, transport),
        ok = starl_live_transport:set_conditions(Transport, Air)
    catch
        %% it has just ended; the next one is notified
        exit:_ -> ok
    end.

-spec check(starl_world_faults:fault(), number(), #here{}) -> ok.
check(_Fault, _RealMs, _Here) -> ok.

-spec release(#here{}) -> {[], #here{}}.
release(Here) -> {[], Here}.

-spec info(term(), #here{}) -> {[starl_world_host:event()], #here{}}.
info({'DOWN', Ref, process, _, _}, #here{watched = Watched} = Here) when
    is_map_key(Ref, Watched)
->
    {Id, Left} = maps:take(Ref, Watched),
    watch(Id, Here#here{watched = Left});
info({watch, Id}, Here) ->
    watch(Id, Here);
info({'EXIT', Sup, _Reason}, #here{sups = Sups} = Here) ->
    Gone = [Id || {Id, S} <- maps:to_list(Sups), S =:= Sup],
    ok = lists:foreach(fun log_given_up/1, Gone),
    {[{given_up, Id} || Id <- Gone], Here#here{sups = maps:without(Gone, Sups)}};
info(_Message, Here) ->
    {[], Here}.

%% The other robots go on.
log_given_up(Id) ->
    Report = #{what => robot_given_up, robot => Id},
    logger:error(Report, #{robot => Id, report_cb => fun given_up/1}).

given_up(#{robot := Id}) -> {"robot ~b has started anew too often, and is given up", [Id]}.

watch(Id, #here{sups = Sups, watched = Watched} = Here) ->
    case link_of(Id, Here) of
        none when is_map_key(Id, Sups) ->
            _ = erlang:send_after(?AGAIN_MS, self(), {watch, Id}),
            {[], Here};
        none ->
            {[], Here};
        Link ->
            Ref = erlang:monitor(process, Link),
            {[{renewed, Id}], Here#here{watched = Watched#{Ref => Id}}}
    end.

link_of(Id, #here{sups = Sups}) ->
    case Sups of
        #{Id := Sup} -> link_of_sup(Sup);
        %% it has given up
        #{} -> none
    end.

link_of_sup(Sup) ->
    try
        starl_live_robot:link(Sup)
    catch
        %% it gives up now
        exit:_ -> none
    end.

-spec call(term(), gen_server:from(), #here{}) -> {reply, term(), #here{}}.
call({link, Id}, _From, Here) -> {reply, link_of(Id, Here), Here};
call(_Request, _From, Here) -> {reply, {error, "the robots of this run have no nodes"}, Here}.

-spec status(#here{}) -> #{}.
status(_Here) -> #{}.

-spec close(starl_world_host:done(), #here{}) -> {[], #here{}}.
close(Done, Here) ->
    _ = Done([]),
    {[], Here}.

-spec stop(#here{}) -> ok.
stop(#here{sups = Sups}) -> lists:foreach(fun shut_down/1, maps:values(Sups)).

shut_down(Sup) ->
    true = unlink(Sup),
    starl_sim_stop:shutdown(Sup, infinity).
