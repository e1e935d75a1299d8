%% @doc The behaviour of a motion controller. After each check of the floor, before the next
%% command, it decides whether the robot waits and with what velocity it drives. The paper leaves
%% the controller open, as long as the robot keeps to its line. So it is here: {@link starl_motion}
%% and the chassis keep control of lines, legs, their ends, and drives that do not obey. So the
%% contract of motion holds under every controller.
%% ```
%%   -module(slow_in_company).
%%   -behaviour(starl_controller).
%%   -export([sees_mm/1, waits_us/1, leg/2, velocity/3]).
%%   sees_mm(_Profile) -> 800.
%%   waits_us(_Profile) -> 0.
%%   leg(_To, _Situation) -> go.
%%   velocity(V, _Us, #{near := []}) -> V;
%%   velocity({VX, VY}, _Us, _Situation) -> {VX / 3, VY / 3}.
%% '''
%% A run selects it by name: `--controller wary', or `--controller slow_in_company.erl'. A
%% controller is a pure function.
-module(starl_controller).

-export([option/0, named/1]).
-export([look/2, leg/4, velocity/4, waits_us/1]).

-export_type([situation/0, near/0]).

%% What the robot knows, from its last check of the floor.
-type situation() :: #{
    pose := starl:pose(),
    near := [near()],
    waited_us := non_neg_integer(),
    profile := starl_chassis:profile()
}.
%% `near': the robots within sight, nearest first. `waited_us': how long it has waited on the way to its goal.

-type near() :: #{
    robot := starl:robot_id(), offset := starl_geometry:point(), distance := float()
}.
%% `offset' and `distance' (mm) are those of the middles.

%% The distance up to which the robot looks for others, mm; `none': it does not look.
-callback sees_mm(starl_chassis:profile()) -> number() | none.
%% The longest time that it may wait on the way to one goal. The contract allows it that much more
%% time to arrive.
-callback waits_us(starl_chassis:profile()) -> non_neg_integer().
%% The robot stands, and is about to drive a leg along its line towards this point: does it go, or wait, and look again?
-callback leg(To :: starl_geometry:point(), situation()) -> go | {wait, Us :: pos_integer()}.
%% The velocity with which the robot drives for this time instead of the given velocity (mm/s). It
%% is limited to what the robot can do.
-callback velocity(starl_chassis:velocity(), Us :: pos_integer(), situation()) ->
    {number(), number()}.

%% The shortest time of a wait: each costs a look besides.
-define(LEAST_WAIT_US, 250000).

known() -> [{straight, none}, {wary, starl_controller_wary}].

%% The names of the controllers that ship.
-spec names() -> [atom()].
names() -> [Name || {Name, _} <- known()].

%% @doc The scenario's option.
-spec option() -> starl_options:option().
option() ->
    {controller, file, "straight",
        "what drives robots between looks: straight (heeds nobody), wary (waits for and evades robots in "
        "sight), or a file of yours, FILE.erl"}.

%% @doc Returns the controller that a text names: one that ships (`none' for the usual one), or the
%% file of a module that has been compiled from it. If there is none, returns one line.
-spec named(string()) -> {ok, module() | none} | {error, unicode:chardata()}.
named(Text) ->
    Texts = [atom_to_list(Name) || Name <- names()],
    case {lists:member(Text, Texts), filename:extension(Text)} of
        {true, _} ->
            {_, Module} = lists:keyfind(list_to_existing_atom(Text), 1, known()),
            {ok, Module};
        {false, ".erl"} ->
            of_file(Text);
        {false, _} ->
            {error, unknown(Text, Texts)}
    end.

of_file(File) ->
    Missing = [
        io_lib:format("~ts/~b", [F, A])
     || {F, A} <- [{sees_mm, 1}, {waits_us, 1}, {leg, 2}, {velocity, 3}],
        not starl_code:exports(filename:basename(File, ".erl"), F, A)
    ],
    case Missing of
        [] ->
            {ok, list_to_existing_atom(filename:basename(File, ".erl"))};
        [First | _] ->
            {error, [File, " is no controller: it exports no ", First, " (starl_controller)"]}
    end.

unknown(Text, Texts) ->
    All = ["; there are ", lists:join(", ", Texts), ", and files of yours (FILE.erl)"],
    ["there is no controller ", Text, starl_similar:meant(starl_similar:words(Text, Texts), All)].

%% -- for motion -----------------------------------------------------------------------------

%% @doc What motion asks of the location service: the robot's own pose, or all that are near.
-spec look(starl:robot_id(), starl_chassis:profile()) ->
    {pose, starl:robot_id()} | {near, number()}.
look(Self, #{controller := Module} = Profile) ->
    case Module:sees_mm(Profile) of
        none -> {pose, Self};
        Mm -> {near, Mm}
    end;
look(Self, _Profile) ->
    {pose, Self}.

%% @doc Does the robot go, or wait?
-spec leg(Poses, To, {starl:robot_id(), WaitedUs}, starl_chassis:profile()) ->
    go | {wait, pos_integer()}
when
    Poses :: #{starl:robot_id() => starl:pose()},
    To :: starl_geometry:point(),
    WaitedUs :: non_neg_integer().
leg(Poses, To, {Self, Waited}, #{controller := Module} = Profile) when is_map_key(Self, Poses) ->
    Left = Module:waits_us(Profile) - Waited,
    case Left >= ?LEAST_WAIT_US andalso Module:leg(To, situation(Poses, Self, Waited, Profile)) of
        {wait, Us} -> {wait, max(?LEAST_WAIT_US, min(Us, Left))};
        _Go -> go
    end;
leg(_Poses, _To, _Who, _Profile) ->
    go.

%% @doc The velocity with which the robot really drives, within its limits.
-spec velocity(Wish, Us, {starl:robot_id(), Poses}, starl_chassis:profile()) ->
    starl_chassis:velocity()
when
    Wish :: {number(), number()},
    Us :: pos_integer(),
    Poses :: #{starl:robot_id() => starl:pose()}.
velocity(Wish, Us, {Self, Poses}, #{controller := Module} = Profile) when
    is_map_key(Self, Poses)
->
    Within = starl_chassis:limited(Wish, Profile),
    Evading = Module:velocity(Within, Us, situation(Poses, Self, 0, Profile)),
    starl_chassis:limited(Evading, Profile);
velocity(Wish, _Us, _Who, Profile) ->
    starl_chassis:limited(Wish, Profile).

%% @doc The time that waiting may cost a robot on the way to a goal, including the checks in
%% between.
-spec waits_us(starl_chassis:profile()) -> non_neg_integer().
waits_us(#{controller := Module} = Profile) -> twice(Module:waits_us(Profile));
waits_us(_Profile) -> 0.

twice(Us) when is_integer(Us), Us >= 0 -> 2 * Us.

situation(Poses, Self, Waited, Profile) ->
    #{Self := {X, Y, _} = Pose} = Poses,
    Others = [
        #{robot => Robot, offset => {OX - X, OY - Y}, distance => distance({OX - X, OY - Y})}
     || {Robot, {OX, OY, _}} <- lists:sort(maps:to_list(maps:remove(Self, Poses)))
    ],
    Near = lists:sort([
        {Mm, Robot, One}
     || #{distance := Mm, robot := Robot} = One <- Others, in_sight(Mm, Profile)
    ]),
    #{
        pose => Pose,
        near => [One || {_, _, One} <- Near],
        waited_us => Waited,
        profile => Profile
    }.

in_sight(Mm, #{controller := Module} = Profile) -> Mm =< Module:sees_mm(Profile).

distance({X, Y}) -> math:sqrt(X * X + Y * Y).
