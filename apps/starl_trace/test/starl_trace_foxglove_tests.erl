%% What applications measure and draw, as viewers get it.
-module(starl_trace_foxglove_tests).
-include_lib("eunit/include/eunit.hrl").

updates(Event) ->
    Message = {trace, 7000000, {2, app, Event}},
    {Updates, _} = starl_trace_foxglove:message(Message, starl_trace_foxglove:new(1)),
    [
        {Channel, jsx:decode(iolist_to_binary(starl_json:encode(Json, 6)), [return_maps])}
     || {Channel, 7000000, Json} <- Updates
    ].

%% Once by field for viewers that choose by it, once by path for those that plot all.
measures_are_written_by_field_and_by_path_test() ->
    [{measures, Json}] = updates({measure, error_mm, 1.5e-9}),
    ?assertEqual(
        #{
            <<"robot">> => 2,
            <<"key">> => <<"error_mm">>,
            <<"value">> => 1.5e-9,
            <<"series">> => #{<<"error_mm">> => #{<<"robot_2">> => 1.5e-9}}
        },
        Json
    ),
    ?assertMatch([{measures, #{<<"value">> := 7}}], updates({measure, n, 7})).

%% An event of a user's own of that name is shown as any other.
other_events_test() ->
    ?assertMatch([{trace, #{<<"event">> := <<"measure">>}}], updates({measure, n, much})),
    ?assertMatch([{trace, #{<<"event">> := <<"draw">>}}], updates({draw, nothing})).

entity(Shape) ->
    {ok, Drawing} = starl_drawing:new(Shape),
    [{drawings, #{<<"deletions">> := [], <<"entities">> := [Entity]}}] = updates({draw, Drawing}),
    #{<<"frame_id">> := <<"floor">>} = Entity,
    Entity.

drawings_are_entities_with_a_lifetime_test() ->
    ?assertMatch(
        #{
            <<"id">> := <<"drawing 2 way">>,
            <<"lifetime">> := #{<<"sec">> := 1, <<"nsec">> := 500000000},
            <<"lines">> := [
                #{<<"type">> := 0, <<"points">> := [#{<<"x">> := 1.0}, #{<<"x">> := 2.5}]}
            ]
        },
        entity(#{key => way, line => [{1000, 0}, {2500, 0}], seconds => 1.5})
    ),
    ?assertMatch(
        #{
            <<"id">> := <<"drawing 2 dot 3">>,
            <<"spheres">> := [_, _],
            <<"lifetime">> := #{<<"sec">> := 0}
        },
        entity(#{key => {dot, 3}, points => [{0, 0}, {1, 1}]})
    ),
    ?assertMatch(
        #{<<"texts">> := [#{<<"text">> := <<"a \"b\"">>, <<"color">> := #{<<"r">> := R}}]} when
            R > 0.8,
        entity(#{key => said, text => "a \"b\"", at => {0, 0}, colour => red})
    ).

%% A convex area is filled; of another one the outline is shown.
convex_areas_are_filled_test() ->
    Filled = fun(Points) ->
        length(maps:get(<<"triangles">>, entity(#{key => a, area => Points})))
    end,
    ?assertEqual(1, Filled([{0, 0}, {4, 0}, {4, 4}, {0, 4}])),
    ?assertEqual(1, Filled([{0, 4}, {4, 4}, {4, 0}, {0, 0}])),
    ?assertEqual(0, Filled([{0, 0}, {4, 0}, {1, 1}, {0, 4}])),
    ?assertEqual(0, Filled([{0, 0}])),
    %% also of less than a millimetre, and either way round
    Small = [{0, 0}, {0.5, 0}, {0.5, 0.5}, {0, 0.5}],
    Hollow = [{0, 0}, {0.9, 0}, {0.3, 0.3}, {0, 0.9}],
    [?assertEqual(1, Filled(Area)) || Area <- [Small, lists:reverse(Small)]],
    [?assertEqual(0, Filled(Area)) || Area <- [Hollow, lists:reverse(Hollow)]],
    ?assertEqual(1, Filled(starl_drawing:circle({0, 0}, 100))),
    %% whichever corner comes first
    Turned = fun(Points) ->
        [lists:nthtail(N, Points) ++ lists:sublist(Points, N) || N <- lists:seq(0, 3)]
    end,
    [?assertEqual(0, Filled(Area)) || Area <- Turned(Hollow)],
    [?assertEqual(1, Filled(Area)) || Area <- Turned(Small)],
    %% a corner may lie on a side
    OnASide = [{0, 0}, {2, 0}, {4, 0}, {4, 4}, {0, 4}],
    [?assertEqual(1, Filled(Area)) || Area <- [OnASide, lists:reverse(OnASide)]].

%% The shapes of drawings in metres, a little above the floor, and in the colours of their names.
drawings_have_sizes_and_colours_test() ->
    Point = #{<<"x">> => 1.0, <<"y">> => 2.0, <<"z">> => 0.005},
    #{<<"spheres">> := [Sphere]} = entity(#{key => p, points => [{1000, 2000}], colour => red}),
    ?assertEqual(
        #{<<"x">> => 0.06, <<"y">> => 0.06, <<"z">> => 0.06}, maps:get(<<"size">>, Sphere)
    ),
    Pose = #{
        <<"position">> => Point,
        <<"orientation">> => #{<<"x">> => 0, <<"y">> => 0, <<"z">> => 0, <<"w">> => 1}
    },
    ?assertEqual(Pose, maps:get(<<"pose">>, Sphere)),
    #{<<"r">> := R, <<"g">> := G, <<"b">> := B, <<"a">> := 1.0} = maps:get(<<"color">>, Sphere),
    ?assertEqual([16#d6, 16#27, 16#28], [round(255 * Part) || Part <- [R, G, B]]),
    #{<<"texts">> := [Text]} = entity(#{key => t, text => "a", at => {1000, 2000}}),
    ?assertMatch(
        #{
            <<"pose">> := Pose,
            <<"font_size">> := 0.25,
            <<"billboard">> := true,
            <<"scale_invariant">> := false,
            <<"text">> := <<"a">>
        },
        Text
    ),
    Square = [{0, 0}, {1000, 0}, {1000, 1000}, {0, 1000}],
    #{<<"lines">> := [Outline], <<"triangles">> := [#{<<"points">> := Fan, <<"color">> := Fill}]} =
        entity(#{key => a, area => Square}),
    ?assertMatch(
        #{<<"type">> := 1, <<"thickness">> := 0.025, <<"scale_invariant">> := false}, Outline
    ),
    ?assertMatch(#{<<"a">> := 0.25}, Fill),
    Corners = fun(Points) -> [{round(X), round(Y)} || #{<<"x">> := X, <<"y">> := Y} <- Points] end,
    ?assertEqual([{0, 0}, {1, 0}, {1, 1}, {0, 0}, {1, 1}, {0, 1}], Corners(Fan)),
    ?assertEqual([{0, 0}, {1, 0}, {1, 1}, {0, 1}], Corners(maps:get(<<"points">>, Outline))).

%% Places of drawings are rounded to the millimetre.
places_are_told_to_the_millimetre_test() ->
    #{<<"lines">> := [#{<<"points">> := Points}]} =
        entity(#{key => way, line => [{1000.4, 2000.6}, {0, -0.4}]}),
    ?assertEqual(
        [{1.0, 2.001}, {0.0, 0.0}], [{X, Y + 0.0} || #{<<"x">> := X, <<"y">> := Y} <- Points]
    ).

%% What is taken away goes by its name.
taken_away_test() ->
    {ok, Nothing} = starl_drawing:new(#{key => way, line => []}),
    ?assertMatch(
        [
            {drawings, #{
                <<"deletions">> := [#{<<"id">> := <<"drawing 2 way">>, <<"type">> := 0}],
                <<"entities">> := []
            }}
        ],
        updates({draw, Nothing})
    ).

%% -- what each message shows --------------------------------------------------------------------

messages() ->
    {ok, Area} = starl_drawing:new(#{key => a, area => [{0, 0}, {1, 0}, {1, 1}]}),
    {ok, Text} = starl_drawing:new(#{key => t, text => "a", at => {0, 0}}),
    {ok, Points} = starl_drawing:new(#{key => p, points => [{0, 0}]}),
    {ok, None} = starl_drawing:new(#{key => p, points => []}),
    Violation = #{contract => app, what => bad, at_us => 5, robots => [1], details => #{}},
    [{scenario, 0, scenario()}, {poses, 0, #{full => true, robots => [{1, {1, 2, 0.0}, none, x}]}}] ++
        [{trace, 1, {1, note, Event}} || Event <- [said, {said, 1}, "odd"]] ++
        [{trace, 2, {1, app, {draw, Drawing}}} || Drawing <- [Area, Text, Points, None]] ++
        [{trace, 3, {1, app, {measure, n, 1}}}] ++
        inked() ++
        [
            {faults, 4, {began, {f1, 0, 1000, loss, all, #{}}}},
            {verdicts, 5, {violation, Violation}},
            {verdicts, 6, {ended, #{ending => done, violations => []}}},
            {gap, 6, 2},
            {log, 6, {info, 1, "a line"}},
            {metrics, 7, #{events => 1, packets => 2, lost => 3, violations => 4}},
            {packets, 8, {1, 2, {ping, 1}, 9, {lost, radio}}}
        ].

scenario() ->
    #{
        kind => simulation,
        app => my_app,
        robots => [{1, {0.0, 0.0, 0.0}}],
        scenario => #{seed => 7, faults => []},
        floor => floor()
    }.

%% A pen goes down, 400 mm to the right, and up.
inked() ->
    [
        {trace, At, {1, chassis, Event}}
     || {At, Event} <- [
            {0, {motion, {piece, 0, 0.0, 0.0, 0.0, 100.0, 0.0}}},
            {1000000, {actuated, pen, down}},
            {5000000, {actuated, pen, up}}
        ]
    ].

floor() ->
    starl_floor:new(#{
        size => {4000, 3000},
        doors => [{{1000, 0}, {2000, 0}}],
        rooms => #{hall => [{0, 0}, {4000, 0}, {4000, 3000}, {0, 3000}]}
    }).

%% All that these messages show, with the packets at the end.
shown(Messages) ->
    {Updates, Last} = lists:mapfoldl(
        fun starl_trace_foxglove:message/2, starl_trace_foxglove:new(500000), Messages
    ),
    {Packets, Empty} = starl_trace_foxglove:packets(1500000, 9000000, Last),
    ?assertEqual({[], Empty}, starl_trace_foxglove:packets(0, 9000000, Empty)),
    [{Channel, At, decoded(Json)} || {Channel, At, Json} <- lists:append(Updates) ++ Packets].

decoded(Json) -> jsx:decode(iolist_to_binary(starl_json:encode(Json, 6)), [return_maps]).

%% What is shown has exactly the fields that the schema of its channel asks for, and of its types.
what_is_shown_fits_the_schema_of_its_channel_test() ->
    Schemas = schemas(),
    Shown = shown(messages()),
    ?assertEqual(
        lists:sort([topic(Id) || Id <- maps:keys(Schemas)] -- [<<"/starl">>]),
        lists:usort([topic(starl_trace_schema:id(Channel)) || {Channel, _, _} <- Shown])
    ),
    [
        ?assertEqual({Channel, Json, []}, {Channel, Json, misfits(Schema, Json)})
     || {Channel, _, Json} <- Shown,
        {_, Schema} <- [maps:get(starl_trace_schema:id(Channel), Schemas)]
    ].

topic(Id) ->
    [Topic] = [
        iolist_to_binary(Topic)
     || {channel, Of, Of, Topic, "json", [{"callerid", "starl"}]} <- starl_trace_schema:channels(),
        Of =:= Id
    ],
    Topic.

%% The names and schemas by the numbers of their channels.
schemas() ->
    maps:from_list([
        {Id, {iolist_to_binary(Name), jsx:decode(iolist_to_binary(Text), [return_maps])}}
     || {schema, Id, Name, "jsonschema", Text} <- starl_trace_schema:channels()
    ]).

misfits(#{<<"type">> := <<"object">>, <<"properties">> := Any}, Json) when map_size(Any) =:= 0 ->
    [Json || not is_map(Json)];
misfits(#{<<"type">> := <<"object">>, <<"properties">> := Fields, <<"required">> := Keys}, Json) ->
    [{fields, Json} || lists:sort(Keys) =/= maps:keys(Fields)] ++
        [{Json, lacks, K} || K <- maps:keys(Fields), not is_map_key(K, Json)] ++
        lists:append([
            case Fields of
                #{K := Schema} -> misfits(Schema, V);
                #{} -> [{K, not_in_schema}]
            end
         || {K, V} <- maps:to_list(Json)
        ]);
misfits(#{<<"type">> := <<"array">>, <<"items">> := Schema}, Json) ->
    lists:append([misfits(Schema, One) || One <- Json]);
misfits(#{<<"type">> := Type}, Json) ->
    Fits =
        case Type of
            <<"string">> -> is_binary(Json);
            <<"integer">> -> is_integer(Json);
            <<"number">> -> is_number(Json);
            <<"boolean">> -> is_boolean(Json)
        end,
    [{Json, no, Type} || not Fits].

%% The schemas that Foxglove knows by their names, as far as nothing of ours fills them, and the bytes of our own
%% messages.
schemas_of_foxglove_test() ->
    Schemas = schemas(),
    [?assertMatch(#{<<"title">> := Name}, Schema) || {Name, Schema} <- maps:values(Schemas)],
    {<<"foxglove.SceneUpdate">>, Scene} = maps:get(starl_trace_schema:id(scene), Schemas),
    ?assertEqual(
        {<<"foxglove.SceneUpdate">>, Scene}, maps:get(starl_trace_schema:id(drawings), Schemas)
    ),
    #{<<"properties">> := #{<<"entities">> := #{<<"items">> := Entity}}} = Scene,
    Of = fun(Kind) ->
        #{<<"properties">> := #{Kind := #{<<"items">> := #{<<"required">> := Fields}}}} = Entity,
        lists:sort([binary_to_list(Field) || Field <- Fields])
    end,
    ?assertEqual(["color", "pose", "size"], Of(<<"cubes">>)),
    ?assertEqual(
        ["color", "data", "media_type", "override_color", "pose", "scale", "url"], Of(<<"models">>)
    ),
    ?assertEqual(["key", "value"], Of(<<"metadata">>)),
    ?assertEqual("time", title(<<"timestamp">>, Entity)),
    ?assertEqual("duration", title(<<"lifetime">>, Entity)),
    {<<"starl.Messages">>, #{<<"properties">> := #{<<"terms">> := Terms}}} = maps:get(1, Schemas),
    ?assertEqual(#{<<"type">> => <<"string">>, <<"contentEncoding">> => <<"base64">>}, Terms).

title(Field, #{<<"properties">> := Fields}) ->
    #{Field := #{<<"title">> := Title}} = Fields,
    binary_to_list(Title).

%% -- the scene in numbers -----------------------------------------------------------------------

entities(Messages) ->
    [Entity || {scene, _, #{<<"entities">> := Entities}} <- shown(Messages), Entity <- Entities].

pose(X, Y, Z) ->
    #{
        <<"position">> => #{<<"x">> => X, <<"y">> => Y, <<"z">> => Z},
        <<"orientation">> => #{<<"x">> => 0, <<"y">> => 0, <<"z">> => 0.0, <<"w">> => 1.0}
    }.

colour(R, G, B, A) -> #{<<"r">> => R, <<"g">> => G, <<"b">> => B, <<"a">> => A}.

%% A robot is a cylinder of its size on the floor, with an arrow to its front and its number above, all in
%% its own frame.
a_body_is_a_cylinder_with_a_nose_and_a_number_test() ->
    Facts = scenario(),
    [_, Body] = entities([{scenario, 1500000, Facts#{robots := [{2, {0.0, 0.0, 0.0}}]}}]),
    Blue = fun(Alpha) -> colour(0.2, 0.6, 0.86, Alpha) end,
    ?assertEqual(
        #{
            <<"timestamp">> => #{<<"sec">> => 1, <<"nsec">> => 500000000},
            <<"frame_id">> => <<"robot 2">>,
            <<"id">> => <<"robot 2">>,
            <<"lifetime">> => #{<<"sec">> => 0, <<"nsec">> => 0},
            <<"frame_locked">> => true,
            <<"arrows">> => [
                #{
                    <<"pose">> => pose(0.0, 0.0, 0.1),
                    <<"shaft_length">> => 0.15,
                    <<"shaft_diameter">> => 0.03,
                    <<"head_length">> => 0.06,
                    <<"head_diameter">> => 0.07,
                    <<"color">> => Blue(1.0)
                }
            ],
            <<"cylinders">> => [
                #{
                    <<"pose">> => pose(0.0, 0.0, 0.05),
                    <<"size">> => #{<<"x">> => 0.33, <<"y">> => 0.33, <<"z">> => 0.1},
                    <<"bottom_scale">> => 1,
                    <<"top_scale">> => 1,
                    <<"color">> => Blue(0.8)
                }
            ],
            <<"texts">> => [
                #{
                    <<"pose">> => pose(0.0, 0.0, 0.3),
                    <<"billboard">> => true,
                    <<"font_size">> => 0.2,
                    <<"scale_invariant">> => false,
                    <<"color">> => colour(1, 1, 1, 1),
                    <<"text">> => <<"2">>
                }
            ]
        },
        filled(Body)
    ).

%% An entity without its empty lists.
filled(Entity) -> maps:filter(fun(_, Value) -> Value =/= [] end, Entity).

%% Walls and doors are lists of lines, each room has its name in it.
a_floor_plan_stands_on_the_floor_test() ->
    [Plan, _] = entities([{scenario, 0, scenario()}]),
    #{<<"lines">> := [Walls, Doors], <<"texts">> := [Hall]} = filled(Plan),
    {X, Y} = starl_floor:middle(maps:get(hall, maps:get(rooms, floor()))),
    Points = fun(#{<<"points">> := Points}) ->
        [{PX + 0.0, PY + 0.0} || #{<<"x">> := PX, <<"y">> := PY, <<"z">> := 0} <- Points]
    end,
    Corners = [{0.0, 0.0}, {0.0, 3.0}, {4.0, 3.0}, {4.0, 0.0}],
    ?assertEqual(
        lists:sort(Corners ++ Corners), lists:sort(Points(Walls))
    ),
    ?assertEqual([{1.0, 0.0}, {2.0, 0.0}], Points(Doors)),
    [
        ?assertMatch(
            #{<<"type">> := 2, <<"thickness">> := 0.03, <<"scale_invariant">> := false}, Lines
        )
     || Lines <- [Walls, Doors]
    ],
    [?assertEqual(pose(0.0, 0.0, 0.0), maps:get(<<"pose">>, Lines)) || Lines <- [Walls, Doors]],
    [
        ?assertEqual([], maps:get(Key, Lines))
     || Lines <- [Walls, Doors], Key <- [<<"colors">>, <<"indices">>]
    ],
    ?assertEqual(stays(), maps:get(<<"lifetime">>, Plan)),
    ?assertEqual(colour(0.5, 0.5, 0.5, 1), maps:get(<<"color">>, Walls)),
    ?assertEqual(colour(0.75, 0.55, 0.25, 1), maps:get(<<"color">>, Doors)),
    ?assertEqual(
        #{
            <<"pose">> => pose(X / 1000, Y / 1000, 0.0),
            <<"billboard">> => true,
            <<"font_size">> => 0.3,
            <<"scale_invariant">> => false,
            <<"color">> => colour(0.5, 0.5, 0.5, 1),
            <<"text">> => <<"hall">>
        },
        Hall
    ),
    ?assertMatch(#{<<"frame_locked">> := false, <<"id">> := <<"floor plan">>}, Plan),
    %% no doors, no lines for them
    Facts = scenario(),
    [Bare, _] = entities([{scenario, 0, Facts#{floor := (floor())#{doors := []}}}]),
    ?assertMatch(#{<<"lines">> := [_]}, Bare).

%% The line of a pen goes from where it went down to where it went up, in parts of a hundred points; of the
%% points of an arc those that are near to the one before are left out.
a_pen_leaves_a_line_test() ->
    ?assertEqual(
        [{<<"ink 0">>, [{0.1, 0.0}, {0.5, 0.0}]}], lines(inked())
    ),
    %% the ends of pieces are points of it; a pen that does not move leaves none
    Pieces = fun(Ends) ->
        lines(
            [chassis(0, {motion, {piece, 0, 0.0, 0.0, 0.0, 100.0, 0.0}}), pen(0, down)] ++
                [
                    chassis(At, {motion, {piece, At, At / 10000, 0.0, 0.0, 100.0, 0.0}})
                 || At <- Ends
                ] ++ [pen(20000000, up)]
        )
    end,
    ?assertEqual([{<<"ink 0">>, [{0.0, 0.0}, {1.0, 0.0}, {2.0, 0.0}]}], Pieces([10000000])),
    %% of two ends within 75 mm the first shows nothing more
    ?assertEqual(
        [{<<"ink 0">>, [{0.0, 0.0}, {0.07, 0.0}, {2.0, 0.0}]}], Pieces([300000, 700000])
    ),
    ?assertMatch([{_, [_, {0.03, _}, {0.075, _}, _]}], Pieces([300000, 750000])),
    ?assertEqual([], lines([pen(0, down), pen(1000000, up)])),
    ?assertEqual([], lines(tl(inked()))),
    %% it stays, as wide as a pen, in the colour of its robot
    [#{<<"lifetime">> := Life, <<"frame_id">> := Frame, <<"lines">> := [Line]}] = [
        Entity
     || #{<<"id">> := <<"ink 0">>} = Entity <- entities(inked())
    ],
    ?assertEqual({stays(), <<"floor">>}, {Life, Frame}),
    ?assertEqual(
        #{
            <<"type">> => 0,
            <<"pose">> => pose(0.0, 0.0, 0.0),
            <<"thickness">> => 0.02,
            <<"scale_invariant">> => false,
            <<"colors">> => [],
            <<"indices">> => []
        },
        maps:without([<<"points">>, <<"color">>], Line)
    ),
    ?assertMatch(#{<<"color">> := #{<<"a">> := 1.0}}, Line),
    %% each line has a number of its own
    ?assertEqual(
        [<<"ink 0">>, <<"ink 1">>],
        [Id || {Id, _} <- lines(inked() ++ [pen(6000000, down), pen(7000000, up)])]
    ).

%% A long line is shown while it grows.
a_long_line_comes_in_parts_test() ->
    Ends = [1000000 * N || N <- lists:seq(1, 250)],
    Parts = lines(
        [chassis(0, {motion, {piece, 0, 0.0, 0.0, 0.0, 100.0, 0.0}}), pen(0, down)] ++
            [chassis(At, {motion, {piece, At, At / 10000, 0.0, 0.0, 100.0, 0.0}}) || At <- Ends] ++
            [pen(250000000, up)]
    ),
    ?assertEqual([100, 100, 53], [length(Points) || {_, Points} <- Parts]),
    ?assertEqual([0.0, 9.9, 19.8], [X || {_, [{X, _} | _]} <- Parts]).

%% The lifetime of what is shown until it is taken away.
stays() -> #{<<"sec">> => 0, <<"nsec">> => 0}.

chassis(At, Event) -> {trace, At, {1, chassis, Event}}.

pen(At, Pen) -> chassis(At, {actuated, pen, Pen}).

lines(Messages) ->
    [
        {Id, [{X + 0.0, Y + 0.0} || #{<<"x">> := X, <<"y">> := Y, <<"z">> := 0} <- Points]}
     || #{<<"id">> := Id, <<"lines">> := [Line]} <- entities(Messages),
        #{<<"type">> := 0, <<"thickness">> := 0.02, <<"points">> := Points} <- [Line]
    ].

%% Frames come once in a period, of all robots that have moved since, each where it was last.
frames_of_the_robots_test() ->
    At = fun(Us, Robots) ->
        {poses, Us, #{full => false, robots => [{R, P, x, x} || {R, P} <- Robots]}}
    end,
    Shown = shown([
        At(0, [{2, {1.0, 2.0, math:pi() / 2}}]),
        At(100000, [{1, {10.0, 0.0, 0.0}}]),
        At(499999, [{1, {1500.0, -250.5, 0.0}}]),
        At(500000, [{2, {1.0, 2.0, 0.0}}]),
        At(900000, [])
    ]),
    Frame = fun(#{<<"child_frame_id">> := Child, <<"translation">> := #{<<"x">> := X}}) ->
        {Child, X}
    end,
    ?assertEqual(
        [
            {0, [{<<"robot 2">>, 0.001}]},
            {500000, [{<<"robot 1">>, 1.5}, {<<"robot 2">>, 0.001}]}
        ],
        [{Us, [Frame(T) || T <- Ts]} || {tf, Us, #{<<"transforms">> := Ts}} <- Shown]
    ),
    [{tf, _, #{<<"transforms">> := [Turned]}} | _] = Shown,
    ?assertMatch(
        #{
            <<"parent_frame_id">> := <<"floor">>,
            <<"timestamp">> := #{<<"sec">> := 0, <<"nsec">> := 0},
            <<"translation">> := #{<<"y">> := 0.002, <<"z">> := 0},
            <<"rotation">> := #{<<"x">> := 0, <<"y">> := 0, <<"z">> := 0.70711, <<"w">> := 0.70711}
        },
        Turned
    ),
    [{tf, _, #{<<"transforms">> := [Late]}}] = shown([At(2300001, [{1, {0, 0, 0.0}}])]),
    ?assertMatch(#{<<"sec">> := 2, <<"nsec">> := 300001000}, maps:get(<<"timestamp">>, Late)).

%% Eight colours, and again from the ninth robot on.
robots_have_colours_test() ->
    Colours = [starl_trace_scene:colour(Robot, own, 1.0) || Robot <- lists:seq(1, 17)],
    ?assertEqual(8, length(lists:usort(Colours))),
    ?assertEqual(lists:sublist(Colours, 8), lists:sublist(Colours, 9, 8)),
    ?assertEqual(hd(Colours), lists:last(Colours)).

%% -- texts --------------------------------------------------------------------------------------

texts(Channel, Message) -> [Json || {C, _, Json} <- shown([Message]), C =:= Channel].

events_are_shown_with_their_details_test() ->
    [
        ?assertEqual(
            [
                #{
                    <<"robot">> => 3,
                    <<"machine">> => <<"note">>,
                    <<"event">> => Name,
                    <<"details">> => Details
                }
            ],
            texts(trace, {trace, 0, {3, note, Event}})
        )
     || {Event, Name, Details} <- [
            {done, <<"done">>, <<>>},
            {said, <<"said">>, <<>>},
            {{said, 1, {a, b}}, <<"said">>, <<"1, {a,b}">>},
            {{1, 2}, <<"event">>, <<"{1,2}">>},
            {[x], <<"event">>, <<"[x]">>},
            {{said, named(40)}, <<"said">>, atom_to_binary(named(40))},
            {{said, named(41)}, <<"said">>, <<(atom_to_binary(named(37)))/binary, "...">>},
            %% not in the middle of a character: these have three bytes each
            {{said, 'a€€€€€€€€€€€€€'}, <<"said">>, <<"'a€€€€€€€€€€€..."/utf8>>}
        ]
    ],
    %% motions and SAP are shown otherwise, or not at all; a pen's ink is in the scene
    [
        ?assertEqual([], texts(trace, {trace, 0, {3, Machine, Event}}))
     || {Machine, Event} <- [
            {sap, {sent, x}},
            {chassis, {motion, {piece, 0, 0.0, 0.0, 0.0, 0.0, 0.0}}},
            {chassis, {actuated, pen, up}}
        ]
    ],
    ?assertMatch([_], texts(trace, {trace, 0, {3, chassis, {actuated, led, on}}})).

named(N) -> list_to_atom(lists:duplicate(N, $a)).

%% Lines of packets: when, between whom, what, how large, and what became of it. Acknowledgements are shown
%% only when they do not arrive.
packets_are_lines_test() ->
    At = 12345000,
    Arrives = {arrives, [{At + 8200, intact}]},
    Lines = fun(Messages) ->
        [
            {Lost, L}
         || {packets, 9000000, #{<<"lost">> := Lost, <<"packets">> := L, <<"since">> := Since}} <-
                shown(Messages),
            Since =:= #{<<"sec">> => 1, <<"nsec">> => 500000000}
        ]
    end,
    Packet = fun(What, Fate) -> {packets, At, {1, 2, What, 45, Fate}} end,
    Way = fun(Way) -> {ways, At, {2, Way}} end,
    [
        ?assertEqual({Message, [{Lost, [Line]}]}, {Message, Lines([Message])})
     || {Message, Lost, Line} <- [
            {Packet({data, note, 17}, Arrives), 0, <<"12.345 1>2 note 17 45B 8.2ms">>},
            {Packet({data, {app, note}, 17}, Arrives), 0, <<"12.345 1>2 app note 17 45B 8.2ms">>},
            {Packet({shout, note}, Arrives), 0, <<"12.345 1>2 shout note 45B 8.2ms">>},
            {Packet({shout, {app, note}}, Arrives), 0, <<"12.345 1>2 shout app note 45B 8.2ms">>},
            {Packet(junk, Arrives), 0, <<"12.345 1>2 junk 45B 8.2ms">>},
            {Packet({ack, 3}, {lost, radio}), 1, <<"12.345 1>2 ack 3 45B lost: radio">>},
            {Packet({ack, 3}, {lost, {fault, f1}}), 1, <<"12.345 1>2 ack 3 45B lost by f1">>},
            {
                Packet({ack, 3}, {arrives, [{At + 1000, corrupt}]}),
                0,
                <<"12.345 1>2 ack 3 45B 1.0ms damaged">>
            },
            {
                Packet({data, n, 1}, {arrives, [{At + 1000, intact}, {At + 2000, intact}]}),
                0,
                <<"12.345 1>2 n 1 45B 1.0ms, 2.0ms">>
            },
            {Way({sent, 1, {data, n, 1}, 45, hash}), 0, <<"12.345 2>1 n 1 45B sent">>},
            {Way({came, 1, {data, n, 1}, 45, hash, Arrives}), 0, <<"12.345 1>2 n 1 45B came">>},
            {
                Way({came, 1, {ack, 1}, 45, hash, {lost, radio}}),
                1,
                <<"12.345 1>2 ack 1 45B lost: radio">>
            }
        ]
    ],
    [
        ?assertEqual([], Lines([Message]))
     || Message <- [
            Packet({ack, 3}, Arrives),
            Way({sent, 1, {ack, 3}, 45, hash}),
            Way({came, 1, {ack, 3}, 45, hash, Arrives})
        ]
    ],
    ?assertMatch(
        [{2, [<<"12.345 1>2 a", _/binary>>, <<"12.345 1>2 b", _/binary>>]}],
        Lines([Packet(a, {lost, radio}), Packet(b, {lost, radio})])
    ).

%% What a log, a gap and a state that is not kept say.
lines_for_people_test() ->
    [
        ?assertEqual([{Level, Name, Text, 1}], logged(texts(log, Message)))
     || {Message, Level, Name, Text} <- [
            {{log, 1000000, {info, 3, "a"}}, 2, <<"robot 3">>, <<"a">>},
            {{log, 1000000, {warning, 3, "a"}}, 3, <<"robot 3">>, <<"a">>},
            {{log, 1000000, {error, none, "a"}}, 4, <<"run">>, <<"a">>},
            {{gap, 1000000, 7}, 3, <<"run">>, <<"7 messages are missing here">>},
            {
                {gap, 1000000, no_end},
                3,
                <<"run">>,
                unicode:characters_to_binary(starl_unjudged:format_why(no_end))
            }
        ]
    ].

logged(Logged) ->
    [
        {Level, Name, Text, Sec}
     || #{
            <<"level">> := Level,
            <<"name">> := Name,
            <<"message">> := Text,
            <<"line">> := 0,
            <<"timestamp">> := #{<<"sec">> := Sec}
        } <- Logged
    ].

%% What a fault, a verdict, the counts and a scenario say.
words_for_people_test() ->
    ?assertEqual(
        [
            #{
                <<"what">> => <<"began">>,
                <<"fault">> => <<"f1">>,
                <<"kind">> => <<"loss">>,
                <<"target">> => <<"all">>
            }
        ],
        texts(faults, {faults, 0, {began, {f1, 0, 1000, loss, all, #{}}}})
    ),
    ?assertEqual(
        [#{<<"what">> => <<"ended">>, <<"text">> => <<"done, violations: 1">>}],
        texts(verdicts, {verdicts, 0, {ended, #{ending => done, violations => [x]}}})
    ),
    ?assertEqual(
        [#{<<"events">> => 1, <<"packets">> => 2, <<"lost">> => 3, <<"violations">> => 4}],
        texts(metrics, {metrics, 7, #{events => 1, packets => 2, lost => 3, violations => 4}})
    ),
    ?assertEqual(
        [
            #{
                <<"kind">> => <<"simulation">>,
                <<"application">> => <<"my_app">>,
                <<"robots">> => 1,
                <<"seed">> => 7,
                <<"values">> => [
                    #{<<"key">> => <<"faults">>, <<"value">> => <<"[]">>},
                    #{<<"key">> => <<"seed">>, <<"value">> => <<"7">>}
                ]
            }
        ],
        texts(scenario, {scenario, 0, scenario()})
    ).
