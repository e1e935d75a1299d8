%% @doc The states of a checked team. A state consists of numbers (see {@link starl_check_part}) for
%% the monitor, for each robot and, in ascending order, for the messages under way; and of the
%% remaining budgets of faults.
%%
%% A state is identified by a hash of 128 bits of its canonical form. Robots that differ only in
%% their number may change places: the least of the resulting states is canonical.
-module(starl_check_state).

-export([new/2, places/1, pack/1, unpack/1, budgets/1, key/4, renamed/4]).

-export_type([t/0]).

-type place() :: starl_check_term:place().
-type store() :: starl_check_store:t().
-type model() :: starl_check_model:t().
-type ref() :: starl_check_part:ref().

%% `stale': pairs of robots; the SAP of the first may not know yet that that of the second has
%% restarted.
-type t() :: #{
    monitor := ref(),
    robots := tuple(),
    items := [ref()],
    loss := non_neg_integer(),
    crash := non_neg_integer(),
    sap := non_neg_integer(),
    dup := non_neg_integer(),
    late := non_neg_integer(),
    timeout := non_neg_integer(),
    reboot := non_neg_integer(),
    death := non_neg_integer(),
    still := non_neg_integer(),
    stale := [{place(), place()}]
}.

%% @doc The team before anything has started.
-spec new(model(), store()) -> t().
new(#{ids := Ids, faults := Faults, monitor := {Module, Config}}, Store) ->
    Faults#{
        monitor => starl_check_part:judge_number({Module, Module:init(Config)}, Store),
        robots => erlang:make_tuple(length(Ids), none),
        items => [],
        stale => []
    }.

%% @doc The places of the team.
-spec places(t()) -> [place()].
places(#{robots := Robots}) -> lists:seq(1, tuple_size(Robots)).

%% @doc Packs a state into few bytes.
-spec pack(t()) -> binary().
pack(#{monitor := Monitor, robots := Robots, items := Items, stale := Stale} = State) ->
    #{loss := Loss, crash := Crash, sap := Sap} = State,
    #{dup := Dup, late := Late, timeout := Timeout} = State,
    #{reboot := Reboot, death := Death, still := Still} = State,
    Pairs = <<<<A, B>> || {A, B} <- Stale>>,
    Parts = <<<<N:32>> || N <- tuple_to_list(Robots) ++ Items>>,
    <<
        (tuple_size(Robots)),
        Monitor:32,
        Loss,
        Crash,
        Sap,
        Dup,
        Late,
        Timeout,
        Reboot,
        Death,
        Still,
        (length(Stale)),
        Pairs/binary,
        Parts/binary
    >>.

%% @doc Unpacks a state.
-spec unpack(binary()) -> t().
unpack(<<Size, Monitor:32, Counts:9/binary, Stale, Rest/binary>>) ->
    <<Loss, Crash, Sap, Dup, Late, Timeout, Reboot, Death, Still>> = Counts,
    <<Pairs:Stale/binary-unit:16, Robots:Size/binary-unit:32, Items/binary>> = Rest,
    #{
        monitor => Monitor,
        robots => list_to_tuple([N || <<N:32>> <= Robots]),
        items => [N || <<N:32>> <= Items],
        loss => Loss,
        crash => Crash,
        sap => Sap,
        dup => Dup,
        late => Late,
        timeout => Timeout,
        reboot => Reboot,
        death => Death,
        still => Still,
        stale => [{A, B} || <<A, B>> <= Pairs]
    }.

%% @doc The remaining budgets of faults of a packed state.
-spec budgets(binary()) -> binary().
budgets(<<_Size, _Monitor:32, Counts:9/binary, _/binary>>) -> Counts.

%% -- canonical form -------------------------------------------------------------------------

%% @doc The hash of the canonical form under these permutations.
-spec key(t(), [starl_check_term:permutation()], model(), store()) -> <<_:128>>.
key(State, Permutations, Model, Store) ->
    erlang:md5(pack(canonical(State, Permutations, Model, Store))).

canonical(State, [], _Model, _Store) ->
    State;
canonical(#{robots := Robots, monitor := Monitor} = State, Permutations, Model, Store) ->
    %% The robots and the monitor are compared first, the other parts only if these are equal.
    Own = {Robots, Monitor},
    Cores = [{core(P, State, Model, Store), P} || P <- Permutations],
    Least = lists:min([Own | [Core || {Core, _} <- Cores]]),
    Images = [image(P, Core, State, Store) || {Core, P} <- Cores, Core =:= Least],
    lists:min([State || Own =:= Least] ++ Images).

%% @doc The state after a permutation of the robots.
-spec renamed(starl_check_term:permutation(), t(), model(), store()) -> t().
renamed(Permutation, State, Model, Store) ->
    image(Permutation, core(Permutation, State, Model, Store), State, Store).

%% The robots and the monitor of the permuted state.
core(Permutation, #{robots := Robots, monitor := Monitor}, #{monitor := {Module, _}}, Store) ->
    Moved = move(1, Permutation, Robots, Robots, Store),
    {Moved, starl_check_part:renamed_monitor(Permutation, Monitor, Module, Store)}.

move(Place, Permutation, _Robots, Moved, _Store) when Place > tuple_size(Permutation) ->
    Moved;
move(Place, Permutation, Robots, Moved, Store) ->
    Renamed = starl_check_part:renamed_robot(Permutation, element(Place, Robots), Store),
    Next = setelement(element(Place, Permutation), Moved, Renamed),
    move(Place + 1, Permutation, Robots, Next, Store).

image(Permutation, {Robots, Monitor}, #{items := Items, stale := Stale} = State, Store) ->
    State#{
        robots := Robots,
        items := lists:sort([starl_check_part:renamed_item(Permutation, I, Store) || I <- Items]),
        stale := lists:sort([
            {element(A, Permutation), element(B, Permutation)}
         || {A, B} <- Stale
        ]),
        monitor := Monitor
    }.
