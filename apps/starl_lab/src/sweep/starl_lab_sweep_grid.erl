%% @doc The grid of a sweep: all combinations of the values of its settings, each with every seed.
%%
%% A setting is a key with a value on the command line or in the scenario file; `robots' is always a
%% setting. A setting with more than one value is swept.
-module(starl_lab_sweep_grid).

-export([flags/1, new/4, points/1, seeds/1, swept/1, fixed/1, settings/1, cells/2]).

-export_type([t/0, point/0, setting/0]).

-type setting() :: {Key :: atom(), starl_options:type(), Values :: [term(), ...]}.
%% A value for every setting.
-type point() :: #{atom() => term()}.

-record(grid, {
    settings :: [setting()],
    swept :: [atom()],
    seeds :: [non_neg_integer(), ...]
}).

-opaque t() :: #grid{}.

-define(USUAL_SEEDS, lists:seq(1, 5)).

%% @doc The flags for the options of a scenario and its application. Each takes several values,
%% except a term, in which commas have their own meaning. The flag `seeds' replaces `seed'.
-spec flags([starl_options:option()]) -> [starl_cli_flags:flag()].
flags(Options) ->
    {seed, Type, _, _} = lists:keyfind(seed, 1, Options),
    Seeds = {seeds, {first, Type}, ?USUAL_SEEDS, "the seeds of every combination"},
    [Seeds | [several(Option) || {Key, _, _, _} = Option <- Options, Key =/= seed]].

several({_, {term, _, _}, _, _} = Option) -> Option;
several({Key, Type, Default, Doc}) -> {Key, {list, Type}, [Default], Doc}.

%% @doc The grid for the values of a scenario file and of the flags, which have priority. The swept
%% settings are in the order of the arguments.
-spec new([starl_options:option()], InFile, Flags, Args :: [string()]) -> t() when
    InFile :: #{atom() => term()}, Flags :: #{atom() => term()}.
new(Options, InFile, Flags, Args) ->
    Settings = [
        {Key, Type, values(Option, InFile, Flags)}
     || {Key, Type, _, _} = Option <- Options,
        Key =/= seed,
        Key =:= robots orelse is_map_key(Key, InFile) orelse is_map_key(Key, Flags)
    ],
    Swept = [{place(Key, Args), Key} || {Key, _, [_, _ | _]} <- Settings],
    #grid{
        settings = Settings,
        swept = [Key || {_, Key} <- lists:sort(Swept)],
        seeds = lists:uniq(maps:get(seeds, Flags, ?USUAL_SEEDS))
    }.

values({Key, {term, _, _}, _, _}, _InFile, Flags) when is_map_key(Key, Flags) ->
    [maps:get(Key, Flags)];
values({Key, _, _, _}, _InFile, Flags) when is_map_key(Key, Flags) ->
    lists:uniq(maps:get(Key, Flags));
values({Key, _, Default, _}, InFile, _Flags) ->
    [maps:get(Key, InFile, Default)].

place(Key, Args) ->
    Flag = starl_cli_flags:flag(Key),
    length(lists:takewhile(fun(Arg) -> hd(string:split(Arg, "=")) =/= Flag end, Args)).

%% @doc All combinations; the values of the last setting change fastest.
-spec points(t()) -> [point(), ...].
points(#grid{settings = Settings}) ->
    lists:foldl(
        fun({Key, _, Values}, Points) -> [P#{Key => V} || P <- Points, V <- Values] end,
        [#{}],
        Settings
    ).

%% @doc The seeds of each point.
-spec seeds(t()) -> [non_neg_integer(), ...].
seeds(#grid{seeds = Seeds}) -> Seeds.

%% @doc The settings, in the order of the tables of options.
-spec settings(t()) -> [setting()].
settings(#grid{settings = Settings}) -> Settings.

%% @doc The settings with several values, in the order of the command line.
-spec swept(t()) -> [setting()].
swept(#grid{swept = Swept, settings = Settings}) ->
    [lists:keyfind(Key, 1, Settings) || Key <- Swept].

%% @doc The settings with one value.
-spec fixed(t()) -> [setting()].
fixed(#grid{settings = Settings}) -> [Setting || {_, _, [_]} = Setting <- Settings].

%% @doc The settings as texts, with the values of a checked scenario.
-spec cells(t(), starl_run_scenario:t()) -> [string()].
cells(#grid{settings = Settings}, Scenario) ->
    [starl_cli_flags:text(Type, maps:get(Key, Scenario)) || {Key, Type, _} <- Settings].
