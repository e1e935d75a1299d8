%% @doc Draws measures over time as SVG: a panel for each measure, a line for each robot, or one for the team. A pure module.
-module(starl_cli_measures_plot).

-export([svg/1]).

%% @doc The plot of these values, which are in the order of time.
-spec svg([starl_cli_measures:value(), ...]) -> iolist().
svg(Values) ->
    Groups = maps:groups_from_list(fun({_, _, Key, _}) -> Key end, Values),
    starl_picture_plot:svg(" s", [
        #{title => atom_to_list(Key), curves => curves(Own)}
     || {Key, Own} <- lists:sort(maps:to_list(Groups))
    ]).

curves(Values) ->
    Lines = maps:groups_from_list(
        fun({_, Robot, _, _}) -> Robot end, fun({T, _, _, Value}) -> {T / 1.0e6, Value} end, Values
    ),
    [
        (whose(Robot))#{points => Points}
     || {Robot, Points} <- lists:sort(maps:to_list(Lines))
    ].

whose(team) -> #{name => "team", colour => 1};
whose(Robot) -> #{name => ["robot ", integer_to_list(Robot)], colour => Robot}.
