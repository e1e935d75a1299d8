%% @doc The behaviour of a rule of path planning: it scores the lines that a robot could paint next
%% (the paper's choice of the next vertex). The block decides everything else: which lines are free
%% and safe, the path there, and the tubes. So every contract holds under every rule.
%% ```
%%   -module(longest).
%%   -behaviour(starl_dpp_rule).
%%   -export([score/2]).
%%   score(#{ink_mm := Ink, way_mm := Way}, _Settings) -> Ink - Way / 100.
%% '''
%% An application selects the rule by name: `{starl_dpp, #{choice => longest, ...}}'. The painting
%% application has a flag: `--choice longest.erl'. A rule is a pure function: equal work, equal
%% score. Any number may be a score, even a negative one; a robot takes the work with the highest
%% score.
-module(starl_dpp_rule).

-export([names/0, module/1, is_rule/1, named/1]).

-export_type([name/0, work/0, settings/0]).

%% The name of a rule that ships, or a module with this behaviour.
-type name() :: atom().

%% A chain of free lines, up to the horizon.
-type work() :: #{
    robot := pos_integer(),
    begins := starl_geometry:point(),
    ink_mm := float(),
    spent_mm := float(),
    way_mm := number(),
    middle := boolean()
}.
%% The robot that would paint it, and where it begins. `ink_mm': its length. `spent_mm': the same with the turns on it, each as the way in its time. `way_mm': the way to its
%% beginning, with turns. `middle': it begins in the middle of a line, so two pieces are left instead of one.

-type settings() :: #{overhead_mm := number(), middle := number()}.
%% The options of the block: the way in the time of a request, mm; the weight of a line that is begun in its middle.

%% How good is this work? More is better.
-callback score(work(), settings()) -> number().
%% Work with at most so much ink, mm, and no turns, has no better score than this one if the way to it is longer than what
%% is returned: the search ends there. With it a rule promises that its score only falls with a longer
%% way, and only rises with more ink. Without it the 40 nearest beginnings are looked at.
-callback farthest(Score :: number(), InkMm :: number(), settings()) -> Mm :: number().

-optional_callbacks([farthest/3]).

%% @doc The names of the rules that ship.
-spec names() -> [name()].
names() -> [Name || {Name, _} <- known()].

known() -> [{ink, starl_dpp_rule_ink}, {nearest, starl_dpp_rule_nearest}].

%% @doc The module of a rule.
-spec module(name()) -> module().
module(Name) ->
    case lists:keyfind(Name, 1, known()) of
        {Name, Module} -> Module;
        false -> Name
    end.

%% @doc Is this the name of a rule, or a module with this behaviour?
-spec is_rule(term()) -> boolean().
is_rule(Name) when is_atom(Name) ->
    starl_callback:exported(module(Name), score, 2);
is_rule(_Other) ->
    false.

%% @doc The rule that a text names: one that ships, or the file of a module that has been compiled from it; one line if
%% there is none.
-spec named(string()) -> {ok, name()} | {error, unicode:chardata()}.
named(Text) ->
    Texts = [atom_to_list(Name) || Name <- names()],
    case {lists:member(Text, Texts), filename:extension(Text)} of
        {true, _} -> {ok, list_to_existing_atom(Text)};
        {false, ".erl"} -> of_file(Text);
        {false, _} -> {error, unknown(Text, Texts)}
    end.

of_file(File) ->
    Text = filename:basename(File, ".erl"),
    case starl_code:exports(Text, score, 2) of
        true -> {ok, list_to_existing_atom(Text)};
        false -> {error, ["choice: ", File, " is no rule: it exports no score/2 (starl_dpp_rule)"]}
    end.

unknown(Text, Texts) ->
    All = ["; there are ", lists:join(", ", Texts), ", and files of yours (FILE.erl)"],
    Meant = starl_similar:meant(starl_similar:words(Text, Texts), All),
    ["choice: there is no rule ", Text, Meant].
