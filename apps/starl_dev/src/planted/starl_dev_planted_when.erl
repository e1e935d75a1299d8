%% @doc The command `./starl planted --when': tests `./starl when' on planted bugs. It asks by which
%% event a bug's violation became inevitable, and compares the answer with what the bug makes wrong.
%% So it shows whether the answer can be trusted where the truth is known.
-module(starl_dev_planted_when).

-export([table/3]).
%% Called in the VMs of the jobs.
-export([asked/1]).

-export_type([answer/0]).

%% What came of a bug: the seed of its run; the answers, one for each branch seed; whether the first seed gave the
%% same curve again; the CPU time of all answers, s.
-type answer() ::
    {asked, Seed :: pos_integer(), [named()], Same :: boolean(), Seconds :: float()}
    | {not_caught, Seeds :: pos_integer(), Seconds :: float()}
    | {failed, term()}.

%% The event that was named, in a line; whether it is one that the bug makes wrong; the fractions just before
%% and after it.
-type named() :: {unicode:chardata(), Right :: boolean(), {Before :: float(), After :: float()}}.

%% Those of the page on finding faults, as few as find a step.
-define(DRAWS, 20).
-define(POINTS, 8).

%% @doc Asks of these bugs, and prints the table.
-spec table(Bugs, [starl_cli_target:code()], Values :: map()) -> 0 | 4 | 130 when
    Bugs :: [{atom(), atom(), string()}].
table(Bugs, Codes, #{seeds := Seeds, 'when' := BranchSeeds, jobs := Most}) ->
    Jobs = [{Bug, Seeds, BranchSeeds} || {Bug, _, _} <- Bugs],
    {How, Answers} = starl_lab_jobs:run(
        Jobs,
        #{
            work => {?MODULE, asked},
            at_once => Most,
            what => "bugs",
            each => fun({Bug, _, _}, Answer, All) -> All#{Bug => Answer} end,
            code => Codes
        },
        #{}
    ),
    Rows = [{B, maps:get(Bug, Answers)} || {Bug, _, _} = B <- Bugs, is_map_key(Bug, Answers)],
    starl_cli_terminal:out([row(B, Answer) || {B, Answer} <- Rows]),
    case {How, [B || {B, Answer} <- Rows, not is_right(Answer)]} of
        {interrupted, _} -> 130;
        {done, []} -> 0;
        {done, _} -> 4
    end.

is_right({ok, {asked, _, Answers, Same, _}}) -> Same andalso lists:all(fun right/1, Answers);
is_right(_) -> false.

right({_, Right, _}) -> Right.

row({Bug, _, Pitfall}, {ok, {asked, Seed, Answers, Same, Seconds}}) ->
    Right = length(lists:filter(fun right/1, Answers)),
    [
        io_lib:format("~ts, seed ~b: ~b of ~b right, ~ts, ~.1f s~n", [
            Bug, Seed, Right, length(Answers), again(Same), Seconds
        ]),
        ["    ", Pitfall, "\n"],
        [event(Group) || Group <- groups(Answers)]
    ];
row({Bug, _, Pitfall}, {ok, {not_caught, Seeds, _}}) ->
    io_lib:format("~ts: NOT FOUND in ~b seeds~n    ~ts~n", [Bug, Seeds, Pitfall]);
row({Bug, _, Pitfall}, {_, Reason}) ->
    io_lib:format("~ts: FAILED, ~0tP~n    ~ts~n", [Bug, Reason, 8, Pitfall]).

again(true) -> "the same curve again";
again(false) -> "ANOTHER CURVE".

%% The answers that name the same event.
groups(Answers) ->
    [
        [Answer || {Other, _, _} = Answer <- Answers, Other =:= Event]
     || Event <- lists:usort([Event || {Event, _, _} <- Answers])
    ].

event([{Event, Right, _} | _] = Group) ->
    {Before, After} = lists:unzip([Fractions || {_, _, Fractions} <- Group]),
    io_lib:format("    ~bx ~ts (~ts), fraction ~ts -> ~ts~n", [
        length(Group), Event, verdict(Right), range(Before), range(After)
    ]).

verdict(true) -> "right";
verdict(false) -> "NOT RIGHT".

range(Fractions) ->
    case {lists:min(Fractions), lists:max(Fractions)} of
        {Same, Same} -> io_lib:format("~.2f", [Same]);
        {Low, High} -> io_lib:format("~.2f..~.2f", [Low, High])
    end.

%% @private The answers for a bug.
-spec asked({Bug :: atom(), Seeds :: pos_integer(), BranchSeeds :: pos_integer()}) -> answer().
asked({Bug, Seeds, BranchSeeds}) ->
    case starl_dev_planted_seed:caught({Bug, Seeds}) of
        {caught, Seed, _Violation, _Seconds} -> small(Bug, Seed, BranchSeeds);
        Other -> Other
    end.

small(Bug, Seed, BranchSeeds) ->
    Catalogue = list_to_existing_atom("starl_planted"),
    Request = #{run => fun starl_sim_trial:run/1, watch => fun watch/1},
    {ok, #{scenario := Scenario}} = starl_sim_shrink:shrink(
        Catalogue:scenario(Bug, Seed), Request
    ),
    {ok, Run} = starl_sim_continuation:repeat(Scenario),
    {Ms, _} = statistics(runtime),
    Results = [result(Run, BranchSeed) || BranchSeed <- lists:seq(1, BranchSeeds)],
    {LaterMs, _} = statistics(runtime),
    Named = [named(Result, Run, Catalogue:wrong(Bug)) || Result <- Results],
    {asked, Seed, Named, result(Run, 1) =:= hd(Results), (LaterMs - Ms) / 1000}.

watch(_Figures) -> {continue, fun watch/1}.

result(Run, BranchSeed) ->
    #{timeline := Timeline, violation := #{at_us := AtUs}} = Run,
    {ok, Settings} = starl_sim_continuation:settings(Run, violation),
    Last = starl_sim_timeline:at(AtUs, Timeline),
    starl_lab_continuations:search(Run, Settings, #{
        grid => starl_sim_inevitable:grid(?POINTS, Last, Timeline),
        draws => ?DRAWS,
        branch_seed => BranchSeed,
        jobs => 1,
        interrupt => make_ref(),
        progress => starl_cli_progress:new(quiet)
    }).

named(#{curve := Curve, step := Step} = Result, Run, Wrong) ->
    {ok, Settings} = starl_sim_continuation:settings(Run, violation),
    Report = starl_lab_when_report:new(Result, Run, violation, Settings),
    case starl_lab_when_report:event(Report) of
        none ->
            {"no event", false,
                fractions({element(1, hd(Curve)), element(1, lists:last(Curve))}, Curve)};
        {Entry, Facts} ->
            Text = unicode:characters_to_list([
                starl_lab_when_report:sentence(Entry), shown(Step)
            ]),
            Ends = {element(1, hd(Curve)), element(1, lists:last(Curve))},
            {Text, lists:any(fun(W) -> starl_lab_when_report:is_of(W, Entry, Facts) end, Wrong),
                fractions(ends(Step, Ends), Curve)}
    end.

ends(none, Ends) -> Ends;
ends(Step, _Ends) -> Step.

shown(none) -> ", where it breaks: inevitable from the start";
shown({_, _}) -> "".

fractions({Low, High}, Curve) -> {fraction(Low, Curve), fraction(High, Curve)}.

fraction(Index, Curve) ->
    {_, #{broken := Broken, draws := N}} = lists:keyfind(Index, 1, Curve),
    starl_sim_proportion:fraction({Broken, N}).
