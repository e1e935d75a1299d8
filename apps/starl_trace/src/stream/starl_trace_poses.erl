%% @doc Computes the poses of a run's robots from the motion segments in its trace. It samples the
%% robots that have changed 20 times a second, and all robots once a second. Motion is known in
%% closed form, so each sample is exact. A pure module.
-module(starl_trace_poses).

-export([new/0, new/1, event/2, due_us/1, sample/2, full/2, restore/2]).

-export_type([t/0, places/0]).

-define(PERIOD_US, 50000).
-define(FULL_US, 1000000).

-record(poses, {
    %% pieces of each robot, the latest first, as far as they are needed
    pieces = #{} :: #{starl:robot_id() => [starl_trajectory:piece(), ...]},
    pens = #{} :: #{starl:robot_id() => up | down},
    period_us = ?PERIOD_US :: pos_integer(),
    next = 0 :: integer(),
    shown = #{} :: #{starl:robot_id() => starl_trace_message:pose()}
}).

-opaque t() :: #poses{}.

%% The motions of the robots at a time, from which follows where they are later: the last two pieces
%% of each, the latest first, since that may not have begun; and the pen.
-type places() :: [{starl:robot_id(), [starl_trajectory:piece(), ...], up | down | none}].

%% @doc No robot is known.
-spec new() -> t().
new() -> #poses{}.

%% @doc The same, with samples in another period, which divides a second.
-spec new(PeriodUs :: pos_integer()) -> t().
new(Period) -> #poses{period_us = Period}.

%% @doc Takes a trace event into account.
-spec event(starl_monitor:trace_event(), t()) -> t().
event({At, Robot, chassis, {motion, Piece}}, #poses{pieces = Pieces} = Poses) ->
    T0 = starl_trajectory:start_us(Piece),
    Known = maps:get(Robot, Pieces, []),
    Before = lists:dropwhile(fun(P) -> starl_trajectory:start_us(P) >= T0 end, Known),
    soon(At, Poses#poses{pieces = Pieces#{Robot => [Piece | Before]}});
event({At, Robot, chassis, {actuated, pen, Pen}}, #poses{pens = Pens} = Poses) when
    Pen =:= up; Pen =:= down
->
    soon(At, Poses#poses{pens = Pens#{Robot => Pen}});
event(_, Poses) ->
    Poses.

%% The next sample is not later than the next regular time.
soon(At, #poses{next = Next, period_us = Period} = Poses) ->
    Poses#poses{next = min(Next, up(At, Period))}.

%% @doc The time of the next sample: events up to it come first.
-spec due_us(t()) -> integer().
due_us(#poses{next = Next}) -> Next.

%% @doc The samples before a time.
-spec sample(Until :: integer(), t()) -> {[starl_trace_message:t()], t()}.
sample(Until, #poses{next = Next, pieces = Pieces, period_us = Period} = Poses) when
    Next < Until, map_size(Pieces) =:= 0
->
    %% a robot that records itself knows no motions, and its time may be that since 1970
    {[], Poses#poses{next = up(Until, Period)}};
sample(Until, #poses{next = Next} = Poses) when Next < Until ->
    {Message, Sampled} = at(Next, Poses),
    {Later, Last} = sample(Until, skip(Sampled)),
    {Message ++ Later, Last};
sample(_Until, Poses) ->
    {[], Poses}.

%% @doc Where all robots are at a time.
-spec full(At :: integer(), t()) -> starl_trace_message:t().
full(At, Poses) -> {poses, At, #{full => true, robots => poses(At, Poses)}}.

%% @doc What was known at a time from these motions.
-spec restore(At :: integer(), places()) -> t().
restore(At, Places) ->
    #poses{
        pieces = maps:from_list([{Id, Pieces} || {Id, Pieces, _} <- Places]),
        pens = maps:from_list([{Id, Pen} || {Id, _, Pen} <- Places, Pen =/= none]),
        %% what was shown last is not shown again
        next = At div ?PERIOD_US * ?PERIOD_US
    }.

at(At, #poses{next = Next, period_us = Period} = Poses0) ->
    Poses = forget(At, Poses0#poses{next = Next + Period}),
    Now = poses(At, Poses),
    Changed = [P || {Id, _, _, _} = P <- Now, not is_shown(Id, P, Poses)],
    Shown = maps:from_list([{Id, P} || {Id, _, _, _} = P <- Now]),
    Told =
        case At rem ?FULL_US of
            0 when Now =/= [] -> [{poses, At, #{full => true, robots => Now}}];
            _ when Changed =/= [] -> [{poses, At, #{full => false, robots => Changed}}];
            _ -> []
        end,
    {Told, Poses#poses{shown = Shown}}.

is_shown(Id, Pose, #poses{shown = Shown}) ->
    case Shown of
        #{Id := Pose} -> true;
        #{} -> false
    end.

%% Nothing changes before the next event once all robots stood still in the last sample.
skip(#poses{next = Next, period_us = Period, pieces = Pieces} = Poses) ->
    case lists:all(fun([P | _]) -> is_at_rest(Next - Period, P) end, maps:values(Pieces)) of
        true -> Poses#poses{next = up(Next, ?FULL_US)};
        false -> Poses
    end.

up(At, Period) -> (At + Period - 1) div Period * Period.

is_at_rest(At, {piece, T0, _, _, _, V, W}) -> T0 =< At andalso V == 0 andalso W == 0;
is_at_rest(At, Ramp) -> starl_trajectory:rests_from(Ramp) =< At.

poses(At, #poses{pieces = Pieces, pens = Pens}) ->
    [
        {Id, Pose, maps:get(Id, Pens, none), Pose}
     || {Id, Known} <- lists:sort(maps:to_list(Pieces)),
        Pose <- [starl_trajectory:pose(At, current(At, Known))]
    ].

%% The latest piece that has begun.
current(_At, [Piece]) ->
    Piece;
current(At, [Piece | Earlier]) ->
    case starl_trajectory:start_us(Piece) =< At of
        true -> Piece;
        false -> current(At, Earlier)
    end.

forget(At, #poses{pieces = Pieces} = Poses) ->
    Poses#poses{pieces = maps:map(fun(_, Known) -> needed(At, Known) end, Pieces)}.

needed(_At, [_] = Known) ->
    Known;
needed(At, [Piece | Earlier]) ->
    case starl_trajectory:start_us(Piece) =< At of
        true -> [Piece];
        false -> [Piece | needed(At, Earlier)]
    end.
