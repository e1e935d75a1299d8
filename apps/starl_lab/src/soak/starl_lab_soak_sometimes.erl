%% @doc Counts what happens in the runs of a soak: the events of the block's machines, and the
%% situations that its monitors name. A contract that is kept where nothing of interest has happened
%% means little. So a soak of many runs must show each of them at least once.
%%
%% The counted items are declared once: the events in a monitor's vocabulary, and further situations
%% by its `sometimes/0', which also marks the rare ones ({@link starl_monitor}). Rare ones are
%% reported, but not required.
%%
%% As a monitor it judges nothing, and only counts the events.
-module(starl_lab_soak_sometimes).
-behaviour(starl_monitor).

-export([watch/1, counts/1, never/3, format/1]).
-export([init/1, interests/1, step/2, finish/2]).

-export_type([name/0, counts/0, never/0]).

%% An event of a machine, or a situation that a monitor names.
-type name() :: {Machine :: starl_machine:name(), Tag :: atom()} | Situation :: atom().
-type counts() :: #{name() => pos_integer()}.
%% What has not happened: what is owed, and what is seldom.
-type never() :: #{owed := [name()], seldom := [name()]}.

%% What happens in one run of fifty is missed by so many runs less than once in 10^8 soaks.
-define(ENOUGH, 1000).

%% @doc The monitor that counts the events of a block's machines.
-spec watch(atom()) -> {module(), map()}.
watch(Block) ->
    Machines = [Machine || Module <- monitors(Block), Machine <- maps:keys(vocabulary(Module))],
    {?MODULE, #{machines => lists:usort(Machines)}}.

%% @doc What has happened in a run, by the results of its monitors.
-spec counts(#{module() => starl_monitor:results()}) -> counts().
counts(Results) ->
    All = [Counts || #{sometimes := Counts} <- maps:values(Results)],
    maps:filter(fun(_Name, N) -> N > 0 end, sum(All)).

sum(Counts) ->
    lists:foldl(
        fun(One, Sum) -> maps:merge_with(fun(_, A, B) -> A + B end, One, Sum) end, #{}, Counts
    ).

%% @doc What has not happened in the runs of a block; a few runs owe nothing.
-spec never(atom(), Runs :: non_neg_integer(), [counts()]) -> never().
never(Block, Runs, Counts) ->
    Seen = sum(Counts),
    {Names, Seldom} = names(Block),
    Missing = [Name || Name <- Names, not is_map_key(Name, Seen)],
    {Rare, Owed} = lists:partition(
        fun(Name) -> Runs < ?ENOUGH orelse lists:member(Name, Seldom) end, Missing
    ),
    #{owed => Owed, seldom => Rare}.

%% All names of the block's monitors, and those that are seldom.
names(Block) ->
    Modules = monitors(Block),
    Events = [
        {Machine, Tag}
     || Module <- Modules,
        {Machine, Names} <- lists:sort(maps:to_list(vocabulary(Module))),
        {Tag, _} <- Names
    ],
    Declared = lists:append([sometimes(Module) || Module <- Modules]),
    {
        lists:usort(Events ++ [Name || {Name, _} <- Declared]),
        [Name || {Name, seldom} <- Declared]
    }.

%% A user's block may have any monitors.
monitors(Name) ->
    case starl_block_catalogue:find(Name) of
        {ok, Block} -> starl_block:monitors(Block);
        %% an application owes nothing
        error -> []
    end.

vocabulary(Module) -> starl_callback:call(Module, vocabulary, [], #{}).

sometimes(Module) -> starl_callback:call(Module, sometimes, [], []).

%% @doc A name as words.
-spec format(name()) -> unicode:chardata().
format({Machine, Tag}) -> io_lib:format("~ts (~ts)", [words(Tag), Machine]);
format(Situation) -> words(Situation).

words(Name) -> string:replace(atom_to_list(Name), "_", " ", all).

%% -- the monitor ----------------------------------------------------------------------------

%% @private
-spec init(#{machines := [starl_machine:name()]}) -> {[starl_machine:name()], counts()}.
init(#{machines := Machines}) -> {Machines, #{}}.

%% @private
-spec interests({[starl_machine:name()], counts()}) -> [starl_machine:name()].
interests({Machines, _Counts}) -> Machines.

%% @private
-spec step(starl_monitor:trace_event(), State) -> {ok, State} when
    State :: {[starl_machine:name()], counts()}.
step({_T, _Robot, Machine, Event}, {Machines, Counts}) ->
    Tag =
        case is_tuple(Event) of
            true -> element(1, Event);
            false -> Event
        end,
    {ok, {Machines, maps:update_with({Machine, Tag}, fun(N) -> N + 1 end, 1, Counts)}}.

%% @private
-spec finish(integer(), {[starl_machine:name()], counts()}) -> {ok, #{sometimes := counts()}}.
finish(_EndUs, {_Machines, Counts}) -> {ok, #{sometimes => Counts}}.
