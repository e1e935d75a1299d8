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
    ?assertEqual(1, Filled(starl_drawing:circle({0, 0}, 100))).

%% What is taken away goes by its name.
taken_away_test() ->
    {ok, Nothing} = starl_drawing:new(#{key => way, line => []}),
    ?assertMatch(
        [
            {drawings, #{
                <<"deletions">> := [#{<<"id">> := <<"drawing 2 way">>}], <<"entities">> := []
            }}
        ],
        updates({draw, Nothing})
    ).
