-module(starl_floor_svg_tests).
-include_lib("eunit/include/eunit.hrl").

svg(Content) -> svg("viewBox='0 0 6000 4000'", Content).

svg(Frame, Content) ->
    iolist_to_binary([
        "<svg xmlns='http://www.w3.org/2000/svg' "
        "xmlns:inkscape='http://www.inkscape.org/namespaces/inkscape' ",
        Frame,
        ">\n",
        Content,
        "\n</svg>"
    ]).

plan(Content) ->
    {ok, Floor} = starl_floor_svg:parse(svg(Content), 1),
    ?assert(starl_floor:is_floor(Floor)),
    Floor.

walls(Shapes) -> plan(["<g id='walls'>", Shapes, "</g>"]).

solid(Points, Floor) -> [starl_floor:is_solid(Point, Floor) || Point <- Points].

%% y points upwards on a floor, and downwards in a drawing.
%% Holds: What is seen in the layer of walls is solid, where and as wide as it is drawn; holes are
%% free by the fill rule
%% Red: y downwards; lines of 1 mm; both rules taken for even-odd
an_area_is_solid_where_it_is_drawn_test() ->
    #{size := Size, walls := [Wall]} =
        Floor = walls("<rect x='1000' y='500' width='300' height='200'/>"),
    ?assertEqual({6000.0, 4000.0}, Size),
    ?assertEqual(lists:sort(starl_floor:box(1000, 3300, 1300, 3500)), lists:sort(Wall)),
    ?assertEqual([true, false], solid([{1100.0, 3400.0}, {1100.0, 600.0}], Floor)).

%% A hole is free by both rules, an inner outline of the same direction by one only.
holes_follow_the_fill_rule_test_() ->
    Outer = "M 1000 1000 H 3000 V 3000 H 1000 Z ",
    Same = "M 1500 1500 H 2500 V 2500 H 1500 Z",
    Against = "M 1500 1500 V 2500 H 2500 V 1500 Z",
    [
        ?_assertEqual(
            {Rule, Inner, [true, Middle, false]},
            {Rule, Inner,
                solid(
                    [{1100.0, 2000.0}, {2000.0, 2000.0}, {500.0, 500.0}],
                    walls(["<path d='", Outer, Inner, "' ", Rule, "/>"])
                )}
        )
     || {Rule, Inner, Middle} <- [
            {"", Same, true},
            {"", Against, false},
            {"fill-rule='evenodd'", Same, false},
            {"style='fill-rule: evenodd'", Against, false},
            {"transform='matrix(1 0 0 -1 0 4000)'", Against, false}
        ]
    ].

%% A line is as thick as it is drawn, to its end and no further; its corners are whole.
a_line_is_as_thick_as_it_is_drawn_test() ->
    Floor = walls(
        "<path d='M 1000 2000 H 3000 V 1000' fill='none' stroke='red' stroke-width='200'/>"
    ),
    ?assertEqual(
        [true, false, true, false, true, false],
        solid(
            [
                {2000.0, 2090.0},
                {2000.0, 2110.0},
                {3090.0, 1910.0},
                {3110.0, 1890.0},
                {1010.0, 2000.0},
                {990.0, 2000.0}
            ],
            Floor
        )
    ).

%% The scale of the drawing and of its groups counts for the width of lines, too.
a_scale_counts_for_all_lengths_test() ->
    Line = "<line x1='10' y1='20' x2='30' y2='20' stroke='black' stroke-width='2'/>",
    Group = ["<g id='walls' transform='scale(2)'>", Line, "</g>"],
    {ok, #{size := {600.0, 800.0}, walls := [Wall]}} =
        starl_floor_svg:parse(svg("width='60' height='80'", Group), 10),
    ?assertEqual({200.0, 380.0, 600.0, 420.0}, starl_geometry:box(Wall)).

%% What is hidden, outside of the layers, or a definition is no wall; a clone in the layer is one.
what_is_not_seen_is_no_wall_test() ->
    #{walls := Walls} = plan(
        "<defs><rect id='block' width='10' height='10'/></defs>"
        "<rect width='50' height='50'/>"
        "<g id='g1' inkscape:label='Walls'><rect display='none' width='70' height='70'/>"
        "<use href='#block' x='500' y='500'/></g>"
    ),
    ?assertEqual([{500.0, 3490.0, 510.0, 3500.0}], [starl_geometry:box(Wall) || Wall <- Walls]).

rooms_doors_and_places_have_their_names_test() ->
    Floor = plan(
        "<title>House</title>"
        "<g id='layer1' inkscape:label='ROOMS' fill='none' stroke='grey'>"
        "<rect id='rect7' inkscape:label='kitchen' width='3000' height='4000'/>"
        "<path id='path8' d='M 3000 0 H 6000 V 4000 H 3000'><title>hall</title></path></g>"
        "<g id='doors' stroke='brown'><path d='M 3000 1500 V 2500'/>"
        "<rect x='4000' y='3900' width='800' height='100'/></g>"
        "<g id='places'><g id='dock'><circle cx='4500' cy='1000' r='50'/></g></g>"
    ),
    #{name := Name, rooms := Rooms, doors := Doors, places := Places} = Floor,
    ?assertEqual(<<"House">>, Name),
    ?assertEqual([hall, kitchen], lists:sort(maps:keys(Rooms))),
    ?assertEqual({ok, kitchen}, starl_floor:room_at({100.0, 100.0}, Floor)),
    ?assertEqual(#{dock => {4500.0, 3000.0}}, Places),
    ?assertEqual(
        [{{3000.0, 2500.0}, {3000.0, 1500.0}}, {{4000.0, 50.0}, {4800.0, 50.0}}], Doors
    ).

a_curve_is_cut_into_chords_of_two_millimetres_test() ->
    #{walls := [Wall]} = walls("<circle cx='3000' cy='2000' r='1000'/>"),
    [
        ?assert(starl_geometry:point_segment({3000.0, 2000.0}, Side) > 997.9)
     || Side <- lists:zip(Wall, tl(Wall) ++ [hd(Wall)])
    ],
    ?assert(abs(starl_floor:area(Wall) / 1.0e6 - math:pi()) < 0.01).

%% Holds: A mistake in a drawing is one line with its place
%% Red: the check for a second room of a name left out
mistakes_are_one_line_with_their_place_test_() ->
    Text = fun(Bytes) ->
        {error, {Line, What}} = starl_floor_svg:parse(Bytes, 1),
        {Line, unicode:characters_to_list(What)}
    end,
    Rooms = fun(Shapes) -> svg(["<g id='rooms'>\n", Shapes, "</g>"]) end,
    [
        ?_assertMatch(
            {Line, {match, _}}, {element(1, Text(Bytes)), re:run(element(2, Text(Bytes)), Words)}
        )
     || {Line, Words, Bytes} <- [
            {none, "needs a viewBox", svg("", "<g id='walls'><rect width='9' height='9'/></g>")},
            {none, "named walls", svg("<rect width='9' height='9'/>")},
            {none, "not an SVG drawing", <<"hello">>},
            {none, "line 2, <path>: the path data", svg("<g id='walls'><path d='X'/></g>")},
            {3, "needs a name", Rooms("<rect width='9' height='9'/>")},
            {3, "letters, digits", Rooms("<rect id='a.b' width='9' height='9'/>")},
            {4, "there twice",
                Rooms(
                    "<rect id='a' width='9' height='9'/>\n"
                    "<rect inkscape:label='a' width='9' height='9'/>"
                )},
            {3, "an area", Rooms("<line id='a' x2='9' stroke='red'/>")}
        ]
    ].
