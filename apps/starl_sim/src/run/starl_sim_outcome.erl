%% @doc The outcome of a run: why it ended, the results of the monitors, a summary of each robot,
%% and the digest. Two runs have equal digests if their robots have had the same events.
-module(starl_sim_outcome).

-export([new/2]).

-export_type([t/0]).

%% The outcome. The robots of lost nodes are missing in it. The digest is empty then, and if a robot
%% did not end its step, which `hung' names.
-type t() :: #{
    ending := starl_run:ending() | none,
    end_us := starl_sim_queue:time(),
    %% the time until which contracts are judged
    judged_us := starl_sim_queue:time(),
    violations := [starl_monitor:violation()],
    %% the parts of the run of which there is no verdict
    unjudged := [starl_unjudged:t()],
    monitors := #{module() => map()},
    robots := [robot()],
    digest := binary(),
    events := non_neg_integer(),
    packets := non_neg_integer(),
    lost := [starl_sim_nodes:loss()],
    hung => starl_sim_window:hang()
}.

-type robot() :: {starl:robot_id(), starl_sim_summary:t()}.

%% @doc The outcome of a run that ends now, from the summaries of its known robots, ascending. If
%% nothing could happen any more (`quiet'), the time still passes until the limit of the run: a
%% robot that should have made progress until then has not.
-spec new(End, starl_sim_judge:t()) -> t() when
    End :: #{
        ending := starl_run:ending() | none,
        end_us := starl_sim_queue:time(),
        limit_us := starl_sim_queue:time(),
        robots := [robot()],
        team := pos_integer(),
        lost := [starl_sim_nodes:loss()],
        hung => starl_sim_window:hang()
    }.
new(#{robots := Robots} = End, Judge) ->
    Until = until_us(End),
    {Violations, Results, Unjudged} = starl_sim_judge:close(Until, Judge),
    (maps:with([ending, end_us, robots, lost, hung], End))#{
        judged_us => Until,
        violations => Violations,
        unjudged => Unjudged,
        monitors => Results,
        digest => digest(End),
        events => lists:sum([N || {_, #{events := N}} <- Robots]),
        packets => lists:sum([N || {_, #{packets := N}} <- Robots])
    }.

until_us(#{ending := quiet, end_us := Now, limit_us := Limit}) -> max(Now, Limit);
until_us(#{end_us := Now}) -> Now.

%% Only a digest over all robots, at the end of a window, can be compared with that of another run.
digest(#{robots := Robots, team := Team}) when length(Robots) < Team ->
    <<>>;
digest(#{hung := _}) ->
    <<>>;
digest(#{robots := Robots}) ->
    Bytes = [<<Id:32, Chain:32>> || {Id, #{chain := Chain}} <- Robots],
    binary:part(crypto:hash(sha256, Bytes), 0, 16).
