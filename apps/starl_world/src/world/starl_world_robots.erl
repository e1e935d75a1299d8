%% @doc The robots of a live run in one VM, and what is done to them by hand, as to the nodes of a
%% cluster: a robot is killed and starts anew with its store, as after a reboot; links are cut and
%% healed; positions are frozen. What is cut stays cut for a robot that has started anew.
-module(starl_world_robots).
-behaviour(gen_server).

-export([start_link/2, link/2, kill/2, cut/3, freeze/2, sense/4, heal/1, stop/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-type specs() :: #{starl:robot_id() => starl_live_robot:spec()}.
-type answer() :: ok | {error, unicode:chardata()}.
-type request() ::
    {link, starl:robot_id()}
    | {kill, starl:robot_id()}
    | {cut, starl:robot_id(), starl:robot_id()}
    | {freeze, starl:robot_id()}
    | {sense, starl:robot_id(), starl_sense:kind() | all, starl_live_sense_fault:fault() | well}
    | heal.

-record(robots, {
    world :: pid(),
    specs :: specs(),
    %% the robots that run
    sups = #{} :: #{starl:robot_id() => pid()},
    %% the monitors of their links
    watched = #{} :: #{reference() => starl:robot_id()},
    %% who cannot hear whom
    cuts = [] :: [{starl:robot_id(), starl:robot_id()}],
    senses = #{} :: #{starl:robot_id() => starl_live_sense_fault:faults()}
}).

%% A robot whose link starts anew is asked for it until it has one.
-define(AGAIN_MS, 20).

%% @doc Starts these robots in this world.
-spec start_link(pid(), specs()) -> gen_server:start_ret().
start_link(World, Specs) -> gen_server:start_link(?MODULE, {World, Specs}, []).

%% @doc The link of a robot; `none' while it starts anew.
-spec link(pid(), starl:robot_id()) -> pid() | none.
link(Robots, Id) -> gen_server:call(Robots, {link, Id}, infinity).

%% @doc Kills all processes of a robot at once, as the death of its node does, and starts it anew.
-spec kill(pid(), starl:robot_id()) -> answer().
kill(Robots, Id) -> gen_server:call(Robots, {kill, Id}, infinity).

%% @doc These two robots do not hear each other any more.
-spec cut(pid(), starl:robot_id(), starl:robot_id()) -> answer().
cut(Robots, A, B) -> gen_server:call(Robots, {cut, A, B}, infinity).

%% @doc From now on this robot, too, gets no new positions.
-spec freeze(pid(), starl:robot_id()) -> answer().
freeze(Robots, Id) -> gen_server:call(Robots, {freeze, Id}, infinity).

%% @doc A sense of this robot, or all of them, has a fault from now on; `well': no more.
-spec sense(
    pid(), starl:robot_id(), starl_sense:kind() | all, starl_live_sense_fault:fault() | well
) -> answer().
sense(Robots, Id, Sense, Fault) -> gen_server:call(Robots, {sense, Id, Sense, Fault}, infinity).

%% @doc All links, positions and senses are as they were.
-spec heal(pid()) -> ok.
heal(Robots) -> gen_server:call(Robots, heal, infinity).

%% @doc Ends the robots.
-spec stop(pid()) -> ok.
stop(Robots) ->
    true = unlink(Robots),
    gen_server:stop(Robots, shutdown, infinity).

-spec init({pid(), specs()}) -> {ok, #robots{}} | {stop, term()}.
init({World, Specs}) ->
    _ = process_flag(trap_exit, true),
    Robots = #robots{world = World, specs = Specs},
    case start_all(lists:sort(maps:keys(Specs)), Robots) of
        {ok, Started} -> {ok, Started};
        {{error, Reason}, _} -> {stop, Reason}
    end.

start_all([], Robots) ->
    {ok, Robots};
start_all([Id | Ids], Robots) ->
    case start(Id, Robots) of
        {ok, Next} -> start_all(Ids, Next);
        {{error, _}, _} = Error -> Error
    end.

start(Id, #robots{specs = Specs, sups = Sups} = Robots) ->
    #{Id := Spec} = Specs,
    case starl_live_robot:start_link(Spec) of
        {ok, Sup} -> {ok, watch(Id, Robots#robots{sups = Sups#{Id => Sup}})};
        {error, _} = Error -> {Error, Robots}
    end.

-spec handle_call(request(), gen_server:from(), #robots{}) ->
    {reply, answer() | pid() | none, #robots{}}.
handle_call({link, Id}, _From, Robots) ->
    {reply, link_of(Id, Robots), Robots};
handle_call({kill, Id}, _From, #robots{world = World} = Robots) ->
    ok = starl_world:struck(World, kill_robot, Id),
    {Started, Next} = start(Id, killed(Id, Robots)),
    {reply, answer(Id, Started), Next};
handle_call({cut, A, B}, _From, #robots{cuts = Cuts} = Robots) ->
    {reply, ok, cuts(lists:usort([{A, B}, {B, A} | Cuts]), Robots)};
handle_call({freeze, Id}, _From, #robots{world = World} = Robots) ->
    {reply, starl_world:freeze_too(World, Id), Robots};
handle_call({sense, Id, Sense, well}, _From, #robots{senses = Senses} = Robots) ->
    Left = maps:remove(Sense, maps:get(Id, Senses, #{})),
    {reply, ok, senses(Senses#{Id => Left}, Robots)};
handle_call({sense, Id, Sense, Fault}, _From, #robots{senses = Senses} = Robots) ->
    Own = (maps:get(Id, Senses, #{}))#{Sense => Fault},
    {reply, ok, senses(Senses#{Id => Own}, Robots)};
handle_call(heal, _From, #robots{world = World} = Robots) ->
    ok = starl_world:freeze(World, []),
    {reply, ok, cuts([], senses(#{}, Robots))}.

answer(_Id, ok) ->
    ok;
answer(Id, {error, Reason}) ->
    {error, io_lib:format("robot ~b does not start again: ~0tP", [Id, Reason, 8])}.

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
given_up(Id, #robots{world = World}) ->
    Report = #{what => robot_given_up, robot => Id},
    logger:error(Report, #{robot => Id, report_cb => fun given_up/1}),
    World ! {starl_ended, Id, self(), given_up},
    ok.

given_up(#{robot := Id}) -> {"robot ~b has started anew too often, and is given up", [Id]}.

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

%% -- what robots hear -----------------------------------------------------------------------

%% A link that starts anew hears everybody at first.
watch(Id, #robots{sups = Sups, watched = Watched} = Robots) ->
    case link_of(Id, Robots) of
        none when is_map_key(Id, Sups) ->
            _ = erlang:send_after(?AGAIN_MS, self(), {watch, Id}),
            Robots;
        none ->
            Robots;
        Link ->
            Next = Robots#robots{watched = Watched#{erlang:monitor(process, Link) => Id}},
            _ = lists:keymember(Id, 1, Robots#robots.cuts) andalso aired(Id, Next),
            _ = is_map_key(Id, Robots#robots.senses) andalso sensing(Id, Next),
            Next
    end.

senses(Senses, #robots{world = World, specs = Specs} = Robots) ->
    Next = Robots#robots{senses = Senses},
    Told = [
        {Id, Sense, Fault}
     || {Id, Faults} <- lists:sort(maps:to_list(Senses)), {Sense, Fault} <- maps:to_list(Faults)
    ],
    ok = starl_world:senses(World, Told),
    ok = lists:foreach(fun(Id) -> sensing(Id, Next) end, maps:keys(Specs)),
    Next.

%% A link that starts anew has sound senses at first.
sensing(Id, #robots{senses = Senses} = Robots) ->
    case link_of(Id, Robots) of
        none -> ok;
        Link -> starl_live_link:sense_faults(Link, maps:get(Id, Senses, #{}))
    end.

cuts(Cuts, #robots{world = World, specs = Specs} = Robots) ->
    Next = Robots#robots{cuts = Cuts},
    ok = starl_world:cut(World, Cuts),
    ok = lists:foreach(fun(Id) -> aired(Id, Next) end, maps:keys(Specs)),
    Next.

aired(Id, #robots{cuts = Cuts} = Robots) ->
    Deaf = [Other || {Robot, Other} <- Cuts, Robot =:= Id],
    try
        Transport = starl_live_link:line(link_of(Id, Robots), transport),
        ok = starl_live_transport:set_air(Transport, #{cut => Deaf})
    catch
        %% it has just ended; the next one is told
        exit:_ -> ok
    end.
