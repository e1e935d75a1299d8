%% @doc A chassis of the user's own in the simulated world. Its driver works as on a real robot and
%% reports the pose of its body. The world knows the body only from these reports.
%% ```
%%     link -- drive --> this -- drive --> the driver's module
%%     world <-- moves -- this <-- posed --      "
%% '''
%% If the driver reports no pose within two seconds, the chassis stops with an error.
-module(starl_world_own).
-behaviour(starl_live_chassis).

-export([open/1, drive/4, actuate/4, stop/1, hear/2, close/1, look/1, rest/1, condition/1]).

-record(own, {
    world :: pid(),
    robot :: starl:robot_id(),
    clock :: starl_live_clock:t(),
    monitor :: reference(),
    module :: module(),
    state :: term(),
    pieces :: starl_world_pieces:t(),
    is_placed = false :: boolean(),
    is_inked = false :: boolean(),
    %% commands to devices without an answer
    devices = [] :: [{Mark :: term(), {Device :: atom(), Value :: term()}}],
    %% the looks that wait until the body has told where it is
    looks = [] :: [{N :: pos_integer(), AskedUs :: integer()}]
}).

-define(PLACE_MS, 2000).
-define(MOST_WAITING, 100).
%% A body that has told nothing for so long stands, as far as is known: the judge waits no longer.
-define(WATCH_MS, 250).
-define(SILENT_US, 500000).

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
                pieces = starl_world_pieces:new(starl_live_clock:now_us(Clock), At)
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

rested(#own{pieces = Pieces} = Own) ->
    case starl_world_pieces:rest(Pieces) of
        {same, _} ->
            Own;
        {Standing, Next} ->
            _ = tell({moves, Standing}, starl_world_pieces:told_us(Next), Own),
            Own#own{pieces = Next}
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
hear({?MODULE, watch}, #own{clock = Clock, pieces = Pieces} = Own) ->
    _ = erlang:send_after(?WATCH_MS, self(), {?MODULE, watch}),
    case starl_live_clock:now_us(Clock) - starl_world_pieces:told_us(Pieces) of
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
    Told = lists:foldl(fun told/2, Own#own{state = State}, Outputs),
    {[Output || Output <- Outputs, element(1, Output) =/= posed], Told}.

told({posed, Us, Pose}, #own{pieces = Pieces} = Own) ->
    {Piece, Next} = starl_world_pieces:add(Us, Pose, Pieces),
    Placed = Own#own{pieces = Next, is_placed = true},
    _ = tell({moves, Piece}, starl_world_pieces:told_us(Next), Placed),
    settled(Us, Placed);
told({Mark, {actuated, Device, Value}}, #own{devices = Devices} = Own) ->
    Left = lists:keydelete(Mark, 1, Devices),
    set({Device, Value}, Own#own{devices = Left});
told(_Output, Own) ->
    Own.

set(Set, #own{clock = Clock, is_inked = IsInked} = Own) ->
    _ = tell({actuate, Set, none}, starl_live_clock:now_us(Clock), Own),
    Own#own{is_inked = Set =:= {pen, down} orelse IsInked andalso Set =/= {pen, up}}.

%% A pose that was taken after a look answers it.
settled(Us, #own{looks = Looks, world = World, robot = Robot} = Own) ->
    {Past, Later} = lists:partition(fun({_, Asked}) -> Asked =< Us end, Looks),
    _ = [World ! {starl_settled, Robot, N} || {N, _} <- lists:reverse(Past)],
    Own#own{looks = Later}.

tell(What, Us, #own{world = World, robot = Robot}) ->
    World ! {starl_body, Robot, self(), {told, Us, What}}.
