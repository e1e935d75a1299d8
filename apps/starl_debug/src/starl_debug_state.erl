%% @doc The state of a robot by its own trace: its mode, the tokens that it held, whether it led.
%% Each state is a set of times of the robot's own clock. Nothing changes between two events, so the
%% state is uncertain only after a death.
-module(starl_debug_state).

-export([new/4, times/2, tokens/1, elections/1, geocasts/3, extent/1]).

-export_type([t/0, events/0, geocast/0, cast/0]).

%% The events of a robot by machine, in the order of their times.
-type events() :: #{starl_machine:name() => [{AtUs :: integer(), Event :: term()}]}.

%% The robot has a message to an area; it serves geocasts: its machine is there, and did not begin
%% anew less than a second ago.
-type geocast() :: {delivered, Id :: term()} | serves.

%% A message to an area, sent at that time of its source's clock.
-type cast() :: #{
    id := term(),
    source := starl:robot_id(),
    at := integer(),
    area := starl_debug_type:area(),
    lifetime := pos_integer()
}.

%% What a robot needs after its start until its program listens.
-define(GRACE_US, 1000000).

-record(state, {
    robot :: starl:robot_id(),
    events :: events(),
    extent :: starl_debug_set:interval(),
    %% times of which its recording says nothing
    unknown :: starl_debug_set:t()
}).

-opaque t() :: #state{}.

%% @doc A robot by its events, from the first to the last time of its recording. A robot that
%% records itself does not know when it went down: `told' is its record until its next start.
-spec new(starl:robot_id(), events(), starl_debug_set:interval(), exact | told) -> t().
new(Robot, Events, Extent, How) ->
    Down = spans(maps:get(robot, Events, []), fun life/1, Extent),
    Unknown =
        case How of
            exact -> [];
            told -> Down
        end,
    #state{robot = Robot, events = Events, extent = Extent, unknown = Unknown}.

%% @doc The first and the last time of the recording.
-spec extent(t()) -> starl_debug_set:interval().
extent(#state{extent = Extent}) -> Extent.

%% @doc The times at which something is true of the robot.
-spec times(starl_debug_type:state() | geocast(), t()) -> starl_debug_set:three().
times(What, #state{extent = Extent, unknown = Unknown} = State) ->
    Known = starl_debug_set:intersect(true(What, State), [Extent]),
    {
        starl_debug_set:union(Known, starl_debug_set:intersect(Unknown, [Extent])),
        starl_debug_set:intersect(Known, starl_debug_set:complement(Unknown, [Extent]))
    }.

true({mode, <<"down">>}, State) ->
    down(State);
true(up, #state{extent = Extent} = State) ->
    starl_debug_set:complement(down(State), [Extent]);
true({mode, <<"moving">>}, State) ->
    moving(State);
true({mode, <<"waiting">>}, State) ->
    waiting(State);
true({mode, <<"idle">>}, #state{extent = Extent} = State) ->
    Busy = starl_debug_set:union([down(State), moving(State), waiting(State)]),
    starl_debug_set:complement(Busy, [Extent]);
true({owner, any}, State) ->
    starl_debug_set:union(maps:values(holds(State)));
true({owner, {token, Name}}, State) ->
    maps:get(Name, holds(State), []);
true({leader, any}, #state{robot = Robot, extent = Extent} = State) ->
    spans(machine(election, State), fun(Event) -> any(leads(Event, Robot)) end, Extent);
true({leader, {election, Name}}, State) ->
    maps:get(Name, led(State), []);
true(coordinator, #state{extent = Extent} = State) ->
    spans(machine(dpp_coordinator, State), fun coordinates/1, Extent);
true({last, Machine, Name}, #state{extent = Extent} = State) ->
    spans(named(Machine, State), fun(Event) -> on(tag(Event) =:= Name) end, Extent);
true({delivered, Id}, #state{extent = Extent} = State) ->
    Is = fun
        ({delivered, Known, _}) -> on(Known =:= Id);
        (_) -> same
    end,
    spans(maps:get(geocast, State#state.events, []), Is, Extent);
true(serves, #state{extent = Extent, events = Events} = State) ->
    Crashed = [{At, At} || {At, crashed} <- maps:get(geocast, Events, [])],
    Gone = starl_debug_set:union(down(State), starl_debug_set:new(Crashed)),
    starl_debug_set:complement(starl_debug_set:dilate(Gone, -?GRACE_US, 0), [Extent]).

down(#state{events = Events, extent = Extent}) ->
    spans(maps:get(robot, Events, []), fun life/1, Extent).

life(down) -> on;
life({died, _}) -> on;
life(up) -> off;
life(_) -> same.

%% The elections that made the robot the leader, each until it enters it anew.
led(#state{robot = Robot, extent = Extent} = State) ->
    held_by(machine(election, State), fun(Event) -> leads(Event, Robot) end, Extent).

leads({elected, Election, Leader, _}, Robot) -> {on(Leader =:= Robot), Election};
leads({entered, Election}, _Robot) -> {off, Election};
leads(gone, _Robot) -> off;
leads(_, _Robot) -> same.

any({How, _Election}) -> How;
any(How) -> How.

coordinates({leads, _}) -> on;
coordinates({stepped_down, _}) -> off;
coordinates(gone) -> off;
coordinates(_) -> same.

%% Motions where they are known, else what it was told to do.
moving(#state{events = Events, extent = Extent} = State) ->
    case maps:get(chassis, Events, []) of
        [] ->
            Goal = spans(machine(motion, State), fun goal/1, Extent),
            starl_debug_set:union(Goal, spans(machine(motion, State), fun velocity/1, Extent));
        Motions ->
            starl_debug_set:new(driving(Motions, Extent))
    end.

goal({goal, _, _}) -> on;
goal({goal_over, _}) -> off;
goal(gone) -> off;
goal(_) -> same.

velocity({velocity, _, _}) -> on;
velocity({velocity_over, _}) -> off;
velocity(gone) -> off;
velocity(_) -> same.

driving([{_, {motion, Piece}} | Rest], {_, End} = Extent) ->
    From = starl_trajectory:start_us(Piece),
    Next = next_motion(Rest, End),
    %% an atom is larger than any number
    Until = min(
        Next, rests(starl_trajectory:is_still(Piece), From, starl_trajectory:rests_from(Piece))
    ),
    [{From, Until} | driving(Rest, Extent)];
driving([_ | Rest], Extent) ->
    driving(Rest, Extent);
driving([], _Extent) ->
    [].

next_motion([{_, {motion, Piece}} | _], _End) -> starl_trajectory:start_us(Piece) - 1;
next_motion([_ | Rest], End) -> next_motion(Rest, End);
next_motion([], End) -> End.

rests(true, From, _At) -> From - 1;
rests(false, _From, never) -> never;
rests(false, _From, At) -> At - 1.

%% It has asked for a token or a path, and has no answer.
waiting(#state{extent = Extent} = State) ->
    Asked = held_by(machine(mutex, State), fun request/1, Extent),
    Path = spans(machine(dpp, State), fun path/1, Extent),
    starl_debug_set:union([Path | maps:values(Asked)]).

request({requested, Token}) -> {on, Token};
request({acquired, Token, _}) -> {off, Token};
request({failed, Token, _}) -> {off, Token};
request(gone) -> off;
request(_) -> same.

path(asks) -> on;
path({answered, _}) -> off;
path(gone) -> off;
path(_) -> same.

holds(#state{extent = Extent} = State) -> held_by(machine(mutex, State), fun hold/1, Extent).

hold({acquired, Token, _}) -> {on, Token};
hold({released, Token, _}) -> {off, Token};
hold({lease_lost, Token, _}) -> {off, Token};
hold(gone) -> off;
hold(_) -> same.

%% @doc The names of the tokens that the robot has held.
-spec tokens(t()) -> [starl_debug_parser:name()].
tokens(State) -> maps:keys(holds(State)).

%% @doc The names of the elections that made the robot the leader.
-spec elections(t()) -> [starl_debug_parser:name()].
elections(State) -> maps:keys(led(State)).

%% @doc The messages to areas that this robot has sent. A robot must receive them if it is inside by
%% at least this margin (mm).
-spec geocasts(starl:robot_id(), t(), MarginMm :: number()) -> [cast()].
geocasts(Robot, #state{events = Events}, Margin) ->
    [
        #{id => Id, source => Robot, at => At, area => Smaller, lifetime => Lifetime}
     || {At, {sent, Id, Area, Lifetime, _}} <- maps:get(geocast, Events, []),
        Smaller <- smaller(Area, Margin)
    ].

smaller({circle, P, Mm}, Margin) -> [{circle, P, Mm - Margin}];
smaller({rectangle, {X0, Y0, X1, Y1}}, D) -> [{rectangle, {X0 + D, Y0 + D, X1 - D, Y1 - D}}];
smaller({polygon, _}, _Margin) -> [].

%% -- spans ----------------------------------------------------------------------------------

%% The events of a machine, and the moments from which on it is gone.
machine(Name, #state{events = Events}) ->
    Own = [{At, gone(E)} || {At, E} <- maps:get(Name, Events, [])],
    Gone = [{At, gone} || {At, E} <- maps:get(robot, Events, []), life(E) =:= on],
    lists:keymerge(1, Own, Gone).

gone(crashed) -> gone;
gone(Event) -> Event.

named(Name, #state{events = Events}) ->
    lists:append([E || {Machine, E} <- maps:to_list(Events), atom_to_binary(Machine) =:= Name]).

tag(Event) when is_tuple(Event), is_atom(element(1, Event)) -> atom_to_binary(element(1, Event));
tag(Event) when is_atom(Event) -> atom_to_binary(Event);
tag(_Event) -> <<>>.

on(true) -> on;
on(false) -> off.

%% From each event that turns it on to the one that turns it off.
spans(Events, Is, {_, End}) -> starl_debug_set:new(spans(Events, Is, none, End)).

spans([], _Is, none, _End) ->
    [];
spans([], _Is, Since, End) ->
    [{Since, End}];
spans([{At, Event} | Events], Is, Since, End) ->
    case {Is(Event), Since} of
        {on, none} -> spans(Events, Is, At, End);
        {off, Begun} when Begun =/= none -> [{Begun, At - 1} | spans(Events, Is, none, End)];
        _ -> spans(Events, Is, Since, End)
    end.

%% The same for each token.
held_by(Events, Is, Extent) ->
    Tokens = lists:usort([T || {_, E} <- Events, {on, T} <- [Is(E)]]),
    maps:from_list([
        {text(Token), spans(Events, fun(E) -> of_token(Token, Is(E)) end, Extent)}
     || Token <- Tokens
    ]).

of_token(Token, {How, Token}) -> How;
of_token(_Token, {_How, _Other}) -> same;
of_token(_Token, How) -> How.

text(Token) -> unicode:characters_to_binary(io_lib:format("~0tp", [Token])).
