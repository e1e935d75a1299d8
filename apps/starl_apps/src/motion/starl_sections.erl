%% @doc Sections of a road, each guarded by a token of mutual exclusion: a robot acquires the next one, looks whether it
%% is free, and drives there.
%%
%% A token's lease may run out while its robot, cut off or dead, still stands in the section; so who has the token also
%% looks. For applications (`starl_crossing', `starl_convoy').
-module(starl_sections).

-export([position/1, take/2, leave/2, enter/3]).

-export_type([section/0]).

%% The way to the middle of a section, the middle last; no other robot may be nearer to it than `free_mm'. `within_ms'
%% (infinity): each point of the way is to be reached within this time.
-type section() :: #{
    token := term(),
    way := [starl_geometry:point(), ...],
    free_mm := number(),
    within_ms => pos_integer()
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

%% @doc Acquires the token of the section where the robot is; does it hold it?
-spec take(starl:robot(), Token :: term()) -> boolean().
take(Robot, Token) ->
    case starl_mutex:acquire(Robot, Token, ?PATIENCE_MS) of
        {ok, _Fence} -> true;
        {error, _} -> false
    end.

%% @doc The section is free again.
-spec leave(starl:robot(), Token :: term()) -> ok.
leave(Robot, Token) ->
    _ = starl_mutex:release(Robot, Token),
    ok.

%% @doc Waits for the section for a while. If it is free, calls the function and drives there. `stuck': it has not come there in
%% time, and the token is free again; as when it believed to be elsewhere.
-spec enter(starl:robot(), section(), Begins :: fun(() -> term())) -> ok | occupied | stuck.
enter(Robot, #{token := Token, way := Way, free_mm := Mm} = Section, Begins) ->
    case take(Robot, Token) of
        false ->
            occupied;
        true ->
            case is_free(Robot, lists:last(Way), Mm) of
                true ->
                    _ = Begins(),
                    driven(
                        follow(Robot, Way, maps:get(within_ms, Section, infinity)), Robot, Token
                    );
                false ->
                    ok = leave(Robot, Token),
                    ok = starl:sleep(Robot, ?LOOK_MS),
                    occupied
            end
    end.

driven(ok, _Robot, _Token) ->
    ok;
driven(stuck, Robot, Token) ->
    _ = starl:stop(Robot),
    ok = leave(Robot, Token),
    stuck.

is_free(Robot, Place, Mm) ->
    case starl:positions(Robot) of
        {ok, Poses} ->
            Others = maps:values(maps:remove(starl:id(Robot), Poses)),
            lists:all(fun({X, Y, _}) -> starl_geometry:distance({X, Y}, Place) > Mm end, Others);
        {error, _} ->
            false
    end.

follow(Robot, [Place | Way], Ms) ->
    case starl:call(Robot, motion, {go_to, Place}, Ms) of
        {ok, ok} ->
            follow(Robot, Way, Ms);
        {error, timeout} ->
            stuck;
        _StoppedOrRestarted ->
            ok = starl:sleep(Robot, ?LOOK_MS),
            follow(Robot, [Place | Way], Ms)
    end;
follow(_Robot, [], _Ms) ->
    ok.
