%% @doc Draws random faults by swarm testing (Groce and others, 2012): a run first draws which
%% classes take part, then which kinds, then the faults. Without some features, the others meet in
%% combinations that are rare in a run with all of them.
%%
%% All draws are stateless, so the draws for one kind do not depend on another.
%%
%% A clock that is set rarely comes alone: when a network comes back, it sets the clocks of others
%% too, and a computer that was halted gets its clock set. So a drawn setting may bring another
%% robot's with it, the other way, or a pause of its robot within the time of a lease.
-module(starl_run_fault_draw).

-export([draw/1, again/4]).

-export_type([request/0]).

%% The robots and machines to hit, the time before which faults end, the longest fault (default a
%% third of that time), and what to draw: `all', classes and kinds. `floor' (none): the number of doors
%% of the floor plan, and its size; without one there is nothing to sense.
-type request() :: #{
    seed := integer(),
    robots := pos_integer(),
    machines := [starl_machine:name()],
    until_ms := pos_integer(),
    longest_ms => pos_integer(),
    floor => {Doors :: non_neg_integer(), Size :: {float(), float()}} | none,
    kinds := [all | starl_run_fault:class() | starl_run_fault:kind()]
}.

%% The probability that a class takes part, and a kind of such a class; the most faults of a kind.
-define(CLASS_IN, 0.7).
-define(KIND_IN, 0.5).
-define(MOST, 3).
%% The probability that a setting brings another, or a pause; the most time between them, ms.
-define(COMPANION_IN, 0.4).
-define(SET_TOGETHER_MS, 500).
-define(HALTED_WITHIN_MS, 5000).

%% @doc The faults of a run; all end before the given time, except permanent ones.
-spec draw(request()) -> [starl_run_fault:t()].
draw(#{seed := Seed, kinds := What} = Request) ->
    Specs = lists:usort(lists:append([starl_run_fault:kinds_of(W) || W <- What])),
    lists:append([
        faults(Spec, Request)
     || {Kind, Class, _, _, _} = Spec <- Specs,
        %% drops of single packets are left to the shrinker
        Kind =/= drop,
        is_possible(Spec, Request),
        uniform({Seed, Class, in}) < ?CLASS_IN,
        uniform({Seed, Kind, in}) < ?KIND_IN
    ]).

%% @doc The same fault at another time and, unless it strikes all, elsewhere: it begins at any of the
%% `WithinMs' milliseconds after a time, and lasts as long. Its parameters stay.
-spec again(starl_run_fault:t(), {AfterMs, WithinMs}, Key :: term(), Team) ->
    starl_run_fault:t()
when
    AfterMs :: non_neg_integer(),
    WithinMs :: pos_integer(),
    Team :: #{robots := pos_integer(), seed := integer()}.
again({Id, From, To, Kind, Target, Params}, {AfterMs, WithinMs}, Key0, Team) ->
    Key = {Key0, Id},
    At = AfterMs + starl_run_draw:between({Key, from}, 1, WithinMs),
    {_, _, Shape, _, _} = lists:keyfind(Kind, 1, starl_run_fault:kinds()),
    {Id, At, At + To - From, Kind, elsewhere(Shape, Target, Key, Team), Params}.

elsewhere(_Shape, all, _Key, _Team) -> all;
elsewhere(machine, {_, Name}, Key, Team) -> {robot(Key, Team), Name};
elsewhere(two, Two, _Key, #{robots := 1}) -> Two;
elsewhere(link, {_, _}, Key, #{robots := N} = Team) when N > 1 -> target(two, Key, Team);
elsewhere(link, Target, Key, Team) when is_integer(Target) -> robot(Key, Team);
elsewhere(robots, _, Key, Team) -> robot(Key, Team);
elsewhere(link, Target, _Key, _Team) -> Target;
elsewhere(Shape, _, Key, Team) -> target(Shape, Key, Team).

%% A single robot has no other to be confused with.
is_possible({_, _, two, _, _}, #{robots := 1}) ->
    false;
is_possible({Kind, Class, _, _, _}, Request) when Class =:= sense; Class =:= floor ->
    case maps:get(floor, Request, none) of
        none -> false;
        {0, _} -> Kind =/= closed;
        {_, _} -> true
    end;
is_possible(_Spec, _Request) ->
    true.

faults({Kind, _, _, _, _} = Spec, #{seed := Seed} = Request) ->
    Count = starl_run_draw:between({Seed, Kind, count}, 1, ?MOST),
    Faults = [fault(Spec, {Seed, Kind, N}, N, Request) || N <- lists:seq(1, Count)],
    Faults ++ lists:append([companions(Fault, Request) || Fault <- Faults]).

companions({Id, From, _, clock_step, Robot, #{ms := Ms}}, #{seed := Seed} = Request) ->
    Key = {Seed, Id},
    #{robots := Robots, kinds := What} = Request,
    Pauses = lists:any(fun(W) -> lists:member(W, [all, process, pause]) end, What),
    [
        set_apart(Id, From, Robot, Ms, {Key, apart}, Request)
     || Robots > 1, uniform({Key, apart}) < ?COMPANION_IN
    ] ++
        [
            halted(Id, From, Robot, {Key, halted}, Request)
         || Pauses, uniform({Key, halted}) < ?COMPANION_IN
        ];
companions(_Fault, _Request) ->
    [].

set_apart(Id, From, Robot, Ms, Key, #{robots := N, until_ms := UntilMs}) ->
    At = min(UntilMs - 1, From + starl_run_draw:between({Key, from}, 0, ?SET_TOGETHER_MS)),
    Other = 1 + (Robot - 1 + starl_run_draw:between({Key, other}, 1, N - 1)) rem N,
    {label(Id, apart), At, At, clock_step, Other, #{ms => opposite(Ms, Key)}}.

%% The other way, by as much as the kind is drawn.
opposite(Ms, Key) ->
    {_, _, _, [{ms, _, {_, Most}}], _} = lists:keyfind(clock_step, 1, starl_run_fault:kinds()),
    case starl_run_draw:between({Key, ms}, 1, Most) of
        Other when Ms > 0 -> -Other;
        Other -> Other
    end.

halted(Id, Set, Robot, Key, #{until_ms := UntilMs} = Request) ->
    Apart = starl_run_draw:between({Key, from}, -?HALTED_WITHIN_MS, ?HALTED_WITHIN_MS),
    From = max(0, min(UntilMs - 1, Set + Apart)),
    {label(Id, halted), From, end_of(From, Key, Request), pause, Robot, #{}}.

%% A bounded number of atoms: two for each setting.
label(Id, What) -> list_to_atom(lists:concat([Id, "_", What])).

fault({Kind, _, Shape, Params, _}, Key, N, Request) ->
    #{until_ms := UntilMs} = Request,
    From = starl_run_draw:between({Key, from}, 0, UntilMs - 1),
    To = end_of(From, Key, Request),
    %% a bounded number of atoms: the number of kinds times ?MOST
    Id = list_to_atom(lists:concat([Kind, "_", N])),
    Values = maps:from_list([
        {Name, value(Type, on_floor(Name, Range, Request), {Key, Name})}
     || {Name, Type, Range} <- Params
    ]),
    {Id, From, To, Kind, target(Shape, Key, Request), Values}.

%% One of the plan's doors, a place on the plan.
on_floor(door, _, #{floor := {Doors, _}}) -> {1, Doors};
on_floor(x, _, #{floor := {_, {W, _}}}) -> {0, W};
on_floor(y, _, #{floor := {_, {_, H}}}) -> {0, H};
on_floor(_Name, Range, _Request) -> Range.

%% Mostly short, now and then nearly as long as allowed.
end_of(From, Key, #{until_ms := UntilMs} = Request) ->
    Longest = maps:get(longest_ms, Request, max(1, UntilMs div 3)),
    Span = round(Longest * math:pow(uniform({Key, span}), 2)),
    min(UntilMs, From + 1 + Span).

value({integer, _, _}, {Low, High}, Key) -> starl_run_draw:between(Key, Low, High);
value({number, _, _}, {Low, High}, Key) -> Low + (High - Low) * uniform(Key);
value({one_of, Atoms}, _, Key) -> pick(Atoms, Key).

target(robots, Key, Request) ->
    case uniform({Key, all}) < 0.5 of
        true -> all;
        false -> robot(Key, Request)
    end;
target(floor, _Key, _Request) ->
    all;
target(robot, Key, Request) ->
    robot(Key, Request);
target(machine, Key, #{machines := Names} = Request) ->
    {robot(Key, Request), pick(Names, {Key, machine})};
target(link, Key, Request) ->
    case starl_run_draw:between({Key, link}, 1, 3) of
        1 -> all;
        2 -> robot(Key, Request);
        3 -> {robot(Key, Request), robot({Key, dest}, Request)}
    end;
target(group, Key, Request) ->
    group(Key, Request);
target(two, Key, #{robots := N} = Request) ->
    A = robot(Key, Request),
    {A, 1 + (A - 1 + starl_run_draw:between({Key, other}, 1, N - 1)) rem N}.

%% Halves of a team would hide a failure that a single robot shows when it is cut off.
group(Key, #{robots := N} = Request) ->
    Size = starl_run_draw:between({Key, size}, 1, max(1, N - 1)),
    First = robot(Key, Request),
    Others = lists:sort([{uniform({Key, member, R}), R} || R <- lists:seq(1, N), R =/= First]),
    lists:sort([First | [R || {_, R} <- lists:sublist(Others, Size - 1)]]).

%% Half of all faults of one robot hit the same robot: several faults of one robot show more
%% than one fault on each of many.
robot(Key, #{robots := N, seed := Seed}) ->
    case uniform({Key, victim}) < 0.5 of
        true -> starl_run_draw:between({Seed, victim}, 1, N);
        false -> starl_run_draw:between({Key, robot}, 1, N)
    end.

pick(List, Key) -> lists:nth(starl_run_draw:between(Key, 1, length(List)), List).

uniform(Key) -> starl_run_draw:uniform(Key).
