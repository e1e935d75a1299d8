%% @doc The state of a robot's mutex machine. It holds the robot's tokens, the acquisitions of its
%% application, the hand-overs under way, the known owners, and the tokens whose home the robot is.
%% Pure; {@link starl_mutex_acquire}, {@link starl_mutex_robot} and {@link starl_mutex_host} work on
%% it. The state collects actions, taken with {@link result/1}, and notices to jobs, taken with
%% {@link take_notices/1}.
-module(starl_mutex_state).

-export([new/1, at/2, now/1, self/1, team_size/1, incarnation/1, lease_us/1, retry_us/1]).
-export([act/2, acts/2, until/4, post/3, post_home/3, is_home/3, of_team/2]).
-export([result/1, notify/2, take_notices/1]).
-export([
    next_job/1, keep_job/3, job/2, waiting/2, complete/2, jobs_of/2, forget_job/2, suspend_job/2
]).
-export([wanting/2, is_wanted/3, entry/2, put_entry/3, forget_entry/2, is_over/2, over/1]).
-export([void/3, is_void/3, all_told/1]).
-export([owners/1, put_owners/2, home/1, put_home/2, sent_out/5, take_out/3, outs/1]).

-export_type([t/0, entry/0, notice/0]).

-type token() :: starl_mutex:token().
-type fence() :: starl_mutex:fence().
-type request() :: starl_mutex_home:request().
-type job_id() :: starl_mutex_job:id().

%% A token that the robot has: the number of the next hold; whether the home has confirmed it, and
%% if so until when; the queue of requests; the job and the number of the present hold; the number
%% of claims sent; whether the present hold is the last one under its number.
-type entry() :: #{
    fence := fence(),
    granted := boolean(),
    lease_end := integer(),
    queue := [request()],
    lock := none | {job_id(), fence()},
    tries := non_neg_integer(),
    last => true
}.

%% A notice to a job: it has got a token, or has lost one that others waited for, too.
-type notice() ::
    {locked, job_id(), token(), fence()} | {lost, job_id(), token(), Queue :: [request()]}.

-record(robot, {
    self :: starl:robot_id(),
    team :: tuple(),
    incarnation :: pos_integer(),
    lease_us :: pos_integer(),
    retry_us :: pos_integer(),
    %% valid for the present event only
    now = 0 :: integer(),
    home :: starl_mutex_home:t(),
    entries = #{} :: #{token() => entry()},
    jobs = #{} :: #{job_id() => starl_mutex_job:t()},
    next = 1 :: job_id(),
    %% hand-overs whose outcome is not known yet
    outs = #{} :: #{{token(), fence()} => {starl:robot_id(), [request()]}},
    owners = starl_mutex_owners:new() :: starl_mutex_owners:t(),
    %% holds of the last step that were told too late, and so have never been
    void = [] :: [{token(), fence()}],
    %% both latest first
    actions = [] :: [starl_machine:action()],
    notices = [] :: [notice()]
}).

-opaque t() :: #robot{}.

%% @doc A robot that has nothing and knows nothing.
-spec new(starl_machine:config()) -> t().
new(#{robot := Self, participants := Team, incarnation := Incarnation, now := Now} = Config) ->
    #{lease_us := LeaseUs, drift_ppm := Drift, lag_us := Lag, retry_us := RetryUs} = Config,
    #robot{
        self = Self,
        team = list_to_tuple(starl_team:members(Team)),
        incarnation = Incarnation,
        lease_us = LeaseUs,
        retry_us = RetryUs,
        home = starl_mutex_home:new(Incarnation, Now, LeaseUs, Drift, Lag, RetryUs)
    }.

%% @doc The robot when an event comes at this time of its clock.
-spec at(integer(), t()) -> t().
at(Now, Robot) -> Robot#robot{now = Now}.

%% @doc The time of its clock at the event at hand, in microseconds.
-spec now(t()) -> integer().
now(#robot{now = Now}) -> Now.

%% @doc The number of the robot.
-spec self(t()) -> starl:robot_id().
self(#robot{self = Self}) -> Self.

%% @doc The number of robots in the team.
-spec team_size(t()) -> pos_integer().
team_size(#robot{team = Team}) -> tuple_size(Team).

%% @doc The incarnation of its machine.
-spec incarnation(t()) -> pos_integer().
incarnation(#robot{incarnation = Incarnation}) -> Incarnation.

%% @doc The duration of a holder's lease, in microseconds.
-spec lease_us(t()) -> pos_integer().
lease_us(#robot{lease_us = Us}) -> Us.

%% @doc The time after which a waiting robot asks again, in microseconds.
-spec retry_us(t()) -> pos_integer().
retry_us(#robot{retry_us = Us}) -> Us.

%% -- actions --------------------------------------------------------------------------------

%% @doc One more action.
-spec act(starl_machine:action(), t()) -> t().
act(Action, #robot{actions = Actions} = Robot) -> Robot#robot{actions = [Action | Actions]}.

%% @doc More actions, in their order.
-spec acts([starl_machine:action()], t()) -> t().
acts(New, Robot) -> lists:foldl(fun act/2, Robot, New).

%% @doc Actions that rest on the lease of a token, or of several: they take place before it is over, or
%% not at all; then the machine gets `{late, Mark}'.
-spec until([entry()], [starl_machine:action()], Mark :: term(), t()) -> t().
until([], Actions, _Mark, Robot) ->
    acts(Actions, Robot);
until(Entries, Actions, Mark, Robot) ->
    End = lists:min([End || #{lease_end := End} <- Entries]),
    act({until, End - 1, Actions, Mark}, Robot).

%% @doc A message to a robot.
-spec post(starl:robot_id(), Body :: tuple(), t()) -> t().
post(To, Body, Robot) -> act(starl_sap:post(To, mutex, Body), Robot).

%% @doc A message to a token's home: a robot chosen by a hash of its name.
-spec post_home(token(), Body :: tuple(), t()) -> t().
post_home(Token, Body, Robot) -> post(home_of(Token, Robot), Body, Robot).

home_of(Token, #robot{team = Team}) -> element(erlang:phash2(Token, tuple_size(Team)) + 1, Team).

%% @doc Is this robot the token's home?
-spec is_home(starl:robot_id(), token(), t()) -> boolean().
is_home(Id, Token, Robot) -> Id =:= home_of(Token, Robot).

%% @doc The requests of robots of the team: no token goes to a robot that does not exist.
-spec of_team([starl_mutex_home:request()], t()) -> [starl_mutex_home:request()].
of_team(Requests, #robot{team = Team}) ->
    Members = tuple_to_list(Team),
    [Request || {Asker, _} = Request <- Requests, lists:member(Asker, Members)].

%% @doc The actions gathered, as a machine's result.
-spec result(t()) -> starl_machine:result().
result(#robot{actions = Actions} = Robot) ->
    {keep_state, Robot#robot{actions = [], now = 0}, lists:reverse(Actions)}.

%% @doc Leaves a notice to a job.
-spec notify(notice(), t()) -> t().
notify(Notice, #robot{notices = Notices} = Robot) -> Robot#robot{notices = [Notice | Notices]}.

%% @doc The notices gathered, the first one first.
-spec take_notices(t()) -> {[notice()], t()}.
take_notices(#robot{notices = []} = Robot) ->
    {[], Robot};
take_notices(#robot{notices = Notices} = Robot) ->
    {lists:reverse(Notices), Robot#robot{notices = []}}.

%% -- jobs -----------------------------------------------------------------------------------

%% @doc A number for a new job.
-spec next_job(t()) -> {job_id(), t()}.
next_job(#robot{next = Id} = Robot) -> {Id, Robot#robot{next = Id + 1}}.

%% @doc Keeps a job as it is now.
-spec keep_job(job_id(), starl_mutex_job:t(), t()) -> t().
keep_job(Id, Job, #robot{jobs = Jobs} = Robot) -> Robot#robot{jobs = Jobs#{Id => Job}}.

%% @doc A job by its number.
-spec job(job_id(), t()) -> starl_mutex_job:t().
job(Id, #robot{jobs = Jobs}) -> maps:get(Id, Jobs).

%% @doc A job that still waits, with the token that it waits for.
-spec waiting(job_id(), t()) -> {wait, token(), starl_mutex_job:t()} | none.
waiting(Id, #robot{jobs = Jobs}) ->
    case Jobs of
        #{Id := Job} ->
            case starl_mutex_job:next(Job) of
                {wait, Token} -> {wait, Token, Job};
                complete -> none
            end;
        #{} ->
            none
    end.

%% @doc A job that has got all that it wants.
-spec complete(job_id(), t()) -> {ok, starl_mutex_job:t()} | none.
complete(Id, #robot{jobs = Jobs}) ->
    case Jobs of
        #{Id := Job} ->
            case starl_mutex_job:next(Job) of
                complete -> {ok, Job};
                {wait, _} -> none
            end;
        #{} ->
            none
    end.

%% @doc The jobs of a machine, in their order.
-spec jobs_of(starl_machine:name(), t()) -> [job_id()].
jobs_of(Caller, #robot{jobs = Jobs}) ->
    lists:sort([Id || {Id, Job} <- maps:to_list(Jobs), starl_mutex_job:caller(Job) =:= Caller]).

%% @doc The jobs that wait for this token now, in their order.
-spec wanting(token(), t()) -> [job_id()].
wanting(Token, #robot{jobs = Jobs}) ->
    lists:sort([Id || {Id, Job} <- maps:to_list(Jobs), starl_mutex_job:waits_for(Token, Job)]).

%% @doc A job has ended.
-spec forget_job(job_id(), t()) -> t().
forget_job(Id, Robot) ->
    acts([{{timeout, {T, Id}}, cancel} || T <- [again, patience]], suspend_job(Id, Robot)).

%% @doc A job is in no queue until it is kept again.
-spec suspend_job(job_id(), t()) -> t().
suspend_job(Id, #robot{jobs = Jobs} = Robot) -> Robot#robot{jobs = maps:remove(Id, Jobs)}.

%% @doc Is this a request for the token that still stands, as far as this robot knows?
-spec is_wanted(token(), request(), t()) -> boolean().
is_wanted(Token, {Self, Id}, #robot{self = Self, jobs = Jobs}) ->
    case Jobs of
        #{Id := Job} -> starl_mutex_job:waits_for(Token, Job);
        #{} -> false
    end;
is_wanted(_Token, {_Other, _Id}, #robot{}) ->
    true.

%% -- tokens ---------------------------------------------------------------------------------

%% @doc The token, if the robot has it.
-spec entry(token(), t()) -> entry() | none.
entry(Token, #robot{entries = Entries}) -> maps:get(Token, Entries, none).

%% @doc The robot has the token, as it is now.
-spec put_entry(token(), entry(), t()) -> t().
put_entry(Token, Entry, #robot{entries = Entries} = Robot) ->
    Robot#robot{entries = Entries#{Token => Entry}}.

%% @doc The robot no longer has the token.
-spec forget_entry(token(), t()) -> t().
forget_entry(Token, #robot{entries = Entries} = Robot) ->
    Cancel = [{{timeout, {T, Token}}, cancel} || T <- [renew, lease]],
    acts(Cancel, Robot#robot{entries = maps:remove(Token, Entries)}).

%% @doc Is the lease of a token that the robot has over, by its clock?
-spec is_over(entry(), t()) -> boolean().
is_over(#{granted := Granted, lease_end := End}, #robot{now = Now}) ->
    Granted andalso End =< Now.

%% @doc The tokens whose lease is over, in the order of terms.
-spec over(t()) -> [token()].
over(#robot{entries = Entries} = Robot) ->
    lists:sort([Token || {Token, Entry} <- maps:to_list(Entries), is_over(Entry, Robot)]).

%% @doc A hold of the last step has never been.
-spec void(token(), fence(), t()) -> t().
void(Token, Fence, #robot{void = Void} = Robot) -> Robot#robot{void = [{Token, Fence} | Void]}.

%% @doc Is this such a hold?
-spec is_void(token(), fence(), t()) -> boolean().
is_void(Token, Fence, #robot{void = Void}) -> lists:member({Token, Fence}, Void).

%% @doc It is known by now what of the last step was late.
-spec all_told(t()) -> t().
all_told(#robot{void = []} = Robot) -> Robot;
all_told(Robot) -> Robot#robot{void = []}.

%% @doc The known owners.
-spec owners(t()) -> starl_mutex_owners:t().
owners(#robot{owners = Owners}) -> Owners.

%% @doc The same as it is now.
-spec put_owners(starl_mutex_owners:t(), t()) -> t().
put_owners(Owners, Robot) -> Robot#robot{owners = Owners}.

%% @doc The tokens whose home the robot is.
-spec home(t()) -> starl_mutex_home:t().
home(#robot{home = Home}) -> Home.

%% @doc The same as it is now.
-spec put_home(starl_mutex_home:t(), t()) -> t().
put_home(Home, Robot) -> Robot#robot{home = Home}.

%% @doc A token is on its way to a robot, with its queue; the outcome is not known yet.
-spec sent_out(token(), fence(), starl:robot_id(), [request()], t()) -> t().
sent_out(Token, Fence, To, Queue, #robot{outs = Outs} = Robot) ->
    Robot#robot{outs = Outs#{{Token, Fence} => {To, Queue}}}.

%% @doc The outcome of a hand-over is known: to whom it went, with which queue.
-spec take_out(token(), fence(), t()) -> {starl:robot_id(), [request()], t()} | none.
take_out(Token, Fence, #robot{outs = Outs} = Robot) ->
    case maps:take({Token, Fence}, Outs) of
        error -> none;
        {{To, Queue}, Rest} -> {To, Queue, Robot#robot{outs = Rest}}
    end.

%% @doc The hand-overs whose outcome is not known, in the order of terms.
-spec outs(t()) -> [{token(), fence()}].
outs(#robot{outs = Outs}) -> lists:sort(maps:keys(Outs)).
