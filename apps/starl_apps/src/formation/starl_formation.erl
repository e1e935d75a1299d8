%% @doc Formation: a team elects a leader, who gives each robot a place in the order; then the team stands in
%% a circle, in a line, in a circle ..., each time turned a little further. At a barrier each waits
%% until all stand in their places.
%%
%% Measure: `error_mm', the distance of a robot from its place. Trace: {@link event()} (see {@link
%% starl_formation_monitor}).
-module(starl_formation).
-behaviour(starl_app).

-export([init/2, step/2]).
-export([options/0, blocks/0, monitors/1, guarantees/0, measures/0, report/2]).

-export_type([event/0]).

%% The robot stands in its place of this round; it knows that all do.
-type event() ::
    {in_place, Round :: pos_integer(), starl_geometry:point()} | {formed, Round :: pos_integer()}.

-type state() :: #{
    next :=
        elect
        | order
        | round
        | {drive, pos_integer(), starl_geometry:point()}
        | {wait, pos_integer()},
    order => [starl:robot_id(), ...],
    atom() => term()
}.

%% The pace of control (ms), the fastest drive (mm/s), and from where a robot drives straight (mm).
-define(PACE_MS, 250).
-define(SPEED, 300).
-define(NEAR_MM, 150).
%% From where a robot avoids another: the distance of their centres (mm).
-define(SHY_MM, 1000).
%% A formation stands so long (ms).
-define(HOLD_MS, 2000).

-spec options() -> [starl_options:option()].
options() ->
    [
        {shapes, {one_of, [circle, line, both]}, both, "the shapes, one after the other"},
        {rounds, {integer, 1, 1000}, 4, "how many formations, one after the other"},
        {spacing, {number, 400, 5000}, 900, "the distance of neighbours, where there is room, mm"},
        {tolerance, {number, 10, 1000}, 50, "a robot this near to its place is in it, mm"}
    ].

-spec blocks() -> [starl_block:entry()].
blocks() -> [starl_election, starl_registers, starl_barrier].

-spec monitors(starl_scene:context()) -> [{module(), map()}].
monitors(#{robots := Ids, options := #{tolerance := Mm}}) ->
    [{starl_formation_monitor, #{robots => Ids, tolerance_mm => Mm}}].

-spec measures() -> [{atom(), string()}].
measures() -> [{error_mm, "distance from the place in the formation, mm"}].

%% @doc What those who use a formation may rely on.
-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {formed, safety,
            "who first takes a formation for formed is right: every robot is in its place", [
                {barrier, together}, positions, store
            ]},
        {next, progress, "the next formation is formed within three minutes", [
            alive, delivery, store, {barrier, passed}, {motion, arrives}
        ]}
    ].

-spec init(starl:robot(), map()) -> state().
init(Robot, Options) ->
    case starl_registers:get(Robot, order) of
        {ok, Order} -> Options#{next => round, order => Order};
        {error, _} -> Options#{next => elect}
    end.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, Rounds :: pos_integer()}.
step(Robot, #{next := elect} = State) ->
    Me = starl:id(Robot),
    case {starl_election:elect(Robot, formation), starl:positions(Robot)} of
        {{ok, Me}, {ok, Poses}} ->
            _ = starl_registers:put(
                Robot, order, starl_formation_places:order(starl:participants(Robot), Poses)
            ),
            Text = io_lib:format("robot ~b leads", [Me]),
            ok = starl:draw(Robot, #{key => leader, text => Text, at => {200, 200}}),
            {continue, State#{next := order}};
        {{ok, Other}, _} when Other =/= Me ->
            {continue, State#{next := order}};
        _ ->
            {continue, State}
    end;
step(Robot, #{next := order} = State) ->
    case starl_registers:get(Robot, order) of
        {ok, Order} ->
            {continue, State#{next := round, order => Order}};
        {error, _} ->
            ok = starl:sleep(Robot, ?PACE_MS),
            {continue, State}
    end;
step(Robot, #{next := round, rounds := Rounds} = State) ->
    case {starl_barrier:round(Robot, formation), starl:floor(Robot)} of
        {{ok, Round}, _} when Round > Rounds ->
            {done, Rounds};
        {{ok, Round}, {ok, #{size := Size}}} ->
            {continue, State#{next := {drive, Round, place(Robot, Round, Size, State)}}};
        _ ->
            {continue, State}
    end;
step(Robot, #{next := {drive, Round, Place}, tolerance := Tolerance} = State) ->
    case starl:position(Robot) of
        {ok, {X, Y, _}} ->
            Mm = starl_geometry:distance(Place, {X, Y}),
            ok = starl:measure(Robot, error_mm, Mm),
            case Mm =< Tolerance of
                true ->
                    ok = starl:trace(Robot, {in_place, Round, Place}),
                    {continue, State#{next := {wait, Round}}};
                false ->
                    _ = drive(Robot, Place, Mm, State),
                    {continue, State}
            end;
        {error, _} ->
            ok = starl:sleep(Robot, ?PACE_MS),
            {continue, State}
    end;
step(Robot, #{next := {wait, Round}} = State) ->
    _ = starl:stop(Robot),
    case starl_barrier:sync(Robot, formation) of
        ok ->
            ok = starl:trace(Robot, {formed, Round}),
            ok = starl:sleep(Robot, ?HOLD_MS),
            {continue, State#{next := round}};
        {error, _} ->
            {continue, State}
    end.

place(Robot, Round, Size, #{order := Order} = State) ->
    Places = starl_formation_places:places(Round, length(Order), Size, State),
    {_, Place} = lists:keyfind(starl:id(Robot), 1, lists:zip(Order, Places)),
    ok = starl:draw(Robot, #{key => place, area => starl_drawing:circle(Place, 250)}),
    Place.

%% Near its place a robot drives straight to it; before that it keeps away from others.
drive(Robot, Place, Mm, _State) when Mm =< ?NEAR_MM ->
    starl:go_to(Robot, Place);
drive(Robot, Place, _Mm, #{spacing := Spacing}) ->
    Shy = min(?SHY_MM, 0.9 * Spacing),
    _ = starl_avoidance:drive(Robot, Place, #{speed => ?SPEED, shy_mm => Shy, ms => 3 * ?PACE_MS}),
    starl:sleep(Robot, ?PACE_MS).

%% -- the report -----------------------------------------------------------------------------

%% @doc The formations, and the greatest distance of a robot from its place when one was formed.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(_Scene, #{monitors := #{starl_formation_monitor := #{formed := Formed, worst_mm := Mm}}}) ->
    #{
        figures => [{formations, Formed}, {worst_mm, Mm}],
        formats => #{
            worst_mm => #{decimals => 1, label => "distance from the place when formed, mm"}
        },
        done => io_lib:format("~b formations", [Formed])
    }.
