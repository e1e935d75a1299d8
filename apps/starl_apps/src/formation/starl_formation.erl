%% @doc Formation: a team elects a leader, who gives each robot a place in the order; then the team stands in
%% a circle, in a line, in a circle ..., each time turned a little further. At a barrier each waits
%% until all stand in their places.
%%
%% Faults: the leader keeps the order in its store before it tells it, so that in a later life it gives no other one.
%% Who takes part in the election after a restart, perhaps alone, looks for the order meanwhile. And who waits long
%% looks where it stands: wrong positions may have led it to a place that another one needs. Then those that stand
%% already may be in its way: who gets no nearer for a time drives round all places.
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
        | tell
        | order
        | round
        | {drive, pos_integer(), starl_geometry:point()}
        | {wait, pos_integer(), starl_geometry:point()},
    order => [starl:robot_id(), ...],
    %% the corners of the way round that it still has to drive
    round => [starl_geometry:point()],
    %% how near it has come to its place, and when, by its own clock (ms)
    nearest => {Mm :: number() | none, AtMs :: integer()},
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
%% The patience of an election, and of a wait for the others (ms).
-define(PATIENCE_MS, 10000).
%% Who has not come nearer by so much (mm) for so long (ms) drives round; it goes on at a corner from here (mm).
-define(NEARER_MM, 100).
-define(STUCK_MS, 15000).
-define(CORNER_MM, 300).

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
    case starl:stored(Robot) of
        {stored, Order} -> Options#{next => tell, order => Order};
        _NoneOrDamaged -> Options#{next => elect}
    end.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, Rounds :: pos_integer()}.
step(Robot, #{next := elect} = State) ->
    case starl_registers:get(Robot, order) of
        {ok, Order} -> {continue, State#{next := round, order => Order}};
        {error, _} -> {continue, elected(elect(Robot), Robot, State)}
    end;
step(Robot, #{next := tell, order := Order} = State) ->
    case starl_registers:put(Robot, order, Order) of
        ok -> {continue, State#{next := round}};
        {error, _} -> {continue, State}
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
            Place = place(Robot, Round, Size, State),
            {continue, begins(Robot, {drive, Round, Place}, State)};
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
                    {continue, State#{next := {wait, Round, Place}}};
                false ->
                    {continue, drive(Robot, {X, Y}, Mm, State)}
            end;
        {error, _} ->
            ok = starl:sleep(Robot, ?PACE_MS),
            {continue, State}
    end;
step(Robot, #{next := {wait, Round, _}} = State) ->
    _ = starl:stop(Robot),
    case starl_barrier:sync(Robot, formation, ?PATIENCE_MS) of
        ok ->
            ok = starl:trace(Robot, {formed, Round}),
            ok = starl:sleep(Robot, ?HOLD_MS),
            {continue, State#{next := round}};
        {error, _} ->
            {continue, look_again(starl:position(Robot), Robot, State)}
    end.

elect(Robot) -> {starl:id(Robot), starl_election:elect(Robot, formation, ?PATIENCE_MS)}.

elected({Me, {ok, Me}}, Robot, State) ->
    case starl:positions(Robot) of
        {ok, Poses} ->
            Order = starl_formation_places:order(starl:participants(Robot), Poses),
            ok = starl:store(Robot, Order),
            Text = io_lib:format("robot ~b leads", [Me]),
            ok = starl:draw(Robot, #{key => leader, text => Text, at => {200, 200}}),
            State#{next := tell, order => Order};
        {error, _} ->
            State
    end;
elected({_Me, {ok, _Other}}, _Robot, State) ->
    State#{next := order};
elected({_Me, {error, _}}, _Robot, State) ->
    State.

%% A robot that is a little off only measures a little otherwise.
look_again({ok, {X, Y, _}}, Robot, #{next := {wait, Round, Place}, tolerance := Mm} = State) ->
    case starl_geometry:distance(Place, {X, Y}) > 2 * Mm of
        true -> begins(Robot, {drive, Round, Place}, State);
        false -> State
    end;
look_again({error, _}, _Robot, State) ->
    State.

begins(Robot, Drive, State) ->
    State#{next := Drive, round => [], nearest => {none, starl:now(Robot)}}.

place(Robot, Round, Size, #{order := Order} = State) ->
    Places = starl_formation_places:places(Round, length(Order), Size, State),
    {_, Place} = lists:keyfind(starl:id(Robot), 1, lists:zip(Order, Places)),
    ok = starl:draw(Robot, #{key => place, area => starl_drawing:circle(Place, 250)}),
    Place.

%% Near its place a robot drives straight to it; before that it keeps away from others.
drive(Robot, _At, Mm, #{next := {drive, _, Place}} = State) when Mm =< ?NEAR_MM ->
    _ = starl:go_to(Robot, Place),
    State;
drive(Robot, At, Mm, State) ->
    #{round := Round, next := {drive, _, Place}} = Next = ahead(Robot, At, Mm, State),
    Options = #{speed => ?SPEED, shy_mm => shy(State), ms => 3 * ?PACE_MS},
    _ = starl_avoidance:drive(Robot, hd(Round ++ [Place]), Options),
    ok = starl:sleep(Robot, ?PACE_MS),
    Next.

shy(#{spacing := Spacing}) -> min(?SHY_MM, 0.9 * Spacing).

ahead(Robot, At, _Mm, #{round := [Corner | Corners], nearest := {_, Since}} = State) ->
    case starl_geometry:distance(At, Corner) =< ?CORNER_MM of
        true -> State#{round := Corners, nearest := {none, starl:now(Robot)}};
        %% no way there, either
        false -> given_up(starl:now(Robot) - Since > ?STUCK_MS, Robot, State)
    end;
ahead(Robot, At, Mm, #{round := [], nearest := {Nearest, Since}} = State) ->
    case starl:now(Robot) of
        Now when Nearest =:= none; Mm < Nearest - ?NEARER_MM -> State#{nearest := {Mm, Now}};
        Now when Now - Since > ?STUCK_MS ->
            State#{
                round := round(Robot, At, State), nearest := {none, Now}
            };
        _ ->
            State
    end.

given_up(true, Robot, State) -> State#{round := [], nearest := {none, starl:now(Robot)}};
given_up(false, _Robot, State) -> State.

round(Robot, At, #{next := {drive, Round, Place}, order := Order} = State) ->
    case starl:floor(Robot) of
        {ok, #{size := Size}} ->
            Places = starl_formation_places:places(Round, length(Order), Size, State),
            starl_formation_places:way_round(At, Place, {Places, shy(State)}, Size);
        {error, _} ->
            []
    end.

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
