%% @doc A chassis of the user's own in the simulated world, named `FILE.erl' or `exec:PROGRAM' in a
%% choice. Before a run starts, its driver is prepared: a source is compiled and checked, and a
%% program is started once and must send its hello.
%%
%% In the run, the driver works as on a real robot and reports the pose of its body. The world knows
%% the body only from these reports.
%% ```
%%     link -- drive --> this -- drive --> the driver's module
%%     world <-- moves -- this <-- posed --      "
%% '''
%% If the driver reports no pose within two seconds, the chassis stops with an error.
-module(starl_world_own_chassis).
-behaviour(starl_live_chassis).

-export([resolve/3, lines/3]).
-export([open/1, drive/4, actuate/4, stop/1, hear/2, close/1, look/1, rest/1, condition/1]).

-export_type([drivers/0]).

%% The drivers by their names, and the modules that were compiled for them.
-type drivers() :: #{
    drivers := #{starl_chassis_choice:name() => starl_live_link:adapter()},
    code := [starl_version:code()]
}.

-record(own, {
    world :: pid(),
    robot :: starl:robot_id(),
    clock :: starl_live_clock:t(),
    monitor :: reference(),
    module :: module(),
    state :: term(),
    motion :: starl_world_sampled_motion:t(),
    is_placed = false :: boolean(),
    is_inked = false :: boolean(),
    %% commands to devices without an answer
    devices = [] :: [{Mark :: term(), {Device :: atom(), Value :: term()}}],
    %% the looks that wait for the pose of the body
    looks = [] :: [{N :: pos_integer(), AskedUs :: integer()}]
}).

-define(PLACE_MS, 2000).
-define(MOST_WAITING, 100).
%% A body without a report for this time stands, as far as is known: the judge waits no longer.
-define(WATCH_MS, 250).
-define(SILENT_US, 500000).

%% -- before a run ---------------------------------------------------------------------------

%% @doc The user's own chassis of a choice, with the profiles that the robots will have.
-spec resolve(starl_chassis_choice:t(), starl_chassis:profiles(), starl_live_own:compile()) ->
    {ok, drivers()} | {error, [unicode:chardata(), ...]}.
resolve(Choice, Profiles, Compile) ->
    Names = lists:zip(starl_chassis_choice:in_turn(Choice), Profiles),
    Own = lists:usort([{N, P} || {N, P} <- Names, starl_chassis_choice:own(N) =/= none]),
    All = [{Name, resolved(Name, Profile, Compile)} || {Name, Profile} <- Own],
    case [["--chassis: ", Why] || {_, {error, Lines}} <- All, Why <- Lines] of
        [] ->
            {ok, #{
                drivers => maps:from_list([{Name, Driver} || {Name, {ok, Driver, _}} <- All]),
                code => lists:append([Code || {_, {ok, _, Code}} <- All])
            }};
        Problems ->
            {error, Problems}
    end.

resolved(Name, Profile, Compile) ->
    case starl_live_own:driver(Name, Compile) of
        {ok, {starl_live_exec, _} = Driver, Code} -> tried(Driver, Code, Profile);
        Answer -> Answer
    end.

%% Does the program start, and does it have the profile of the robots?
tried({Module, Own} = Driver, Code, Profile) ->
    _ = process_flag(trap_exit, true),
    Clock = starl_live_clock:new(erlang:system_time(microsecond), 1),
    case Module:open(Own#{robot => 1, clock => Clock, profile => Profile}) of
        {ok, State} ->
            ok = Module:close(Module:stop(State)),
            {ok, Driver, Code};
        {error, Why} ->
            {error, [Why]}
    end.

%% @doc The chassis of each robot of a run: the user's own, or that of the other lines, or one of the
%% world.
-spec lines(starl_chassis_choice:t(), drivers(), starl_world_chassis:lines() | undefined) ->
    starl_world_chassis:lines() | undefined.
lines(_Choice, #{drivers := None}, Others) when map_size(None) =:= 0 ->
    Others;
lines(Choice, #{drivers := Drivers}, Others) ->
    fun(Robot, World) ->
        case maps:find(starl_chassis_choice:of_robot(Robot, Choice), Drivers) of
            {ok, Driver} -> {starl_world_own_chassis, #{world => World, own => Driver}};
            error when Others =:= undefined -> {starl_world_chassis, #{world => World}};
            error -> Others(Robot, World)
        end
    end.

%% -- in the run -----------------------------------------------------------------------------

-spec open(map()) -> {ok, #own{}} | {error, unicode:chardata()}.
open(#{world := World, robot := Robot, clock := Clock, own := {Module, Options}} = Config) ->
    Monitor = erlang:monitor(process, World),
    case starl_world:track(World, Robot) of
        {ok, At} ->
            Known = maps:merge(maps:without([world, own], Config), Options),
            Own = #own{
                world = World,
                robot = Robot,
                clock = Clock,
                monitor = Monitor,
                module = Module,
                state = none,
                motion = starl_world_sampled_motion:new(starl_live_clock:now_us(Clock), At)
            },
            opened(Module:open(Known#{at => At}), Own);
        {error, _} = Error ->
            Error
    end.

opened({ok, State}, Own) ->
    _ = erlang:send_after(?PLACE_MS, self(), {?MODULE, placed}),
    _ = erlang:send_after(?WATCH_MS, self(), {?MODULE, watch}),
    {ok, Own#own{state = State}};
opened({error, _} = Error, _Own) ->
    Error.

-spec drive(starl_chassis:script(), integer(), term(), #own{}) ->
    {[starl_live_chassis:output()], #own{}}.
drive(Script, Until, Mark, #own{module = Module, state = State} = Own) ->
    did(Module:drive(Script, Until, Mark, State), Own).

-spec actuate(atom(), term(), {mark, term()} | none, #own{}) ->
    {[starl_live_chassis:output()], #own{}}.
actuate(Device, Value, none, #own{module = Module, state = State} = Own) ->
    did(Module:actuate(Device, Value, none, State), set({Device, Value}, Own));
actuate(Device, Value, {mark, Mark} = Marked, #own{module = Module, state = State} = Own) ->
    Devices = lists:sublist([{Mark, {Device, Value}} | Own#own.devices], ?MOST_WAITING),
    did(Module:actuate(Device, Value, Marked, State), Own#own{devices = Devices}).

-spec stop(#own{}) -> #own{}.
stop(#own{module = Module, state = State, is_inked = IsInked} = Own) ->
    Stopped = Own#own{state = Module:stop(State), devices = []},
    case IsInked of
        true -> set({pen, up}, Stopped);
        false -> Stopped
    end.

-spec rest(#own{}) -> #own{}.
rest(Own) -> optional(rest, Own).

-spec look(#own{}) -> #own{}.
look(Own) -> optional(look, Own).

optional(Function, #own{module = Module, state = State} = Own) ->
    Own#own{state = starl_callback:call(Module, Function, [State], State)}.

-spec condition(#own{}) -> map().
condition(#own{module = Module, state = State}) ->
    starl_callback:call(Module, condition, [State], #{}).

-spec close(#own{}) -> ok.
close(#own{module = Module, state = State} = Own) ->
    _ = rested(Own),
    Module:close(State).

rested(#own{motion = Motion} = Own) ->
    case starl_world_sampled_motion:rest(Motion) of
        {same, _} ->
            Own;
        {Standing, Next} ->
            _ = report({moves, Standing}, starl_world_sampled_motion:reported_us(Next), Own),
            Own#own{motion = Next}
    end.

-spec hear(term(), #own{}) ->
    {[starl_live_chassis:output()], #own{}} | {stop, unicode:chardata()} | unknown.
hear({starl_settle, World, N}, #own{world = World, clock = Clock, looks = Looks} = Own) ->
    Asked = lists:sublist([{N, starl_live_clock:now_us(Clock)} | Looks], ?MOST_WAITING),
    {[], look(Own#own{looks = Asked})};
hear({?MODULE, placed}, #own{is_placed = false}) ->
    {stop, "the chassis tells no pose, and this world has no other way to know where its body is"};
hear({?MODULE, placed}, Own) ->
    {[], Own};
hear({?MODULE, watch}, #own{clock = Clock, motion = Motion} = Own) ->
    _ = erlang:send_after(?WATCH_MS, self(), {?MODULE, watch}),
    case starl_live_clock:now_us(Clock) - starl_world_sampled_motion:reported_us(Motion) of
        Us when Us > ?SILENT_US -> {[], rested(Own)};
        _ -> {[], Own}
    end;
hear({'DOWN', Monitor, _, _, _}, #own{monitor = Monitor}) ->
    {stop, "the world has ended"};
hear(Message, #own{module = Module, state = State} = Own) ->
    case Module:hear(Message, State) of
        {Outputs, Next} when is_list(Outputs) -> did({Outputs, Next}, Own);
        Other -> Other
    end.

did({Outputs, State}, Own) ->
    Handled = lists:foldl(fun handled/2, Own#own{state = State}, Outputs),
    {[Output || Output <- Outputs, element(1, Output) =/= posed], Handled}.

handled({posed, Us, Pose}, #own{motion = Motion} = Own) ->
    {Piece, Next} = starl_world_sampled_motion:add(Us, Pose, Motion),
    Placed = Own#own{motion = Next, is_placed = true},
    _ = report({moves, Piece}, starl_world_sampled_motion:reported_us(Next), Placed),
    settled(Us, Placed);
handled({Mark, {actuated, Device, Value}}, #own{devices = Devices} = Own) ->
    Left = lists:keydelete(Mark, 1, Devices),
    set({Device, Value}, Own#own{devices = Left});
handled(_Output, Own) ->
    Own.

set(Set, #own{clock = Clock, is_inked = IsInked} = Own) ->
    _ = report({actuate, Set, none}, starl_live_clock:now_us(Clock), Own),
    Own#own{is_inked = Set =:= {pen, down} orelse IsInked andalso Set =/= {pen, up}}.

%% A pose that was taken after a look answers it.
settled(Us, #own{looks = Looks, world = World, robot = Robot} = Own) ->
    {Past, Later} = lists:partition(fun({_, Asked}) -> Asked =< Us end, Looks),
    _ = [World ! {starl_settled, Robot, N} || {N, _} <- lists:reverse(Past)],
    Own#own{looks = Later}.

report(What, Us, #own{world = World, robot = Robot}) ->
    World ! {starl_body, Robot, self(), {reported, Us, What}}.
