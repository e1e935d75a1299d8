%% @doc Checks a scene that an application has made: its keys and their values.
-module(starl_scene_check).

-export([check/1, monitors/1, no_answer/1]).

%% @doc Is this a scene? Otherwise one line on the first problem.
-spec check(term()) -> ok | {error, unicode:chardata()}.
check(#{app := _} = Scene) ->
    case [Key || Key <- lists:sort(maps:keys(Scene)), not lists:member(Key, keys())] of
        [] -> values([{Key, maps:get(Key, Scene)} || Key <- keys(), is_checked(Key, Scene)]);
        [Key | _] -> unknown("the scene", Key, keys())
    end;
check(Scene) when is_map(Scene) ->
    {error, "the scene lacks the key app, as in app => {sequential, my_app, Args}"};
check(Other) ->
    {error, no_answer({ok, Other})}.

%% Another implementation of SAP has a configuration of its own.
is_checked(sap, #{sap_machine := _}) -> false;
is_checked(Key, Scene) -> is_map_key(Key, Scene).

%% @doc One line on an answer that is none.
-spec no_answer(term()) -> unicode:chardata().
no_answer(Other) ->
    io_lib:format("{ok, #{app => ...}} or {error, \"Why\"} expected, not ~0tP", [Other, 12]).

keys() ->
    [app, blocks, waypoints, floor, poses, apart_mm, things, senses, monitors, profile, sap] ++
        [never_crashes, never_bumps, notes, sap_machine, motion_machine, memo].

values([]) ->
    ok;
values([{Key, Value} | Values]) ->
    case value(Key, Value) of
        true ->
            values(Values);
        {error, _} = Error ->
            Error;
        Expected ->
            {error, io_lib:format("~tp: ~ts expected, not ~0tP", [Key, Expected, Value, 12])}
    end.

value(app, {sequential, App, _Args}) when is_atom(App) -> callbacks(App, [{init, 2}, {step, 2}]);
value(app, {machine, App, Config}) when is_atom(App), is_map(Config) ->
    callbacks(App, [{init, 1}, {handle_event, 5}]);
value(app, _) ->
    "{sequential, Module, Args} or {machine, Module, Config}";
value(waypoints, Points) ->
    is_map_of(fun is_atom/1, fun is_point/1, Points, "#{Name => {X, Y}}");
value(poses, Poses) ->
    is_map_of(fun is_robot/1, fun is_pose/1, Poses, "#{Robot => {X, Y, Heading}}");
value(apart_mm, Mm) ->
    (is_number(Mm) andalso Mm >= 0) orelse "a distance in mm";
value(monitors, Monitors) ->
    monitors(Monitors);
value(profile, Profile) ->
    known("the profile", Profile, profile_keys());
value(sap, Sap) ->
    known("sap", Sap, sap_keys());
value(Key, Is) when Key =:= never_crashes; Key =:= never_bumps ->
    is_boolean(Is) orelse "true or false";
value(notes, Notes) ->
    is_list(Notes) orelse "a list of lines";
value(floor, Floor) ->
    starl_floor:is_floor(Floor) orelse
        "a floor plan, of starl_floor_file:read/1 or starl_floor:new/1";
value(things, Things) ->
    is_list(Things) andalso lists:all(fun is_thing/1, Things) orelse
        "a list of #{at => {X, Y}, colour => Colour}, with radius_mm and lamp_mm, mm";
value(senses, Senses) ->
    case starl_sense:profiles(Senses) of
        {ok, _} -> true;
        {error, Why} -> {error, ["senses: ", Why]}
    end;
value(Machine, Module) when Machine =:= sap_machine; Machine =:= motion_machine ->
    is_atom(Module) orelse "a module";
value(_Key, _Value) ->
    true.

callbacks(Module, Wanted) ->
    case {code:ensure_loaded(Module), missing(Module, Wanted)} of
        {{error, _}, _} ->
            {error, io_lib:format("app: there is no module ~tp", [Module])};
        {_, []} ->
            true;
        {_, [{Function, Arity} | _]} ->
            {error, io_lib:format("app: ~tp does not export ~tp/~b", [Module, Function, Arity])}
    end.

missing(Module, Wanted) -> [{F, A} || {F, A} <- Wanted, not erlang:function_exported(Module, F, A)].

is_map_of(IsKey, IsValue, Map, Expected) ->
    Is = fun({Key, Value}) -> IsKey(Key) andalso IsValue(Value) end,
    (is_map(Map) andalso lists:all(Is, maps:to_list(Map))) orelse Expected.

is_point({X, Y}) -> is_number(X) andalso is_number(Y);
is_point(_) -> false.

is_thing(#{at := At} = Thing) ->
    is_point(At) andalso is_atom(maps:get(colour, Thing, none)) andalso
        lists:all(
            fun(Mm) -> is_number(Mm) andalso Mm > 0 end,
            maps:values(maps:with([radius_mm, lamp_mm], Thing))
        );
is_thing(_) ->
    false.

is_pose({X, Y, Heading}) -> is_point({X, Y}) andalso is_number(Heading);
is_pose(_) -> false.

is_robot(Id) -> is_integer(Id) andalso Id > 0.

%% @doc Is this a list of monitors? What they export is another matter ({@link starl_monitor_check}).
-spec monitors(term()) -> true | (Expected :: string()).
monitors([{Module, Config} | Monitors]) when is_atom(Module), is_map(Config) -> monitors(Monitors);
monitors([]) -> true;
monitors(_) -> "a list of {Module, #{...}}".

known(What, Map, Keys) when is_map(Map) ->
    case [Key || Key <- lists:sort(maps:keys(Map)), not lists:member(Key, Keys)] of
        [] -> true;
        [Key | _] -> unknown(What, Key, Keys)
    end;
known(_What, _Other, Keys) ->
    io_lib:format("a map with keys of ~0tp", [Keys]).

unknown(What, Key, Keys) ->
    Meant =
        case starl_options:suggestion(Key, Keys) of
            [Near | _] -> io_lib:format("did you mean ~tp?", [Near]);
            [] -> ["keys: ", lists:join(", ", [atom_to_list(K) || K <- Keys])]
        end,
    {error, io_lib:format("~ts has no key ~tp (~ts)", [What, Key, Meant])}.

%% The keys of every chassis.
profile_keys() ->
    Chassis = [starl_chassis_differential, starl_chassis_holonomic],
    Keys = lists:append([maps:keys(Module:profile(#{})) || Module <- Chassis]),
    lists:usort([chassis, latency_ms, radius_mm | Keys]).

sap_keys() -> [retransmit_ms, backoff, longest_ms, limit, window, unclaimed].
