%% @doc The command `./starl planted --when': tests `./starl when' on planted bugs. It asks by which
%% event a bug's violation became inevitable, and compares the answer with what the bug makes wrong.
%% So it shows whether the answer can be trusted where the truth is known.
-module(starl_dev_planted_when).

-export([table/3]).
%% Called in the VMs of the jobs.
-export([asked/1]).

-export_type([answer/0]).

%% What came of a bug: the seed of its run; the answers, one for each salt; whether the first salt gave the
%% same curve again; the CPU time of all answers, s.
-type answer() ::
    {asked, Seed :: pos_integer(), [named()], Same :: boolean(), Seconds :: float()}
    | {not_caught, Seeds :: pos_integer(), Seconds :: float()}
    | {failed, term()}.

%% The event that was named, in a line; whether it is one that the bug makes wrong; the shares just before
%% and after it.
-type named() :: {unicode:chardata(), Right :: boolean(), {Before :: float(), After :: float()}}.

%% Those of the page on finding faults, as few as find a step.
-define(FUTURES, 20).
-define(MOMENTS, 8).

%% @doc Asks of these bugs, and prints the table.
-spec table(Bugs, [starl_cli_target:code()], Values :: map()) -> 0 | 4 | 130 when
    Bugs :: [{atom(), atom(), string()}].
table(Bugs, Codes, #{seeds := Seeds, 'when' := Salts, jobs := Most}) ->
    Jobs = [{Bug, Seeds, Salts} || {Bug, _, _} <- Bugs],
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
    {Before, After} = lists:unzip([Shares || {_, _, Shares} <- Group]),
    io_lib:format("    ~bx ~ts (~ts), share ~ts -> ~ts~n", [
        length(Group), Event, verdict(Right), range(Before), range(After)
    ]).

verdict(true) -> "right";
verdict(false) -> "NOT RIGHT".

range(Shares) ->
    case {lists:min(Shares), lists:max(Shares)} of
        {Same, Same} -> io_lib:format("~.2f", [Same]);
        {Low, High} -> io_lib:format("~.2f..~.2f", [Low, High])
    end.

%% @private The answers for a bug.
-spec asked({Bug :: atom(), Seeds :: pos_integer(), Salts :: pos_integer()}) -> answer().
asked({Bug, Seeds, Salts}) ->
    case starl_dev_planted_seed:caught({Bug, Seeds}) of
        {caught, Seed, _Violation, _Seconds} -> small(Bug, Seed, Salts);
        Other -> Other
    end.

small(Bug, Seed, Salts) ->
    Catalogue = list_to_existing_atom("starl_planted"),
    Request = #{run => fun starl_sim_trial:run/1, watch => fun watch/1},
    {ok, #{scenario := Scenario}} = starl_sim_shrink:shrink(
        Catalogue:scenario(Bug, Seed), Request
    ),
    {ok, Run} = starl_sim_future:repeat(Scenario),
    {Ms, _} = statistics(runtime),
    Results = [result(Run, Salt) || Salt <- lists:seq(1, Salts)],
    {LaterMs, _} = statistics(runtime),
    Named = [named(Result, Run, Catalogue:wrong(Bug)) || Result <- Results],
    {asked, Seed, Named, result(Run, 1) =:= hd(Results), (LaterMs - Ms) / 1000}.

watch(_Figures) -> {continue, fun watch/1}.

result(Run, Salt) ->
    starl_lab_futures:step(Run, starl_sim_future:settings(Run), #{
        moments => ?MOMENTS,
        futures => ?FUTURES,
        salt => Salt,
        jobs => 1,
        interrupt => make_ref(),
        progress => starl_cli_progress:new(quiet)
    }).

named(#{curve := Curve, step := Step} = Result, Run, Wrong) ->
    Report = starl_lab_when_report:new(Result, Run, starl_sim_future:settings(Run)),
    case starl_lab_when_report:event(Report) of
        none ->
            {"no event", false,
                shares({element(1, hd(Curve)), element(1, lists:last(Curve))}, Curve)};
        {Entry, Facts} ->
            Text = unicode:characters_to_list([
                starl_lab_when_report:sentence(Entry), shown(Step)
            ]),
            Ends = {element(1, hd(Curve)), element(1, lists:last(Curve))},
            {Text, lists:any(fun(W) -> starl_lab_when_report:is_of(W, Entry, Facts) end, Wrong),
                shares(ends(Step, Ends), Curve)}
    end.

ends(none, Ends) -> Ends;
ends(Step, _Ends) -> Step.

shown(none) -> ", where it breaks: inevitable from the start";
shown({_, _}) -> "".

shares({Low, High}, Curve) -> {share(Low, Curve), share(High, Curve)}.

share(Moment, Curve) ->
    {_, #{broken := Broken, futures := N}} = lists:keyfind(Moment, 1, Curve),
    starl_sim_proportion:share({Broken, N}).
