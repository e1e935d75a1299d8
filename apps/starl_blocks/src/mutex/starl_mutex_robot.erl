%% @doc Handles a robot's operations on tokens. A request looks for a token. A token arrives, is
%% confirmed by its home, is held, lapses and is handed over. Pure. With {@link starl_mutex_acquire}
%% it implements the operations of {@link starl_mutex_tokens}.
-module(starl_mutex_robot).

-export([owner/3, sap_restarted/1]).
-export([route/5, supersede/4, receive_token/5, confirmed/5, refused/3]).
-export([announced/4, knows/4, handed/4]).
-export([renew/2, lapse/2, unlock/2, orphan/3]).

-export_type([nonce/0]).

-import(starl_mutex_state, [
    act/2, acts/2, until/4, notify/2, post/3, post_home/3, entry/2, put_entry/3, forget_entry/2
]).

-type t() :: starl_mutex_state:t().
-type token() :: starl_mutex:token().
-type fence() :: starl_mutex:fence().
-type request() :: starl_mutex_home:request().
%% The time of a claim, and the incarnation in which it was sent.
-type nonce() :: {Incarnation :: pos_integer(), SentUs :: integer()}.

%% The number of repetitions of a claim in a lease, and in all.
-define(CLAIMS_A_LEASE, 4).
-define(CLAIMS, 16).

%% @doc Answers with the robot that was last announced as the token's owner.
-spec owner(starl_machine:from(), token(), t()) -> t().
owner(From, Token, Robot) ->
    {_, Owner} = newest_owner(Token, Robot),
    act({reply, From, Owner}, Robot).

newest_owner(Token, Robot) -> starl_mutex_owners:newest(Token, starl_mutex_state:owners(Robot)).

%% -- requests -------------------------------------------------------------------------------

%% @doc A request looks for the token. It is sent on to a newer owner than its sender knew, or
%% once to the home; so it cannot go in circles.
-spec route(token(), request(), Known :: fence() | 0, Via :: home | none, t()) -> t().
route(Token, {Asker, _} = Request, Known, Via, Robot) ->
    Self = starl_mutex_state:self(Robot),
    case {entry(Token, Robot), newest_owner(Token, Robot)} of
        {#{queue := Queue} = Entry, _} ->
            serve(Token, Entry#{queue := starl_mutex_owners:add(Request, Queue)}, Robot);
        {none, _} when Via =:= home, Known =:= 0 ->
            starl_mutex_host:requested(Token, Request, Robot);
        {none, {Fence, Owner}} when Fence > Known, Owner =/= Self, Owner =/= Asker ->
            post(Owner, {request, Token, Request, Fence, Via}, Robot);
        {none, _} when Via =:= none ->
            post_home(Token, {request, Token, Request, 0, home}, Robot);
        {none, _} ->
            wait_for_token(Token, {Request, Known}, Robot)
    end.

wait_for_token(Token, Early, Robot) ->
    Most = starl_mutex_state:team_size(Robot),
    Owners = starl_mutex_owners:wait(Token, Early, Most, starl_mutex_state:owners(Robot)),
    starl_mutex_state:put_owners(Owners, Robot).

%% @doc An owner has announced itself. The requests that wait here for the token go on to it, if
%% it is newer than the hand-over that they wait for: announcements overtake each other.
-spec announced(token(), fence(), starl:robot_id(), t()) -> t().
announced(Token, Fence, Owner, Robot) ->
    case starl_mutex_owners:announced(Token, Fence, Owner, starl_mutex_state:owners(Robot)) of
        known ->
            Robot;
        {newer, Early, Owners} ->
            Told = starl_mutex_state:put_owners(Owners, Robot),
            lists:foldl(
                fun({Request, Known}, R) -> route(Token, Request, Known, home, R) end, Told, Early
            )
    end.

%% @doc Does an announcement of this owner change nothing?
-spec knows(token(), fence(), starl:robot_id(), t()) -> boolean().
knows(Token, Fence, Owner, Robot) ->
    Owners = starl_mutex_state:owners(Robot),
    starl_mutex_owners:announced(Token, Fence, Owner, Owners) =:= known.

%% -- tokens ---------------------------------------------------------------------------------

%% @doc A token comes: an older one of the name, which the robot still has, is over.
-spec supersede(token(), fence(), From :: starl:robot_id(), t()) -> t().
supersede(Token, Fence, From, Robot) ->
    case {entry(Token, Robot), is_newer(Token, Fence, From, Robot)} of
        {#{fence := Own}, true} when Own < Fence -> lapse(Token, Robot);
        _ -> Robot
    end.

%% Is no newer one known? What another robot has announced does not count against a token of its home: a robot
%% that wants it asks the home before it holds it, and is refused if the token is an old one that comes late.
is_newer(Token, Fence, From, Robot) ->
    {Known, _} = newest_owner(Token, Robot),
    Known < Fence orelse starl_mutex_state:is_home(From, Token, Robot).

%% @doc A token has come. It is claimed if it is wanted here, else it goes on; unless the robot
%% knows of a newer one.
-spec receive_token(token(), fence(), [request()], From :: starl:robot_id(), t()) -> t().
receive_token(Token, Fence, Queue0, From, Robot) ->
    Owners = starl_mutex_state:owners(Robot),
    case {entry(Token, Robot), is_newer(Token, Fence, From, Robot)} of
        {none, true} ->
            {Early, Left} = starl_mutex_owners:take_early(Token, Owners),
            Queue = lists:foldl(fun starl_mutex_owners:add/2, Queue0, Early),
            Heard = starl_mutex_state:put_owners(Left, Robot),
            claim_or_pass(Token, Fence, trim(Token, Queue, Heard), Heard);
        {_, _} ->
            Robot
    end.

claim_or_pass(Token, Fence, Queue, Robot) ->
    Self = starl_mutex_state:self(Robot),
    case Queue of
        [{Self, _} | _] -> ask(claim, Token, new_entry(Fence, Queue), Robot);
        _ -> pass_on(Token, Fence, Queue, Robot)
    end.

new_entry(Fence, Queue) ->
    #{fence => Fence, granted => false, lease_end => 0, queue => Queue, lock => none, tries => 0}.

%% Without the requests of this robot that it no longer makes, wherever they stand; one that it makes
%% now has the turn of the first of them. So a token that is wanted goes round the team at most once: none
%% who wants it hands it on for those who do not.
trim(Token, Queue, Robot) ->
    Self = starl_mutex_state:self(Robot),
    Wanting = [{Self, Id} || Id <- starl_mutex_state:wanting(Token, Robot)],
    turns(Queue, Wanting -- Queue, fun(R) -> starl_mutex_state:is_wanted(Token, R, Robot) end).

turns([], _Wanting, _IsWanted) ->
    [];
turns([Request | Requests], Wanting, IsWanted) ->
    case {IsWanted(Request), Wanting} of
        {true, _} -> [Request | turns(Requests, Wanting, IsWanted)];
        {false, [First | Others]} -> [First | turns(Requests, Others, IsWanted)];
        {false, []} -> turns(Requests, [], IsWanted)
    end.

%% Asks the home to confirm the token, and again in a while.
ask(Kind, Token, #{fence := Fence} = Entry, Robot) ->
    Nonce = {starl_mutex_state:incarnation(Robot), starl_mutex_state:now(Robot)},
    Again = {{timeout, {renew, Token}}, quarter(Robot), again},
    Asking = act(Again, put_entry(Token, tried(Kind, Entry), Robot)),
    post_home(Token, {ask, Kind, Token, base(Fence), Nonce}, Asking).

%% Only claims are counted: renewals end with the lease.
tried(claim, #{tries := Tries} = Entry) -> Entry#{tries := Tries + 1};
tried(renew, Entry) -> Entry.

%% The number of the hand-over, without the holds counted since.
base(Fence) -> starl_mutex_home:hand_over(Fence).

%% @doc It is time to ask the home again.
-spec renew(token(), t()) -> t().
renew(Token, Robot) ->
    case entry(Token, Robot) of
        #{granted := false, tries := ?CLAIMS} -> lapse(Token, Robot);
        #{granted := false} = Entry -> ask(claim, Token, Entry, Robot);
        #{lock := {_, _}} = Entry -> ask(renew, Token, Entry, Robot);
        #{queue := [_ | _]} = Entry -> ask(renew, Token, Entry, Robot);
        _ -> Robot
    end.

%% @doc The home has confirmed a token; the lease counts from the asking. `kept': by an incarnation
%% later than the token, and for the present hold only.
-spec confirmed(granted | kept, token(), fence(), nonce(), t()) -> t().
confirmed(How, Token, Fence, {Incarnation, Sent}, Robot) ->
    End = Sent + starl_mutex_state:lease_us(Robot),
    Now = starl_mutex_state:now(Robot),
    Alive = End > Now andalso Incarnation =:= starl_mutex_state:incarnation(Robot),
    case entry(Token, Robot) of
        #{fence := Own, granted := Already, lease_end := Before} = Entry when
            Alive, not Already orelse End > Before
        ->
            case base(Own) of
                Fence -> extend(How, Token, Entry#{lease_end := End}, Robot);
                _ -> Robot
            end;
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
        {false, none} -> serve(fresh, Token, Granted, announce(Token, base(Fence), Timed));
        {true, none} -> serve(fresh, Token, Granted, Timed);
        {true, {_, Held}} -> put_entry(Token, Granted, leased(Token, Held, Entry, Timed))
    end.

left(#{lease_end := End}, Robot) -> End - starl_mutex_state:now(Robot).

leased(Token, Fence, Entry, Robot) ->
    until([Entry], [lease(Token, Fence, Entry, Robot)], leased, Robot).

lease(Token, Fence, Entry, Robot) -> {trace, {leased, Token, Fence, left(Entry, Robot)}}.

announce(Token, Fence, Robot) ->
    Broadcast = {cast, sap, {broadcast, mutex, {owner, Token, Fence}}},
    Owners = starl_mutex_owners:refute(Token, Fence, starl_mutex_state:owners(Robot)),
    Confirmed = starl_mutex_state:put_owners(Owners, act(Broadcast, Robot)),
    announced(Token, Fence, starl_mutex_state:self(Robot), Confirmed).

%% @doc The home does not confirm a token: there is a newer one.
-spec refused(token(), fence(), t()) -> t().
refused(Token, Fence, Robot) ->
    case entry(Token, Robot) of
        #{fence := Own} ->
            case base(Own) of
                Fence -> lapse(Token, Robot);
                _ -> Robot
            end;
        none ->
            Robot
    end.

%% Gives a free token to the first request of its queue.
serve(Token, Entry, Robot) -> serve(used, Token, Entry, Robot).

serve(How, Token, #{granted := true, lock := none, queue := Queue} = Entry, Robot) ->
    Self = starl_mutex_state:self(Robot),
    case trim(Token, Queue, Robot) of
        [] ->
            put_entry(Token, Entry#{queue := []}, Robot);
        [{Self, Id} | Rest] ->
            begin_hold(How, Token, Id, Entry#{queue := Rest}, Robot);
        [_ | _] = Others ->
            pass_on(Token, map_get(fence, Entry), Others, forget_entry(Token, Robot))
    end;
serve(_How, Token, Entry, Robot) ->
    put_entry(Token, Entry, Robot).

%% A hold that began with the rest of an old lease might be over before it is renewed: the home is
%% asked first. A lease that it has just given is taken as it is, after any delay.
begin_hold(used, Token, Id, #{queue := Rest} = Entry, Robot) ->
    case is_worn(Entry, Robot) of
        true ->
            ask(renew, Token, Entry#{queue := [{starl_mutex_state:self(Robot), Id} | Rest]}, Robot);
        false ->
            lock(Token, Id, Entry, Robot)
    end;
begin_hold(fresh, Token, Id, Entry, Robot) ->
    lock(Token, Id, Entry, Robot).

is_worn(Entry, Robot) -> left(Entry, Robot) < half(Robot).

lock(Token, Id, #{fence := Fence} = Entry, Robot) ->
    Locked = Entry#{lock := {Id, Fence}},
    Facts = [lease(Token, Fence, Entry, Robot), {trace, {acquired, Token, Fence}}],
    Traced = until([Entry], Facts, {hold, Token, Fence}, Robot),
    notify({locked, Id, Token, Fence}, prolong(Token, Locked, Traced)).

%% A hold begins: the lease must be renewed, when half of it is left at the latest.
prolong(Token, Entry, Robot) ->
    case left(Entry, Robot) - half(Robot) of
        Spare when Spare < 0 ->
            ask(renew, Token, Entry, Robot);
        Spare ->
            Us = min(Spare, quarter(Robot)),
            put_entry(Token, Entry, act({{timeout, {renew, Token}}, Us, again}, Robot))
    end.

half(Robot) -> starl_mutex_state:lease_us(Robot) div 2.

quarter(Robot) -> starl_mutex_state:lease_us(Robot) div ?CLAIMS_A_LEASE.

%% @doc A hold ends; the next one has another number. One whose lease is over had ended before.
-spec unlock(token(), t()) -> t().
unlock(Token, Robot) ->
    #{queue := Queue} = Entry = entry(Token, Robot),
    case starl_mutex_state:is_over(Entry, Robot) of
        true -> orphan(Token, Queue, lose(Token, Entry, Robot));
        false -> free(Token, Entry, Robot)
    end.

free(Token, #{lock := {_, Fence}, queue := Queue} = Entry, Robot) ->
    Released = [{trace, {released, Token, Fence}}],
    Told = until([Entry], Released, {released, Token, Fence}, Robot),
    Freed = act({{timeout, {renew, Token}}, cancel}, Told),
    case {Entry, starl_mutex_home:last_hold(Fence)} of
        {#{last := true}, _} -> give_home(Token, Fence, Queue, forget_entry(Token, Freed));
        {_, true} -> pass_on(Token, Fence, Queue, forget_entry(Token, Freed));
        {_, false} -> serve(Token, Entry#{lock := none, fence := Fence + 1}, Freed)
    end.

%% @doc The lease of a token is over: the robot no longer has it, and the hold, if any, ends.
-spec lapse(token(), t()) -> t().
lapse(Token, Robot) ->
    case entry(Token, Robot) of
        #{lock := {Id, _}, queue := Queue} = Entry ->
            %% the job gives back what else it has before the requests look for another token
            notify({lost, Id, Token, Queue}, lose(Token, Entry, Robot));
        #{queue := Queue} ->
            orphan(Token, Queue, forget_entry(Token, Robot));
        none ->
            Robot
    end.

lose(Token, #{lock := {_, Fence}}, Robot) ->
    act({trace, {lease_lost, Token, Fence}}, forget_entry(Token, Robot)).

%% @doc The queue of a token that no longer exists: its requests go to the home.
-spec orphan(token(), [request()], t()) -> t().
orphan(Token, Queue, Robot) ->
    lists:foldl(
        fun(Request, R) -> post_home(Token, {request, Token, Request, 0, home}, R) end,
        Robot,
        [Request || Request <- Queue, starl_mutex_state:is_wanted(Token, Request, Robot)]
    ).

%% -- hand-over ------------------------------------------------------------------------------

%% Hands the token over, to the first of the queue, or back to its home.
pass_on(Token, Fence, Queue, Robot) ->
    case Queue =:= [] orelse starl_mutex_home:last_hand_over(Fence) of
        true -> give_home(Token, Fence, Queue, Robot);
        false -> hand_over(Token, starl_mutex_home:next(Fence), Queue, Robot)
    end.

give_home(Token, Fence, Queue, Robot) ->
    post_home(Token, {return, Token, base(Fence), Queue}, Robot).

hand_over(Token, Next, [{To, _} | _] = Queue, Robot) ->
    Sent = acts(
        [
            {trace, {handed_over, Token, Next, To}},
            starl_sap:send(To, mutex, {token, Token, Next, Queue}, {hand, Token, Next})
        ],
        Robot
    ),
    Owners = starl_mutex_owners:handed(Token, Next, To, starl_mutex_state:owners(Sent)),
    starl_mutex_state:put_owners(
        Owners, starl_mutex_state:sent_out(Token, Next, To, Queue, Sent)
    ).

%% @doc The outcome of a hand-over. One reported lost may have arrived all the same: the home
%% decides which comes first, the claim or the return. A robot that cannot be reached has no turn until it
%% asks again: a dead one would have it in each round.
-spec handed(token(), fence(), starl:outcome(), t()) -> t().
handed(Token, Fence, Outcome, Robot) ->
    case starl_mutex_state:take_out(Token, Fence, Robot) of
        none ->
            Robot;
        {_To, _Queue, Known} when Outcome =:= ok ->
            Known;
        {To, [_First | Others], Known} ->
            Traced = act({trace, {hand_over_lost, Token, Fence, To}}, Known),
            post_home(Token, {return, Token, Fence, Others}, Traced)
    end.

%% @doc SAP has restarted: the outcomes of hand-overs under way will not be known, and a new SAP
%% knows no listeners.
-spec sap_restarted(t()) -> t().
sap_restarted(Robot) ->
    lists:foldl(
        fun({Token, Fence}, R) -> handed(Token, Fence, {error, restarted}, R) end,
        act(starl_sap:listen(mutex, mutex), Robot),
        starl_mutex_state:outs(Robot)
    ).
