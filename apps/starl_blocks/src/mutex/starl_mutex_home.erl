%% @doc The home of tokens: the single authority over the fencing numbers and leases of the tokens
%% whose home a robot is. Pure. The safety of {@link starl_mutex_tokens} rests on this part.
%%
%% A fencing number consists of four numbers: the incarnation of the home's machine, the creation of
%% the token in it, the hand-over of that creation, the owner's hold. So every hand-over has a
%% number of its own, even after tokens are lost, created anew or forgotten in a crash. The rules:
%% ```
%%   claim F    granted if F is larger than the last granted number (its holder has handed the
%%              token over, or the token was never granted) and of the last creation, or the
%%              claimant's own again
%%   renew F    granted if F is the claimant's own; after a crash of the home, one of an earlier
%%              incarnation is kept for its present hold, as long as nothing has been granted
%%              since, nor a newer one been renewed
%%   create     a new token with the next number, when the lease of the last one has surely
%%              ended, or was given back
%% '''
%% The home counts a lease from the receipt of the claim, the claimant from its sending. The home's
%% lease is longer by the most that two clocks drift apart, and by the time that a robot may take to
%% notice the end. So the claimant's lease always ends first, for any delay of messages. After a
%% crash of the home no lease can be younger than the crash, so the home waits for one full lease.
%% It cannot know what earlier incarnations granted. So a hold of an earlier incarnation may end in
%% peace, and no other hold begins under its number. A number of a later creation than the home's
%% last is false, so nobody can use up the numbers to come.
-module(starl_mutex_home).

-export([new/6, next/1, hand_over/1, last_hold/1, last_hand_over/1]).
-export([request/4, claim/5, renew/5, return/6, expire/3, due/2]).

-export_type([t/0, request/0, outgoing/0]).

%% A waiting robot, and the number of its request.
-type request() :: {starl:robot_id(), pos_integer()}.

%% A message to a robot.
-type outgoing() :: {starl:robot_id(), Body :: tuple()}.

%% A request that waits, and the number of tokens that were made here since it was asked for last. Who
%% waits asks again and again.
-type waiting() :: {request(), Tokens :: non_neg_integer()}.

-type us() :: integer().

%% A request that is asked for again arrives at most this much later: after all retransmissions.
-define(LATE_US, 2000000).
%% The most holds of an owner, hand-overs of a creation and creations of an incarnation.
-define(HOLD_BITS, 8).
-define(HAND_OVER_BITS, 12).
-define(CREATION_BITS, 24).
%% The most tokens of which a robot is the last owner here, beyond which it gets no new one made; and the most
%% requests of a robot that wait for one token.
-define(TOKENS, 4096).
-define(REQUESTS, 64).

-record(lease, {
    fence :: starl_mutex:fence(),
    owner = none :: starl:robot_id() | none,
    %% until when nothing may be granted to another robot
    until :: us(),
    %% those of earlier incarnations that were renewed by this one, latest first
    renewed = [] :: [starl_mutex:fence()],
    pending = [] :: [waiting()]
}).

-record(home, {
    base :: starl_mutex:fence(),
    ready :: us(),
    lease_us :: pos_integer(),
    %% so many tokens are made, at most, before one who waits has asked again
    most :: pos_integer(),
    leases = #{} :: #{starl_mutex:token() => #lease{}}
}).

-opaque t() :: #home{}.

%% @doc A home without tokens. `LeaseUs' is the holder's lease, `DriftPpm' the bound on the drift of
%% any clock. `LagUs' is the longest delay with which a robot notices the end of its lease, and
%% `RetryUs' the time after which a robot that waits asks again.
-spec new(
    Incarnation :: pos_integer(),
    us(),
    LeaseUs :: pos_integer(),
    DriftPpm :: integer(),
    LagUs :: integer(),
    RetryUs :: pos_integer()
) -> t().
new(Incarnation, Now, LeaseUs, DriftPpm, LagUs, RetryUs) ->
    Longer = (LeaseUs + LagUs) * (1000000 + DriftPpm) div (1000000 - DriftPpm) + 1000,
    Ready =
        case Incarnation of
            1 -> Now;
            _ -> Now + Longer
        end,
    Base = Incarnation bsl (?CREATION_BITS + ?HAND_OVER_BITS + ?HOLD_BITS),
    Most = 1 + (2 * RetryUs + ?LATE_US) div Longer,
    #home{base = Base, ready = Ready, lease_us = Longer, most = Most}.

%% @doc The number of the hand-over after this one.
-spec next(starl_mutex:fence()) -> starl_mutex:fence().
next(Fence) -> (Fence bsr ?HOLD_BITS + 1) bsl ?HOLD_BITS.

%% @doc The number of the hand-over that a hold belongs to.
-spec hand_over(starl_mutex:fence()) -> starl_mutex:fence().
hand_over(Fence) -> Fence bsr ?HOLD_BITS bsl ?HOLD_BITS.

%% @doc Are the owner's numbers used up by this hold?
-spec last_hold(starl_mutex:fence()) -> boolean().
last_hold(Fence) -> Fence + 1 =:= next(Fence).

%% @doc Are the hand-overs of this creation used up? Then the token must be returned.
-spec last_hand_over(starl_mutex:fence()) -> boolean().
last_hand_over(Fence) -> next(Fence) =:= created(Fence).

%% @doc A request has come to the home: a token is made for it, or it is sent on to the owner
%% and kept, in case the owner does not live.
-spec request(starl_mutex:token(), request(), us(), t()) -> {[outgoing()], t()}.
request(Token, {Robot, _} = Request, Now, #home{leases = Leases} = Home) ->
    case is_map_key(Token, Leases) orelse owned(Robot, Leases) < ?TOKENS of
        true -> requested(Token, Request, Now, Home);
        false -> {[], Home}
    end.

owned(Robot, Leases) when map_size(Leases) >= ?TOKENS ->
    length([Owner || #lease{owner = Owner} <- maps:values(Leases), Owner =:= Robot]);
owned(_Robot, Leases) ->
    map_size(Leases).

requested(Token, Request, Now, Home) ->
    #lease{pending = Pending} = Lease = lease(Token, Home),
    Waiting = Lease#lease{pending = ask(Request, Pending)},
    case Lease#lease.until =< Now of
        true -> create(Token, Waiting, Now, Home);
        false -> {forward(Token, Request, Lease), put_lease(Token, Waiting, Home)}
    end.

%% @doc A robot that got the token asks to be its owner.
-spec claim(starl_mutex:token(), starl_mutex:fence(), starl:robot_id(), us(), t()) ->
    {granted | refused, t()}.
claim(Token, Fence, By, Now, Home) ->
    case lease(Token, Home) of
        #lease{fence = Fence, owner = By} = Lease ->
            grant(Token, Lease, Now, Home);
        #lease{} = Lease ->
            case is_handed_over(Fence, Lease, Home) of
                true -> grant(Token, Lease#lease{fence = Fence, owner = By}, Now, Home);
                false -> {refused, Home}
            end
    end.

%% Is this the number of a later hand-over of the token that was made last?
is_handed_over(Fence, #lease{fence = Last}, #home{base = Base}) ->
    Fence > Last andalso Fence > Base andalso Fence < created(Last).

%% @doc An owner asks for a longer lease.
-spec renew(starl_mutex:token(), starl_mutex:fence(), starl:robot_id(), us(), t()) ->
    {granted | kept | refused, t()}.
renew(Token, Fence, By, Now, #home{base = Base} = Home) ->
    case lease(Token, Home) of
        #lease{fence = Fence, owner = By} = Lease ->
            grant(Token, Lease, Now, Home);
        #lease{fence = Base, owner = none, renewed = Renewed} = Lease when
            Renewed =:= []; Fence >= hd(Renewed)
        ->
            Kept = Lease#lease{renewed = lists:usort(fun erlang:'>='/2, [Fence | Renewed])},
            {granted, Next} = grant(Token, Kept, Now, Home),
            {kept, Next};
        #lease{} ->
            {refused, Home}
    end.

%% @doc A token comes back: it is not wanted, or its hand-over was reported lost. One that has
%% been claimed by another robot meanwhile stays there.
-spec return(
    starl_mutex:token(), starl_mutex:fence(), starl:robot_id(), [request()], us(), t()
) -> {[outgoing()], t()}.
return(Token, Fence, By, Queue, Now, #home{base = Base} = Home) ->
    case lease(Token, Home) of
        #lease{fence = Fence, owner = By} = Lease ->
            free(Token, Fence, Queue, Lease, Now, Home);
        %% the only one of an earlier incarnation that has shown itself
        #lease{fence = Base, owner = none, renewed = [Fence], pending = Pending} = Lease ->
            Waiting = back(Queue, Pending),
            Free = Lease#lease{until = max(Now, Home#home.ready), pending = Waiting},
            expire(Token, Now, put_lease(Token, Free, Home));
        #lease{} = Lease ->
            case is_handed_over(Fence, Lease, Home) of
                true -> free(Token, Fence, Queue, Lease, Now, Home);
                false -> {[], Home}
            end
    end.

free(Token, Fence, Queue, #lease{pending = Pending} = Lease, Now, Home) ->
    Waiting = back(Queue, Pending),
    Free = Lease#lease{fence = Fence, owner = none, until = Now, pending = Waiting},
    create(Token, Free, Now, Home).

%% @doc Makes a new token, if the lease is over and a robot waits.
-spec expire(starl_mutex:token(), us(), t()) -> {[outgoing()], t()}.
expire(Token, Now, Home) ->
    case lease(Token, Home) of
        #lease{until = Until} = Lease when Until =< Now -> create(Token, Lease, Now, Home);
        #lease{} -> {[], Home}
    end.

%% @doc The time at which {@link expire/3} is to be called for a token.
-spec due(starl_mutex:token(), t()) -> us() | never.
due(Token, Home) ->
    case lease(Token, Home) of
        #lease{pending = []} -> never;
        #lease{until = Until} -> Until
    end.

%% Those who have not asked for long wait no more: their robots have got the token from another owner,
%% have given up, or are dead. Each would cost the way to it, and all of them together more than a lease.
%% All requests of a robot have one turn, as when it has the token: if it is dead, those that it made one
%% after the other would cost a lease each.
create(Token, #lease{pending = Pending} = Lease, Now, #home{most = Most} = Home) ->
    case [Waiting || {_, Tokens} = Waiting <- Pending, Tokens < Most] of
        [] ->
            {[], put_lease(Token, Lease#lease{pending = []}, Home)};
        [{{Robot, _}, _} | _] = Waiting ->
            Rest = [{Request, Tokens + 1} || {Request, Tokens} <- others(Robot, Waiting)],
            Queue = [Request || {Request, _} <- Waiting],
            Fence = created(Lease#lease.fence),
            Until = Now + Home#home.lease_us,
            Made = Lease#lease{fence = Fence, owner = Robot, until = Until, pending = Rest},
            {[{Robot, {token, Token, Fence, Queue}}], put_lease(Token, Made, Home)}
    end.

created(Fence) ->
    Bits = ?HAND_OVER_BITS + ?HOLD_BITS,
    (Fence bsr Bits + 1) bsl Bits.

forward(Token, {Robot, _} = Request, #lease{fence = Fence, owner = Owner}) ->
    [
        {Owner, {request, Token, Request, Fence, home}}
     || Owner =/= none, Owner =/= Robot
    ].

%% A robot that has the token waits no longer.
grant(Token, #lease{owner = Owner, pending = Pending} = Lease, Now, Home) ->
    Granted = Lease#lease{until = Now + Home#home.lease_us, pending = others(Owner, Pending)},
    {granted, put_lease(Token, Granted, Home)}.

others(Robot, Pending) -> [Waiting || {{From, _}, _} = Waiting <- Pending, From =/= Robot].

ask({Robot, _} = Request, Pending) ->
    case lists:keymember(Request, 1, Pending) of
        true ->
            lists:keyreplace(Request, 1, Pending, {Request, 0});
        false when length(Pending) < ?REQUESTS -> Pending ++ [{Request, 0}];
        false ->
            Before = [Waiting || {{From, _}, _} = Waiting <- Pending, From =:= Robot],
            Pending ++ [{Request, 0} || length(Before) < ?REQUESTS]
    end.

%% The requests that a token brings back are first.
back(Queue, Pending) ->
    [{Request, 0} || Request <- Queue] ++
        [Waiting || {Request, _} = Waiting <- Pending, not lists:member(Request, Queue)].

lease(Token, #home{leases = Leases, base = Base, ready = Ready}) ->
    maps:get(Token, Leases, #lease{fence = Base, until = Ready}).

put_lease(Token, Lease, #home{leases = Leases} = Home) ->
    Home#home{leases = Leases#{Token => Lease}}.
