%% @doc Tests the store of a live robot on a simulated disk, under power cuts and disk failures. One
%% robot boots many times, and each boot ends by a power cut at some operation of the disk.
%%
%% The contract:
%% <ul>
%% <li>A machine finds the last term whose `keep' was answered with `ok', or one that was to be kept
%%   after it; never `none' or `damaged' when there is such a term. If its file is damaged, it finds
%%   `damaged'.</li>
%% <li>The numbers of starts that were answered with `ok' never go back, even if one of the two copies is
%%   damaged.</li>
%% <li>A healthy disk is never `full'.</li>
%% </ul>
-module(starl_virtual_store).

-export([run/1]).

-export_type([result/0]).

-define(DISK, "disk").
-define(DIR, {starl_virtual_disk, "disk/robot-1"}).
-define(MACHINES, [sap, app, location, motion]).
-define(LIVES, 12).
%% The most operations of the disk in a life, and the most bytes of a term.
-define(OPERATIONS, 60).
-define(BYTES, 300).

-type result() :: #{
    violations := [starl_monitor:violation()],
    events := non_neg_integer(),
    digest := non_neg_integer()
}.

-record(run, {
    seed :: integer(),
    life = 0 :: non_neg_integer(),
    n = 0 :: non_neg_integer(),
    %% of each machine: the terms that it may find, the last answered one last
    terms :: #{starl_machine:name() => [none | {stored, term()}, ...]},
    %% the numbers of starts that were answered, and what they may be
    starts = 0 :: non_neg_integer(),
    %% the trouble of the disk once the robot has started
    trouble = none :: starl_virtual_disk:trouble(),
    chain = 0 :: non_neg_integer(),
    violations = [] :: [starl_monitor:violation()]
}).

%% @doc The lives that belong to a seed, up to the first violation.
-spec run(Seed :: integer()) -> result().
run(Seed) ->
    ok = starl_virtual_disk:new(?DISK, {Seed, disk}),
    ok = starl_live_store:commission(?DIR),
    Terms = maps:from_list([{Name, [none]} || Name <- ?MACHINES]),
    #run{n = N, chain = Chain, violations = Violations} = lives(#run{seed = Seed, terms = Terms}),
    #{violations => lists:reverse(Violations), events => N, digest => Chain}.

lives(#run{violations = [_ | _]} = Run) -> Run;
lives(#run{life = ?LIVES} = Run) -> Run;
lives(#run{life = Life} = Run) -> lives(cut(live(Run#run{life = Life + 1}))).

%% What the life has tried before the power cut is in the dictionary: the cut is thrown.
live(#run{seed = Seed, life = Life} = Run) ->
    ok = starl_virtual_disk:cut_after(
        ?DISK, starl_run_draw:between({Seed, Life, cut}, 1, ?OPERATIONS), any
    ),
    _ = put(?MODULE, Run),
    try
        born(noted(troubled(Run)))
    catch
        throw:{starl_power_cut, ?DISK} -> get(?MODULE)
    end.

noted(Run) ->
    _ = put(?MODULE, Run),
    Run.

cut(Run) ->
    ok = starl_virtual_disk:suffer(?DISK, none),
    ok = starl_virtual_disk:cut_power(?DISK),
    Run.

troubled(#run{seed = Seed, life = Life} = Run) ->
    Trouble =
        case starl_run_draw:between({Seed, Life, trouble}, 1, 6) of
            1 -> full;
            2 -> {fails, 0.3};
            _ -> none
        end,
    Run#run{trouble = Trouble}.

born(Run) ->
    case starl_live_store:open(?DIR) of
        {ok, Store} -> found(Store, counted(Store, Run));
        {error, _} -> broken(cannot_open, #{}, Run)
    end.

%% One copy of the numbers may be damaged; otherwise the disk is healthy while the robot starts.
counted(Store, #run{seed = Seed, life = Life, starts = Before} = Run) ->
    Copy = lists:nth(starl_run_draw:between({Seed, Life, copy}, 1, 4), ["a", "b", "no", "no"]),
    ok = starl_virtual_disk:suffer(?DISK, {damaged, "starts-" ++ Copy}),
    Known = maps:get(sap, starl_live_store:starts(Store), 0),
    ok = starl_virtual_disk:suffer(?DISK, none),
    Next = Known + 1,
    case Known >= Before of
        false -> broken(starts_went_back, #{before => Before, now => Known}, Run);
        true -> counted(starl_live_store:started(#{sap => Next}, Store), Next, Run)
    end.

counted(ok, Next, Run) -> noted(Run#run{starts = Next});
counted({error, _}, _Next, Run) -> broken(starts_not_stored, #{}, Run).

found(_Store, #run{violations = [_ | _]} = Run) ->
    Run;
found(Store, Run) ->
    #run{seed = Seed, life = Life} = Run,
    Damage =
        case starl_run_draw:between({Seed, Life, damage}, 1, 6) of
            1 -> {damaged, ".kept"};
            _ -> none
        end,
    ok = starl_virtual_disk:suffer(?DISK, Damage),
    Found = noted(lists:foldl(fun(Name, R) -> found(Name, Damage, Store, R) end, Run, ?MACHINES)),
    ok = starl_virtual_disk:suffer(?DISK, Run#run.trouble),
    keeps(Store, Found).

found(Name, Damage, Store, #run{terms = Terms, chain = Chain} = Run) ->
    Found = starl_live_store:kept(Name, Store),
    #{Name := Possible} = Terms,
    Chained = Run#run{chain = erlang:phash2({Chain, Name, Found})},
    case lists:member(Found, Possible) of
        false when Found =:= damaged, Damage =/= none ->
            Chained;
        true ->
            Chained#run{terms = Terms#{Name := [Found]}};
        false ->
            Told = #{
                machine => Name, found => brief(Found), possible => [brief(T) || T <- Possible]
            },
            broken(wrong_term, Told, Chained)
    end.

%% Until the power goes.
keeps(_Store, #run{violations = [_ | _]} = Run) ->
    Run;
keeps(Store, #run{seed = Seed, n = N} = Run) ->
    Name = lists:nth(starl_run_draw:between({Seed, N, name}, 1, length(?MACHINES)), ?MACHINES),
    Size = starl_run_draw:between({Seed, N, size}, 0, ?BYTES),
    Term = {N, binary:copy(<<N>>, Size)},
    Trying = noted(tries(Name, {stored, Term}, Run#run{n = N + 1})),
    keeps(Store, noted(kept(starl_live_store:keep(Name, Term, Store), Name, Term, Trying))).

%% The number of a term.
brief({stored, {N, _}}) -> N;
brief(Other) -> Other.

tries(Name, Found, #run{terms = Terms} = Run) ->
    Run#run{terms = maps:update_with(Name, fun(Before) -> Before ++ [Found] end, Terms)}.

kept(ok, Name, Term, #run{terms = Terms} = Run) ->
    Run#run{terms = Terms#{Name := [{stored, Term}]}};
kept(full, Name, _Term, #run{trouble = none} = Run) ->
    broken(full_without_trouble, #{machine => Name}, Run);
kept(full, _Name, _Term, Run) ->
    Run.

broken(What, Details, #run{life = Life, violations = Violations} = Run) ->
    Violation = #{
        contract => live_store,
        what => What,
        at_us => 1000000 * Life,
        robots => [1],
        details => Details
    },
    noted(Run#run{violations = [Violation | Violations]}).
