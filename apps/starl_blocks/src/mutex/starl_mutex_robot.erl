%% @doc What a robot knows and does of tokens: those it has, the acquisitions ("jobs") of its
%% application that wait or hold, and what it has heard of owners. Pure; the operations of
%% {@link starl_mutex_tokens}. Actions are gathered in the state and taken with `result/1'.
-module(starl_mutex_robot).

-export([new/1, at/2, result/1]).
-export([acquire/5, release/4, owner/3, again/2, give_up/3, caller_restarted/2, sap_restarted/1]).
-export([route/5, receive_token/4, granted/4, refused/3, announced/4, handed/4]).
-export([renew/2, lapse/2, expire/2, asked/6, returned/5]).

-export_type([t/0, nonce/0]).

-type token() :: starl_mutex:token().
-type fence() :: starl_mutex:fence().
-type request() :: starl_mutex_home:request().
-type job_id() :: starl_mutex_job:id().
%% When, and in which incarnation, a claim was sent.
-type nonce() :: {Incarnation :: pos_integer(), SentUs :: integer()}.

%% A claim is repeated so often in a lease, and so often in all.
-define(CLAIMS_A_LEASE, 4).
-define(CLAIMS, 16).
%% The home looks this much later, as timers may be rounded.
-define(MARGIN_US, 1000).

%% A token that the robot has. `fence': the number of the next hold.
-record(entry, {
    fence :: fence(),
    granted = false :: boolean(),
    lease_end = 0 :: integer(),
    queue :: [request()],
    lock = none :: none | {job_id(), fence()},
    tries = 0 :: non_neg_integer()
}).

-record(robot, {
    self :: starl:robot_id(),
    team :: tuple(),
    incarnation :: pos_integer(),
    lease_us :: pos_integer(),
    retry_us :: pos_integer(),
    now :: integer(),
    home :: starl_mutex_home:t(),
    entries = #{} :: #{token() => #entry{}},
    jobs = #{} :: #{job_id() => starl_mutex_job:t()},
    next = 1 :: job_id(),
    %% hand-overs whose outcome is not known yet
    outs = #{} :: #{{token(), fence()} => {starl:robot_id(), [request()]}},
    owners = starl_mutex_owners:new() :: starl_mutex_owners:t(),
    actions = [] :: [starl_machine:action()]
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
        now = Now,
        home = starl_mutex_home:new(Incarnation, Now, LeaseUs, Drift, Lag)
    }.

%% @doc The robot at a later time of its clock.
-spec at(integer(), t()) -> t().
at(Now, Robot) -> Robot#robot{now = Now}.

%% @doc The actions gathered, as a machine's result.
-spec result(t()) -> starl_machine:result().
result(#robot{actions = Actions} = Robot) ->
    {keep_state, Robot#robot{actions = []}, lists:reverse(Actions)}.

%% -- jobs -----------------------------------------------------------------------------------

%% @doc Begins an acquisition.
-spec acquire(starl_machine:name(), starl_machine:from(), token() | [token()], pos_integer(), t())
    -> t().
acquire(_Caller, From, [], _Us, Robot) ->
    act({reply, From, {ok, []}}, Robot);
acquire(Caller, From, Tokens, Us, #robot{next = Id} = Robot) ->
    Job = starl_mutex_job:new(Caller, From, Tokens),
    Begun = act({{timeout, {patience, Id}}, Us, patience}, Robot#robot{next = Id + 1}),
    proceed(Id, Job, Begun).

proceed(Id, Job, #robot{retry_us = Retry} = Robot) ->
    Kept = keep(Id, Job, Robot),
    case starl_mutex_job:next(Job) of
        complete ->
            Done = acts([{{timeout, {T, Id}}, cancel} || T <- [again, patience]], Kept),
            act({reply, starl_mutex_job:from(Job), {ok, starl_mutex_job:answer(Job)}}, Done);
        {wait, Token} ->
            Asked = [{trace, {requested, Token}}, {{timeout, {again, Id}}, Retry, again}],
            route(Token, {Robot#robot.self, Id}, 0, none, acts(Asked, Kept))
    end.

%% @doc Ends the caller's holds of these tokens.
-spec release(starl_machine:name(), starl_machine:from(), token() | [token()], t()) -> t().
release(Caller, From, Tokens, Robot) ->
    List = listed(Tokens),
    Held = [{Token, Id} || Token <- List, Id <- holder(Caller, Token, Robot)],
    Answer =
        case length(Held) =:= length(List) of
            true -> ok;
            false -> {error, lost}
        end,
    Freed = lists:foldl(fun({Token, Id}, R) -> drop(Id, Token, R) end, Robot, Held),
    act({reply, From, Answer}, lists:foldl(fun unlock/2, Freed, [T || {T, _} <- Held])).

listed(Tokens) when is_list(Tokens) -> lists:usort(Tokens);
listed(Token) -> [Token].

%% The job of this caller that holds the token, as one that has all it wants.
holder(Caller, Token, #robot{entries = Entries, jobs = Jobs, now = Now}) ->
    case Entries of
        #{Token := #entry{lock = {Id, _}, lease_end = End}} when Now < End ->
            Job = maps:get(Id, Jobs),
            [Id || starl_mutex_job:next(Job) =:= complete, starl_mutex_job:caller(Job) =:= Caller];
        #{} ->
            []
    end.

%% @doc Tells who was last announced as the token's owner.
-spec owner(starl_machine:from(), token(), t()) -> t().
owner(From, Token, #robot{owners = Owners} = Robot) ->
    {_, Owner} = starl_mutex_owners:newest(Token, Owners),
    act({reply, From, Owner}, Robot).

%% @doc A job that still waits asks the home of its token again.
-spec again(job_id(), t()) -> t().
again(Id, #robot{entries = Entries, self = Self, retry_us = Retry} = Robot) ->
    case waiting(Id, Robot) of
        {wait, Token, _Job} ->
            Next = act({{timeout, {again, Id}}, Retry, again}, Robot),
            case Entries of
                #{Token := _} -> route(Token, {Self, Id}, 0, none, Next);
                #{} -> post_home(Token, {request, Token, {Self, Id}, 0, home}, Next)
            end;
        none ->
            Robot
    end.

%% A job that still waits, with the token that it waits for.
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

%% @doc A job that still waits fails; it gives back what it has got so far.
-spec give_up(job_id(), timeout | restarted, t()) -> t().
give_up(Id, Why, Robot) ->
    case waiting(Id, Robot) of
        {wait, Token, Job} ->
            Reply = {reply, starl_mutex_job:from(Job), {error, Why}},
            Told = acts([{trace, {failed, Token, Why}}, Reply], Robot),
            lists:foldl(fun unlock/2, forget_job(Id, Told), starl_mutex_job:held(Job));
        none ->
            Robot
    end.

%% @doc All jobs of a machine that has crashed end.
-spec caller_restarted(starl_machine:name(), t()) -> t().
caller_restarted(Caller, #robot{jobs = Jobs} = Robot) ->
    Ids = [Id || {Id, Job} <- maps:to_list(Jobs), starl_mutex_job:caller(Job) =:= Caller],
    lists:foldl(fun end_job/2, Robot, lists:sort(Ids)).

end_job(Id, #robot{jobs = Jobs} = Robot) ->
    Job = maps:get(Id, Jobs),
    case starl_mutex_job:next(Job) of
        complete -> lists:foldl(fun unlock/2, forget_job(Id, Robot), starl_mutex_job:held(Job));
        {wait, _} -> give_up(Id, restarted, Robot)
    end.

keep(Id, Job, #robot{jobs = Jobs} = Robot) -> Robot#robot{jobs = Jobs#{Id => Job}}.

forget_job(Id, #robot{jobs = Jobs} = Robot) ->
    Cancel = [{{timeout, {T, Id}}, cancel} || T <- [again, patience]],
    acts(Cancel, Robot#robot{jobs = maps:remove(Id, Jobs)}).

%% A job has one token less.
drop(Id, Token, #robot{jobs = Jobs} = Robot) ->
    case starl_mutex_job:without(Token, maps:get(Id, Jobs)) of
        none -> forget_job(Id, Robot);
        Rest -> keep(Id, Rest, Robot)
    end.

%% Is this the request of a job that waits for the token now?
wanted(Token, {Self, Id}, #robot{self = Self, jobs = Jobs}) ->
    case Jobs of
        #{Id := Job} -> starl_mutex_job:waits_for(Token, Job);
        #{} -> false
    end;
wanted(_Token, {_Other, _Id}, #robot{}) ->
    true.

%% -- requests -------------------------------------------------------------------------------

%% @doc A request looks for the token. It is sent on to a newer owner than its sender knew, or
%% once to the home; so it cannot go in circles.
-spec route(token(), request(), Known :: fence() | 0, Via :: home | none, t()) -> t().
route(Token, {Robot, _} = Request, Known, Via, #robot{self = Self, entries = Entries} = Data) ->
    case {Entries, starl_mutex_owners:newest(Token, Data#robot.owners)} of
        {#{Token := #entry{queue = Queue} = Entry}, _} ->
            serve(Token, Entry#entry{queue = starl_mutex_owners:add(Request, Queue)}, Data);
        {_, _} when Via =:= home, Known =:= 0 ->
            #robot{now = Now, home = Home} = Data,
            at_home(Token, starl_mutex_home:request(Token, Request, Now, Home), Data);
        {_, {Fence, Owner}} when Fence > Known, Owner =/= Self, Owner =/= Robot ->
            post(Owner, {request, Token, Request, Fence, Via}, Data);
        {_, _} when Via =:= none ->
            post_home(Token, {request, Token, Request, 0, home}, Data);
        {_, _} ->
            wait_for_token(Token, Request, Data)
    end.

wait_for_token(Token, Request, #robot{owners = Owners, team = Team} = Data) ->
    Data#robot{owners = starl_mutex_owners:wait(Token, Request, tuple_size(Team), Owners)}.

%% @doc An owner has announced itself.
-spec announced(token(), fence(), starl:robot_id(), t()) -> t().
announced(Token, Fence, Owner, #robot{owners = Owners} = Robot) ->
    Robot#robot{owners = starl_mutex_owners:announced(Token, Fence, Owner, Owners)}.

%% -- tokens ---------------------------------------------------------------------------------

%% @doc A token has come. It is claimed if it is wanted here, else it goes on.
-spec receive_token(token(), fence(), [request()], t()) -> t().
receive_token(Token, Fence, Queue0, #robot{entries = Entries, owners = Owners} = Robot) ->
    {Known, _} = starl_mutex_owners:newest(Token, Owners),
    case Entries of
        #{} when Known >= Fence ->
            Robot;
        #{Token := #entry{fence = Newer}} when Newer >= Fence ->
            Robot;
        #{Token := #entry{}} ->
            receive_token(Token, Fence, Queue0, lapse(Token, Robot));
        #{} ->
            {Early, Left} = starl_mutex_owners:take_early(Token, Owners),
            Queue = lists:foldl(fun starl_mutex_owners:add/2, Queue0, Early),
            Heard = Robot#robot{owners = Left},
            claim_or_pass(Token, Fence, trim(Token, Queue, Heard), Heard)
    end.

claim_or_pass(Token, Fence, [{Self, _} | _] = Queue, #robot{self = Self} = Robot) ->
    ask(claim, Token, #entry{fence = Fence, queue = Queue}, Robot);
claim_or_pass(Token, Fence, Queue, Robot) ->
    pass_on(Token, Fence, Queue, Robot).

%% Requests of this robot that it no longer makes.
trim(Token, Queue, Robot) ->
    lists:dropwhile(fun(Request) -> not wanted(Token, Request, Robot) end, Queue).

%% Asks the home to confirm the token, and again in a while.
ask(Kind, Token, #entry{fence = Fence} = Entry, Robot) ->
    #robot{entries = Entries, lease_us = Lease, incarnation = Incarnation, now = Now} = Robot,
    Asking = Robot#robot{entries = Entries#{Token => tried(Kind, Entry)}},
    Timer = {{timeout, {renew, Token}}, Lease div ?CLAIMS_A_LEASE, again},
    post_home(Token, {ask, Kind, Token, base(Fence), {Incarnation, Now}}, act(Timer, Asking)).

%% Only claims are counted: renewals end with the lease.
tried(claim, #entry{tries = Tries} = Entry) -> Entry#entry{tries = Tries + 1};
tried(renew, Entry) -> Entry.

%% The number of the hand-over, without the holds counted since.
base(Fence) -> starl_mutex_home:hand_over(Fence).

%% @doc It is time to ask the home again.
-spec renew(token(), t()) -> t().
renew(Token, #robot{entries = Entries} = Robot) ->
    case Entries of
        #{Token := #entry{granted = false, tries = ?CLAIMS}} -> lapse(Token, Robot);
        #{Token := #entry{granted = false} = Entry} -> ask(claim, Token, Entry, Robot);
        #{Token := #entry{lock = {_, _}} = Entry} -> ask(renew, Token, Entry, Robot);
        #{} -> Robot
    end.

%% @doc The home has confirmed a token; the lease counts from the asking.
-spec granted(token(), fence(), nonce(), t()) -> t().
granted(Token, Fence, {Incarnation, Sent}, #robot{incarnation = Incarnation} = Robot) ->
    #robot{entries = Entries, lease_us = Lease, now = Now} = Robot,
    End = Sent + Lease,
    case Entries of
        #{Token := #entry{fence = Own, lease_end = Before} = Entry} when
            End > Now, End > Before
        ->
            case base(Own) of
                Fence -> extend(Token, Entry#entry{lease_end = End}, Robot);
                _ -> Robot
            end;
        #{} ->
            Robot
    end;
granted(_Token, _Fence, _Earlier, Robot) ->
    Robot.

extend(Token, #entry{granted = Already, lease_end = End} = Entry, #robot{now = Now} = Robot) ->
    Timed = act({{timeout, {lease, Token}}, End - Now, over}, Robot),
    Granted = Entry#entry{granted = true, tries = 0},
    case Already of
        true -> put_entry(Token, Granted, Timed);
        false -> serve(Token, Granted, announce(Token, base(Entry#entry.fence), Timed))
    end.

announce(Token, Fence, #robot{self = Self} = Robot) ->
    Broadcast = {cast, sap, {broadcast, mutex, {owner, Token, Fence}}},
    announced(Token, Fence, Self, act(Broadcast, Robot)).

%% @doc The home does not confirm a token: there is a newer one.
-spec refused(token(), fence(), t()) -> t().
refused(Token, Fence, #robot{entries = Entries} = Robot) ->
    case Entries of
        #{Token := #entry{fence = Own}} ->
            case base(Own) of
                Fence -> lapse(Token, Robot);
                _ -> Robot
            end;
        #{} ->
            Robot
    end.

%% The queue of a token that is no more: its requests go to the home.
orphan(Token, Queue, Robot) ->
    lists:foldl(
        fun(Request, R) -> post_home(Token, {request, Token, Request, 0, home}, R) end,
        Robot,
        [Request || Request <- Queue, wanted(Token, Request, Robot)]
    ).

%% Gives a token that is free to whoever is first in its queue.
serve(Token, #entry{granted = true, lease_end = End} = Entry, #robot{now = Now} = Robot) when
    End =< Now
->
    %% later than its timer, which will tell
    put_entry(Token, Entry, Robot);
serve(Token, #entry{granted = true, lock = none, queue = Queue} = Entry, Robot) ->
    Self = Robot#robot.self,
    case trim(Token, Queue, Robot) of
        [] -> put_entry(Token, Entry#entry{queue = []}, Robot);
        [{Self, Id} | Rest] -> lock(Token, Id, Entry#entry{queue = Rest}, Robot);
        Others -> pass_on(Token, Entry#entry.fence, Others, forget_entry(Token, Robot))
    end;
serve(Token, Entry, Robot) ->
    put_entry(Token, Entry, Robot).

lock(Token, Id, #entry{fence = Fence} = Entry, #robot{jobs = Jobs} = Robot) ->
    Job = starl_mutex_job:got(Token, Fence, maps:get(Id, Jobs)),
    Locked = Entry#entry{lock = {Id, Fence}},
    Held = prolong(Token, Locked, act({trace, {acquired, Token, Fence}}, Robot)),
    proceed(Id, Job, Held).

%% A hold begins: the lease must be renewed, at once if more than half of it is over.
prolong(Token, Entry, #robot{lease_us = Lease, now = Now} = Robot) ->
    case Entry#entry.lease_end - Now < Lease div 2 of
        true ->
            ask(renew, Token, Entry, Robot);
        false ->
            Timer = {{timeout, {renew, Token}}, Lease div ?CLAIMS_A_LEASE, again},
            put_entry(Token, Entry, act(Timer, Robot))
    end.

%% A hold ends; the next one has another number.
unlock(Token, #robot{entries = Entries} = Robot) ->
    #{Token := #entry{lock = {_, Fence}} = Entry} = Entries,
    Freed = acts([{trace, {released, Token, Fence}}, {{timeout, {renew, Token}}, cancel}], Robot),
    case starl_mutex_home:last_hold(Fence) of
        true -> pass_on(Token, Fence, Entry#entry.queue, forget_entry(Token, Freed));
        false -> serve(Token, Entry#entry{lock = none, fence = Fence + 1}, Freed)
    end.

%% @doc The lease of a token is over: the robot has it no more, and the hold, if any, ends.
-spec lapse(token(), t()) -> t().
lapse(Token, #robot{entries = Entries} = Robot) ->
    case Entries of
        #{Token := #entry{lock = {Id, Fence}, queue = Queue}} ->
            Lost = act({trace, {lease_lost, Token, Fence}}, forget_entry(Token, Robot)),
            orphan(Token, Queue, lost(Id, Token, Lost));
        #{Token := #entry{queue = Queue}} ->
            orphan(Token, Queue, forget_entry(Token, Robot));
        #{} ->
            Robot
    end.

%% A job that has all it wanted is told at the release; one that waits begins anew.
lost(Id, Token, #robot{jobs = Jobs} = Robot) ->
    case waiting(Id, Robot) of
        none ->
            drop(Id, Token, Robot);
        {wait, Waiting, Job} ->
            %% while it gives back what it has got, it is in no queue
            Failed = act(
                {trace, {failed, Waiting, lease_lost}}, Robot#robot{jobs = maps:remove(Id, Jobs)}
            ),
            Others = lists:delete(Token, starl_mutex_job:held(Job)),
            proceed(Id, starl_mutex_job:anew(Job), lists:foldl(fun unlock/2, Failed, Others))
    end.

put_entry(Token, Entry, #robot{entries = Entries} = Robot) ->
    Robot#robot{entries = Entries#{Token => Entry}}.

forget_entry(Token, #robot{entries = Entries} = Robot) ->
    Cancel = [{{timeout, {T, Token}}, cancel} || T <- [renew, lease]],
    acts(Cancel, Robot#robot{entries = maps:remove(Token, Entries)}).

%% -- hand-over ------------------------------------------------------------------------------

%% The token leaves: to the first of the queue, or back to its home.
pass_on(Token, Fence, Queue, #robot{outs = Outs, owners = Owners} = Robot) ->
    case Queue =:= [] orelse starl_mutex_home:last_hand_over(Fence) of
        true ->
            post_home(Token, {return, Token, base(Fence), Queue}, Robot);
        false ->
            [{To, _} | _] = Queue,
            Next = starl_mutex_home:next(Fence),
            Sent = acts([
                {trace, {handed_over, Token, Next, To}},
                starl_sap:send(To, mutex, {token, Token, Next, Queue}, {hand, Token, Next})
            ], Robot),
            Sent#robot{
                outs = Outs#{{Token, Next} => {To, Queue}},
                owners = starl_mutex_owners:handed(Token, Next, To, Owners)
            }
    end.

%% @doc The outcome of a hand-over. One reported lost may have arrived all the same: the home
%% decides which comes first, the claim or the return.
-spec handed(token(), fence(), starl:outcome(), t()) -> t().
handed(Token, Fence, Outcome, #robot{outs = Outs} = Robot) ->
    case maps:take({Token, Fence}, Outs) of
        error -> Robot;
        {_, Rest} when Outcome =:= ok -> Robot#robot{outs = Rest};
        {{To, [First | Others]}, Rest} ->
            Traced = act({trace, {hand_over_lost, Token, Fence, To}}, Robot#robot{outs = Rest}),
            post_home(Token, {return, Token, Fence, Others ++ [First]}, Traced)
    end.

%% @doc The outcomes of what is under way will not be known; new SAPs know no listeners.
-spec sap_restarted(t()) -> t().
sap_restarted(#robot{outs = Outs} = Robot) ->
    lists:foldl(
        fun({Token, Fence}, R) -> handed(Token, Fence, {error, restarted}, R) end,
        act(starl_sap:listen(mutex, mutex), Robot),
        lists:sort(maps:keys(Outs))
    ).

%% -- the home -------------------------------------------------------------------------------

%% @doc The lease of a token of this home may be over.
-spec expire(token(), t()) -> t().
expire(Token, #robot{now = Now, home = Home} = Robot) ->
    at_home(Token, starl_mutex_home:expire(Token, Now, Home), Robot).

%% @doc A robot asks this home to confirm a token.
-spec asked(claim | renew, token(), fence(), nonce(), starl:robot_id(), t()) -> t().
asked(Kind, Token, Fence, Nonce, By, #robot{now = Now, home = Home} = Robot) ->
    {Answer, Next} = starl_mutex_home:Kind(Token, Fence, By, Now, Home),
    at_home(Token, {[{By, {Answer, Token, Fence, Nonce}}], Next}, Robot).

%% @doc A token comes back to this home.
-spec returned(token(), fence(), [request()], starl:robot_id(), t()) -> t().
returned(Token, Fence, Queue, By, #robot{now = Now, home = Home} = Robot) ->
    at_home(Token, starl_mutex_home:return(Token, Fence, By, Queue, Now, Home), Robot).

at_home(Token, {Messages, Home}, #robot{now = Now} = Robot) ->
    Sent = lists:foldl(fun({To, M}, R) -> post(To, M, R) end, Robot#robot{home = Home}, Messages),
    case starl_mutex_home:due(Token, Home) of
        never -> act({{timeout, {home, Token}}, cancel}, Sent);
        Due -> act({{timeout, {home, Token}}, max(0, Due - Now) + ?MARGIN_US, check}, Sent)
    end.

post_home(Token, Body, #robot{team = Team} = Robot) ->
    post(element(erlang:phash2(Token, tuple_size(Team)) + 1, Team), Body, Robot).

post(To, Body, Robot) -> act(starl_sap:post(To, mutex, Body), Robot).

act(Action, #robot{actions = Actions} = Robot) -> Robot#robot{actions = [Action | Actions]}.

acts(New, Robot) -> lists:foldl(fun act/2, Robot, New).
