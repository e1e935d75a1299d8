%% @doc The durable store of a simulated robot: the terms that its machines keep over crashes and
%% reboots, the code that they start with if it is not their first, and the faults of the class
%% `store'.
-module(starl_sim_store).

-export([new/1, keep/4, kept/3, codes/1, codes/2]).

-export_type([t/0]).

-record(store, {
    faults :: [starl_sim_fault:compiled()],
    kept = #{} :: #{starl_machine:name() => term()},
    codes = #{} :: starl_reload:codes()
}).

-opaque t() :: #store{}.

%% @doc An empty store, with the faults that strike it.
-spec new([starl_sim_fault:compiled()]) -> t().
new(Faults) -> #store{faults = Faults}.

%% @doc Keeps a term for a machine in place of its earlier term; `full': nothing is written.
-spec keep(starl_machine:name(), term(), starl_sim_queue:time(), t()) -> {ok, t()} | full.
keep(Name, Term, Now, #store{kept = Kept} = Store) ->
    case suffers(store_full, Now, Store) of
        true -> full;
        false -> {ok, Store#store{kept = Kept#{Name => Term}}}
    end.

%% @doc The stored term for a machine that starts now. A machine that never kept a term finds
%% `none', even if the store is damaged.
-spec kept(starl_machine:name(), starl_sim_queue:time(), t()) -> starl_machine:stored().
kept(Name, Now, #store{kept = Kept} = Store) ->
    case {Kept, suffers(store_damaged, Now, Store)} of
        {#{Name := _}, true} -> damaged;
        {#{Name := Term}, false} -> {stored, Term};
        {#{}, _} -> none
    end.

%% @doc The code of its machines.
-spec codes(t()) -> starl_reload:codes().
codes(#store{codes = Codes}) -> Codes.

%% @doc The store with other code.
-spec codes(starl_reload:codes(), t()) -> t().
codes(Codes, Store) -> Store#store{codes = Codes}.

suffers(Kind, Now, #store{faults = Faults}) ->
    lists:keymember(Kind, 4, starl_sim_fault:holding(Now, Faults)).
