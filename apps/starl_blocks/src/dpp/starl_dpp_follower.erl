%% @doc Tracks, for a participant of path planning, the coordinator that it follows: the coordinator
%% of the highest term that it has heard of. It holds the participant's vote, the report that it
%% still has to send, and its lease to drive. Pure; the giver's side of leases is
%% {@link starl_dpp_lease}.
-module(starl_dpp_follower).

-export([new/1, begins/1, join/2, coordinator/1, term/1, answers/3]).
-export([
    prevote/3, recover/4, beat/4, returned/1, heard/2, deaf/2, missed/2, missing/1, restarted/1
]).
-export([tell/4]).
-export([timed/4, asked/2, in_no_time/2, lease_us/2]).
-export_type([t/0, ballot/0, turn/0]).

-type turn() :: {t(), [starl_machine:action()]}.
%% The answer to the coordinator's beat Seq: the own clock, and whether it has the vote.
-type ballot() :: {starl_dpp_lease:seq(), starl_dpp_lease:stamp(), Vote :: boolean()}.

-record(follow, {
    self :: starl:robot_id(),
    team :: [starl:robot_id()],
    coordinator = none :: starl:robot_id() | none,
    vote :: starl_dpp_vote:t(),
    %% the highest term heard of, in this life or an earlier one; is it known from an earlier one
    %% only?
    term :: starl_dpp:term_id(),
    anew = true :: boolean(),
    %% how near numbers have brought it that were too far above to be believed
    reach = 0 :: non_neg_integer(),
    %% the beat of this term that asked for the robot's place
    wanted = none :: starl_dpp_lease:seq() | none,
    %% when the coordinator was last heard, and when it was last answered
    heard = none :: integer() | none,
    here = none :: integer() | none,
    %% the time between two answers to beats
    here_us :: pos_integer(),
    %% the duration of a drive lease, and from when it counts, the later of two: the robot's latest
    %% stamp that came back in a beat, and the stamp of the latest request
    short_us :: pos_integer(),
    granted :: integer(),
    asked :: integer(),
    %% what the beats of coordinators show of the own clock; stamps up to `void' count no more
    witness = starl_dpp_clock_check:new() :: starl_dpp_clock_check:t(),
    void = none :: integer() | none,
    limits :: starl_dpp_clock_check:limits()
}).
-opaque t() :: #follow{}.

%% @doc Follows the coordinator of the term that was last stored; without a drive lease. The robot
%% has not voted in a lower term since, and will not from now on.
-spec new(starl_machine:config()) -> t().
new(#{robot := Self, participants := Team, now := Now} = Config) ->
    Short = starl_dpp_lease:short_us(Config),
    Members = starl_team:members(Team),
    {_, Claimant, _} = Term = stored(Config),
    #follow{
        self = Self,
        team = Members,
        vote = starl_dpp_vote:new(Config),
        coordinator =
            case lists:member(Claimant, Members) of
                true -> Claimant;
                false -> none
            end,
        term = Term,
        here_us = 2 * starl_dpp_lease:beat_us(Config),
        short_us = Short,
        limits = starl_dpp_lease:limits(Config),
        granted = Now - Short,
        asked = Now - Short
    }.

%% A term that was forgotten is replaced by one higher than any that is reached by counting. So is one that an
%% earlier version has believed and no team can have come to.
stored(#{stored := none}) ->
    {0, 0, 0};
stored(#{stored := Stored, incarnation := Life}) ->
    case Stored of
        {stored, {N, _Claimant, _} = Term} ->
            case starl_term:is_counted(N) of
                true -> Term;
                false -> forgotten(Life)
            end;
        damaged ->
            forgotten(Life)
    end.

forgotten(Life) -> {starl_term:guess(Life), 0, 0}.

%% @doc Watches a coordinator known from an earlier life: if it says nothing, another has to lead.
-spec begins(t()) -> [starl_machine:action()].
begins(#follow{coordinator = none}) -> [];
begins(F) -> watch(F).

%% @doc Names the first coordinator. A participant that knows one already stays with it.
-spec join(starl:robot_id(), t()) -> turn().
join(Coordinator, #follow{coordinator = none} = F) ->
    Joined = F#follow{coordinator = Coordinator},
    {Joined, watch(Joined)};
join(_Coordinator, F) ->
    {F, []}.

%% @doc The coordinator that is followed.
-spec coordinator(t()) -> starl:robot_id() | none.
coordinator(#follow{coordinator = Coordinator}) -> Coordinator.

%% @doc The highest term heard of.
-spec term(t()) -> starl_dpp:term_id().
term(#follow{term = Term}) -> Term.

%% @doc Is this the coordinator that is followed, in its term?
-spec answers(starl:robot_id(), starl_dpp:term_id(), t()) -> boolean().
answers(Source, Term, #follow{coordinator = Coordinator, term = Known}) ->
    {Source, Term} =:= {Coordinator, Known}.

%% -- terms ----------------------------------------------------------------------------------

%% @doc A robot asks whether it would get the vote if it claimed a term now: only a yes is answered. The answer
%% promises nothing.
-spec prevote(starl:robot_id(), Now :: integer(), t()) -> [starl_machine:action()].
prevote(Source, Now, #follow{term = Known, vote = Vote}) ->
    [
        starl_sap:post(Source, dpp_prevoted, Known)
     || starl_dpp_vote:may_claim(Source, Now, Vote)
    ].

%% @doc A robot that claims a term, or leads it, asks for this robot's place. A lower term is always
%% refused; a claim is refused also if the vote is promised to another robot, or another robot
%% leads. A robot that leads has a quorum's votes and needs no further one. A term in the name of another robot is
%% none, and one that is too far above is not believed ({@link starl_term}): who means it says it again.
-spec recover(starl:robot_id(), {starl_dpp:term_id(), Seq, Leads :: boolean()}, Now, t()) ->
    {followed | refused, turn()}
when
    Seq :: starl_dpp_lease:seq(), Now :: integer().
recover(Source, {{N, Source, _} = Term, _, _} = Claim, Now, #follow{} = F) ->
    #follow{term = {Known, _, _}, reach = Reach} = F,
    case starl_term:toward(N, max(Known, Reach)) of
        N ->
            claimed(Source, Claim, Now, F);
        Nearer ->
            Doubt = starl_sap:post(Source, dpp_refused, {doubted, Term}),
            {refused, {F#follow{reach = Nearer}, [{trace, {doubted, Source, Term}}, Doubt]}}
    end;
recover(Source, {Term, _Seq, _Leads}, _Now, F) ->
    {refused, {F, [{trace, {doubted, Source, Term}}]}}.

claimed(Source, {Term, Seq, Leads}, Now, #follow{term = Known, vote = Vote} = F) ->
    Own = Term =:= Known orelse Leads orelse starl_dpp_vote:may_claim(Source, Now, Vote),
    case Term >= Known andalso Own of
        true ->
            {followed, follow(Source, {Term, Leads}, Now, F#follow{wanted = Seq})};
        false ->
            {refused, {F, [starl_sap:post(Source, dpp_refused, Known)]}}
    end.

%% @doc Handles a heartbeat with its stamps, which prolong leases to drive. A heartbeat of the term
%% that is followed is answered now and then. A heartbeat of another term asks for the robot's
%% place. A robot that has not reported its place does so first.
-spec beat(starl:robot_id(), {starl_dpp:term_id(), Seq, [Stamp]}, Now, t()) ->
    {beaten | followed | refused, turn()}
when
    Seq :: starl_dpp_lease:seq(),
    Stamp :: {starl:robot_id(), starl_dpp_lease:stamp()},
    Now :: integer().
beat(Source, {{_, Source, _} = Term, Seq, Stamps}, Now, #follow{term = Term, anew = false} = F) ->
    #follow{self = Self, granted = Old} = F,
    Granted = granted(min(Now, proplists:get_value(Self, Stamps, Old)), F),
    {Following, Actions} = follow(Source, {Term, true}, Now, F#follow{granted = Granted}),
    {Answered, Here} = here(Seq, Now, Following),
    {beaten, {Answered, Actions ++ Here}};
beat(Source, {Term, Seq, _Stamps}, Now, F) ->
    recover(Source, {Term, Seq, true}, Now, F).

%% No stamp of the own clock is in the future, but after that was set back.
granted(Stamp, #follow{granted = Old, void = Void}) when is_integer(Void), Stamp =< Void -> Old;
granted(Stamp, #follow{granted = Old}) -> max(Old, Stamp).

%% @doc The robot's latest stamp that a coordinator has returned: it has heard the robot say that.
-spec returned(t()) -> starl_dpp_lease:stamp().
returned(#follow{granted = Stamp}) -> Stamp.

leads(Source, Now, #follow{vote = Vote} = F) ->
    F#follow{vote = starl_dpp_vote:leads(Source, Now, Vote)}.

%% A new term is stored before anything is said in it. The own robot's coordinator machine hears of
%% it, too. A claim is no sign that somebody leads: the time until the leader is missed runs on.
follow(Source, {Term, Leads}, Now, #follow{self = Self, term = Known, coordinator = Last} = F) ->
    Following = F#follow{coordinator = Source, term = Term, anew = false, heard = Now},
    New = [Action || Term =/= Known, Action <- [{store, Term} | led(Source, Term, Self)]],
    case Leads of
        true -> {leads(Source, Now, Following), New ++ watch(Following)};
        false when Last =:= none -> {Following, New ++ watch(Following)};
        false -> {Following, New}
    end.

led(Self, _Term, Self) -> [];
led(_Source, Term, _Self) -> [{cast, dpp_coordinator, {led, Term}}].

here(Seq, Now, #follow{wanted = none, here = Last, here_us = Us, term = Term} = F) when
    Last =:= none; Now - Last >= Us
->
    {Ballot, Voted} = ballot(Seq, Now, F),
    {Voted, [starl_sap:post(Voted#follow.coordinator, dpp_here, {Term, Ballot})]};
here(_Seq, _Now, F) ->
    {F, []}.

%% @doc Has the coordinator been silent for a lease?
-spec missed(Now :: integer(), t()) -> boolean().
missed(_Now, #follow{heard = none}) -> true;
missed(Now, #follow{heard = Heard, short_us = Short}) -> Now - Heard > Short.

%% @doc An answer of the coordinator is heard.
-spec heard(Now :: integer(), t()) -> t().
heard(Now, F) -> F#follow{heard = Now}.

%% @doc Does the robot not hear its coordinator any more? It did before, and not for a lease. Then it would not
%% hear an answer either.
-spec deaf(Now :: integer(), t()) -> boolean().
deaf(_Now, #follow{heard = none}) -> false;
deaf(Now, F) -> missed(Now, F).

%% @doc The own robot's coordinator machine has restarted and forgotten all terms. If it led the
%% last term, it claims the next one; else it is sent the last term.
-spec restarted(t()) -> [starl_machine:action()].
restarted(#follow{coordinator = Self, self = Self, term = {N, _, _}} = F) ->
    [{cast, dpp_coordinator, {lead, N}} | watch(F)];
restarted(#follow{term = Term}) ->
    [{cast, dpp_coordinator, {led, Term}}].

%% @doc The coordinator has been silent for long: the own robot tries to lead, and again later.
-spec missing(t()) -> [starl_machine:action()].
missing(#follow{term = {N, _, _}} = F) -> [{cast, dpp_coordinator, {missing, N}} | watch(F)].

%% When the coordinator stays silent it is missed.
watch(#follow{coordinator = Coordinator, self = Self, team = Team, vote = Vote}) ->
    [{{timeout, missing}, starl_dpp_vote:missing_us(Coordinator, Self, {Team, Vote}), missing}].

%% -- reports to the coordinator -------------------------------------------------------------

%% @doc Reports the robot's place and the edges that it knows to be painted, once for each time that
%% it was asked. The vote goes with the report.
-spec tell(starl_dpp:request_id(), {starl_dpp:place(), [Edge]}, Now :: integer(), t()) ->
    turn()
when
    Edge :: starl_dpp_graph:edge_id().
tell(_Id, _Place, _Now, #follow{wanted = none} = F) ->
    {F, []};
tell(Id, {Place, Painted}, Now, #follow{wanted = Seq, term = Term} = F) ->
    {Ballot, #follow{coordinator = Coordinator} = Voted} = ballot(Seq, Now, F),
    Body = {Term, Id, Place, Painted, Ballot},
    {Voted#follow{wanted = none}, [starl_sap:post(Coordinator, dpp_state, Body)]}.

ballot(Seq, Now, #follow{vote = Vote0, coordinator = Coordinator} = F) ->
    {Given, Vote} = starl_dpp_vote:give(Coordinator, Now, Vote0),
    {{Seq, Now, Given}, F#follow{vote = Vote, here = Now}}.

%% -- lease ----------------------------------------------------------------------------------

%% @doc Handles a stamp of a coordinator's clock. `lags': the own clock has lost more against it
%% than drift and jumps explain; then all leases given up to now have ended. Only a heartbeat is
%% remembered: it is not repeated, so it has not taken long.
-spec timed(starl:robot_id(), {starl_dpp_lease:seq(), IsBeat :: boolean()}, Now, t()) ->
    {agrees | lags, t()}
when
    Now :: integer().
timed(Source, {Seq, IsBeat}, Now, #follow{witness = Before, limits = Limits, short_us = Short} = F) ->
    case starl_dpp_clock_check:hear(Source, Seq, Now, Limits, Before) of
        {lags, Witness} ->
            Ended = F#follow{granted = Now - Short, asked = Now - Short, void = Now},
            {lags, Ended#follow{witness = Witness}};
        {agrees, Witness} when IsBeat ->
            {agrees, F#follow{witness = Witness}};
        {agrees, _NotRemembered} ->
            {agrees, F}
    end.

%% @doc A request is made: the drive lease that comes with its answer counts from now.
-spec asked(Now :: integer(), t()) -> t().
asked(Now, F) -> F#follow{asked = Now}.

%% @doc Has the answer to the latest request come in no time, though over the air? Then the own
%% clock has stopped or was set back. A lease would last too long by the time that it has lost.
-spec in_no_time(Now :: integer(), t()) -> boolean().
in_no_time(_Now, #follow{coordinator = Self, self = Self}) -> false;
in_no_time(Now, #follow{asked = Asked}) -> Now =< Asked.

%% @doc What is left of the lease to drive (us); 0 or less: it has ended.
-spec lease_us(Now :: integer(), t()) -> integer().
lease_us(Now, #follow{granted = Granted, asked = Asked, short_us = Short}) ->
    case max(Granted, Asked) + Short - Now of
        Us when is_integer(Us) -> Us
    end.
