%% @doc The outcome of a live run, as of a simulation, with the counters of the robots that still run.
-module(starl_world_outcome).

-export([close/4]).

%% @doc The outcome of a run that ends now: its monitors are closed, and its observer is told.
-spec close(Ending, NowUs, {starl_world_judge:t(), starl_world_team:t()}, starl_observer:t()) ->
    starl_run:outcome()
when
    Ending :: starl_world:ending() | none, NowUs :: integer().
close(Ending, Now, {Judge, Robots}, Observer) ->
    {Violations, Results, Unjudged} = starl_world_judge:close(Now, Judge),
    Told = #{
        ending => Ending,
        end_us => Now,
        violations => Violations,
        unjudged => Unjudged,
        digest => <<>>
    },
    ok = starl_observer:tell({ended, Told}, Observer),
    Outcome = outcome(Ending, Now, {Violations, Results, Unjudged}, Robots),
    Outcome#{late_computers => starl_world_judge:late_computers(Judge)}.

outcome(Ending, Now, {Violations, Results, Unjudged}, Robots) ->
    Summaries = [
        {Id, summary(Now, Robot)}
     || {Id, Robot} <- starl_world_team:summaries(Now, Robots)
    ],
    #{
        ending => Ending,
        end_us => Now,
        judged_us => Now,
        violations => Violations,
        unjudged => Unjudged,
        monitors => Results,
        robots => Summaries,
        digest => <<>>,
        events => lists:sum([E || {_, #{events := E}} <- Summaries]),
        packets => lists:sum([P || {_, #{packets := P}} <- Summaries]),
        lost => []
    }.

summary(Now, #{result := Result, pose := Pose, link := Link}) ->
    Figures = figures(Link),
    Figures#{
        at_us => Now,
        chain => 0,
        checkpoints => [],
        result => Result,
        pose => Pose,
        crashes => []
    }.

figures(none) ->
    #{events => 0, packets => 0};
figures(Link) ->
    try
        starl_live_link:figures(Link)
    catch
        exit:_ -> #{events => 0, packets => 0}
    end.
