%% @doc The machine of mutual exclusion: tokens travel with their queues from robot to robot, under
%% leases.
%% ```
%%   requester          owner             home of the token        all others
%%     | request --------->|                     |   (retries go to the home, which
%%     |                   |<------- request ----|    knows the owner)
%%     |<- token {F, Queue}|  at its release     |
%%     | claim F --------------------------------->| granted if F is the newest
%%     |<------------------------------- granted F |
%%     | owner {F, requester} ----------------------------------------->|
%%     | renew F, while it holds ----------------->|
%%     | return {F, Queue} ----------------------->|   if nobody in the queue can get it
%% '''
%% A robot that has got a token holds it only once the home has confirmed it. It holds it only as
%% long as the lease that it counts from the sending of its last confirmed claim. At every event it
%% first checks which of its leases are over. So a robot that has stalled notices this before it
%% answers a call or hands a token on. What it then reports of a hold, to the application and in the
%% trace, leaves before the lease is over, or not at all (`until'). The rules of the home are those
%% of {@link starl_mutex_home}; safety rests on these rules and the lease alone. Requests, queues
%% and announcements may be lost at any time: a robot that waits asks the home again.
%%
%% A token as seen by a robot that has it (an entry):
%% ```
%%   -- token --> claiming -- granted --> idle <-- released -- locked by a job
%%                   | refused              | a request: handed over, or locked
%%                   v                      v lease over: forgotten
%% '''
%% An acquisition of the application (a job) waits for one token after the other, in the order of
%% terms, until it holds all of them. If it loses one before, it begins anew. When its patience is
%% over, it fails and gives back the others.
%%
%% Calls: `{acquire, Tokens, Us}', `{release, Tokens}', `{forgo, Tokens}' when the answer to an
%% acquisition came too late, `{owner, Token}'; one message type,
%% `mutex'. Trace: {@link event()}.
-module(starl_mutex_tokens).
-behaviour(starl_machine).

-export([has_history/0, init/1, handle_event/5, accepts/2]).

-export_type([event/0]).

%% The trace of the mutex machine.
-type event() ::
    {requested, token()}
    %% a hold that begins now, or exists, may last so much longer by the robot's clock (us)
    | {leased, token(), fence(), LeftUs :: integer()}
    | {acquired, token(), fence()}
    %% the application is told that it holds these
    | {answered, [{token(), fence()}]}
    | {released, token(), fence()}
    %% the lease of a hold is over
    | {lease_lost, token(), fence()}
    %% a request has ended without the token
    | {failed, token(), timeout | restarted | lease_lost}
    %% at the home: the hand-over to this robot counts
    | {granted, token(), fence(), To :: starl:robot_id()}
    %% for the reader of a recording: the token is sent on; SAP reports that message lost
    | {handed_over, token(), fence(), To :: starl:robot_id()}
    | {hand_over_lost, token(), fence(), To :: starl:robot_id()}.

-type token() :: starl_mutex:token().
-type fence() :: starl_mutex:fence().
-type request() :: starl_mutex_home:request().
-type job_id() :: pos_integer().

%% The number of repetitions of a claim in a lease, and in all.
-define(CLAIMS_A_LEASE, 4).
-define(CLAIMS, 16).
%% The most requests of a robot in a queue.
-define(REQUESTS, 64).
%% The home looks this much later, as timers may be rounded.
-define(MARGIN_US, 1000).

%% A token that the robot has.
-type entry() :: #{
    %% the number of the next hold
    fence := fence(),
    %% whether the home has confirmed the token, and if so until when
    granted := boolean(),
    lease_end := integer(),
    queue := [request()],
    %% the job and the number of the present hold
    lock := none | {job_id(), fence()},
    %% the number of claims sent
    tries := non_neg_integer(),
    %% the present hold is the last one under its number
    last => true
}.

%% A job waits for the first token of `todo', or holds all its tokens.
-record(job, {
    caller :: starl_machine:name(),
    from :: starl_machine:from(),
    shape :: one | set,
    %% in the order of terms; one that it has lost is neither waited for nor held
    asked :: [token()],
    todo :: [token()],
    %% the last one first
    got = [] :: [{token(), fence()}],
    %% it misses a token that it seemed to have got, and must begin anew
    broken = false :: boolean()
}).

-record(robot, {
    self :: starl:robot_id(),
    team :: tuple(),
    incarnation :: pos_integer(),
    lease_us :: pos_integer(),
    retry_us :: pos_integer(),
    %% valid for the present event only
    now = 0 :: integer(),
    %% the tokens whose home the robot is
    home :: starl_mutex_home:t(),
    entries = #{} :: #{token() => entry()},
    jobs = #{} :: #{job_id() => #job{}},
    next = 1 :: job_id(),
    %% hand-overs whose outcome is not known yet
    outs = #{} :: #{{token(), fence()} => {starl:robot_id(), [request()]}},
    owners = starl_mutex_owners:new() :: starl_mutex_owners:t(),
    %% holds of the last step whose beginning was late: they have never been
    void = [] :: [{token(), fence()}],
    %% of the present event, the latest first
    actions = [] :: [starl_machine:action()]
}).

-spec has_history() -> true.
has_history() -> true.

-spec init(starl_machine:config()) -> {ready, #robot{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Incarnation, now := Now} = Config) ->
    Options = starl_options:defaults(starl_mutex:options()),
    #{lease_ms := Lease, drift_ppm := Drift, lag_ms := Lag, retry_ms := Retry} =
        maps:merge(Options, Config),
    Robot = #robot{
        self = Self,
        team = list_to_tuple(starl_team:members(Team)),
        incarnation = Incarnation,
        lease_us = 1000 * Lease,
        retry_us = 1000 * Retry,
        home = starl_mutex_home:new(
            Incarnation, Now, 1000 * Lease, Drift, 1000 * Lag, 1000 * Retry
        )
    },
    {ready, Robot, [starl_sap:listen(mutex, mutex)]}.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #robot{}, starl_machine:meta()
) -> starl_machine:result().
handle_event(Type, Content, ready, Robot, #{now := Now}) ->
    case event(Type, Content, current(Type, Content, Robot#robot{now = Now})) of
        unknown_event ->
            unknown_event;
        #robot{actions = Actions} = Next ->
            {keep_state, Next#robot{actions = [], now = 0}, lists:reverse(Actions)}
    end.

%% Leases that are over end before any other step. Only an announcement that is known already does
%% nothing, now and for ever: the checker skips it.
current(cast, {message, From, mutex, {owner, Token, Fence}}, #robot{owners = Owners} = Robot) ->
    case starl_mutex_owners:announced(Token, Fence, From, Owners) of
        known -> Robot;
        {newer, _, _} -> begin_step(Robot)
    end;
%% A hold of which nobody has learned is not lost: that is handled first.
current(info, {late, _}, Robot) ->
    Robot;
current(_Type, _Content, Robot) ->
    begin_step(Robot).

%% By now it is known what of the last step was late.
begin_step(#robot{void = []} = Robot) -> lapse_all(Robot);
begin_step(Robot) -> lapse_all(Robot#robot{void = []}).

event({call, {Caller, _} = From}, {acquire, Tokens, Us}, Robot) ->
    acquire(Caller, From, Tokens, Us, Robot);
event({call, {Caller, _} = From}, {release, Tokens}, Robot) ->
    release(Caller, From, Tokens, Robot);
event({call, {Caller, _} = From}, {forgo, Tokens}, Robot) ->
    forgo(Caller, From, Tokens, Robot);
event({call, From}, {owner, Token}, Robot) ->
    {_, Owner} = newest_owner(Token, Robot),
    act({reply, From, Owner}, Robot);
event(cast, {message, From, mutex, Message}, Robot) ->
    message(Message, From, Robot);
event({reply, {hand, Token, Fence}}, Outcome, Robot) ->
    handed(Token, Fence, Outcome, Robot);
event({timeout, {renew, Token}}, _, Robot) ->
    renew(Token, Robot);
event({timeout, {lease, Token}}, _, Robot) ->
    lapse(Token, Robot);
event({timeout, {home, Token}}, _, #robot{now = Now, home = Home} = Robot) ->
    at_home(Token, starl_mutex_home:expire(Token, Now, Home), Robot);
event({timeout, {again, Id}}, _, Robot) ->
    again(Id, Robot);
event({timeout, {anew, Id}}, _, Robot) ->
    repair(Id, Robot);
event({timeout, {patience, Id}}, _, Robot) ->
    give_up(Id, timeout, Robot);
event(info, {late, Mark}, Robot) ->
    late(Mark, Robot);
event(info, {restarted, sap}, Robot) ->
    sap_restarted(Robot);
event(info, {Gone, Caller}, Robot) when Gone =:= restarted; Gone =:= given_up ->
    lists:foldl(fun end_job/2, Robot, jobs_of(Caller, Robot));
event(_, _, _) ->
    unknown_event.

message({request, Token, Request, Known, Via}, _From, Robot) ->
    case of_team([Request], Robot) of
        [Request] -> route(Token, Request, Known, Via, Robot);
        [] -> unknown_event
    end;
message({token, Token, Fence, Queue}, From, Robot) ->
    %% a job that loses the older one may want the newer one
    Ready = supersede(Token, Fence, From, Robot),
    receive_token(Token, Fence, of_team(Queue, Robot), From, Ready);
message({How, Token, Fence, Nonce}, From, Robot) when
    How =:= granted; How =:= kept; How =:= refused
->
    case home_of(Token, Robot) of
        From when How =:= refused -> refused(Token, Fence, Robot);
        From -> confirmed(How, Token, Fence, Nonce, Robot);
        _ -> unknown_event
    end;
message({owner, Token, Fence}, From, Robot) ->
    announced(Token, Fence, From, Robot);
message({ask, Kind, Token, Fence, Nonce}, From, Robot) when Kind =:= claim; Kind =:= renew ->
    #robot{now = Now, home = Home} = Robot,
    {Answer, Next} = starl_mutex_home:Kind(Token, Fence, From, Now, Home),
    Granted = [{trace, {granted, Token, Fence, From}} || {Kind, Answer} =:= {claim, granted}],
    at_home(Token, {[{From, {Answer, Token, Fence, Nonce}}], Next}, acts(Granted, Robot));
message({return, Token, Fence, Queue}, From, #robot{now = Now, home = Home} = Robot) ->
    Requests = of_team(Queue, Robot),
    at_home(Token, starl_mutex_home:return(Token, Fence, From, Requests, Now, Home), Robot);
message(_, _, _) ->
    unknown_event.

%% The requests of robots of the team: no token goes to a robot that does not exist.
of_team(Requests, #robot{team = Team}) ->
    Members = tuple_to_list(Team),
    [Request || {Asker, _} = Request <- Requests, lists:member(Asker, Members)].

%% @private What comes over the radio.
-spec accepts(starl_packet:type(), Body :: term()) -> boolean().
accepts(mutex, Body) when tuple_size(Body) > 0 -> starl_shape:is(shape(element(1, Body)), Body);
accepts(_Type, _Body) -> false.

shape(request) ->
    [any, label, request(), {either, [{is, 0}, serial]}, {either, [{is, home}, {is, none}]}];
shape(token) ->
    [any, label, serial, {list, request()}];
shape(Answer) when Answer =:= granted; Answer =:= kept; Answer =:= refused ->
    [any, label, serial, nonce()];
shape(owner) ->
    [any, label, serial];
shape(ask) ->
    [any, {either, [{is, claim}, {is, renew}]}, label, serial, nonce()];
shape(return) ->
    [any, label, serial, {list, request()}];
shape(_Unknown) ->
    {either, []}.

request() -> [count, count].

%% The incarnation in which a claim was sent, and when.
nonce() -> [count, integer].

%% -- jobs -----------------------------------------------------------------------------------

acquire(_Caller, From, [], _Us, Robot) ->
    act({reply, From, {ok, []}}, Robot);
acquire(Caller, From, Tokens, Us, #robot{next = Id} = Robot) ->
    Shape =
        case is_list(Tokens) of
            true -> set;
            false -> one
        end,
    Asked = listed(Tokens),
    Job = #job{caller = Caller, from = From, shape = Shape, asked = Asked, todo = Asked},
    proceed(Id, Job, act({{timeout, {patience, Id}}, Us, patience}, Robot#robot{next = Id + 1})).

listed(Tokens) when is_list(Tokens) -> lists:usort(Tokens);
listed(Token) -> [Token].

proceed(Id, #job{todo = []} = Job, Robot) ->
    answer(Id, Job, keep_job(Id, Job, Robot));
proceed(Id, #job{todo = [Token | _]} = Job, #robot{retry_us = RetryUs} = Robot) ->
    Retry = {{timeout, {again, Id}}, RetryUs, again},
    search(Token, Id, acts([{trace, {requested, Token}}, Retry], keep_job(Id, Job, Robot))).

search(Token, Id, #robot{self = Self} = Robot) -> route(Token, {Self, Id}, 0, none, Robot).

%% The answer says until when the application holds all that it wants.
answer(Id, #job{from = From, got = Got} = Job, Robot) ->
    Entries = entries(held(Job), Robot),
    Until = lists:min([End || #{lease_end := End} <- Entries]) - 1,
    Answered = [
        {trace, {answered, lists:sort(Got)}},
        {reply, From, {until, Until, {ok, fences(Job)}}}
        | [{{timeout, {T, Id}}, cancel} || T <- [again, patience]]
    ],
    until(Entries, Answered, {answer, Id}, Robot).

fences(#job{shape = one, got = [{_, Fence}]}) -> Fence;
fences(#job{shape = set, got = Got}) -> lists:sort(Got).

%% A job that still waits asks the home of its token again.
again(Id, #robot{self = Self, retry_us = RetryUs} = Robot) ->
    case waiting(Id, Robot) of
        #job{todo = [Token | _]} ->
            Next = act({{timeout, {again, Id}}, RetryUs, again}, Robot),
            case entry(Token, Robot) of
                none -> post_home(Token, {request, Token, {Self, Id}, 0, home}, Next);
                #{} -> search(Token, Id, Next)
            end;
        none ->
            Robot
    end.

%% A job that still waits fails; it gives back what it has got so far.
give_up(Id, Why, Robot) ->
    case waiting(Id, Robot) of
        #job{todo = [Token | _], from = From} = Job ->
            Failed = [{trace, {failed, Token, Why}}, {reply, From, {error, Why}}],
            give_back(held(Job), forget_job(Id, acts(Failed, Robot)));
        none ->
            Robot
    end.

%% A robot that gets a token goes on before the next one is given back.
give_back(Tokens, Robot) -> lists:foldl(fun unlock/2, Robot, Tokens).

%% The machine whose job it is has crashed.
end_job(Id, Robot) ->
    case job(Id, Robot) of
        #job{todo = []} = Job -> give_back(held(Job), forget_job(Id, Robot));
        #job{} -> give_up(Id, restarted, Robot)
    end.

%% Ends the caller's holds of these tokens.
release(Caller, From, Names, Robot) ->
    List = listed(Names),
    Held = [{Token, Id} || Token <- List, Id <- holder(Caller, Token, Robot)],
    Tokens = [Token || {Token, _} <- Held],
    Freed = lists:foldl(fun({Token, Id}, R) -> drop(Id, Token, R) end, Robot, Held),
    Given = give_back(Tokens, Freed),
    case length(Held) =:= length(List) of
        true -> until(entries(Tokens, Robot), [{reply, From, ok}], {release, From}, Given);
        false -> act({reply, From, {error, lost}}, Given)
    end.

%% The job of this caller that holds the token, as one that has all it wants.
holder(Caller, Token, Robot) ->
    case entry(Token, Robot) of
        #{lock := {Id, _}} ->
            [Id || #job{todo = [], caller = By} <- [job(Id, Robot)], By =:= Caller];
        _ ->
            []
    end.

%% A job has one token less.
drop(Id, Token, Robot) ->
    #job{got = Got} = Job = job(Id, Robot),
    case lists:keydelete(Token, 1, Got) of
        [] -> forget_job(Id, Robot);
        Rest -> keep_job(Id, Job#job{got = Rest}, Robot)
    end.

%% Ends the caller's last acquisition of these tokens, which it has given up: the answer came too
%% late. One of them may have been lost meanwhile.
forgo(Caller, From, Names, Robot) ->
    Asked = listed(Names),
    Jobs = [{Id, job(Id, Robot)} || Id <- jobs_of(Caller, Robot)],
    case [Made || {_, #job{asked = Tokens}} = Made <- Jobs, Tokens =:= Asked] of
        [] ->
            act({reply, From, ok}, Robot);
        Made ->
            {Id, Job} = lists:last(Made),
            Forgotten = give_back(held(Job), forget_job(Id, failed(Job, Robot))),
            act({reply, From, ok}, Forgotten)
    end.

failed(#job{todo = [Token | _]}, Robot) -> act({trace, {failed, Token, lease_lost}}, Robot);
failed(#job{todo = []}, Robot) -> Robot.

%% A token of a job is lost. A job that is complete learns it at the release; one that waits begins
%% anew.
lost(Id, Token, Robot) ->
    case waiting(Id, Robot) of
        none -> drop(Id, Token, Robot);
        Job -> anew(Id, Job, lists:delete(Token, held(Job)), Robot)
    end.

%% A job of which a token has never been held begins anew, unless it has done so meanwhile.
repair(Id, Robot) ->
    case waiting(Id, Robot) of
        #job{broken = true} = Job -> anew(Id, Job, held(Job), Robot);
        _ -> Robot
    end.

%% Begins a job anew, when it has given back these tokens. While it does so, it is in no queue.
anew(Id, #job{todo = Todo} = Job, Tokens, Robot) ->
    Suspended = failed(Job, suspend_job(Id, Robot)),
    Anew = Job#job{todo = lists:usort(held(Job) ++ Todo), got = [], broken = false},
    proceed(Id, Anew, lapse_all(give_back(Tokens, Suspended))).

%% -- requests look for a token --------------------------------------------------------------

%% A request is sent on to a newer owner than its sender knew, or once to the home; so it cannot go
%% in circles.
route(Token, {Asker, _} = Request, Known, Via, #robot{self = Self} = Robot) ->
    case {entry(Token, Robot), newest_owner(Token, Robot)} of
        {#{queue := Queue} = Entry, _} ->
            serve(used, Token, Entry#{queue := add(Request, Queue)}, Robot);
        {none, _} when Via =:= home, Known =:= 0 ->
            #robot{now = Now, home = Home} = Robot,
            at_home(Token, starl_mutex_home:request(Token, Request, Now, Home), Robot);
        {none, {Fence, Owner}} when Fence > Known, Owner =/= Self, Owner =/= Asker ->
            post(Owner, {request, Token, Request, Fence, Via}, Robot);
        {none, _} when Via =:= none ->
            post_home(Token, {request, Token, Request, 0, home}, Robot);
        {none, _} ->
            #robot{team = Team, owners = Owners} = Robot,
            Early = {Request, Known},
            Robot#robot{
                owners = starl_mutex_owners:wait(Token, Early, tuple_size(Team), Owners)
            }
    end.

%% A request joins the end of a queue, unless it is in it already.
add({Robot, _} = Request, Queue) ->
    case lists:member(Request, Queue) of
        true -> Queue;
        false when length(Queue) < ?REQUESTS -> Queue ++ [Request];
        false -> Queue ++ [Request || length([R || {R, _} <- Queue, R =:= Robot]) < ?REQUESTS]
    end.

%% An owner has announced itself. The requests that wait here for the token go on to it, if it is
%% newer than the hand-over that they wait for: announcements overtake each other.
announced(Token, Fence, Owner, #robot{owners = Owners} = Robot) ->
    case starl_mutex_owners:announced(Token, Fence, Owner, Owners) of
        known ->
            Robot;
        {newer, Early, Newer} ->
            lists:foldl(
                fun({Request, Known}, R) -> route(Token, Request, Known, home, R) end,
                Robot#robot{owners = Newer},
                Early
            )
    end.

newest_owner(Token, #robot{owners = Owners}) -> starl_mutex_owners:newest(Token, Owners).

%% -- a token comes, and is claimed ----------------------------------------------------------

%% An older token of the name, which the robot still has, is over.
supersede(Token, Fence, From, Robot) ->
    case {entry(Token, Robot), is_newer(Token, Fence, From, Robot)} of
        {#{fence := Own}, true} when Own < Fence -> lapse(Token, Robot);
        _ -> Robot
    end.

%% Is no newer token known? What another robot has announced does not count against a token that
%% comes from its home. A robot that wants it asks the home before it holds it, and is refused if it
%% is an old token that comes late.
is_newer(Token, Fence, From, Robot) ->
    {Known, _} = newest_owner(Token, Robot),
    Known < Fence orelse home_of(Token, Robot) =:= From.

%% A token is claimed if it is wanted here, else it goes on; unless the robot knows of a newer one.
receive_token(Token, Fence, Queue0, From, #robot{self = Self, owners = Owners} = Robot0) ->
    case {entry(Token, Robot0), is_newer(Token, Fence, From, Robot0)} of
        {none, true} ->
            {Early, Left} = starl_mutex_owners:take_early(Token, Owners),
            Robot = Robot0#robot{owners = Left},
            case trim(Token, lists:foldl(fun add/2, Queue0, Early), Robot) of
                [{Self, _} | _] = Queue -> ask(claim, Token, new_entry(Fence, Queue), Robot);
                Queue -> pass_on(Token, Fence, Queue, Robot)
            end;
        {_, _} ->
            Robot0
    end.

new_entry(Fence, Queue) ->
    #{fence => Fence, granted => false, lease_end => 0, queue => Queue, lock => none, tries => 0}.

%% The queue without the requests that this robot no longer makes. A request that it makes now takes
%% the place of the first of them. So a token that is wanted goes round the team at most once: no
%% robot that wants it hands it on to robots that do not.
trim(Token, Queue, #robot{self = Self, jobs = Jobs} = Robot) ->
    Wanting = lists:sort([Id || {Id, #job{todo = [T | _]}} <- maps:to_list(Jobs), T =:= Token]),
    trim(Token, Queue, [{Self, Id} || Id <- Wanting] -- Queue, Robot).

trim(_Token, [], _Wanting, _Robot) ->
    [];
trim(Token, [Request | Requests], Wanting, Robot) ->
    case {is_wanted(Token, Request, Robot), Wanting} of
        {true, _} -> [Request | trim(Token, Requests, Wanting, Robot)];
        {false, [First | Others]} -> [First | trim(Token, Requests, Others, Robot)];
        {false, []} -> trim(Token, Requests, [], Robot)
    end.

%% Asks the home to confirm the token, and again in a while.
ask(Kind, Token, #{fence := Fence} = Entry, #robot{incarnation = Incarnation} = Robot) ->
    Nonce = {Incarnation, Robot#robot.now},
    Again = {{timeout, {renew, Token}}, quarter(Robot), again},
    Asking = act(Again, put_entry(Token, tried(Kind, Entry), Robot)),
    post_home(Token, {ask, Kind, Token, starl_mutex_home:hand_over(Fence), Nonce}, Asking).

%% Only claims are counted: renewals end with the lease.
tried(claim, #{tries := Tries} = Entry) -> Entry#{tries := Tries + 1};
tried(renew, Entry) -> Entry.

%% It is time to ask the home again.
renew(Token, Robot) ->
    case entry(Token, Robot) of
        #{granted := false, tries := ?CLAIMS} -> lapse(Token, Robot);
        #{granted := false} = Entry -> ask(claim, Token, Entry, Robot);
        #{lock := {_, _}} = Entry -> ask(renew, Token, Entry, Robot);
        #{queue := [_ | _]} = Entry -> ask(renew, Token, Entry, Robot);
        _ -> Robot
    end.

%% The home does not confirm a token: there is a newer one.
refused(Token, Fence, Robot) ->
    case has_hand_over(Fence, entry(Token, Robot)) of
        true -> lapse(Token, Robot);
        false -> Robot
    end.

has_hand_over(Fence, #{fence := Own}) -> starl_mutex_home:hand_over(Own) =:= Fence;
has_hand_over(_Fence, none) -> false.

%% The home has confirmed a token; the lease counts from the asking. `kept': by an incarnation later
%% than the token, and for the present hold only.
confirmed(How, Token, Fence, {Life, Sent}, #robot{incarnation = Incarnation} = Robot) ->
    End = Sent + Robot#robot.lease_us,
    Entry = entry(Token, Robot),
    Counts =
        End > Robot#robot.now andalso Life =:= Incarnation andalso has_hand_over(Fence, Entry),
    case Entry of
        #{granted := Already, lease_end := Before} when Counts, not Already orelse End > Before ->
            extend(How, Token, Entry#{lease_end := End}, Robot);
        _ ->
            Robot
    end.

extend(kept, Token, #{lock := none, fence := Fence, queue := Queue}, Robot) ->
    give_home(Token, Fence, Queue, forget_entry(Token, Robot));
extend(kept, Token, Entry, Robot) ->
    extend(granted, Token, Entry#{last => true}, Robot);
extend(granted, Token, #{granted := Already, fence := Fence, lock := Lock} = Entry, Robot) ->
    Timed = act({{timeout, {lease, Token}}, left(Entry, Robot), over}, Robot),
    Granted = Entry#{granted := true, tries := 0},
    case {Already, Lock} of
        {false, none} -> serve(fresh, Token, Granted, announce(Token, Fence, Timed));
        {true, none} -> serve(fresh, Token, Granted, Timed);
        {true, {_, Held}} -> put_entry(Token, Granted, leased(Token, Held, Entry, Timed))
    end.

leased(Token, Fence, Entry, Robot) ->
    until([Entry], [lease(Token, Fence, Entry, Robot)], leased, Robot).

lease(Token, Fence, Entry, Robot) -> {trace, {leased, Token, Fence, left(Entry, Robot)}}.

announce(Token, Hold, #robot{self = Self, owners = Owners} = Robot) ->
    Fence = starl_mutex_home:hand_over(Hold),
    Broadcast = {cast, sap, {broadcast, mutex, {owner, Token, Fence}}},
    Confirmed = Robot#robot{owners = starl_mutex_owners:refute(Token, Fence, Owners)},
    announced(Token, Fence, Self, act(Broadcast, Confirmed)).

%% -- holds ----------------------------------------------------------------------------------

%% Gives a free token to the first request of its queue. `fresh': the home has just confirmed it.
serve(How, Token, #{granted := true, lock := none, queue := Queue} = Entry, Robot) ->
    #robot{self = Self} = Robot,
    case trim(Token, Queue, Robot) of
        [] ->
            put_entry(Token, Entry#{queue := []}, Robot);
        [{Self, Id} | Rest] = Trimmed ->
            %% A hold that began with the rest of an old lease might be over before it is renewed,
            %% so the home is asked first. A new lease is taken after any delay.
            case How =:= used andalso left(Entry, Robot) < half(Robot) of
                true -> ask(renew, Token, Entry#{queue := Trimmed}, Robot);
                false -> lock(Token, Id, Entry#{queue := Rest}, Robot)
            end;
        [_ | _] = Others ->
            pass_on(Token, map_get(fence, Entry), Others, forget_entry(Token, Robot))
    end;
serve(_How, Token, Entry, Robot) ->
    put_entry(Token, Entry, Robot).

lock(Token, Id, #{fence := Fence} = Entry, Robot) ->
    Facts = [lease(Token, Fence, Entry, Robot), {trace, {acquired, Token, Fence}}],
    Traced = until([Entry], Facts, {hold, Token, Fence}, Robot),
    Holding = prolong(Token, Entry#{lock := {Id, Fence}}, Traced),
    #job{todo = [Token | Rest], got = Got} = Job = job(Id, Holding),
    proceed(Id, Job#job{todo = Rest, got = [{Token, Fence} | Got]}, Holding).

%% A hold begins: the lease must be renewed, when half of it is left at the latest.
prolong(Token, Entry, Robot) ->
    case left(Entry, Robot) - half(Robot) of
        Spare when Spare < 0 ->
            ask(renew, Token, Entry, Robot);
        Spare ->
            Us = min(Spare, quarter(Robot)),
            put_entry(Token, Entry, act({{timeout, {renew, Token}}, Us, again}, Robot))
    end.

%% A hold ends; the next one has another number. One whose lease is over had ended before.
unlock(Token, Robot) ->
    #{lock := {_, Fence}, queue := Queue} = Entry = entry(Token, Robot),
    case is_over(Entry, Robot) of
        true ->
            orphan(Token, Queue, lose(Token, Fence, Robot));
        false ->
            Released = [{trace, {released, Token, Fence}}],
            Traced = until([Entry], Released, {released, Token, Fence}, Robot),
            free(Token, Entry, act({{timeout, {renew, Token}}, cancel}, Traced))
    end.

free(Token, #{lock := {_, Fence}, queue := Queue} = Entry, Robot) ->
    case {Entry, starl_mutex_home:last_hold(Fence)} of
        {#{last := true}, _} -> give_home(Token, Fence, Queue, forget_entry(Token, Robot));
        {_, true} -> pass_on(Token, Fence, Queue, forget_entry(Token, Robot));
        {_, false} -> serve(used, Token, Entry#{lock := none, fence := Fence + 1}, Robot)
    end.

%% Ends all tokens whose lease is over, in the order of terms.
lapse_all(#robot{entries = Entries} = Robot) ->
    Over = lists:sort([Token || {Token, Entry} <- maps:to_list(Entries), is_over(Entry, Robot)]),
    lists:foldl(fun lapse/2, Robot, Over).

%% The robot no longer has a token, and the hold, if any, ends.
lapse(Token, Robot) ->
    case entry(Token, Robot) of
        #{lock := {Id, Fence}, queue := Queue} ->
            %% the job gives back what else it has before the requests look for another token
            orphan(Token, Queue, lost(Id, Token, lose(Token, Fence, Robot)));
        #{queue := Queue} ->
            orphan(Token, Queue, forget_entry(Token, Robot));
        none ->
            Robot
    end.

lose(Token, Fence, Robot) -> act({trace, {lease_lost, Token, Fence}}, forget_entry(Token, Robot)).

%% The queue of a token that no longer exists: its requests go to the home.
orphan(Token, Queue, Robot) ->
    lists:foldl(
        fun(Request, R) -> post_home(Token, {request, Token, Request, 0, home}, R) end,
        Robot,
        [Request || Request <- Queue, is_wanted(Token, Request, Robot)]
    ).

%% -- a token is handed over -----------------------------------------------------------------

%% Hands the token over, to the first of the queue, or back to its home.
pass_on(Token, Fence, Queue, Robot) ->
    case Queue =:= [] orelse starl_mutex_home:last_hand_over(Fence) of
        true -> give_home(Token, Fence, Queue, Robot);
        false -> hand_over(Token, starl_mutex_home:next(Fence), Queue, Robot)
    end.

give_home(Token, Fence, Queue, Robot) ->
    post_home(Token, {return, Token, starl_mutex_home:hand_over(Fence), Queue}, Robot).

hand_over(Token, Next, [{To, _} | _] = Queue, #robot{outs = Outs, owners = Owners} = Robot) ->
    Sent = [
        {trace, {handed_over, Token, Next, To}},
        starl_sap:send(To, mutex, {token, Token, Next, Queue}, {hand, Token, Next})
    ],
    acts(Sent, Robot#robot{
        outs = Outs#{{Token, Next} => {To, Queue}},
        owners = starl_mutex_owners:handed(Token, Next, To, Owners)
    }).

%% The outcome of a hand-over. One reported lost may have arrived all the same: the home decides
%% which comes first, the claim or the return. A robot that cannot be reached has no turn until it
%% asks again: a dead one would have it in each round.
handed(Token, Fence, Outcome, #robot{outs = Outs} = Robot) ->
    case maps:take({Token, Fence}, Outs) of
        error ->
            Robot;
        {_, Left} when Outcome =:= ok ->
            Robot#robot{outs = Left};
        {{To, [_First | Others]}, Left} ->
            Traced = act({trace, {hand_over_lost, Token, Fence, To}}, Robot#robot{outs = Left}),
            post_home(Token, {return, Token, Fence, Others}, Traced)
    end.

%% The outcomes of hand-overs under way will not be known, and a new SAP knows no listeners.
sap_restarted(#robot{outs = Outs} = Robot) ->
    lists:foldl(
        fun({Token, Fence}, R) -> handed(Token, Fence, {error, restarted}, R) end,
        act(starl_sap:listen(mutex, mutex), Robot),
        lists:sort(maps:keys(Outs))
    ).

%% -- what was too late ----------------------------------------------------------------------

%% A lease was over when what rests on it was to leave the step ({@link starl_machine:action()}).
%% Nobody has learned of a hold whose beginning was late, so it has never been. Its job begins anew
%% as soon as it is known what else of the step was late. A job whose answer alone was late begins
%% anew, too. An application that is late with a release learns that it had lost a token.
late({hold, Token, Fence}, #robot{void = Void} = Robot) ->
    missed(Token, Fence, Robot#robot{void = [{Token, Fence} | Void]});
late(leased, Robot) ->
    Robot;
late({answer, Id}, #robot{jobs = Jobs} = Robot) ->
    case Jobs of
        #{Id := #job{todo = []} = Job} -> anew(Id, Job, held(Job), Robot);
        #{} -> Robot
    end;
late({released, Token, Fence}, #robot{void = Void} = Robot) ->
    case lists:member({Token, Fence}, Void) of
        true -> Robot;
        false -> act({trace, {lease_lost, Token, Fence}}, Robot)
    end;
late({release, From}, Robot) ->
    act({reply, From, {error, lost}}, Robot).

missed(Token, Fence, Robot) ->
    case entry(Token, Robot) of
        #{lock := {Id, Fence}, queue := Queue} ->
            %% it waits for this one, no more for the one after it
            #job{todo = Todo, got = Got} = Job = job(Id, Robot),
            Broken = Job#job{
                todo = [Token | Todo], got = lists:keydelete(Token, 1, Got), broken = true
            },
            Kept = keep_job(Id, Broken, forget_entry(Token, failed(Job, Robot))),
            orphan(Token, Queue, act({{timeout, {anew, Id}}, 0, anew}, Kept));
        _ ->
            Robot
    end.

%% -- the home -------------------------------------------------------------------------------

%% Sends what the home has answered, and sets its timer.
at_home(Token, {Messages, Home}, Robot) ->
    Sent = lists:foldl(fun({To, M}, R) -> post(To, M, R) end, Robot#robot{home = Home}, Messages),
    case starl_mutex_home:due(Token, Home) of
        never ->
            act({{timeout, {home, Token}}, cancel}, Sent);
        Due ->
            Wait = max(0, Due - Robot#robot.now) + ?MARGIN_US,
            act({{timeout, {home, Token}}, Wait, check}, Sent)
    end.

post_home(Token, Body, Robot) -> post(home_of(Token, Robot), Body, Robot).

post(To, Body, Robot) -> act(starl_sap:post(To, mutex, Body), Robot).

home_of(Token, #robot{team = Team}) -> element(erlang:phash2(Token, tuple_size(Team)) + 1, Team).

%% -- the state ------------------------------------------------------------------------------

act(Action, #robot{actions = Actions} = Robot) -> Robot#robot{actions = [Action | Actions]}.

acts(New, Robot) -> lists:foldl(fun act/2, Robot, New).

%% Actions that rest on the leases of these tokens: they take place before one of them is over, or
%% not at all; then the machine gets `{late, Mark}'.
until([], Actions, _Mark, Robot) ->
    acts(Actions, Robot);
until(Entries, Actions, Mark, Robot) ->
    End = lists:min([End || #{lease_end := End} <- Entries]),
    act({until, End - 1, Actions, Mark}, Robot).

job(Id, #robot{jobs = Jobs}) -> maps:get(Id, Jobs).

%% A job that still waits for a token.
waiting(Id, #robot{jobs = Jobs}) ->
    case Jobs of
        #{Id := #job{todo = [_ | _]} = Job} -> Job;
        #{} -> none
    end.

jobs_of(Caller, #robot{jobs = Jobs}) ->
    lists:sort([Id || {Id, #job{caller = By}} <- maps:to_list(Jobs), By =:= Caller]).

%% Does the request for the token still stand, as far as this robot knows?
is_wanted(Token, {Self, Id}, #robot{self = Self, jobs = Jobs}) ->
    case Jobs of
        #{Id := #job{todo = [Token | _]}} -> true;
        #{} -> false
    end;
is_wanted(_Token, {_Other, _Id}, #robot{}) ->
    true.

held(#job{got = Got}) -> [Token || {Token, _} <- Got].

keep_job(Id, Job, #robot{jobs = Jobs} = Robot) -> Robot#robot{jobs = Jobs#{Id => Job}}.

forget_job(Id, Robot) ->
    acts([{{timeout, {T, Id}}, cancel} || T <- [again, patience]], suspend_job(Id, Robot)).

%% The job is in no queue until it is kept again.
suspend_job(Id, #robot{jobs = Jobs} = Robot) -> Robot#robot{jobs = maps:remove(Id, Jobs)}.

entry(Token, #robot{entries = Entries}) -> maps:get(Token, Entries, none).

entries(Tokens, Robot) -> [entry(Token, Robot) || Token <- Tokens].

put_entry(Token, Entry, #robot{entries = Entries} = Robot) ->
    Robot#robot{entries = Entries#{Token => Entry}}.

forget_entry(Token, #robot{entries = Entries} = Robot) ->
    Cancel = [{{timeout, {T, Token}}, cancel} || T <- [renew, lease]],
    acts(Cancel, Robot#robot{entries = maps:remove(Token, Entries)}).

is_over(#{granted := Granted, lease_end := End}, #robot{now = Now}) -> Granted andalso End =< Now.

left(#{lease_end := End}, #robot{now = Now}) -> End - Now.

half(#robot{lease_us = Us}) -> Us div 2.

quarter(#robot{lease_us = Us}) -> Us div ?CLAIMS_A_LEASE.
