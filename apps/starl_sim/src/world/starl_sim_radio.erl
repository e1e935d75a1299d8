%% @doc The simulated radio: decides which copies of the N-th packet from one robot to another
%% arrive, when, and whether they are damaged. All draws are stateless: a hash of the link, the
%% number and the purpose.
-module(starl_sim_radio).

-export([arrivals/3, fate/3, lost/2, delays/2, range/3, is_on_link/4]).

-export_type([link/0, arrival/0]).

%% The seed, the source, the destination, and the packet's number among those on this link,
%% or among those to all.
-type link() ::
    {integer(), starl:robot_id(), starl:robot_id(), pos_integer() | {all, pos_integer()}}.

%% A copy of the packet that arrives: its delay in microseconds, and whether it is intact.
-type arrival() :: {DelayUs :: pos_integer(), intact | corrupt}.

%% @doc The copies that arrive of a packet sent now.
-spec arrivals(link(), Now :: starl_sim_queue:time(), starl_sim_world:t()) ->
    [arrival()] | lost.
arrivals(Link, Now, #{network := Faults} = World) ->
    case lost(Link, World) of
        true -> lost;
        false when Faults =:= [] -> [{Delay, intact} || Delay <- delays(Link, World)];
        false -> disturb(Link, Now, World)
    end.

%% @doc The same for an observer: the times of the arrivals, or why the packet is lost.
-spec fate(link(), Now :: starl_sim_queue:time(), starl_sim_world:t()) ->
    starl_observer:fate().
fate({_, Source, Dest, _} = Link, Now, #{network := All, team := Team} = World) ->
    case arrivals(Link, Now, World) of
        lost ->
            Ids = [
                element(1, F)
             || F <- starl_run_fault:holding(Now, All),
                is_on_link(Source, Dest, F, Team),
                swallows(F, Link, Now)
            ],
            {lost, why(lost(Link, World), Ids)};
        Arrivals ->
            {arrives, [{Now + Delay, State} || {Delay, State} <- Arrivals]}
    end.

why(false, [Fault | _]) -> {fault, Fault};
why(true, _Faults) -> chance.

%% @doc Is the packet lost without a fault?
-spec lost(link(), #{loss := number(), _ => _}) -> boolean().
lost(Link, #{loss := Loss}) -> Loss > 0.0 andalso starl_run_draw:uniform({Link, loss}) < Loss.

%% @doc The delays, in microseconds, of the one or two copies that arrive without a fault.
-spec delays(link(), starl_sim_world:t()) -> [pos_integer(), ...].
delays(Link, #{duplicate := Duplicate} = World) ->
    case Duplicate > 0.0 andalso starl_run_draw:uniform({Link, duplicate}) < Duplicate of
        true -> [delay({Link, delay}, World), delay({Link, again}, World)];
        false -> [delay({Link, delay}, World)]
    end.

%% Whole milliseconds if both bounds are, as in the workloads of the paper and of our benchmarks.
delay(Key, #{delay_us := {Min, Max}}) when Min rem 1000 =:= 0, Max rem 1000 =:= 0 ->
    1000 * starl_run_draw:between(Key, Min div 1000, Max div 1000);
delay(Key, #{delay_us := {Min, Max}}) ->
    starl_run_draw:between(Key, Min, Max).

%% @doc The range of a robot's radio now, in millimetres.
-spec range(starl:robot_id(), Now :: starl_sim_queue:time(), starl_sim_world:t()) ->
    float() | infinity.
range(_, _, #{range_mm := Range, network := []}) ->
    Range;
range(Robot, Now, #{range_mm := Range, network := Faults}) ->
    Shorter = [
        float(Mm)
     || {_, _, _, range, _, #{range_mm := Mm}} = F <- starl_run_fault:holding(Now, Faults),
        starl_run_fault:hits(Robot, F)
    ],
    %% a number is less than the atom infinity
    lists:min([Range | Shorter]).

%% -- faults ---------------------------------------------------------------------------------

disturb({_, Source, Dest, _} = Link, Now, #{network := All} = World) ->
    Faults = [
        F
     || F <- starl_run_fault:holding(Now, All), is_on_link(Source, Dest, F, maps:get(team, World))
    ],
    case lists:any(fun(Fault) -> swallows(Fault, Link, Now) end, Faults) of
        true -> lost;
        false -> arrive(Faults, Link, World)
    end.

%% @doc Does a fault disturb what this robot sends to that one?
-spec is_on_link(starl:robot_id(), starl:robot_id(), Fault :: tuple(), starl_team:t()) -> boolean().
is_on_link(Source, Dest, {_, _, _, Kind, Target, _} = Fault, Team) ->
    case Kind of
        partition -> lists:member(Source, Target) =/= lists:member(Dest, Target);
        one_way_partition -> lists:member(Source, Target) andalso not lists:member(Dest, Target);
        isolate -> Source =:= Target orelse Dest =:= Target;
        ring -> starl_run_fault:hits(Source, Fault) andalso not are_neighbours(Source, Dest, Team);
        range -> false;
        _ -> is_hit(Source, Dest, Target)
    end.

is_hit(_, _, all) -> true;
is_hit(Source, _, Source) -> true;
is_hit(Source, Dest, {Source, Dest}) -> true;
is_hit(_, _, _) -> false.

are_neighbours(A, B, Team) -> starl_team:next(A, Team) =:= B orelse starl_team:next(B, Team) =:= A.

%% Does this fault lose the packet?
swallows({Id, _, _, loss, _, #{part := Part}}, Link, _Now) ->
    starl_run_draw:uniform({Link, Id}) < Part;
swallows({Id, From, _, burst_loss, _, #{part := Part, burst_ms := Ms}}, Link, Now) ->
    {Seed, Source, Dest, _} = Link,
    Burst = (Now - From) div (1000 * Ms),
    starl_run_draw:uniform({Seed, Source, Dest, Id, Burst}) < Part;
swallows({_, _, _, drop, _, #{packet := N}}, {_, _, _, Number}, _Now) ->
    Number =:= N orelse Number =:= {all, N};
swallows({_, _, _, Kind, _, _}, _Link, _Now) ->
    lists:member(Kind, [partition, one_way_partition, isolate, ring]).

arrive(Faults, Link, World) ->
    Copies = delays(Link, World) ++ [delay(Key, World) || F <- Faults, Key <- copies(F, Link)],
    Numbered = lists:zip(lists:seq(1, length(Copies)), Copies),
    [
        {Delay + lists:sum([extra(F, Link, N) || F <- Faults]), state(Faults, Link, N)}
     || {N, Delay} <- Numbered
    ].

%% The keys for the delays of further copies.
copies({Id, _, _, duplicate, _, #{part := Part}}, Link) ->
    [{Link, Id, again} || starl_run_draw:uniform({Link, Id}) < Part];
copies({Id, _, _, babble, _, #{copies := Copies}}, Link) ->
    [{Link, Id, N} || N <- lists:seq(2, Copies)];
copies(_, _) ->
    [].

extra({_, _, _, delay, _, #{extra_ms := Ms}}, _Link, _N) ->
    1000 * Ms;
extra({Id, _, _, reorder, _, #{part := Part, extra_ms := Ms}}, Link, N) ->
    case starl_run_draw:uniform({Link, Id, N}) < Part of
        true -> 1000 * starl_run_draw:between({Link, Id, N, extra}, 1, Ms);
        false -> 0
    end;
extra(_, _, _) ->
    0.

state(Faults, Link, N) ->
    Hits = [
        Id
     || {Id, _, _, corrupt, _, #{part := Part}} <- Faults,
        starl_run_draw:uniform({Link, Id, N}) < Part
    ],
    case Hits of
        [] -> intact;
        [_ | _] -> corrupt
    end.
