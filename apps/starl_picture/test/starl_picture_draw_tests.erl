%% @doc Contracts of the drawing of a run: it is itself a sound SVG picture in floor millimetres
%% with y upwards, numbers have at most one decimal, robots have colours that are told apart.
-module(starl_picture_draw_tests).

-include_lib("eunit/include/eunit.hrl").

%% Read back, the target and ink lines are where they were: the drawing is its own check.
read_back_test() ->
    Text = text(drawing()),
    %% The frame of 4096 x 3072 with margins is placed so that one floor mm stays one mm.
    {match, [Box]} = re:run(Text, "viewBox=\"([^\"]*)\"", [{capture, all_but_first, binary}]),
    {ok, [X, Y, W, H]} = starl_svg_number:list(Box),
    {ok, Picture} = starl_picture:parse(Text, #{area => {X, 3072.0 - Y - H, X + W, 3072.0 - Y}}),
    Near = [
        [{round(PX), round(PY)} || {PX, PY} <- [P, Q]]
     || {P, Q} <- starl_picture:segments(Picture)
    ],
    [
        ?assert(lists:member(Line, Near), {Line, Near})
     || Line <- [
            [{100, 200}, {4000, 3000}],
            [{100, 200}, {2000, 1600}]
        ]
    ].

one_decimal_test() ->
    ?assertEqual(nomatch, re:run(text(drawing()), "[0-9]\\.[0-9][0-9]")),
    ?assertEqual(nomatch, re:run(text(drawing()), "[0-9]e[-+]?[0-9]")).

robots_test() ->
    Text = text(drawing()),
    %% Robot 2 stands at (1000, 500), y turned over, with the radius of a Create.
    ?assertMatch({match, _}, re:run(Text, "<circle cx=\"1000\" cy=\"2572\" r=\"165\"")),
    [
        ?assertMatch({match, _}, re:run(Text, Word))
     || Word <- [
            ">robot 1<", ">robot 2<", starl_picture_draw:colour(1), starl_picture_draw:colour(2)
        ]
    ].

%% A team of thousands does not make the page taller.
large_team_test() ->
    Team = fun(Count) ->
        text((drawing())#{robots := [{Id, {1.0, 1.0}, 0.0} || Id <- lists:seq(1, Count)]})
    end,
    ?assertNotEqual(nomatch, binary:match(Team(64), <<">robot 64<">>)),
    ?assertEqual(nomatch, binary:match(Team(65), <<">robot 17<">>)),
    ?assertNotEqual(nomatch, binary:match(Team(65), <<">and so on<">>)),
    [Height, Height] = [binary:part(Team(N), 0, 60) || N <- [65, 3000]].

title_is_escaped_test() ->
    Text = text((drawing())#{title => "a < b & \x{3b1}\n"}),
    ?assertNotEqual(nomatch, binary:match(Text, <<"a &lt; b &amp; ", 16#CE, 16#B1, " <">>)),
    ?assertEqual(nomatch, binary:match(text(drawing()), <<"\"middle\" fill=\"#303030\"">>)).

empty_test() ->
    Empty = #{floor => {1000, 1000}, target => [], ink => #{}, robots => []},
    ?assertMatch({ok, _}, starl_picture:parse(text(Empty), #{area => {0, 0, 1, 1}})),
    Dot = Empty#{ink := #{1 => [[], [{5.0, 5.0}]]}},
    ?assertMatch({match, _}, re:run(text(Dot), "points=\"5,995 5,995\"")).

%% Sixteen colours, each two at least 40 apart in CIE L*a*b*, and from white and black; then again.
colours_test() ->
    Colours = [starl_picture_draw:colour(Id) || Id <- lists:seq(1, 16)],
    Labs = [lab(Colour) || Colour <- ["#ffffff", "#000000" | Colours]],
    [?assert(distance(A, B) > 40.0, {A, B}) || A <- Labs, B <- Labs, A < B],
    ?assertEqual(18, length(lists:usort(Labs))),
    ?assertEqual(Colours, [starl_picture_draw:colour(Id) || Id <- lists:seq(17, 32)]).

%% The same drawing gives the same bytes, with more robots than a small map has keys.
order_test() ->
    Ids = lists:seq(1, 50),
    Ink = fun(Order) -> maps:from_list([{Id, [[{1.0, 1.0}, {2.0, 2.0}]]} || Id <- Order]) end,
    Text = text((drawing())#{ink := Ink(Ids)}),
    ?assertEqual(Text, text((drawing())#{ink := Ink(lists:reverse(Ids))})),
    {match, Names} = re:run(Text, ">robot ([0-9]+)<", [global, {capture, all_but_first, list}]),
    ?assertEqual(Ids, [list_to_integer(Name) || [Name] <- Names]).

write_test_() ->
    {timeout, 40, fun() ->
        Unique = integer_to_list(erlang:unique_integer([positive])),
        Dir = filename:join(["/tmp", "starl_draw_" ++ os:getpid() ++ "_" ++ Unique, "-deep er"]),
        {messages, Before} = process_info(self(), messages),
        {ok, Files} = starl_picture_draw:write(Dir, "painting", drawing()),
        Svg = filename:join(Dir, "painting.svg"),
        {ok, Text} = file:read_file(Svg),
        ?assertEqual(text(drawing()), Text),
        case os:find_executable("rsvg-convert") of
            false ->
                ?assertEqual([Svg], Files);
            _ ->
                ?assertEqual([Svg, filename:join(Dir, "painting.png")], Files),
                {ok, <<_:16/binary, Width:32, _/binary>>} = file:read_file(lists:last(Files)),
                ?assertEqual(1200, Width)
        end,
        ok = file:del_dir_r(filename:dirname(Dir)),
        %% No message of the conversion stays behind.
        ?assertEqual({messages, Before}, process_info(self(), messages))
    end}.

write_error_test() ->
    {error, Reason} = starl_picture_draw:write("/dev/null/no", "painting", drawing()),
    ?assertMatch({cannot_write, "/dev/null/no/painting.svg", _}, Reason),
    ?assertMatch(
        <<"cannot write /dev/null/no/painting.svg: ", _/binary>>,
        iolist_to_binary(starl_picture_draw:format_error(Reason))
    ).

%% What is still to be painted is light beneath the ink, and dark where it is shown alone.
lines_of_a_preview_are_dark_test() ->
    Drawing = drawing(),
    Found = fun(Colour, D) -> nomatch =/= binary:match(text(D), Colour) end,
    ?assertEqual(
        [{true, false}, {false, true}],
        [
            {Found(<<"#c4c4c4">>, D), Found(<<"#404040">>, D)}
         || D <- [Drawing, Drawing#{preview => true}]
        ]
    ).

%%% Helpers

drawing() ->
    #{
        floor => {4096.0, 3072.0},
        target => [{{100.0, 200.0}, {4000.0, 3000.0}}],
        ink => #{1 => [[{100.0, 200.0}, {2000.04, 1600.0}]], 2 => []},
        robots => [{2, {1000.0, 500.0}, 0.5}, {1, {2000.0, 1600.0}, -1.0}]
    }.

text(Drawing) -> iolist_to_binary(starl_picture_draw:svg(Drawing)).

distance({L0, A0, B0}, {L1, A1, B1}) ->
    math:sqrt((L0 - L1) * (L0 - L1) + (A0 - A1) * (A0 - A1) + (B0 - B1) * (B0 - B1)).

%% sRGB, D65, to CIE L*a*b*.
lab([$# | Hex]) ->
    Value = list_to_integer(Hex, 16),
    [R, G, B] = [linear(((Value bsr Shift) band 255) / 255) || Shift <- [16, 8, 0]],
    X = cube((0.4124 * R + 0.3576 * G + 0.1805 * B) / 0.9505),
    Y = cube(0.2126 * R + 0.7152 * G + 0.0722 * B),
    Z = cube((0.0193 * R + 0.1192 * G + 0.9505 * B) / 1.0888),
    {116 * Y - 16, 500 * (X - Y), 200 * (Y - Z)}.

linear(C) when C =< 0.04045 -> C / 12.92;
linear(C) -> math:pow((C + 0.055) / 1.055, 2.4).

cube(T) when T > 0.008856 -> math:pow(T, 1 / 3);
cube(T) -> 7.787 * T + 16 / 116.
