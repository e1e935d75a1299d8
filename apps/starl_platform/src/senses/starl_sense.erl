%% @doc The behaviour of a sense. A sense measures one thing in the robot's surroundings, such as a
%% bumper or a camera, besides the places of robots.
%% ```
%%   {ok, Blobs} = starl:sense(Robot, camera),
%%   [{Colour, Bearing, Mm} || #{colour := Colour, bearing := Bearing, mm := Mm} <- Blobs]
%% '''
%% A sense is a pure function from a {@link view()} to a reading, with the errors of a real sensor.
%% Bearings are radians from straight ahead, positive to the left; lengths are millimetres.
%% `is_reading/2' decides which terms can be readings of the sense, whatever its errors.
-module(starl_sense).

-export([
    kinds/0,
    is_kind/1,
    profiles/1,
    read/3,
    noisy/3,
    blurred/4,
    guess/3,
    is_reading/3,
    normal/2,
    bearing/2
]).

-export_type([kind/0, profile/0, profiles/0, view/0, thing/0, draw/0]).

-type kind() :: bump | range | bearing | camera | light | battery.

%% The measures and errors of a sense; all are numbers.
-type profile() :: #{atom() => number()}.
-type profiles() :: #{kind() => profile()}.

%% A thing on the floor that bodies pass through: a ball for a camera, with a colour; a lamp, whose
%% light falls to a third within `lamp_mm'.
-type thing() :: #{
    at := starl_geometry:point(),
    radius_mm => number(),
    colour => atom(),
    lamp_mm => number()
}.

%% A random number in `0.0 =< X < 1.0' for a purpose, always the same one.
-type draw() :: fun((Purpose :: term()) -> float()).

%% What is around a robot. `bodies': the other robots. `driven_mm': how far it has driven.
-type view() :: #{
    pose := starl:pose(),
    radius_mm := float(),
    now_us := integer(),
    driven_mm := float(),
    walls := starl_walls:t(),
    bodies := [{starl:robot_id(), starl_geometry:point(), RadiusMm :: float()}],
    things := [thing()],
    draw := draw()
}.

%% What it measures, and its usual errors.
-callback profile() -> profile().
%% The keys of the profile that are errors: noise multiplies them.
-callback errors() -> [atom()].
-callback read(view(), profile()) -> Reading :: term().
%% A reading with further errors, those of the profile.
-callback blurred(Reading :: term(), draw(), profile()) -> Reading :: term().
%% A reading that has nothing to do with the world: of a sense that is wrong.
-callback guess(draw(), profile()) -> Reading :: term().
%% May the sense say this?
-callback is_reading(term(), profile()) -> boolean().

-define(LEAST_PART, 0.005).

%% @doc All senses.
-spec kinds() -> [{kind(), module()}].
kinds() ->
    [
        {bump, starl_sense_bump},
        {range, starl_sense_range},
        {bearing, starl_sense_bearing},
        {camera, starl_sense_camera},
        {light, starl_sense_light},
        {battery, starl_sense_battery}
    ].

%% @doc Is this a sense?
-spec is_kind(term()) -> boolean().
is_kind(Kind) -> lists:keymember(Kind, 1, kinds()).

%% @doc The profiles of all senses; those of the scene replace the usual values.
-spec profiles(#{kind() => profile()}) -> {ok, profiles()} | {error, unicode:chardata()}.
profiles(Own) when is_map(Own) ->
    Usual = maps:from_list([{Kind, Module:profile()} || {Kind, Module} <- kinds()]),
    case lists:append([problems(One, Usual) || One <- lists:sort(maps:to_list(Own))]) of
        [] -> {ok, maps:map(fun(Kind, P) -> maps:merge(P, maps:get(Kind, Own, #{})) end, Usual)};
        [Problem | _] -> {error, Problem}
    end;
profiles(_Other) ->
    {error, "a map from senses to their values, as in #{camera => #{field => 2.0}}"}.

problems({Kind, Values}, Usual) when is_map(Values) ->
    case Usual of
        #{Kind := Profile} ->
            [
                io_lib:format("the sense ~tp has no ~tp; it has ~0tp", [
                    Kind, Key, lists:sort(maps:keys(Profile))
                ])
             || Key <- lists:sort(maps:keys(Values)), not is_map_key(Key, Profile)
            ] ++
                [
                    io_lib:format("the sense ~tp: ~tp is a number from 0", [Kind, Key])
                 || {Key, Value} <- lists:sort(maps:to_list(Values)),
                    not (is_number(Value) andalso Value >= 0)
                ];
        #{} ->
            [io_lib:format("there is no sense ~tp", [Kind])]
    end;
problems({Kind, _Values}, _Usual) ->
    [io_lib:format("the sense ~tp: a map of numbers expected", [Kind])].

%% @doc A reading.
-spec read(kind(), view(), profiles()) -> term().
read(Kind, View, Profiles) -> (module(Kind)):read(View, maps:get(Kind, Profiles)).

%% @doc The profiles with the errors of one sense multiplied by a factor; fractions stay below 1.
-spec noisy(kind(), Times :: number(), profiles()) -> profiles().
noisy(Kind, Times, Profiles) ->
    #{Kind := Profile} = Profiles,
    Errors = maps:with((module(Kind)):errors(), Profile),
    Larger = maps:map(fun(Key, Value) -> larger(Key, Value, Times) end, Errors),
    Profiles#{Kind := maps:merge(Profile, Larger)}.

%% Parts are missed and invented. What does not err otherwise, as a switch, errs as well.
larger(Key, Part, Times) when Key =:= missed; Key =:= invented ->
    min(0.9, max(Part, ?LEAST_PART) * Times);
larger(_Key, Error, Times) ->
    Error * Times.

%% @doc A reading with further errors, those of the profile of its sense.
-spec blurred(kind(), Reading :: term(), draw(), profiles()) -> term().
blurred(Kind, Reading, Draw, Profiles) ->
    (module(Kind)):blurred(Reading, Draw, maps:get(Kind, Profiles)).

%% @doc A wrong reading of a sense.
-spec guess(kind(), draw(), profiles()) -> term().
guess(Kind, Draw, Profiles) -> (module(Kind)):guess(Draw, maps:get(Kind, Profiles)).

%% @doc Checks whether this term can be a reading of the sense.
-spec is_reading(kind(), term(), profiles()) -> boolean().
is_reading(Kind, Reading, Profiles) ->
    (module(Kind)):is_reading(Reading, maps:get(Kind, Profiles)).

module(Kind) ->
    {Kind, Module} = lists:keyfind(Kind, 1, kinds()),
    Module.

%% @doc A draw from the normal distribution, at most four times its standard deviation.
-spec normal(Purpose :: term(), draw()) -> float().
normal(Purpose, Draw) ->
    U = max(1.0e-9, Draw({Purpose, size})),
    Size = min(4.0, math:sqrt(-2.0 * math:log(U))),
    Size * math:cos(2.0 * math:pi() * Draw({Purpose, angle})).

%% @doc The bearing of a point for a robot at a pose.
-spec bearing(starl_geometry:point(), starl:pose()) -> float().
bearing(Point, {X, Y, Heading}) ->
    starl_geometry:angle_diff(starl_geometry:heading({X, Y}, Point), Heading).
