%% @doc Runs the robots of a live run in one VM, and applies scheduled and manual faults to them
%% ({@link starl_world_injection}). Like a node of a cluster, a robot is killed and restarted with
%% its store, without it or with an old one, as after a reboot. Links are cut and senses fail.
%% Faults that last also apply to a robot that has restarted.
-module(starl_world_robots).
-behaviour(gen_server).

-export([start_link/2, link/2, act/2, heal/2, stop/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-type specs() :: #{starl:robot_id() => starl_live_robot:spec()}.
-type answer() :: ok | {error, unicode:chardata()}.

%% The robots, the clock of the run and its pace, and the schedule of its faults.
-type run() :: #{
    world := pid(),
    clock := starl_live_clock:t(),
    speed := number(),
    schedule := [starl_run_fault:t()]
}.

-record(robots, {
    specs :: specs(),
    %% the robots that run
    sups = #{} :: #{starl:robot_id() => pid()},
    %% the monitors of their links
    watched = #{} :: #{reference() => starl:robot_id()},
    injection :: starl_world_injection:t()
}).

%% A robot whose link starts anew is asked for it until it has one.
-define(AGAIN_MS, 20).

%% @doc Starts these robots in this world.
-spec start_link(specs(), run()) -> gen_server:start_ret().
start_link(Specs, Run) -> gen_server:start_link(?MODULE, {Specs, Run}, []).

%% @doc The link of a robot; `none' while it restarts.
-spec link(pid(), starl:robot_id()) -> pid() | none.
link(Robots, Id) -> gen_server:call(Robots, {link, Id}, infinity).

%% @doc Applies manual faults now.
-spec act(pid(), [starl_run_hand:t()]) -> answer().
act(Robots, Hands) -> gen_server:call(Robots, {act, Hands}, infinity).

%% @doc Ends these faults.
-spec heal(pid(), starl_run_hand:heal()) -> ok.
heal(Robots, What) -> gen_server:call(Robots, {heal, What}, infinity).

%% @doc Ends the robots.
-spec stop(pid()) -> ok.
stop(Robots) ->
    true = unlink(Robots),
    gen_server:stop(Robots, shutdown, infinity).

-spec init({specs(), run()}) -> {ok, #robots{}} | {stop, term()}.
init({Specs, #{schedule := Schedule} = Run}) ->
    _ = process_flag(trap_exit, true),
    Ids = lists:sort(maps:keys(Specs)),
    Injection = starl_world_injection:new(Ids, Run),
    AtOnce = starl_world_injection:planned(Schedule, Injection),
    Robots = lists:foldl(fun played/2, #robots{specs = Specs, injection = Injection}, AtOnce),
    case start_all(Ids, Robots) of
        {ok, _} = Started -> Started;
        {{error, Reason}, _} -> {stop, Reason}
    end.

start_all([], Robots) ->
    {ok, Robots};
start_all([Id | Ids], Robots) ->
    case start(Id, Robots) of
        {ok, Next} -> start_all(Ids, Next);
        {{error, _}, _} = Error -> Error
    end.

start(Id, #robots{specs = Specs, sups = Sups, injection = Injection} = Robots) ->
    #{Id := Spec} = Specs,
    {Fate, Fated} = starl_world_injection:fate(Id, Injection),
    ok = starl_world_store:before_start(Fate, Spec),
    Air = starl_world_injection:air(Id, Fated),
    case starl_live_robot:start_link(starl_world_stage:in_air(Air, Spec)) of
        {ok, Sup} ->
            Up = starl_world_injection:up(Id, Fated),
            {ok, watch(Id, Robots#robots{sups = Sups#{Id => Sup}, injection = Up})};
        {error, _} = Error ->
            {Error, Robots#robots{injection = Fated}}
    end.

-spec handle_call(term(), gen_server:from(), #robots{}) ->
    {reply, answer() | pid() | none, #robots{}}.
handle_call({link, Id}, _From, Robots) ->
    {reply, link_of(Id, Robots), Robots};
handle_call({act, Hands}, _From, #robots{injection = Injection} = Robots) ->
    case starl_world_injection:check(Hands, Injection) of
        ok ->
            {Answers, Next} = lists:mapfoldl(fun hand/2, Robots, Hands),
            {reply, lists:last(Answers), Next};
        {error, _} = Error ->
            {reply, Error, Robots}
    end;
handle_call({heal, What}, _From, #robots{injection = Injection} = Robots) ->
    {reply, ok, lists:foldl(fun over/2, Robots, starl_world_injection:healable(What, Injection))}.

-spec handle_cast(term(), #robots{}) -> {noreply, #robots{}}.
handle_cast(_Request, Robots) -> {noreply, Robots}.

-spec handle_info(term(), #robots{}) -> {noreply, #robots{}}.
handle_info({'DOWN', Ref, process, _, _}, #robots{watched = Watched} = Robots) when
    is_map_key(Ref, Watched)
->
    {Id, Left} = maps:take(Ref, Watched),
    {noreply, watch(Id, Robots#robots{watched = Left})};
handle_info({watch, Id}, Robots) ->
    {noreply, watch(Id, Robots)};
handle_info({begins, Fault}, Robots) ->
    {noreply, played(Fault, Robots)};
handle_info({over, Id}, Robots) ->
    {noreply, over(Id, Robots)};
handle_info({'EXIT', Sup, _Reason}, #robots{sups = Sups} = Robots) ->
    Gone = [Id || {Id, S} <- maps:to_list(Sups), S =:= Sup],
    ok = lists:foreach(fun(Id) -> given_up(Id, Robots) end, Gone),
    {noreply, Robots#robots{sups = maps:without(Gone, Sups)}};
handle_info(_Message, Robots) ->
    {noreply, Robots}.

-spec terminate(term(), #robots{}) -> ok.
terminate(_Reason, #robots{sups = Sups}) ->
    lists:foreach(fun shut_down/1, maps:values(Sups)).

shut_down(Sup) ->
    true = unlink(Sup),
    starl_sim_stop:shutdown(Sup, infinity).

%% It has started anew too often; the others go on.
given_up(Id, #robots{injection = Injection}) ->
    Report = #{what => robot_given_up, robot => Id},
    logger:error(Report, #{robot => Id, report_cb => fun given_up/1}),
    starl_world:dead(starl_world_injection:world(Injection), Id).

given_up(#{robot := Id}) -> {"robot ~b has started anew too often, and is given up", [Id]}.

%% -- faults ---------------------------------------------------------------------------------

hand(Hand, #robots{injection = Injection} = Robots) ->
    {Fault, Named} = starl_world_injection:hand(Hand, Injection),
    begins(Fault, Robots#robots{injection = Named}).

%% One of the schedule.
played(Fault, Robots) ->
    {Answer, Next} = begins(Fault, Robots),
    _ = [starl_world_injection:not_played(Fault, Why) || {error, Why} <- [Answer]],
    Next.

begins(Fault, #robots{injection = Injection} = Robots) ->
    case starl_world_injection:begins(Fault, Injection) of
        {ok, Effects, Next} -> effects(Effects, Robots#robots{injection = Next});
        {error, _} = Error -> {Error, Robots}
    end.

over(Id, #robots{injection = Injection} = Robots) ->
    {Effects, Next} = starl_world_injection:over(Id, Injection),
    {_, Last} = effects(Effects, Robots#robots{injection = Next}),
    Last.

%% An error is what is answered.
effects(Effects, Robots) ->
    lists:foldl(
        fun(Effect, {Answer, Before}) ->
            {Own, Next} = does(Effect, Before),
            {lists:max([Answer, Own]), Next}
        end,
        {ok, Robots},
        Effects
    ).

%% Pauses and full disks need nodes.
-spec does(starl_world_injection:effect(), #robots{}) -> {answer(), #robots{}}.
does({kill, Id}, Robots) ->
    does({start, Id}, killed(Id, Robots));
does({start, Id}, #robots{sups = Sups, injection = Injection} = Robots) ->
    case is_map_key(Id, Sups) orelse starl_world_injection:is_down(Id, Injection) of
        true ->
            {ok, Robots};
        false ->
            {Started, Next} = start(Id, Robots),
            {answer(Id, Started), Next}
    end;
does({dead, Id}, #robots{injection = Injection} = Robots) ->
    {starl_world:dead(starl_world_injection:world(Injection), Id), Robots};
does({machine, Id, Name}, Robots) ->
    _ = [starl_live_link:kill(Link, Name) || Link <- [link_of(Id, Robots)], Link =/= none],
    {ok, Robots};
does({tell, Ids}, Robots) ->
    {lists:foreach(fun(Id) -> aired(Id, Robots) end, Ids), Robots}.

answer(_Id, ok) ->
    ok;
answer(Id, {error, Reason}) ->
    {error, io_lib:format("robot ~b does not start again: ~0tP", [Id, Reason, 8])}.

%% -- robots that start and end --------------------------------------------------------------

killed(Id, #robots{sups = Sups} = Robots) ->
    case maps:take(Id, Sups) of
        {Sup, Left} ->
            ok = struck(Sup, [P || P <- [Sup, link_of_sup(Sup)], is_pid(P)]),
            unwatched(Id, Robots#robots{sups = Left});
        error ->
            Robots
    end.

struck(Sup, Processes) ->
    true = unlink(Sup),
    Ends = [erlang:monitor(process, Process) || Process <- Processes],
    true = exit(Sup, kill),
    lists:foreach(fun await_end/1, Ends).

await_end(Monitor) ->
    receive
        {'DOWN', Monitor, process, _, _} -> ok
    end.

unwatched(Id, #robots{watched = Watched} = Robots) ->
    {Own, Others} = lists:partition(fun({_, Robot}) -> Robot =:= Id end, maps:to_list(Watched)),
    _ = [erlang:demonitor(Ref, [flush]) || {Ref, _} <- Own],
    Robots#robots{watched = maps:from_list(Others)}.

link_of(Id, #robots{sups = Sups}) ->
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

%% -- what robots hear and sense -------------------------------------------------------------

%% A link that starts anew hears everybody at first, and has sound senses.
watch(Id, #robots{sups = Sups, watched = Watched} = Robots) ->
    case link_of(Id, Robots) of
        none when is_map_key(Id, Sups) ->
            _ = erlang:send_after(?AGAIN_MS, self(), {watch, Id}),
            Robots;
        none ->
            Robots;
        Link ->
            Next = Robots#robots{watched = Watched#{erlang:monitor(process, Link) => Id}},
            ok = aired(Id, Next),
            Next
    end.

aired(Id, #robots{injection = Injection} = Robots) ->
    case link_of(Id, Robots) of
        none ->
            ok;
        Link ->
            ok = starl_live_link:sense_faults(Link, starl_world_injection:senses(Id, Injection)),
            set_air(Link, starl_world_injection:air(Id, Injection))
    end.

set_air(Link, Air) ->
    try
        Transport = starl_live_link:port(Link, transport),
        ok = starl_live_transport:set_conditions(Transport, Air)
    catch
        %% it has just ended; the next one is told
        exit:_ -> ok
    end.
