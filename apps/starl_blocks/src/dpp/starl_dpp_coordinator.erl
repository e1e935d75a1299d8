%% @doc The coordinator of distributed path planning (the paper's Subroutine 3). This machine
%% ensures that at most one robot leads; {@link starl_dpp_dispatcher} serves the robots.
%% ```
%%        a request, or a participant that misses its coordinator
%%   idle ------> prevoting --------------------> claiming
%%     ^              |     a quorum would vote     |   | a quorum's votes
%%     |              |                             |   v
%%     |              v  no quorum                  v  leading
%%     +--------------+-----------------------------+---+ votes have run out
%% '''
%% There is one machine on every robot; the robot that leads is the coordinator.
%%
%% First the robot asks all participants whether they would vote for it (`dpp_prevote'). This
%% question changes nothing for anybody. A robot that hears no quorum gets no further, however often
%% it is asked to lead. It takes no votes from others, keeps none of them waiting, and raises no
%% term. (This is the pre-vote of Ongaro, "Consensus: bridging theory and practice", 2014, section
%% 9.6.) Before the very first term nobody can lead yet, so a robot that is asked for a path claims
%% at once.
%%
%% A claim begins a new term, {N, Robot, Incarnation}, higher than all terms known. The claimant
%% asks all participants for their vote, their place and their path (`dpp_recover'). Participants
%% accept nothing from a lower term. A coordinator assigns only while a quorum's votes last
%% ({@link starl_dpp_lease}), and only when it knows every robot's place. It knows a place from the
%% robot's own report in this term. If the robot is silent, it asks the positioning service once all
%% leases to drive of that robot must have ended.
%%
%% A computer may stall in the middle of a step. So every message and every fact of a leading
%% coordinator has a deadline: the end of its votes ({@link starl_machine:action()}).
%%
%% Its heartbeats, one a second or more often ({@link starl_dpp_lease:beat_us/1}), carry the stamps
%% that prolong the participants' leases to drive. A machine that crashed has forgotten its term;
%% the participants that voted for its robot vote for it again at once.
%%
%% Messages to participants: `dpp_prevote N', `dpp_recover {Term, Seq, Leads}', `dpp_beat {Term,
%% Seq, Stamps}' and `dpp_answer'. Messages from them: `dpp_request', `dpp_passed', `dpp_state',
%% `dpp_here', `dpp_refused', and `dpp_prevoted Term' from those that would vote for it. The last
%% two carry the highest term that the sender knows. Casts from the own participant: `{missing, N}',
%% `{lead, N}', `{led, Term}', and `out_of_time' when the robot's clock has stopped or was set: then
%% votes given before do not count.
%%
%% Trace: {@link event()}.
-module(starl_dpp_coordinator).
-behaviour(starl_machine).

-export([init/1, handle_event/5, accepts/2]).

-export_type([event/0]).

%% The trace of a coordinator.
-type event() ::
    %% it asks for votes; it has those of a quorum; it leads no longer
    {claims, starl_dpp:term_id()}
    | {leads, starl_dpp:term_id()}
    | {stepped_down, starl_dpp:term_id()}
    %% this robot knows a term that is too far above to be believed at once
    | {doubted, starl:robot_id(), starl_dpp:term_id()}
    | starl_dpp_dispatcher:event().

%% The time after which robots whose place is not known are asked again.
-define(RECOVER_US, 2000000).

%% The platform's part of its configuration.
-define(PLATFORMS, [
    robot, participants, incarnation, life, name, random, team_seed, now, stored
]).

%% A robot that doubts is asked again so often in this time; then the next beat asks it.
-define(DOUBTS, 64).
-define(DOUBTS_US, 500000).

-record(coordinator, {
    self :: starl:robot_id(),
    incarnation :: pos_integer(),
    team :: [starl:robot_id()],
    config :: starl_dpp:config(),
    now :: integer(),
    service :: module(),
    %% prepared by the service, for all terms
    blank = none :: term() | none,
    %% the highest number of a term that is known, and the own term
    n = 0 :: non_neg_integer(),
    term = {0, 0, 0} :: starl_dpp:term_id(),
    %% how near numbers have brought it that were too far above to be believed
    reach = 0 :: non_neg_integer(),
    %% the robots that doubt the own term: since when, and how often each was asked again
    doubters = #{} :: #{starl:robot_id() => {FromUs :: integer(), Count :: pos_integer()}},
    lease :: starl_dpp_lease:t(),
    %% the robots that would vote for this one
    agreed = [] :: [starl:robot_id()],
    witness = starl_dpp_clock_check:new() :: starl_dpp_clock_check:t(),
    serve = none :: starl_dpp_service:t() | none
}).

-type state() :: idle | prevoting | claiming | leading.

%% Is the own term under way?
-define(IS_CURRENT(State), State =:= claiming orelse State =:= leading).

-spec init(starl_machine:config()) -> {idle, #coordinator{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Life, now := Now} = Config) ->
    Given = maps:without(?PLATFORMS ++ [counted, serve], Config),
    Members = starl_team:members(Team),
    Data = #coordinator{
        self = Self,
        incarnation = Life,
        team = Members,
        config = Given,
        now = Now,
        service = maps:get(serve, Config, starl_dpp_dispatcher),
        lease = starl_dpp_lease:new(Members, Given)
    },
    {idle, Data, listen()}.

-spec handle_event(
    starl_machine:event_type(), term(), state(), #coordinator{}, starl_machine:meta()
) -> starl_machine:result().
handle_event(Type, Content, State, Data0, #{now := Now}) ->
    Data = Data0#coordinator{now = Now},
    Result =
        case State =:= leading andalso not starl_dpp_lease:leads(Now, Data#coordinator.lease) of
            true -> after_end(Type, Content, Data);
            false -> event(Type, Content, State, Data)
        end,
    in_time(State, Result).

%% Whatever a leading coordinator says leaves before its votes have ended, or not at all.
in_time(_State, {next_state, leading, Data, Actions}) ->
    {next_state, leading, Data, said(Actions, Data)};
in_time(leading, {keep_state, Data, Actions}) ->
    {keep_state, Data, said(Actions, Data)};
in_time(_State, Result) ->
    Result.

said(Actions, #coordinator{lease = Lease}) ->
    case lists:partition(fun is_timer/1, Actions) of
        {Timers, []} ->
            Timers;
        {Timers, Said} ->
            Until = starl_dpp_lease:until(Lease),
            [{until, Until, [bounded(Action, Until) || Action <- Said], said} | Timers]
    end.

is_timer(Action) -> is_tuple(element(1, Action)).

bounded({call, sap, {send, To, Type, Body}, Tag}, Until) ->
    starl_sap:send(To, Type, Body, Tag, Until);
bounded({cast, sap, {shout, Type, Body}}, Until) ->
    starl_sap:shout(Type, Body, Until);
bounded(Action, _Until) ->
    Action.

%% The votes have ended: nothing may be assigned any more.
after_end(Type, Content, Data) ->
    Ended = [{trace, {stepped_down, Data#coordinator.term}} | stop_timers()],
    case event(Type, Content, idle, Data) of
        {next_state, State, Next, Actions} -> {next_state, State, Next, Ended ++ Actions};
        {keep_state, Next, Actions} -> {next_state, idle, Next, Ended ++ Actions};
        keep_state_and_data -> {next_state, idle, Data, Ended};
        unknown_event -> {next_state, idle, Data, [{trace, {unknown_event, Type, Content}} | Ended]}
    end.

stop_timers() -> [{{timeout, T}, cancel} || T <- [serve, give_up, beat, recover, claim]].

event(cast, {message, Robot, Type, Body}, State, Data) ->
    message(Type, Body, Robot, State, Data);
event({timeout, Timer}, _, State, Data) ->
    timed_out(Timer, State, Data);
event({reply, Tag}, Answer, State, Data) ->
    replied(Tag, Answer, State, Data);
event(cast, Word, State, Data) ->
    follower(Word, State, Data);
%% What it has promised in the meantime is known to nobody: it begins a new term.
event(info, {late, said}, leading, #coordinator{n = N} = Data) ->
    claim(N, Data);
event(info, {late, said}, _State, _Data) ->
    keep_state_and_data;
event(info, {restarted, sap}, _State, Data) ->
    {keep_state, Data, listen()};
event(info, {restarted, _}, _State, _Data) ->
    keep_state_and_data;
event(_, _, _, _) ->
    unknown_event.

timed_out(beat, leading, Data) ->
    keep(beat(Data));
timed_out(recover, State, Data) when ?IS_CURRENT(State) ->
    keep(ask_unknown(State, Data));
timed_out(serve, leading, #coordinator{service = Service, serve = Serve} = Data) ->
    keep(served(Service:serve(Serve), Data));
timed_out(give_up, leading, #coordinator{service = Service, serve = Serve} = Data) ->
    keep(served(Service:give_up(Serve), Data));
timed_out(reopen, leading, #coordinator{service = Service, serve = Serve} = Data) ->
    keep(served(Service:reopen(Serve), Data));
timed_out(claim, State, Data) when State =:= prevoting; State =:= claiming ->
    {next_state, idle, Data, stop_timers()};
timed_out(_Timer, _State, _Data) ->
    keep_state_and_data.

replied({rest, Term, Robot}, {ok, {X, Y, _}}, leading, #coordinator{term = Term} = Data) ->
    keep(rests(Robot, {X, Y}, Data));
replied({answered, Term, Robot}, Outcome, leading, #coordinator{term = Term} = Data) ->
    #coordinator{service = Service, serve = Serve} = Data,
    Arrived =
        case Outcome of
            ok -> ok;
            {error, _} -> lost
        end,
    {keep_state, Data#coordinator{serve = Service:answered(Robot, Arrived, Serve)}, []};
replied(_Tag, _Answer, _State, _Data) ->
    keep_state_and_data.

%% Words of the robot's own follower.
follower({missing, N}, State, Data) when State =:= idle; State =:= prevoting ->
    prevote(N, Data);
follower({missing, _N}, _State, _Data) ->
    keep_state_and_data;
follower({lead, N}, State, #coordinator{n = Known} = Data) ->
    case not (?IS_CURRENT(State)) orelse N > Known of
        true -> claim(N, Data);
        false -> keep_state_and_data
    end;
follower({led, Term}, State, #coordinator{term = Own} = Data) when Term > Own ->
    Ended = [{trace, {stepped_down, Own}} || State =:= leading],
    {next_state, idle, higher(Term, Data), Ended ++ stop_timers()};
follower({led, _Term}, _State, _Data) ->
    keep_state_and_data;
follower(out_of_time, State, #coordinator{n = N} = Data) when ?IS_CURRENT(State) ->
    claim(N, Data);
follower(out_of_time, _State, _Data) ->
    keep_state_and_data;
follower(_Word, _State, _Data) ->
    unknown_event.

%% @private What comes over the radio.
-spec accepts(starl_packet:type(), Body :: term()) -> boolean().
accepts(Type, Body) -> starl_dpp_message:accepts(Type, Body).

listen() ->
    [
        starl_sap:listen(Type, dpp_coordinator)
     || Type <- [dpp_request, dpp_passed, dpp_state, dpp_here, dpp_refused, dpp_prevoted]
    ].

keep({Data, Actions}) -> {keep_state, Data, Actions}.

higher({N, _, _}, #coordinator{n = Known} = Data) -> Data#coordinator{n = max(N, Known)}.

%% -- claiming -------------------------------------------------------------------------------

%% Asks all others whether they would vote for this robot.
prevote(N, #coordinator{n = Known, self = Self, config = Config} = Data) ->
    Next = max(N, Known),
    case agreed([Self], Data#coordinator{n = Next}) of
        {keep_state, Asking, []} ->
            {next_state, prevoting, Asking, [
                claim_timer(Config), {cast, sap, {broadcast, dpp_prevote, Next}}
            ]};
        Claiming ->
            Claiming
    end.

agreed(Robots, #coordinator{team = Team, n = N} = Data) ->
    case starl_dpp_lease:quorum(Robots, Team) of
        true -> claim(N, Data);
        false -> {keep_state, Data#coordinator{agreed = lists:usort(Robots)}, []}
    end.

claim_timer(Config) -> {{timeout, claim}, starl_dpp_lease:long_us(Config) * 3 div 2, claim}.

%% Begins a term higher than all that are known.
claim(N, #coordinator{n = Known, self = Self, team = Team, config = Config} = Data0) ->
    #coordinator{service = Service, blank = Blank} = Data = with_blank(Data0),
    Next = max(N, Known) + 1,
    Term = {Next, Self, Data#coordinator.incarnation},
    Claiming = Data#coordinator{
        n = Next,
        term = Term,
        agreed = [],
        lease = starl_dpp_lease:new(Team, Config),
        serve = Service:new(Blank, Term)
    },
    {Asked, Actions} = ask_unknown(claiming, Claiming),
    Trace = {trace, {claims, Term}},
    {next_state, claiming, Asked, stop_timers() ++ [Trace, claim_timer(Config) | Actions]}.

with_blank(#coordinator{blank = none, config = Config, team = Team} = Data) ->
    #coordinator{service = Service} = Data,
    Settings = maps:without([lease_ms, drift_ppm, jump_ms], Config),
    Data#coordinator{blank = Service:prepare(Settings#{robots => Team})};
with_blank(Data) ->
    Data.

%% One packet for all at first; robots that have not answered are asked again one by one. The own
%% participant is asked last, when its vote makes a quorum: a robot that gets no votes goes on
%% following the robot that leads.
ask_unknown(State, #coordinator{service = Service, self = Self, team = Team} = Data) ->
    {Seq, Lease} = starl_dpp_lease:beat(Data#coordinator.now, Data#coordinator.lease),
    Body = {Data#coordinator.term, Seq, State =:= leading},
    All = Service:unknown(Data#coordinator.serve),
    Unknown = All -- [Self || not hopeful(Data)],
    Messages =
        case Unknown -- [Self] =:= Team -- [Self] of
            true -> [{cast, sap, {broadcast, dpp_recover, Body}}];
            false -> [starl_sap:post(Robot, dpp_recover, Body) || Robot <- Unknown -- [Self]]
        end,
    Own = [starl_sap:post(Self, dpp_recover, Body) || lists:member(Self, Unknown)],
    Timer = [{{timeout, recover}, ?RECOVER_US, recover} || All =/= []],
    {Data#coordinator{lease = Lease}, Messages ++ Own ++ Timer}.

hopeful(#coordinator{self = Self, team = Team, lease = Lease, now = Now}) ->
    starl_dpp_lease:quorum([Self | starl_dpp_lease:votes(Now, Lease)], Team).

%% -- leading --------------------------------------------------------------------------------

beat(#coordinator{now = Now, term = Term, lease = Lease0, self = Self, team = Team} = Data) ->
    {Seq, Lease} = starl_dpp_lease:beat(Now, Lease0),
    Body = {Term, Seq, starl_dpp_lease:stamps(Lease)},
    Lost = [
        starl_location:pose(Robot, {rest, Term, Robot})
     || Robot <- Team, may_rest(Robot, Data)
    ],
    {Data#coordinator{lease = Lease}, [
        starl_sap:shout(dpp_beat, Body),
        starl_sap:post(Self, dpp_beat, Body),
        {{timeout, beat}, starl_dpp_lease:beat_us(Data#coordinator.config), beat}
        | Lost
    ]}.

%% All drive leases that the robot may have have ended.
may_rest(Robot, #coordinator{now = Now, lease = Lease, service = Service, serve = Serve}) ->
    starl_dpp_lease:rests(Robot, Now, Lease) andalso not Service:silent(Robot, Serve).

rests(Robot, At, #coordinator{service = Service, serve = Serve} = Data) ->
    case may_rest(Robot, Data) of
        true -> served(Service:rests(Robot, At, Serve), Data);
        false -> {Data, []}
    end.

served({Serve, Actions}, Data) -> {Data#coordinator{serve = Serve}, Actions}.

%% -- messages of participants ---------------------------------------------------------------

message(dpp_refused, {doubted, Own}, Robot, State, #coordinator{term = Own} = Data) when
    ?IS_CURRENT(State)
->
    keep(ask_doubter(Robot, State =:= leading, Data));
message(dpp_refused, {doubted, _Term}, _Robot, _State, _Data) ->
    keep_state_and_data;
message(Type, Body, Robot, State, #coordinator{n = Known, reach = Reach} = Data) ->
    {N, _, _} = Term = term(Type, Body),
    case starl_term:toward(N, max(Known, Reach)) of
        N -> believed(Type, Body, Robot, State, Data);
        Nearer -> doubted(Type, Term, Robot, State, Data#coordinator{reach = Nearer})
    end.

term(Type, Term) when Type =:= dpp_refused; Type =:= dpp_prevoted -> Term;
term(_Type, Body) -> element(1, Body).

%% A robot knows a term too far above the own one. Asked again, it says that again, until that is believed. A
%% robot that would vote, or asks for a path, is heard all the same.
doubted(Type, Term, Robot, State, Data) ->
    Trace = {trace, {doubted, Robot, Term}},
    case {Type, State} of
        {dpp_prevoted, prevoting} ->
            traced(Trace, agreed([Robot | Data#coordinator.agreed], Data));
        {dpp_request, idle} ->
            traced(Trace, prevote(0, Data));
        {dpp_refused, _} when ?IS_CURRENT(State) ->
            {Asked, Again} = ask_doubter(Robot, State =:= leading, Data),
            {keep_state, Asked, [Trace | Again]};
        _ ->
            {keep_state, Data, [Trace]}
    end.

traced(Trace, {keep_state, Data, Actions}) -> {keep_state, Data, [Trace | Actions]};
traced(Trace, {next_state, State, Data, Actions}) -> {next_state, State, Data, [Trace | Actions]}.

believed(dpp_prevoted, Term, Robot, prevoting, #coordinator{agreed = Agreed} = Data) ->
    agreed([Robot | Agreed], higher(Term, Data));
%% Only messages of this term count: an older one does not tell what another coordinator has
%% assigned since.
believed(dpp_refused, {N, _, _} = Term, _Robot, State, #coordinator{term = Own} = Data) when
    ?IS_CURRENT(State), Term > Own
->
    claim(N, Data);
believed(Type, Term, _Robot, _State, Data) when Type =:= dpp_refused; Type =:= dpp_prevoted ->
    {keep_state, higher(Term, Data), []};
believed(Type, Body, Robot, State, #coordinator{term = Own, n = Known} = Data) ->
    case element(1, Body) of
        Own when ?IS_CURRENT(State) -> heard(Type, Body, Robot, State, Data);
        {0, _, _} when State =:= idle, Type =:= dpp_request, Known =:= 0 -> claim(0, Data);
        {N, _, _} when State =:= idle, Type =:= dpp_request -> prevote(N, Data);
        {N, _, _} = Term when ?IS_CURRENT(State), Term > Own -> claim(N, Data);
        Term when State =:= leading, Term < Own -> keep(ask_again(Robot, true, Data));
        Term -> {keep_state, higher(Term, Data), []}
    end.

%% Each answer brings the two nearer, and each is asked for by the one before: so many of them a second.
ask_doubter(Robot, Leads, #coordinator{now = Now, doubters = Doubters} = Data) ->
    {From, Count} =
        case Doubters of
            #{Robot := {Begun, Asked}} when Now - Begun < ?DOUBTS_US -> {Begun, Asked};
            #{} -> {Now, 0}
        end,
    case Count < ?DOUBTS of
        true ->
            ask_again(Robot, Leads, Data#coordinator{
                doubters = Doubters#{Robot => {From, Count + 1}}
            });
        false ->
            {Data, []}
    end.

%% The robot follows an earlier term, or says that it does not believe this one.
ask_again(Robot, Leads, #coordinator{now = Now, term = Term} = Data) ->
    {Seq, Lease} = starl_dpp_lease:beat(Now, Data#coordinator.lease),
    {Data#coordinator{lease = Lease}, [starl_sap:post(Robot, dpp_recover, {Term, Seq, Leads})]}.

%% If the clocks of others show that the own one has stood still, votes given before do not count.
heard(Type, Body, Robot, State, Data) ->
    #coordinator{now = Now, config = Config, witness = Before, n = N} = Data,
    Limits = starl_dpp_lease:limits(Config),
    case starl_dpp_clock_check:hear(Robot, stamp(Type, Body), Now, Limits, Before) of
        {agrees, Witness} -> in_time(Type, Body, Robot, State, Data#coordinator{witness = Witness});
        {lags, Witness} -> claim(N, Data#coordinator{witness = Witness})
    end.

stamp(dpp_request, Body) -> element(5, Body);
stamp(dpp_state, {_, _Id, _Place, _Painted, {_, Stamp, _}}) -> Stamp;
stamp(dpp_here, {_, {_, Stamp, _}}) -> Stamp;
stamp(dpp_passed, _Body) -> none.

in_time(dpp_request, {Term, Id, At, Painted, Stamp, Towards}, Robot, State, Data) ->
    #coordinator{service = Service, serve = S} = Data,
    {Told, Actions} = served(Service:blocked(At, Towards, S), Data),
    Request = {Term, Id, At, Painted, Stamp},
    {keep_state, Next, More} = in_time(dpp_request, Request, Robot, State, Told),
    {keep_state, Next, Actions ++ More};
in_time(dpp_request, {_, Id, At, Painted, Stamp}, Robot, _State, #coordinator{serve = S} = Data) ->
    #coordinator{lease = Lease, now = Now, term = Term} = Heard = stamped(Robot, Stamp, Data),
    Service = Data#coordinator.service,
    case starl_dpp_lease:outlives(Robot, Stamp, Now, Lease) of
        true ->
            keep({Heard, [starl_sap:post(Robot, dpp_answer, {Term, Id, again, []})]});
        false ->
            keep(served(Service:requested(Robot, Id, {At, Painted}, S), Heard))
    end;
in_time(dpp_passed, {_, Id, N}, Robot, _State, #coordinator{serve = S} = Data) ->
    keep(served((Data#coordinator.service):passed(Robot, Id, N, S), Data));
in_time(dpp_state, {_, Id, Place, Painted, Ballot}, Robot, State, #coordinator{serve = S} = Data) ->
    {_, Stamp, _} = Ballot,
    Reported = (Data#coordinator.service):reported(Robot, Id, {Place, Painted}, S),
    {Told, Actions} = served(Reported, Data),
    elected(State, Actions, voted(Robot, Ballot, stamped(Robot, Stamp, Told)));
in_time(dpp_here, {_, {_, Stamp, _} = Ballot}, Robot, State, #coordinator{serve = Serve} = Data) ->
    Service = Data#coordinator.service,
    Heard =
        case Service:knows(Robot, Serve) andalso not Service:silent(Robot, Serve) of
            true -> stamped(Robot, Stamp, Data);
            false -> Data
        end,
    elected(State, [], voted(Robot, Ballot, Heard)).

stamped(Robot, Stamp, #coordinator{lease = Lease, now = Now} = Data) ->
    Data#coordinator{lease = starl_dpp_lease:heard(Robot, Stamp, Now, Lease)}.

voted(Robot, {Seq, _, Vote}, #coordinator{lease = Lease} = Data) ->
    Data#coordinator{lease = starl_dpp_lease:voted(Robot, Seq, Vote, Lease)}.

%% With a quorum's votes a claim is won.
elected(claiming, Actions, #coordinator{lease = Lease, now = Now, self = Self} = Data) ->
    case {starl_dpp_lease:leads(Now, Lease), hopeful(Data)} of
        {true, _} ->
            Leading = Data#coordinator{lease = starl_dpp_lease:since(Now, Lease)},
            #coordinator{service = Service, serve = Serve} = Data,
            {Served, More} = served(Service:lead(Serve), Leading),
            {Beaten, Beat} = beat(Served),
            Trace = {trace, {leads, Data#coordinator.term}},
            Timers = [{{timeout, claim}, cancel}, {{timeout, recover}, ?RECOVER_US, recover}],
            {next_state, leading, Beaten, Actions ++ [Trace | More] ++ Beat ++ Timers};
        {false, true} ->
            case (Data#coordinator.service):knows(Self, Data#coordinator.serve) of
                true ->
                    {keep_state, Data, Actions};
                false ->
                    {Asked, Own} = ask_self(Data),
                    {keep_state, Asked, Actions ++ Own}
            end;
        {false, false} ->
            {keep_state, Data, Actions}
    end;
elected(_State, Actions, Data) ->
    {keep_state, Data, Actions}.

ask_self(#coordinator{self = Self, now = Now, term = Term} = Data) ->
    {Seq, Lease} = starl_dpp_lease:beat(Now, Data#coordinator.lease),
    {Data#coordinator{lease = Lease}, [starl_sap:post(Self, dpp_recover, {Term, Seq, false})]}.
