%% @doc Lists the time windows in which faults break the assumptions of contracts about clocks,
%% promptness or positions ({@link starl_assumption}). Monitors ask for these windows. Contracts
%% must hold under all other faults.
-module(starl_run_assumption).

-export([broken/2, positions/1, senses/1, faults/1, places/1, bodies/2, core/3, radio/2, ends/1]).

%% Clocks are within 1 % of real time.
-define(DRIFT_PPM, 10000).
%% Wheels slip by no more than half.
-define(SLIP, 0.5).
%% A loss or a delay of the radio that bounds allow for, however long it lasts; and one that they allow for where
%% it lasts for most of the run.
-define(LITTLE_LOSS, 0.02).
-define(LITTLE_MS, 5).
-define(SOME_LOSS, 0.5).
-define(SOME_MS, 200).
%% Robots look after a way that was closed again and again, and drive there meanwhile.
-define(REOPENED_US, 60000000).

%% @doc The windows in which these faults break an assumption. A positioning system that is not
%% exact is found out when it freezes (`starl_location'), so only an exact one breaks an assumption
%% then.
-spec broken([starl_run_fault:t()], IsExact :: boolean()) -> [starl_assumption:window()].
broken(Faults, IsExact) ->
    lists:append([
        windows(starl_run_fault:compile(Fault))
     || {_, _, _, Kind, _, _} = Fault <- Faults, IsExact orelse Kind =/= location_frozen
    ]).

windows({_, Time, Time, Kind, _, _}) when Kind =/= clock_step ->
    [];
windows({_, From, To, clock_offset, Robot, #{ms := Ms}}) ->
    shift(Robot, From, 1000 * Ms) ++ shift(Robot, To, -1000 * Ms);
windows({_, From, _, clock_step, Robot, #{ms := Ms}}) ->
    shift(Robot, From, 1000 * Ms);
windows({_, From, To, clock_freeze, Robot, _}) ->
    [{Robot, From, To, {clock, From - To}}];
windows({_, From, To, clock_drift, Robot, #{ppm := Ppm}}) when abs(Ppm) > ?DRIFT_PPM ->
    [{Robot, From, To, {clock, round((To - From) * Ppm / 1000000)}}];
windows({_, From, To, pause, Robot, _}) ->
    [{Robot, From, To, pause}];
windows({_, From, To, stand_still, {Robot, Machine}, _}) ->
    [{Robot, From, To, pause}, {Robot, From, To, still}] ++
        [{Robot, From, To, caller} || Machine =:= app];
windows({_, From, To, slow, Robot, #{lag_ms := Ms}}) ->
    [{Robot, From, To, {slow, 1000 * Ms}}];
windows({_, From, To, location_frozen, Robots, _}) ->
    [{Robots, From, To, position}];
windows({_, From, To, location_swap, {A, B}, _}) ->
    [{A, From, To, position}, {B, From, To, position}];
windows(_) ->
    [].

%% @doc The windows in which robots get positions with larger errors than usual, besides those of
%% {@link broken/2}. They concern only contracts about places: a block that uses no positions must
%% work in spite of them.
-spec positions([starl_run_fault:t()]) -> [starl_assumption:window()].
positions(Faults) ->
    [
        {Robot, 1000 * From, 1000 * To, position}
     || {_, From, To, Kind, Robot, #{mm := Mm}} <- Faults,
        Kind =:= location_noise orelse Kind =:= location_bias,
        Mm > 0
    ].

%% @doc The windows in which a robot's senses answer what is not so. A sense that is gone does not answer.
-spec senses([starl_run_fault:t()]) -> [starl_assumption:window()].
senses(Faults) ->
    [
        {Robot, 1000 * From, 1000 * To, fault}
     || {_, From, To, Kind, Robot, _} = Fault <- Faults,
        starl_run_fault:class(Fault) =:= sense,
        Kind =/= sense_gone
    ].

%% @doc The windows of the faults that may cost a team time: those of the network, of computers, of
%% stores, of the floor, and of clocks that do not keep their bound. A timer that runs while its clock is set back is
%% late by that, what is under way in a slow radio comes later, and a computer that is slow has a
%% queue.
-spec faults([starl_run_fault:t()]) -> [starl_assumption:window()].
faults(Faults) ->
    lists:append([
        [{Robot, From, To + rest(Kind, To - From, Params), fault} || Robot <- struck(Fault)]
     || {_, _, _, Kind, _, _} = Fault <- Faults,
        lists:member(starl_run_fault:class(Fault), [network, clock, process, store, floor]),
        {_, From, To, _, _, Params} <- [starl_run_fault:compile(Fault)],
        Kind =/= clock_drift orelse abs(maps:get(ppm, Params)) > ?DRIFT_PPM
    ]).

%% @doc The windows of the faults that keep a robot from knowing its place, or from moving as its program says: of
%% the positioning system and of the line to the chassis. Wheels that turn slowly are none: the robot arrives later.
-spec places([starl_run_fault:t()]) -> [starl_assumption:window()].
places(Faults) ->
    [
        {Robot, From, To, fault}
     || Fault <- Faults,
        lists:member(starl_run_fault:class(Fault), [location, serial]),
        {_, From, To, _, _, _} <- [starl_run_fault:compile(Fault)],
        Robot <- struck(Fault)
    ].

%% @doc Splits off the faults that change the radio only a little, or only a little for most of the run: by a small
%% delay, by the loss of a small part of the packets, or by copies. They are no excuse. Bounds allow for them instead:
%% the part of the packets that they lose, and the time by which they delay one (us), on the link that they strike
%% most, are taken for every link.
-spec radio([starl_run_fault:t()], EndUs :: non_neg_integer()) ->
    {Lost :: float(), ExtraUs :: non_neg_integer(), Others :: [starl_run_fault:t()]}.
radio(Faults, EndUs) ->
    {Mild, Others} = lists:partition(fun(Fault) -> is_mild(Fault, EndUs div 1000) end, Faults),
    Arrive = lists:foldl(fun(Fault, Part) -> Part * (1 - lost(Fault)) end, 1.0, Mild),
    {1.0 - Arrive, 1000 * lists:sum([extra_ms(Fault) || Fault <- Mild]), Others}.

is_mild({_, _, _, Kind, _, _}, _EndMs) when Kind =:= duplicate; Kind =:= babble ->
    true;
is_mild({_, From, To, Kind, _, #{part := Part}}, EndMs) when Kind =:= loss; Kind =:= corrupt ->
    Part =< ?LITTLE_LOSS orelse (Part =< ?SOME_LOSS andalso lasts(From, To, EndMs));
is_mild({_, From, To, Kind, _, #{extra_ms := Ms}}, EndMs) when Kind =:= delay; Kind =:= reorder ->
    Ms =< ?LITTLE_MS orelse (Ms =< ?SOME_MS andalso lasts(From, To, EndMs));
is_mild(_Fault, _EndMs) ->
    false.

lasts(From, To, EndMs) -> 2 * (To - From) >= EndMs.

lost({_, _, _, Kind, _, #{part := Part}}) when Kind =:= loss; Kind =:= corrupt -> Part;
lost(_Fault) -> 0.

extra_ms({_, _, _, _, _, #{extra_ms := Ms}}) -> Ms;
extra_ms(_Fault) -> 0.

%% @doc When the last fault of each class is over (us). A clock that drifts by less than its bound is no fault.
-spec ends([starl_run_fault:t()]) -> #{starl_run_fault:class() => non_neg_integer()}.
ends(Faults) ->
    Of = maps:groups_from_list(
        fun starl_run_fault:class/1, [Fault || Fault <- Faults, not is_small_drift(Fault)]
    ),
    maps:map(fun(_Class, Same) -> starl_run_fault:healed_us(Same) end, Of).

is_small_drift({_, _, _, clock_drift, _, #{ppm := Ppm}}) -> abs(Ppm) =< ?DRIFT_PPM;
is_small_drift(_Fault) -> false.

%% @doc The core of a team, a majority for which all faults have an end, though some last until the end
%% of the run: the robots beside it (the smaller part, where a fault separates two; one end of a single link), and the faults that
%% have an end. Without a majority there is no core.
-spec core([starl_run_fault:t()], [starl:robot_id()], EndUs :: integer()) ->
    {Rest :: [starl:robot_id()], [starl_run_fault:t()]}.
core(Faults, Team, EndUs) ->
    {Endless, Ending} = lists:partition(
        fun({_, _, To, Kind, _, _}) -> Kind =/= kill_robot andalso 1000 * To >= EndUs end, Faults
    ),
    {Links, Others} = lists:partition(fun is_link/1, Endless),
    Struck = lists:usort(lists:append([beside(Fault, Team) || Fault <- Others])),
    Rest = lists:usort(Struck ++ ends([Link || {_, _, _, _, Link, _} <- Links], Struck)),
    case 2 * length(Rest) < length(Team) of
        true -> {Rest, Ending};
        false -> {[], Faults}
    end.

is_link({_, _, _, _, Link, _} = Fault) ->
    is_tuple(Link) andalso starl_run_fault:class(Fault) =:= network.

%% One end of each link, as few robots as are found by taking the end of most links first.
ends(Links, Struck) ->
    Left = [Link || {A, B} = Link <- Links, [R || R <- [A, B], lists:member(R, Struck)] =:= []],
    Ends = lists:append([[A, B] || {A, B} <- Left]),
    case lists:sort([{-length([E || E <- Ends, E =:= R]), R} || R <- lists:usort(Ends)]) of
        [] -> [];
        [{_, Most} | _] -> [Most | ends(Left, [Most])]
    end.

beside({_, _, _, Kind, Group, _}, Team) when
    Kind =:= partition; Kind =:= one_way_partition
->
    case 2 * length(Group) < length(Team) of
        true -> Group;
        false -> Team -- Group
    end;
%% Of two robots one of which does not hear the other, the one that does not hear.
beside({_, _, _, loss, {_From, To}, _}, _Team) ->
    [To];
beside(Fault, Team) ->
    case starl_run_fault:targets(Fault) of
        [] -> Team;
        Robots -> Robots
    end.

%% @doc The windows of the faults that may cost a robot's drive time, or lead it off its line: positions
%% that are wrong by more than their bound (a picture that freezes is found out unless positions are
%% exact), and wheels that slip by more than half. Of a computer that stands still it is told apart.
-spec bodies([starl_run_fault:t()], IsExact :: boolean()) -> [starl_assumption:window()].
bodies(Faults, IsExact) ->
    lists:append([
        [
            {Robot, From, To + rest(Kind, To - From, Params), costs(Kind, Params, IsExact)}
         || Robot <- struck(Fault)
        ]
     || {_, _, _, Kind, _, _} = Fault <- Faults,
        not lists:member(starl_run_fault:class(Fault), [network, floor]),
        not lists:member(Kind, [actuator_lost, actuator_stuck]),
        {_, From, To, _, _, Params} <- [starl_run_fault:compile(Fault)],
        Kind =/= clock_drift orelse abs(maps:get(ppm, Params)) > ?DRIFT_PPM
    ]).

costs(location_frozen, _Params, true) ->
    position;
costs(slip, #{factor := Factor}, _IsExact) when Factor < ?SLIP -> position;
costs(stand_still, _Params, _IsExact) ->
    still;
costs(pause, _Params, _IsExact) ->
    pause;
costs(Kind, _Params, _IsExact) ->
    case starl_assumption:misleads(Kind) of
        true -> position;
        false -> fault
    end.

rest(_Kind, _Us, #{extra_ms := Ms}) -> 1000 * Ms;
rest(_Kind, _Us, #{lag_ms := Ms}) -> 1000 * Ms;
rest(_Kind, _Us, #{ms := Ms}) -> 1000 * abs(Ms);
rest(Kind, _Us, _Params) when Kind =:= closed; Kind =:= obstacle -> ?REOPENED_US;
rest(clock_freeze, Us, _Params) -> Us;
rest(clock_drift, Us, #{ppm := Ppm}) -> Us * abs(round(Ppm)) div 1000000 + 1;
rest(_Kind, _Us, _Params) -> 0.

%% Whom a group or a part of the floor does not hear, it costs time as well.
struck({_, _, _, Kind, _, _}) when
    Kind =:= partition; Kind =:= one_way_partition; Kind =:= ring; Kind =:= range
->
    [all];
struck(Fault) ->
    case starl_run_fault:targets(Fault) of
        [] -> [all];
        Robots -> lists:usort(Robots)
    end.

shift(_Robot, _Time, 0) -> [];
shift(Robot, Time, Us) -> [{Robot, Time, Time, {clock, Us}}].
