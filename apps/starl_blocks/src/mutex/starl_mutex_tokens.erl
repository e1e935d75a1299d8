%% @doc Mutual exclusion by tokens that travel with their queues, under leases.
%% ```
%%   requester          owner             home of the token        all others
%%     | request --------->|                     |   (retries go to the home, which
%%     |                   |<------- request ----|    knows the owner)
%%     |<- token {F, Queue}|  at its release     |
%%     | claim F --------------------------------->| granted if F is the newest
%%     |<------------------------------- granted F |
%%     | owner {F, requester} ----------------------------------------->|
%%     | renew F, while it holds ----------------->|
%% '''
%% A robot that has got a token holds it only once the home has confirmed it. It holds it only as
%% long as the lease that it counts from the sending of its last confirmed claim. At every event it
%% first checks which of its leases are over. So a robot that has stalled notices this before it
%% answers a call or hands a token on. What it then reports of a hold, to the application and in the
%% trace, leaves before the lease is over, or not at all (`until'). The rules of the home are those
%% of {@link starl_mutex_home}; safety rests on these rules and the lease alone. Requests, queues
%% and announcements may be lost at any time: a robot that waits asks the home again.
%%
%% A token as seen by a robot that has it:
%% ```
%%   -- token --> claiming -- granted --> idle <-- released -- locked by a job
%%                   | refused              | a request: handed over, or locked
%%                   v                      v lease over: forgotten
%% '''
%% Calls: `{acquire, Tokens, Us}', `{release, Tokens}', `{forgo, Tokens}' when the answer to an
%% acquisition came too late, `{owner, Token}'; one message type,
%% `mutex'. Trace: {@link event()}.
-module(starl_mutex_tokens).
-behaviour(starl_machine).

-export([has_history/0, init/1, handle_event/5, accepts/2]).

-export_type([event/0]).

%% The trace of the mutex machine.
-type event() ::
    {requested, starl_mutex:token()}
    %% a hold that begins now, or exists, may last so much longer by the robot's clock (us)
    | {leased, starl_mutex:token(), starl_mutex:fence(), LeftUs :: integer()}
    | {acquired, starl_mutex:token(), starl_mutex:fence()}
    %% the application is told that it holds these
    | {answered, [{starl_mutex:token(), starl_mutex:fence()}]}
    | {released, starl_mutex:token(), starl_mutex:fence()}
    %% the lease of a hold is over
    | {lease_lost, starl_mutex:token(), starl_mutex:fence()}
    %% a request has ended without the token
    | {failed, starl_mutex:token(), timeout | restarted | lease_lost}
    %% at the home: the hand-over to this robot counts
    | {granted, starl_mutex:token(), starl_mutex:fence(), To :: starl:robot_id()}
    %% for the reader of a recording: the token is sent on; SAP reports that message lost
    | {handed_over, starl_mutex:token(), starl_mutex:fence(), To :: starl:robot_id()}
    | {hand_over_lost, starl_mutex:token(), starl_mutex:fence(), To :: starl:robot_id()}.

-define(LEASE_MS, 8000).
-define(DRIFT_PPM, 10000).
-define(LAG_MS, 250).
-define(RETRY_MS, 3000).

-spec has_history() -> true.
has_history() -> true.

-spec init(starl_machine:config()) ->
    {ready, starl_mutex_state:t(), [starl_machine:action()]}.
init(Config) ->
    Robot = starl_mutex_state:new(Config#{
        lease_us => 1000 * maps:get(lease_ms, Config, ?LEASE_MS),
        drift_ppm => maps:get(drift_ppm, Config, ?DRIFT_PPM),
        lag_us => 1000 * maps:get(lag_ms, Config, ?LAG_MS),
        retry_us => 1000 * maps:get(retry_ms, Config, ?RETRY_MS)
    }),
    {ready, Robot, [starl_sap:listen(mutex, mutex)]}.

-spec handle_event(
    starl_machine:event_type(), term(), ready, starl_mutex_state:t(), starl_machine:meta()
) -> starl_machine:result().
handle_event(Type, Content, ready, Robot, #{now := Now}) ->
    case event(Type, Content, current(Type, Content, starl_mutex_state:at(Now, Robot))) of
        unknown_event -> unknown_event;
        Next -> starl_mutex_state:result(starl_mutex_acquire:settle(Next))
    end.

%% Leases that are over end before any other step. Only an announcement that is known already does
%% nothing, now and for ever: the checker skips it.
current(cast, {message, From, mutex, {owner, Token, Fence}}, Robot) ->
    case starl_mutex_robot:knows(Token, Fence, From, Robot) of
        true -> Robot;
        false -> starl_mutex_acquire:lapse_all(starl_mutex_state:all_told(Robot))
    end;
%% A hold of which nobody has learned is not lost: that is handled first.
current(info, {late, _}, Robot) ->
    Robot;
current(_Type, _Content, Robot) ->
    starl_mutex_acquire:lapse_all(starl_mutex_state:all_told(Robot)).

%% The roles: a robot that wants or has tokens, and the home of some.
event({call, {Caller, _} = From}, {acquire, Tokens, Us}, Robot) ->
    starl_mutex_acquire:acquire(Caller, From, Tokens, Us, Robot);
event({call, {Caller, _} = From}, {release, Tokens}, Robot) ->
    starl_mutex_acquire:release(Caller, From, Tokens, Robot);
event({call, {Caller, _} = From}, {forgo, Tokens}, Robot) ->
    starl_mutex_acquire:forgo(Caller, From, Tokens, Robot);
event({call, From}, {owner, Token}, Robot) ->
    starl_mutex_robot:owner(From, Token, Robot);
event(cast, {message, From, mutex, Message}, Robot) ->
    message(Message, From, Robot);
event({reply, {hand, Token, Fence}}, Outcome, Robot) ->
    starl_mutex_robot:handed(Token, Fence, Outcome, Robot);
event({timeout, {renew, Token}}, _, Robot) ->
    starl_mutex_robot:renew(Token, Robot);
event({timeout, {lease, Token}}, _, Robot) ->
    starl_mutex_robot:lapse(Token, Robot);
event({timeout, {home, Token}}, _, Robot) ->
    starl_mutex_host:expire(Token, Robot);
event({timeout, {again, Job}}, _, Robot) ->
    starl_mutex_acquire:again(Job, Robot);
event({timeout, {anew, Job}}, _, Robot) ->
    starl_mutex_acquire:anew(Job, Robot);
event({timeout, {patience, Job}}, _, Robot) ->
    starl_mutex_acquire:give_up(Job, timeout, Robot);
event(info, {late, Mark}, Robot) ->
    starl_mutex_acquire:late(Mark, Robot);
event(info, {restarted, sap}, Robot) ->
    starl_mutex_robot:sap_restarted(Robot);
event(info, {Gone, Caller}, Robot) when Gone =:= restarted; Gone =:= given_up ->
    starl_mutex_acquire:caller_restarted(Caller, Robot);
event(_, _, _) ->
    unknown_event.

%% @private What comes over the radio.
-spec accepts(starl_packet:type(), Body :: term()) -> boolean().
accepts(mutex, Body) when tuple_size(Body) > 0 -> starl_shape:is(shape(element(1, Body)), Body);
accepts(_Type, _Body) -> false.

shape(request) ->
    [any, label, request(), {either, [{is, 0}, serial]}, {either, [{is, home}, {is, none}]}];
shape(token) ->
    [any, label, serial, {list, request()}];
shape(Confirmed) when Confirmed =:= granted; Confirmed =:= kept ->
    [any, label, serial, [count, integer]];
shape(refused) ->
    [any, label, serial, [count, integer]];
shape(owner) ->
    [any, label, serial];
shape(ask) ->
    [any, {either, [{is, claim}, {is, renew}]}, label, serial, [count, integer]];
shape(return) ->
    [any, label, serial, {list, request()}];
shape(_Unknown) ->
    {either, []}.

request() -> [count, count].

message({request, Token, Request, Known, Via}, _From, Robot) ->
    case starl_mutex_state:of_team([Request], Robot) of
        [Request] -> starl_mutex_robot:route(Token, Request, Known, Via, Robot);
        [] -> unknown_event
    end;
message({token, Token, Fence, Queue}, From, Robot) ->
    %% a job that loses the older one may want the newer one
    Ready = starl_mutex_acquire:settle(starl_mutex_robot:supersede(Token, Fence, From, Robot)),
    Waiting = starl_mutex_state:of_team(Queue, Robot),
    starl_mutex_robot:receive_token(Token, Fence, Waiting, From, Ready);
message({How, Token, Fence, Nonce}, From, Robot) when
    How =:= granted; How =:= kept; How =:= refused
->
    case starl_mutex_state:is_home(From, Token, Robot) of
        true -> answered(How, Token, Fence, Nonce, Robot);
        false -> unknown_event
    end;
message({owner, Token, Fence}, From, Robot) ->
    starl_mutex_robot:announced(Token, Fence, From, Robot);
message({ask, Kind, Token, Fence, Nonce}, From, Robot) when Kind =:= claim; Kind =:= renew ->
    starl_mutex_host:asked(Kind, Token, Fence, Nonce, From, Robot);
message({return, Token, Fence, Queue}, From, Robot) ->
    Waiting = starl_mutex_state:of_team(Queue, Robot),
    starl_mutex_host:returned(Token, Fence, Waiting, From, Robot);
message(_, _, _) ->
    unknown_event.

answered(refused, Token, Fence, _Nonce, Robot) ->
    starl_mutex_robot:refused(Token, Fence, Robot);
answered(How, Token, Fence, Nonce, Robot) ->
    starl_mutex_robot:confirmed(How, Token, Fence, Nonce, Robot).
