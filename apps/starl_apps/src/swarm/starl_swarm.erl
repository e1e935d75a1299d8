%% @doc A swarm that sends messages to areas (the paper's section III-A). Robots with a short radio
%% range move about. From time to time a robot sends a message to all robots inside a circle
%% somewhere on the floor. The message reaches them over several hops, and no other robot receives
%% it. The contracts of geocast and of the swarm ({@link starl_swarm_monitor}) judge every run.
%%
%% A circle shows the area of each robot's last message, a dot the place where a message was
%% received. Measure: `heard', how many messages a robot has received.
-module(starl_swarm).
-behaviour(starl_app).

-export([init/2, step/2]).
-export([options/0, blocks/0, monitors/1, guarantees/0, measures/0, report/2, knows_walls/0]).

%% Times by the robot's own clock (ms).
-type state() :: #{
    until := integer(),
    send_at := integer(),
    every := number(),
    goal := starl_geometry:point(),
    size := {number(), number()},
    heard := non_neg_integer()
}.

-define(PACE_MS, 500).
-define(LIFETIME_MS, 5000).
%% How long areas and dots are shown (s).
-define(SHOWN_S, 15).
-define(SPEED, 150).
-define(SHY_MM, 700).
-define(NEAR_MM, 300).
%% The radius of an area: mean, standard deviation and least value (mm).
-define(RADIUS_MM, {2000, 500, 800.0}).

-spec options() -> [starl_options:option()].
options() ->
    [
        {every, {number, 1, 3600}, 15, "the mean time between two messages of a robot, s"},
        {duration, {integer, 1, 86400}, 60, "how long they move about, s"}
    ].

-spec blocks() -> [starl_block:entry()].
blocks() -> [{starl_geocast, #{listeners => #{note => app}, all_listen => true}}].

-spec monitors(starl_scene:context()) -> [{module(), map()}].
monitors(#{profiles := Profiles} = Context) ->
    Speed = lists:max([Speed || #{speed := Speed} <- Profiles]),
    [{starl_swarm_monitor, #{range_mm => maps:get(range, Context, none), speed => Speed}}].

-spec measures() -> [{atom(), string()}].
measures() -> [{heard, "messages that a robot has heard"}].

%% @doc Robots drive as if the floor were free.
-spec knows_walls() -> false.
knows_walls() -> false.

%% @doc The guarantees on who receives a message.
-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {nobody_else, safety, "who is outside of an area hears nothing that is sent to it", [
            {geocast, inside}
        ]},
        {heard, progress,
            "who is inside, and linked to the sender by robots in reach of each other, hears it", [
                no_loss, quick, {geocast, delivered}
            ]}
    ].

-spec init(starl:robot(), map()) -> state().
init(Robot, #{duration := Seconds, every := Every}) ->
    Now = starl:now(Robot),
    Size = size_of(Robot),
    #{
        until => Now + 1000 * Seconds,
        send_at => Now + pause(Robot, Every),
        every => Every,
        goal => anywhere(Robot, Size),
        size => Size,
        heard => 0
    }.

size_of(Robot) ->
    case starl:floor(Robot) of
        {ok, #{size := Size}} -> Size;
        {error, _} -> size_of(Robot)
    end.

%% From half to one and a half of the mean.
pause(Robot, Every) -> round(1000 * Every * (0.5 + starl:random(Robot))).

anywhere(Robot, {W, H}) ->
    {W * (0.1 + 0.8 * starl:random(Robot)), H * (0.1 + 0.8 * starl:random(Robot))}.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, Heard :: non_neg_integer()}.
step(Robot, #{until := Until, heard := Heard} = State) ->
    Now = starl:now(Robot),
    case Now >= Until of
        true ->
            _ = starl:stop(Robot),
            {done, Heard};
        false ->
            Sent = send(Now, Robot, State),
            {continue, listen(Robot, Now + ?PACE_MS, move(starl:position(Robot), Robot, Sent))}
    end.

%% A message that would outlive the run is not sent.
send(Now, Robot, #{send_at := At, until := Until, every := Every, size := Size} = State) when
    Now >= At, Now + ?LIFETIME_MS < Until
->
    {Mean, Deviation, Least} = ?RADIUS_MM,
    Centre = anywhere(Robot, Size),
    Radius = max(Least, starl:normal(Robot, Mean, Deviation)),
    Options = #{lifetime_ms => ?LIFETIME_MS},
    case starl_geocast:send(Robot, {circle, Centre, Radius}, note, Now, Options) of
        ok ->
            Area = starl_drawing:circle(Centre, Radius),
            ok = starl:draw(Robot, #{key => area, area => Area, seconds => ?SHOWN_S});
        {error, _} ->
            ok
    end,
    State#{send_at := Now + pause(Robot, Every)};
send(_Now, _Robot, State) ->
    State.

move({ok, {X, Y, _}}, Robot, #{goal := Goal, size := Size} = State) ->
    Next =
        case starl_geometry:distance({X, Y}, Goal) < ?NEAR_MM of
            true -> anywhere(Robot, Size);
            false -> Goal
        end,
    Options = #{speed => ?SPEED, shy_mm => ?SHY_MM, ms => 2 * ?PACE_MS},
    _ = starl_avoidance:drive(Robot, Next, Options),
    State#{goal := Next};
move({error, _}, _Robot, State) ->
    State.

listen(Robot, Until, #{heard := Heard} = State) ->
    case Until - starl:now(Robot) of
        Ms when Ms > 0 ->
            case starl:await(Robot, note, Ms) of
                {ok, From, _} ->
                    ok = starl:measure(Robot, heard, Heard + 1),
                    ok = mark(starl:position(Robot), Robot, From),
                    listen(Robot, Until, State#{heard := Heard + 1});
                timeout ->
                    State
            end;
        _ ->
            State
    end.

mark({ok, {X, Y, _}}, Robot, From) ->
    starl:draw(Robot, #{key => {heard, From}, points => [{X, Y}], seconds => ?SHOWN_S});
mark({error, _}, _Robot, _From) ->
    ok.

%% @doc What the monitor of geocast has counted: messages, deliveries, and how long these took.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(_Scene, #{monitors := #{starl_geocast_monitor := Results, starl_swarm_monitor := Own}}) ->
    #{sent := Sent, delivered := Delivered} = Results,
    #{owed := Owed} = Own,
    #{
        figures => [{sent, Sent}, {delivered, Delivered}, {owed, Owed}],
        formats => #{delivered => #{label => "deliveries", plotted => true}},
        done => io_lib:format("~b messages to areas, heard ~b times (~b had to be)", [
            Sent, Delivered, Owed
        ])
    }.
