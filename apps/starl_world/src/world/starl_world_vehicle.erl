%% @doc The vehicle of one robot in the world: the body of the simulator ({@link starl_sim_vehicle}),
%% moved in real time. A pure module.
%%
%% The steps of its chassis take place at their exact times, even if the world looks later: before
%% anything else happens to a body, {@link advance/2} catches up.
-module(starl_world_vehicle).

-export([new/3, advance/2, next_due/1, drive/4, actuate/4, stop/2, pose/2, piece/1, on_floor/3]).
-export([moves/2]).

-export_type([t/0, change/0]).

-record(body, {
    id :: starl:robot_id(),
    vehicle :: starl_sim_vehicle:t(),
    %% its motion, as reported by a chassis that moves it elsewhere
    reported = none :: starl_trajectory:piece() | none,
    %% the planned steps and answers of the chassis, ascending
    agenda = [] :: [{DueUs :: integer(), N :: non_neg_integer(), Content :: term()}],
    n = 0 :: non_neg_integer()
}).

-opaque t() :: #body{}.

%% The facts, and the answers of the chassis to its robot, oldest first; the vehicle.
-type change() :: {
    [starl_monitor:trace_event()], [{Mark :: term(), starl_live_chassis:answer()}], t()
}.

%% @doc A body at rest at a pose, in the world of a simulation.
-spec new(starl:robot_id(), starl:pose(), starl_sim_vehicle:world()) ->
    {[starl_monitor:trace_event()], t()}.
new(Id, Pose, World) ->
    Vehicle = starl_sim_vehicle:new(Id, Pose, World),
    Piece = starl_sim_vehicle:piece(Vehicle),
    {[{0, Id, chassis, {motion, Piece}}], #body{id = Id, vehicle = Vehicle}}.

%% @doc The time of the next step or answer of the chassis.
-spec next_due(t()) -> integer() | none.
next_due(#body{agenda = []}) -> none;
next_due(#body{agenda = [{Due, _, _} | _]}) -> Due.

%% @doc Lets everything happen that is due until now.
-spec advance(NowUs :: integer(), t()) -> change().
advance(Now, Body) -> advance(Now, [], [], Body).

advance(Now, Traces, Answers, #body{agenda = [{Due, _, What} | Agenda]} = Body) when Due =< Now ->
    {Traced, Answered, Next} = happens(What, Due, Body#body{agenda = Agenda}),
    advance(Now, [Traced | Traces], [Answered | Answers], Next);
advance(_Now, Traces, Answers, Body) ->
    {lists:append(lists:reverse(Traces)), lists:append(lists:reverse(Answers)), Body}.

happens({says, Run, chassis, Answer}, _Due, #body{vehicle = Vehicle} = Body) ->
    case starl_sim_vehicle:says(Run, Vehicle) of
        true -> {[], [answer(Answer)], Body};
        false -> {[], [], Body}
    end;
happens({chassis, info, Answer}, _Due, Body) ->
    {[], [answer(Answer)], Body};
happens(Beat, Due, #body{vehicle = Vehicle} = Body) ->
    moved(Due, starl_sim_vehicle:beat(Beat, Due, Vehicle), Body).

answer({driven, Mark, Us}) -> {Mark, {driven, Us}};
answer({stalled, Mark, Told}) -> {Mark, {stalled, Told}};
answer({actuated, Mark, Device, Value}) -> {Mark, {actuated, Device, Value}}.

%% @doc The chassis hears a script.
-spec drive(starl_chassis:script(), Mark :: term(), NowUs :: integer(), t()) -> change().
drive(Script, Mark, Now, Body0) ->
    {Traces, Answers, #body{id = Id, vehicle = Vehicle} = Body} = advance(Now, Body0),
    {Traced, Answered, Next} =
        case starl_sim_vehicle:drive(Script, {chassis, Mark}, Now, Vehicle) of
            {lost, Deaf} ->
                {[], [], Body#body{vehicle = Deaf}};
            not_understood ->
                {[{Now, Id, chassis, {not_understood, element(2, Script)}}], [], Body};
            Change ->
                moved(Now, Change, Body)
        end,
    {Traces ++ Traced, Answers ++ Answered, Next}.

%% @doc Another actuator hears a command.
-spec actuate({atom(), term()}, {mark, term()} | none, NowUs :: integer(), t()) -> change().
actuate({Device, Value}, Mark, Now, Body0) ->
    {Traces, Answers, #body{id = Id, vehicle = Vehicle} = Body} = advance(Now, Body0),
    Owner =
        case Mark of
            {mark, M} -> {chassis, M};
            none -> none
        end,
    {Set, Plans, Actuated} = starl_sim_vehicle:actuate({Device, Value}, Owner, Now, Vehicle),
    Traced = [{Now, Id, chassis, {actuated, Device, Value}} || Set =:= set],
    {Traces ++ Traced, Answers, planned(Now, Plans, Body#body{vehicle = Actuated})}.

%% @doc Moves the body along this piece from its beginning on, whatever its chassis was commanded;
%% `same': as before.
-spec moves(starl_trajectory:piece() | same, t()) -> change().
moves(same, Body) ->
    {[], [], Body};
moves(Piece, #body{id = Id} = Body) ->
    Fact = {starl_trajectory:start_us(Piece), Id, chassis, {motion, Piece}},
    {[Fact], [], Body#body{reported = Piece}}.

%% @doc The chassis comes to rest. A body that is moved elsewhere stands where it was.
-spec stop(NowUs :: integer(), t()) -> change().
stop(_Now, #body{reported = {piece, _, _, _, _, V, W}} = Body) when V == 0, W == 0 ->
    {[], [], Body};
stop(Now, #body{reported = Piece} = Body) when Piece =/= none ->
    moves(starl_trajectory:stop(max(Now, starl_trajectory:start_us(Piece)), Piece), Body);
stop(Now, Body0) ->
    {Traces, Answers, #body{vehicle = Vehicle} = Body} = advance(Now, Body0),
    {Traced, Answered, Next} = moved(Now, starl_sim_vehicle:stop(Now, Vehicle), Body),
    {Traces ++ Traced, Answers ++ Answered, Next}.

moved(Now, {same, Plans, Vehicle}, Body) ->
    {[], [], planned(Now, Plans, Body#body{vehicle = Vehicle})};
moved(Now, {moved, Plans, Vehicle}, #body{id = Id} = Body) ->
    Piece = starl_sim_vehicle:piece(Vehicle),
    Motion = {Now, Id, chassis, {motion, Piece}},
    {[Motion], [], planned(Now, Plans, Body#body{vehicle = Vehicle})}.

planned(Now, Plans, #body{agenda = Agenda, n = N} = Body) ->
    Count = length(Plans),
    New = [{Now + Us, M, What} || {M, {Us, What}} <- lists:zip(lists:seq(N, N + Count - 1), Plans)],
    Body#body{agenda = lists:merge(lists:sort(New), Agenda), n = N + Count}.

%% @doc The true pose at a time, after {@link advance/2} to it.
-spec pose(NowUs :: integer(), t()) -> starl:pose().
pose(Now, Body) -> starl_trajectory:pose(Now, piece(Body)).

%% @doc The piece of motion that it is in.
-spec piece(t()) -> starl_trajectory:piece().
piece(#body{reported = none, vehicle = Vehicle}) -> starl_sim_vehicle:piece(Vehicle);
piece(#body{reported = Piece}) -> Piece.

%% @doc Where it is, and how it moves, at a time: for {@link starl_world_floor}.
-spec on_floor(starl:robot_id(), NowUs :: integer(), t()) -> starl_world_floor:body().
on_floor(Id, Now, Body) ->
    {_, _, Caught} = advance(Now, Body),
    Piece = piece(Caught),
    At = max(Now, starl_trajectory:start_us(Piece)),
    {Id, starl_trajectory:pose(At, Piece), starl_trajectory:velocity(At, Piece)}.
