%% @doc The history of the code versions of a machine, and the version to which it goes back.
%%
%% Each reload adds a version. Going back means: to the last version whose trial ended well, or to
%% the first code. Versions that were replaced before their trial was over have proven nothing; all
%% of them are left together. Here reload 3 crashes, and the machine goes on with the code of reload
%% 1:
%% ```
%%   first code <-- 1, passed <-- 2, replaced after 40 ms <-- 3, on trial: crashes
%%                     ^                                         |
%%                     +-----------------------------------------+
%% '''
%% If reload 1 fails on another robot meanwhile, the machine stays with the code of reload 3, and
%% then goes back to the first code.
-module(starl_lineage).

-export([new/1, take/3, code/1, is_first/1, has/2, is_on_trial/2, back/1, leave/2, bare/1]).

-export_type([t/0, version/0]).

%% A version: the number of its reload, its module, its trial time, and what its runner keeps for
%% the way back.
-type version() :: #{
    number := starl_reload:count(),
    module := module(),
    trial_us := non_neg_integer(),
    kept := term(),
    until_us => integer(),
    standing => standing()
}.

%% It runs and has not passed yet; its trial ended well; it was replaced before; its reload has
%% failed on another robot.
-type standing() :: new | passed | replaced | failed.

-record(lineage, {
    first :: module(),
    %% the newest first
    versions = [] :: [version()]
}).

-opaque t() :: #lineage{}.

%% @doc The lineage of a machine that runs its first code.
-spec new(module()) -> t().
new(First) -> #lineage{first = First}.

%% @doc The machine goes on with a new version.
-spec take(version(), NowUs :: integer(), t()) -> t().
take(#{trial_us := Us} = Version, Now, Lineage) ->
    #lineage{versions = Versions} = Known = needed(judged(Now, Lineage)),
    New = Version#{until_us => Now + Us, standing => new},
    Known#lineage{versions = [New | Versions]}.

%% The present version has had its time, or not.
judged(Now, #lineage{versions = [#{standing := new} = Last | Older]} = Lineage) ->
    #{until_us := Until} = Last,
    Standing =
        case Now < Until of
            true -> replaced;
            false -> passed
        end,
    Lineage#lineage{versions = [Last#{standing := Standing} | Older]};
judged(_Now, Lineage) ->
    Lineage.

%% Nobody goes back further than to the second version that has passed.
needed(#lineage{versions = Versions} = Lineage) ->
    {Unproven, Proven} = unproven(Versions),
    case Proven of
        [Passed | Older] ->
            {Below, Base} = unproven(Older),
            rooted(Base, Lineage#lineage{versions = Unproven ++ [Passed | Below]});
        [] ->
            Lineage
    end.

rooted([], Lineage) -> Lineage;
rooted([#{module := Module} | _], Lineage) -> Lineage#lineage{first = Module}.

unproven(Versions) -> lists:splitwith(fun(#{standing := S}) -> S =/= passed end, Versions).

%% @doc The module that runs.
-spec code(t()) -> module().
code(#lineage{first = First, versions = []}) -> First;
code(#lineage{versions = [#{module := Module} | _]}) -> Module.

%% @doc Is there no version to go back from?
-spec is_first(t()) -> boolean().
is_first(#lineage{versions = Versions}) -> Versions =:= [].

%% @doc Has the machine come through this reload?
-spec has(starl_reload:count(), t()) -> boolean().
has(N, #lineage{versions = Versions}) -> lists:any(fun(#{number := M}) -> M =:= N end, Versions).

%% @doc Is the present version on trial?
-spec is_on_trial(NowUs :: integer(), t()) -> boolean().
is_on_trial(Now, #lineage{versions = [#{standing := new, until_us := Until} | _]}) -> Now < Until;
is_on_trial(_Now, #lineage{}) -> false.

%% @doc Leaves the present version, and with it those before that have not passed. Returns the
%% versions that were left, the newest first.
-spec back(t()) -> {[version(), ...], t()}.
back(#lineage{versions = [Present | Older]} = Lineage) ->
    {Unproven, Left} = unproven(Older),
    {[Present | Unproven], Lineage#lineage{versions = Left}}.

%% @doc The reload of this number has failed on another robot. Its version is left, if it is the
%% present one; if it was replaced, the machine will never go back to it.
-spec leave(starl_reload:count(), t()) ->
    {left, [version(), ...], t()} | {skipped, t()} | unknown.
leave(N, #lineage{versions = [#{number := N} | _]} = Lineage) ->
    {Left, Now} = back(Lineage),
    {left, Left, Now};
leave(N, #lineage{versions = Versions} = Lineage) ->
    case lists:splitwith(fun(#{number := M}) -> M =/= N end, Versions) of
        {Newer, [#{standing := Standing} = Version | Older]} when Standing =/= failed ->
            Failed = Newer ++ [Version#{standing := failed} | Older],
            {skipped, Lineage#lineage{versions = Failed}};
        {_, _} ->
            unknown
    end.

%% @doc The lineage without what its runner keeps: what outlives the runner.
-spec bare(t()) -> t().
bare(#lineage{versions = Versions} = Lineage) ->
    Lineage#lineage{versions = [Version#{kept := none} || Version <- Versions]}.
