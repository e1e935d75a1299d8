%% @doc Faults as data: each names its kind, its target and its time span.
%%
%% A fault is `{Id, FromMs, ToMs, Kind, Target, Params}'; times are of the run, in milliseconds,
%% and a fault holds from FromMs on and before ToMs. The table {@link starl_run_fault_kinds} defines each
%% kind completely: its class, its possible targets, and its parameters. Momentary faults
%% (a crash, a step of a clock) happen at FromMs.
-module(starl_run_fault).

-export([kinds/0, classes/0, kinds_of/1, check/1, targets/1, format_problem/1]).
-export([compile/1, strikes/1, holding/2, hits/2, healed_us/1]).
-export([class/1]).

-export_type([t/0, kind/0, class/0, target/0, compiled/0, problem/0, spec/0]).

-type t() :: {
    Id :: atom(),
    FromMs :: non_neg_integer(),
    ToMs :: non_neg_integer(),
    kind(),
    target(),
    Params :: #{atom() => term()}
}.

-type class() :: starl_run_fault_kinds:class().
-type kind() :: starl_run_fault_kinds:kind().
-type spec() :: starl_run_fault_kinds:spec().

%% The target of a fault: see the shapes in {@link starl_run_fault_kinds:spec()}.
-type target() ::
    all
    | starl:robot_id()
    | {starl:robot_id(), starl_machine:name()}
    | {starl:robot_id(), starl:robot_id()}
    | [starl:robot_id()].

%% A fault with its times in microseconds.
-type compiled() :: {
    Id :: atom(),
    FromUs :: non_neg_integer(),
    ToUs :: non_neg_integer(),
    kind(),
    target(),
    #{atom() => term()}
}.

-type problem() ::
    {shape, Place :: pos_integer(), term()}
    | {unknown_kind, atom(), term()}
    | {span, atom()}
    | {target, atom(), kind(), Shape :: atom(), term()}
    | {params, atom(), kind(), [starl_options:problem()]}
    | {missing_param, atom(), kind(), Key :: atom()}
    | {same_id, atom()}.

%% @doc All kinds of faults.
-spec kinds() -> [spec()].
kinds() -> starl_run_fault_kinds:all().

%% @doc The classes of faults.
-spec classes() -> [class()].
classes() -> [network, clock, process, location, actuation, serial, store, sense, floor].

%% @doc The kinds that `all', a class or a kind stands for.
-spec kinds_of(all | class() | kind()) -> [spec()].
kinds_of(What) ->
    [
        Spec
     || {Kind, Class, _, _, _} = Spec <- kinds(), lists:member(What, [all, Class, Kind])
    ].

%% @doc All problems of a list of faults.
-spec check(term()) -> [problem()].
check(Faults) -> check(Faults, 1, []).

check([Fault | Rest], N, Seen) when is_tuple(Fault), is_atom(element(1, Fault)) ->
    Id = element(1, Fault),
    Same = [{same_id, Id} || lists:member(Id, Seen)],
    Same ++ problems(Fault, N) ++ check(Rest, N + 1, [Id | Seen]);
check([Fault | Rest], N, Seen) ->
    [{shape, N, Fault} | check(Rest, N + 1, Seen)];
check([], _N, _Seen) ->
    [];
check(Tail, N, _Seen) ->
    [{shape, N, Tail}].

problems({Id, From, To, Kind, Target, Params}, N) when is_map(Params) ->
    case lists:keyfind(Kind, 1, kinds()) of
        {_, _, Shape, Specs, _} ->
            [{span, Id} || not is_span(From, To)] ++
                [{target, Id, Kind, Shape, Target} || not is_target(Shape, Target)] ++
                param_problems(Id, Kind, Params, Specs);
        false when is_atom(Kind) ->
            [{unknown_kind, Id, Kind}];
        false ->
            [{shape, N, Kind}]
    end;
problems(Fault, N) ->
    [{shape, N, Fault}].

is_span(From, To) -> is_integer(From) andalso From >= 0 andalso is_integer(To) andalso To >= From.

is_target(floor, Target) -> Target =:= all;
is_target(robots, all) -> true;
is_target(robots, Target) -> is_robot(Target);
is_target(robot, Target) -> is_robot(Target);
is_target(machine, {Robot, Name}) -> is_robot(Robot) andalso is_atom(Name);
is_target(link, {From, To}) -> is_robot(From) andalso is_robot(To);
is_target(link, Target) -> Target =:= all orelse is_robot(Target);
is_target(two, {A, B}) -> is_robot(A) andalso is_robot(B) andalso A =/= B;
is_target(group, [_ | _] = Group) -> is_group(Group);
is_target(_, _) -> false.

%% The tail of a user's list may be anything.
is_group([Robot | Group]) -> is_robot(Robot) andalso is_group(Group);
is_group(Tail) -> Tail =:= [].

is_robot(Robot) -> is_integer(Robot) andalso Robot > 0.

param_problems(Id, Kind, Params, Specs) ->
    Missing = [{missing_param, Id, Kind, Key} || {Key, _, _} <- Specs, not is_map_key(Key, Params)],
    case starl_options:check(Params, [{Key, Type, none, ""} || {Key, Type, _} <- Specs]) of
        {ok, _} -> Missing;
        {error, Problems} -> Missing ++ [{params, Id, Kind, Problems}]
    end.

%% @doc The robots that a fault names.
-spec targets(t()) -> [starl:robot_id()].
targets({_, _, _, _, all, _}) -> [];
targets({_, _, _, Kind, {Robot, _}, _}) when Kind =:= kill_machine; Kind =:= stand_still -> [Robot];
targets({_, _, _, _, {A, B}, _}) -> [A, B];
targets({_, _, _, _, Group, _}) when is_list(Group) -> Group;
targets({_, _, _, _, Robot, _}) -> [Robot].

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_problem(problem()) -> unicode:chardata().
format_problem({shape, N, {Id, _, _, _, _, _}}) when not is_atom(Id) ->
    io_lib:format("fault ~b of the list: its name is an atom, as in a~b, not ~0tP", [N, N, Id, 12]);
format_problem({shape, N, Fault}) ->
    io_lib:format(
        "fault ~b of the list: {Id, FromMs, ToMs, Kind, Target, #{}} expected, not ~0tP", [
            N, Fault, 12
        ]
    );
format_problem({unknown_kind, Id, Kind}) ->
    io_lib:format("fault ~ts: there is no kind ~ts~ts", [Id, Kind, near(Kind)]);
format_problem({span, Id}) ->
    io_lib:format("fault ~ts: FromMs and ToMs are whole numbers from 0 on, in this order", [Id]);
format_problem({target, Id, Kind, Shape, Target}) ->
    io_lib:format("fault ~ts: ~ts is for ~ts, not ~0tP", [Id, Kind, shape(Shape), Target, 12]);
format_problem({params, Id, Kind, Problems}) ->
    Lines = lists:join(", ", [starl_options:format_problem(P) || P <- Problems]),
    io_lib:format("fault ~ts, ~ts: ~ts", [Id, Kind, Lines]);
format_problem({missing_param, Id, Kind, Key}) ->
    io_lib:format("fault ~ts: ~ts needs the parameter ~ts", [Id, Kind, Key]);
format_problem({same_id, Id}) ->
    io_lib:format("fault ~ts: another one has this name", [Id]).

near(Kind) ->
    Near = starl_similar:atoms(Kind, [Known || {Known, _, _, _, _} <- kinds()]),
    starl_similar:meant(Near, "; ./starl faults lists the kinds").

shape(floor) -> "all";
shape(robots) -> "all or one Robot";
shape(robot) -> "one Robot";
shape(machine) -> "{Robot, Machine}";
shape(link) -> "all, a Robot that sends, or {From, To}";
shape(two) -> "two robots, {A, B}";
shape(group) -> "a list of robots".

%% @doc The same fault, with its times in microseconds.
-spec compile(t()) -> compiled().
compile({Id, From, To, Kind, Target, Params}) ->
    {Id, From * 1000, To * 1000, Kind, Target, Params}.

%% @doc The class of a fault.
-spec class(t()) -> class().
class({_, _, _, Kind, _, _}) ->
    {_, Class, _, _, _} = lists:keyfind(Kind, 1, kinds()),
    Class.

%% @doc The effects on robots when a fault begins or ends: which robot, when (us), and the effect.
-spec strikes(t()) -> [{starl:robot_id(), non_neg_integer(), Strike :: term()}].
strikes({Id, From, To, Kind, Target, Params}) ->
    Begin = 1000 * From,
    End = 1000 * To,
    case Kind of
        kill_machine ->
            [{element(1, Target), Begin, {kill_machine, element(2, Target)}}];
        kill_robot ->
            [{Target, Begin, kill_robot}];
        reboot ->
            [{Target, Begin, go_down}, {Target, End, come_up}];
        store_lost ->
            [{Target, Begin, go_down}, {Target, Begin, lose_store}, {Target, End, come_up}];
        store_set_back ->
            set_back(Id, Target, Begin, End);
        pause ->
            [{Target, Begin, {pause, End}}];
        stand_still ->
            stand_still(Target, Begin, End, Params);
        slow ->
            [{Target, Begin, {lag, 1000 * maps:get(lag_ms, Params)}}, {Target, End, {lag, 0}}];
        _ when Kind =:= wheel_stuck; Kind =:= wheel_slow; Kind =:= slip ->
            [{Target, Begin, turn_wheels}, {Target, End, turn_wheels}];
        _ ->
            []
    end.

%% A whole life of the robot that its store knows nothing of.
set_back(Id, Robot, Begin, End) ->
    [{Robot, Begin, Strike} || Strike <- [go_down, {save_store, Id}, come_up]] ++
        [{Robot, End, Strike} || Strike <- [go_down, {set_back_store, Id}, come_up]].

stand_still({Robot, Name}, Begin, End, #{actions := After}) ->
    [{Robot, Begin, {stand_still, Name, After, End}}, {Robot, End, go_on}].

%% @doc The faults that hold at a time.
-spec holding(non_neg_integer(), [compiled()]) -> [compiled()].
holding(Now, Faults) -> [F || {_, From, To, _, _, _} = F <- Faults, From =< Now, Now < To].

%% @doc Is this robot a target of the fault?
-spec hits(starl:robot_id(), compiled()) -> boolean().
hits(_Robot, {_, _, _, _, all, _}) -> true;
hits(Robot, {_, _, _, _, Robot, _}) -> true;
hits(Robot, {_, _, _, _, {A, B}, _}) -> Robot =:= A orelse Robot =:= B;
hits(Robot, {_, _, _, _, Group, _}) when is_list(Group) -> lists:member(Robot, Group);
hits(_, _) -> false.

%% @doc The time from which on no fault acts any more, in microseconds: the last delayed packets
%% have arrived. A dead robot stays dead.
-spec healed_us([t()]) -> non_neg_integer().
healed_us(Faults) -> round(1000 * lists:max([0 | [end_ms(Fault) || Fault <- Faults]])).

end_ms({_, From, _, Kind, _, _}) when
    Kind =:= kill_machine; Kind =:= kill_robot; Kind =:= clock_step
->
    From;
end_ms({_, _, To, _, _, #{extra_ms := Ms}}) ->
    To + Ms;
end_ms({_, _, To, _, _, _}) ->
    To.
