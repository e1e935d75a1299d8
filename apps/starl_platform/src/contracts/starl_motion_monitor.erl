%% @doc The contract of motion for a robot that drives with a velocity ({@link starl:velocity/3}): it
%% stands at the end of its dead-man's time at the latest, whatever becomes of its program, unless
%% another command came before. It stands, too, when motion says that the time is over. A chassis that
%% does not hear a velocity keeps to the one before, and to its time; it has heard one if it moves
%% otherwise from that moment on.
%%
%% A command takes at most `latency_ms' to the chassis, and a chassis that brakes comes to rest a
%% little later ({@link starl_chassis:rests_s/1}); the bound is later by these two. It needs no excuse:
%% the chassis carries out the script, with its end, by itself.
%%
%% Events: of machine `motion', {@link starl_motion:event()}; of machine `chassis', `motion'. A robot
%% costs memory only while it drives with a velocity.
-module(starl_motion_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0, vocabulary/0]).

-record(state, {
    profiles :: starl_chassis:profiles(),
    driving = #{} :: #{starl:robot_id() => driving()},
    %% the earliest of these times
    due = infinity :: integer() | infinity,
    commands = 0 :: non_neg_integer()
}).

%% A robot that drives with a velocity: until when at the latest, and its piece of motion; the time
%% of its last command, and until when the robot drives if the chassis has heard it.
-type driving() :: {UntilUs :: integer(), piece(), {ToldUs :: integer(), UntilUs :: integer()}}.

-type piece() :: starl_trajectory:piece() | unknown.

-define(LATENCY_MS, 5).

%% @doc `profiles': those of the team's robots.
-spec init(#{profiles := starl_chassis:profiles()}) -> #state{}.
init(#{profiles := Profiles}) -> #state{profiles = Profiles}.

%% @doc The events of motion, and the motion of the chassis.
-spec interests() -> [atom()].
interests() -> [motion, chassis].

%% @doc {@link starl_motion:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{motion => [{velocity, 2}, {velocity_over, 1}]}.

%% @doc Judges one event, and the time until it.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, #state{due = Due} = State) when T =< Due ->
    %% integers sort before the atom infinity
    judge(Event, State);
step({T, _, _, _} = Event, State) ->
    case pass(T, State) of
        {[], Passed} -> judge(Event, Passed);
        {[First | _], Passed} -> first(First, judge(Event, Passed))
    end.

first(Violation, {ok, State}) -> {violation, Violation, State};
first(Violation, {violation, _Second, State}) -> {violation, Violation, State}.

judge({T, Robot, chassis, {motion, Piece}}, #state{driving = Driving} = State) ->
    case Driving of
        #{Robot := {_, _, {T, Until} = Told}} ->
            {ok, due(State#state{driving = Driving#{Robot := {Until, Piece, Told}}})};
        #{Robot := {Until, _, Told}} ->
            {ok, State#state{driving = Driving#{Robot := {Until, Piece, Told}}}};
        #{} ->
            {ok, State}
    end;
judge({T, Robot, motion, {velocity, _, Us}}, #state{driving = Driving, commands = N} = State) ->
    Until = T + Us + spare_us(starl_chassis:of_robot(Robot, State#state.profiles)),
    {Before, Piece, _} = maps:get(Robot, Driving, {Until, unknown, none}),
    Drives = {max(Before, Until), Piece, {T, Until}},
    {ok, due(State#state{driving = Driving#{Robot => Drives}, commands = N + 1})};
judge({T, Robot, motion, {velocity_over, Why}}, #state{driving = Driving} = State) ->
    Ended = due(State#state{driving = maps:remove(Robot, Driving)}),
    case Driving of
        #{Robot := {_, Piece, _}} when Why =:= time -> stands(T, Robot, Piece, Ended);
        #{} -> {ok, Ended}
    end;
judge(_, State) ->
    {ok, State}.

stands(T, Robot, Piece, State) ->
    case is_at_rest(T, Piece) of
        true -> {ok, State};
        false -> {violation, violation(drives_when_time_is_over, T, Robot), State}
    end.

spare_us(Profile) ->
    Latency = maps:get(latency_ms, Profile, ?LATENCY_MS),
    ceil(1000 * Latency + 1.0e6 * starl_chassis:rests_s(Profile)).

due(#state{driving = Driving} = State) ->
    State#state{due = lists:min([infinity | [Until || {Until, _, _} <- maps:values(Driving)]])}.

%% Robots whose time has passed are judged by the piece that they were in then.
pass(T, #state{driving = Driving} = State) ->
    All = [{Until, Robot, Piece} || {Robot, {Until, Piece, _}} <- maps:to_list(Driving)],
    Late = lists:sort([One || {Until, _, _} = One <- All, Until < T]),
    Found = [
        violation(drives_beyond_its_time, Until, Robot)
     || {Until, Robot, Piece} <- Late, not is_at_rest(Until, Piece)
    ],
    {Found, due(State#state{driving = maps:without([R || {_, R, _} <- Late], Driving)})}.

%% A robot whose chassis has not heard a command has no piece: it stands as it stood.
is_at_rest(_T, unknown) -> true;
is_at_rest(_T, {piece, _, _, _, _, V, W}) -> V == 0 andalso W == 0;
is_at_rest(T, Ramp) -> starl_trajectory:rests_from(Ramp) =< T.

violation(What, T, Robot) ->
    #{contract => motion, what => What, at_us => T, robots => [Robot], details => #{}}.

%% @doc Judges the time until the end. Result: the number of velocities that were given.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, #{velocities := non_neg_integer()}}.
finish(EndUs, State) ->
    Results = #{velocities => State#state.commands},
    case pass(EndUs, State) of
        {[], _} -> {ok, Results};
        {Found, _} -> {{violation, Found}, Results}
    end.
