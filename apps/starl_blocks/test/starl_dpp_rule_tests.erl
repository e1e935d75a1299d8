%% @doc Rules of path planning: what one may say, and what the block makes of it.
%%
%% Holds: Path planning leaves no line out, whatever scores a rule gives; the nearest line comes
%% first by the paper's rule
%% Red: a chain had to be better than 0: `every_rule_leaves_no_work_undone`
-module(starl_dpp_rule_tests).

-include_lib("eunit/include/eunit.hrl").

%% Rules of this test.
-export([score/2]).

%% A rule that finds everything bad, and the far worst.
score(#{way_mm := Way}, _Settings) -> Way - 1.0e6.

a_name_is_a_rule_test() ->
    [?assert(starl_dpp_rule:is_rule(Name)) || Name <- starl_dpp_rule:names()],
    ?assert(starl_dpp_rule:is_rule(?MODULE)),
    [?assertNot(starl_dpp_rule:is_rule(Other)) || Other <- [lists, no_such_rule, "ink", 7]].

a_wrong_name_is_one_line_test() ->
    ?assertEqual({ok, nearest}, starl_dpp_rule:named("nearest")),
    ?assertEqual(
        "choice: there is no rule neerest (did you mean nearest?)", line("neerest")
    ),
    ?assertEqual(
        "choice: there is no rule best; there are ink, nearest, and files of yours (FILE.erl)",
        line("best")
    ),
    ?assertEqual(
        "choice: a/lists.erl is no rule: it exports no score/2 (starl_dpp_rule)",
        line("a/lists.erl")
    ),
    ?assertEqual({ok, ?MODULE}, starl_dpp_rule:named("a/starl_dpp_rule_tests.erl")).

line(Text) ->
    {error, Line} = starl_dpp_rule:named(Text),
    lists:flatten(Line).

%% A short line is near, a long one is far.
lines() -> [{{2500.0, 5000.0}, {2700.0, 5000.0}}, {{4500.0, 6000.0}, {7500.0, 6000.0}}].

the_usual_rule_takes_the_most_ink_for_its_way_test() -> ?assertMatch({long, _}, first(ink)).

the_nearest_line_comes_first_by_the_rule_of_the_paper_test() ->
    ?assertMatch({short, _}, first(nearest)).

%% It is not told where no better work can be, and looks at all.
a_rule_without_a_bound_sees_all_work_test() -> ?assertMatch({long, _}, first(?MODULE)).

%% Bad work is work: with every rule a team comes to the end.
every_rule_leaves_no_work_undone_test_() ->
    [
        {atom_to_list(Rule), fun() -> ?assertEqual(complete, all(Rule, plan(Rule))) end}
     || Rule <- starl_dpp_rule:names() ++ [?MODULE]
    ].

all(_Rule, {complete, _Plan}) ->
    complete;
all(Rule, {{assign, Path}, Plan}) ->
    Passed = starl_dpp_plan:passed(1, length(Path), Plan),
    {Last, _} = lists:last(Path),
    all(Rule, starl_dpp_assign:request(1, starl_dpp_plan:standing(1, Last, Passed)));
all(Rule, Plan) ->
    all(Rule, starl_dpp_assign:request(1, Plan)).

first(Rule) ->
    {{assign, Path}, Plan} = starl_dpp_assign:request(1, plan(Rule)),
    [Edge | _] = [E || {_, {down, E}} <- Path],
    case starl_dpp_plan:target(Edge, Plan) of
        {{_, 5000.0}, _} -> {short, Path};
        {{_, 6000.0}, _} -> {long, Path}
    end.

plan(Rule) ->
    {ok, Plan} = starl_dpp_plan:new(#{
        segments => lines(),
        world => {12000.0, 12000.0},
        robots => [1],
        tube_radius => 211.0,
        slack => 11.0,
        choice => Rule
    }),
    starl_dpp_plan:standing(1, {2000.0, 5000.0}, Plan).
