%% @doc Shows a witness as a table: each robot's clock, place and state at that moment.
-module(starl_debug_witness).

-export([rows/3, format/2]).

-export_type([row/0]).

%% The robot's clock (us of its recording, and less than the time line's), its place with the bound
%% of its error (mm), its modes, the tokens that it holds.
-type row() :: #{
    robot := starl:robot_id(),
    clock := integer(),
    offset := integer(),
    place := none | {starl_geometry:point(), Mm :: float()},
    is := [starl_debug_parser:name()]
}.

%% @doc The robots of a formula at a witness.
-spec rows(starl_debug_ground:t(), starl_debug_search:witness(), starl_debug_recording:t()) ->
    [row()].
rows(Formula, {At, Offsets}, Recording) ->
    [row(R, At, maps:get(R, Offsets, 0), Recording) || R <- starl_debug_ground:robots(Formula)].

row(R, At, Offset, #{states := States, tracks := Tracks, tokens := Tokens}) ->
    Clock = At + Offset,
    #{R := State} = States,
    #{
        robot => R,
        clock => Clock,
        offset => Offset,
        place => place(Clock, maps:get(R, Tracks, none)),
        is => [
            Word
         || {Word, What} <- what(Tokens), is_in(Clock, starl_debug_state:times(What, State))
        ]
    }.

what(Tokens) ->
    [{Mode, {mode, Mode}} || Mode <- starl_debug_type:modes()] ++
        [{<<"leader">>, {leader, any}}, {<<"coordinator">>, coordinator}] ++
        [{<<"holds ", Token/binary>>, {owner, {token, Token}}} || Token <- Tokens].

place(_Clock, none) -> none;
place(Clock, Track) -> starl_debug_track:place(Track, Clock).

is_in(At, {May, _Must}) -> starl_debug_set:intersect(May, [{At, At}]) =/= [].

%% @doc The rows as lines of a table; times in seconds since `Begun'.
-spec format([row()], Begun :: integer()) -> [unicode:chardata()].
format(Rows, Begun) ->
    Cells = [
        ["robot", "its clock", "ahead by", "place", "it is"] | [cells(Row, Begun) || Row <- Rows]
    ],
    Widths = [
        lists:max([string:length(lists:nth(N, Line)) || Line <- Cells])
     || N <- lists:seq(1, 5)
    ],
    [line(Line, Widths) || Line <- Cells].

cells(#{robot := R, clock := Clock, offset := Offset, place := Place, is := Is}, Begun) ->
    [
        "r" ++ integer_to_list(R),
        io_lib:format("~.4f s", [(Clock - Begun) / 1.0e6]),
        io_lib:format("~.1f ms", [Offset / 1000]),
        shown(Place),
        lists:join(", ", Is)
    ].

shown(none) -> "unknown";
shown({{X, Y}, Error}) when Error < 0.05 -> io_lib:format("(~.1f, ~.1f) mm", [X * 1.0, Y * 1.0]);
shown({{X, Y}, Error}) -> io_lib:format("(~.1f, ~.1f) ± ~.1f mm", [X * 1.0, Y * 1.0, Error]).

line(Cells, Widths) ->
    Padded = [string:pad(Cell, Width) || {Cell, Width} <- lists:zip(Cells, Widths)],
    ["  ", string:trim(lists:join("  ", Padded), trailing)].
