%% @doc The durable store of a simulated robot. It keeps the terms of its machines over crashes and
%% reboots, the code versions that its machines start with, and the faults of class `store'.
%%
%% A store can be lost, or set back to an earlier image. A store that is known to be lost or set
%% back is outdated, like that of a live robot (`starl_live_store'). Each term of an outdated store
%% counts as damaged until its machine has written a new one.
-module(starl_sim_store).

-export([new/1, keep/4, kept/3, codes/1, codes/2]).
-export([strike/3, outdate/1]).

-export_type([t/0, strike/0]).

%% `lose_store': data lost. `outdate': rolled back, and known to be. `save_store', `set_back_store': snapshot and
%% silent rollback, for the fault of this name.
-type strike() :: lose_store | outdate | {save_store | set_back_store, Fault :: atom()}.

-type image() :: {starl_robot_machines:starts(), kept(), written()}.
-type kept() :: #{starl_machine:name() => term()}.
%% The machines that have written a term since the store became outdated; `all': it is not.
-type written() :: all | [starl_machine:name()].

-record(store, {
    faults :: [starl_run_fault:compiled()],
    kept = #{} :: kept(),
    written = all :: written(),
    images = #{} :: #{Fault :: atom() => image()},
    codes = #{} :: starl_reload:codes()
}).

-opaque t() :: #store{}.

%% @doc The empty store of a robot that has never run, with the faults that strike it.
-spec new([starl_run_fault:compiled()]) -> t().
new(Faults) -> #store{faults = Faults}.

%% @doc Keeps a term for a machine in place of its earlier term; `full': nothing is written.
-spec keep(starl_machine:name(), term(), starl_sim_queue:time(), t()) -> {ok, t()} | full.
keep(Name, Term, Now, #store{kept = Kept, written = Written} = Store) ->
    case suffers(store_full, Now, Store) of
        true -> full;
        false -> {ok, Store#store{kept = Kept#{Name => Term}, written = written(Name, Written)}}
    end.

written(_Name, all) -> all;
written(Name, Names) -> lists:usort([Name | Names]).

%% @doc The stored term for a machine that starts now. A machine that never kept a term finds
%% `none', even if the store is damaged, unless the store is outdated: then nobody knows.
-spec kept(starl_machine:name(), starl_sim_queue:time(), t()) -> starl_machine:stored().
kept(Name, Now, #store{kept = Kept, written = Written} = Store) ->
    Doubtful = Written =/= all andalso not lists:member(Name, Written),
    case {Kept, suffers(store_damaged, Now, Store)} of
        _ when Doubtful -> damaged;
        {#{Name := _}, true} -> damaged;
        {#{Name := Term}, false} -> {stored, Term};
        {#{}, _} -> none
    end.

%% @doc Applies a fault to the store of machines with these numbers of starts. Returns the numbers
%% of starts from now on, and the reports.
-spec strike(strike(), starl_robot_machines:starts(), t()) ->
    {starl_robot_machines:starts(), Facts :: [store_set_back], t()}.
strike(lose_store, _Starts, Store) ->
    {#{}, [], outdate(Store)};
strike(outdate, Starts, Store) ->
    {Starts, [], outdate(Store)};
strike({save_store, Fault}, Starts, #store{kept = Kept, written = Written} = Store) ->
    #store{images = Images} = Store,
    {Starts, [], Store#store{images = Images#{Fault => {Starts, Kept, Written}}}};
strike({set_back_store, Fault}, _Starts, #store{images = Images} = Store) ->
    #{Fault := {Starts, Kept, Written}} = Images,
    {Starts, [store_set_back], Store#store{kept = Kept, written = Written}}.

%% @doc The store is known to be lost or set back.
-spec outdate(t()) -> t().
outdate(Store) -> Store#store{kept = #{}, written = []}.

%% @doc The code of its machines.
-spec codes(t()) -> starl_reload:codes().
codes(#store{codes = Codes}) -> Codes.

%% @doc The store with other code.
-spec codes(starl_reload:codes(), t()) -> t().
codes(Codes, Store) -> Store#store{codes = Codes}.

suffers(Kind, Now, #store{faults = Faults}) ->
    lists:keymember(Kind, 4, starl_run_fault:holding(Now, Faults)).
