%% @doc Drives a robot through sections of a road that are guarded by tokens of mutual exclusion.
%% The robot acquires the token of the next section, checks that the section is free, and drives
%% there.
%%
%% A token's lease may run out while its robot, cut off or dead, still stands in the section. So the
%% next holder also looks. For applications (`starl_crossing', `starl_convoy').
-module(starl_sections).

-export([position/1, distance/2, others/1, take/2, leave/2, enter/3]).

-export_type([section/0]).

%% The way to the middle of a section, the middle last; no other robot may be nearer to it than `free_mm'. `within_ms'
%% (infinity): each point of the way is to be reached within this time. `far_mm' (infinity): a robot that is
%% farther from the middle is off its road.
-type section() :: #{
    token := term(),
    way := [starl_geometry:point(), ...],
    free_mm := number(),
    within_ms => pos_integer(),
    far_mm => number()
}.

-define(PATIENCE_MS, 5000).
-define(LOOK_MS, 500).

%% @doc Where the robot is; waits until it knows.
-spec position(starl:robot()) -> starl_geometry:point().
position(Robot) ->
    case starl:position(Robot) of
        {ok, {X, Y, _}} ->
            {X, Y};
        {error, _} ->
            ok = starl:sleep(Robot, ?LOOK_MS),
            position(Robot)
    end.

%% @doc How far another robot is (mm), as far as that is known.
-spec distance(starl:robot(), starl:robot_id()) -> {ok, float()} | {error, restarted | unknown}.
distance(Robot, Other) ->
    Here = position(Robot),
    case starl:position(Robot, Other) of
        {ok, {X, Y, _}} -> {ok, starl_geometry:distance(Here, {X, Y})};
        {error, _} = Error -> Error
    end.

%% @doc Where the other robots are; none while that is unknown.
-spec others(starl:robot()) -> [starl_geometry:point()].
others(Robot) ->
    case starl:positions(Robot) of
        {ok, Poses} -> [{X, Y} || {X, Y, _} <- maps:values(maps:remove(starl:id(Robot), Poses))];
        {error, _} -> []
    end.

%% @doc Acquires the token of the section where the robot is: the tokens that it holds then, this one or none.
-spec take(starl:robot(), Token) -> [Token].
take(Robot, Token) ->
    case starl_mutex:acquire(Robot, Token, ?PATIENCE_MS) of
        {ok, _Fence} -> [Token];
        {error, _} -> []
    end.

%% @doc The sections of these tokens are free again.
-spec leave(starl:robot(), [Token :: term()]) -> ok.
leave(Robot, Tokens) ->
    _ = [starl_mutex:release(Robot, Token) || Token <- Tokens],
    ok.

%% @doc Waits for the section for a while. If it is free, calls the function and drives there. `stuck': it has not come there in
%% time, and the token is free again; as when it believed to be elsewhere. `lost': it is far from the section, as when
%% it was led astray, and has not begun to drive.
-spec enter(starl:robot(), section(), Begins :: fun(() -> term())) ->
    ok | occupied | stuck | {lost, starl_geometry:point()}.
enter(Robot, #{token := Token, way := Way} = Section, Begins) ->
    case take(Robot, Token) of
        [] ->
            occupied;
        [Token] ->
            case look(Robot, lists:last(Way), Section) of
                free ->
                    _ = Begins(),
                    driven(
                        follow(Robot, Way, maps:get(within_ms, Section, infinity)), Robot, Token
                    );
                occupied ->
                    ok = leave(Robot, [Token]),
                    ok = starl:sleep(Robot, ?LOOK_MS),
                    occupied;
                {lost, _} = Lost ->
                    ok = leave(Robot, [Token]),
                    Lost
            end
    end.

driven(ok, _Robot, _Token) ->
    ok;
driven(stuck, Robot, Token) ->
    _ = starl:stop(Robot),
    ok = leave(Robot, [Token]),
    stuck.

look(Robot, Place, #{free_mm := Mm} = Section) ->
    Far = maps:get(far_mm, Section, infinity),
    Self = starl:id(Robot),
    case starl:positions(Robot) of
        {ok, #{Self := {X, Y, _}} = Poses} ->
            case starl_geometry:distance({X, Y}, Place) > Far of
                true -> {lost, {X, Y}};
                false -> free(Place, Mm, maps:values(maps:remove(Self, Poses)))
            end;
        {ok, Poses} ->
            free(Place, Mm, maps:values(Poses));
        {error, _} ->
            occupied
    end.

free(Place, Mm, Others) ->
    case lists:all(fun({X, Y, _}) -> starl_geometry:distance({X, Y}, Place) > Mm end, Others) of
        true -> free;
        false -> occupied
    end.

%% Who has been led past a point of the way, round a corner even, may reach the next one all the same.
follow(Robot, [Place | Way], Ms) ->
    case reached(Robot, Place, deadline(Robot, Ms)) of
        stuck when Way =:= [] -> stuck;
        _OkOrStuck -> follow(Robot, Way, Ms)
    end;
follow(_Robot, [], _Ms) ->
    ok.

%% Who is refused at once, by a wall between itself and the place, may be so for ever.
reached(Robot, Place, Deadline) ->
    case left(Robot, Deadline) of
        Ms when is_integer(Ms), Ms =< 0 ->
            stuck;
        Ms ->
            case starl:call(Robot, motion, {go_to, Place}, Ms) of
                {ok, ok} ->
                    ok;
                {error, timeout} ->
                    stuck;
                _StoppedOrRestarted ->
                    ok = starl:sleep(Robot, ?LOOK_MS),
                    reached(Robot, Place, Deadline)
            end
    end.

deadline(_Robot, infinity) -> infinity;
deadline(Robot, Ms) -> starl:now(Robot) + Ms.

left(_Robot, infinity) -> infinity;
left(Robot, Deadline) -> Deadline - starl:now(Robot).
