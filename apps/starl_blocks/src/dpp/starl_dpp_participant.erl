%% @doc A participant of distributed path planning (the paper's Subroutines 2 and 4). It drives the
%% robot, and only under a lease to drive.
%% ```
%%              request: stop the robot, locate it        answer: a path
%%   standing -----------------------> asking ---------------------------> moving
%%      ^ ^                              |  ^                                | |
%%      | |          answer: complete    |  |       request: stop, locate    | |
%%      | +------------------------------+  +--------------------------------+ |
%%      +------------------ the lease has ended: the robot is stopped ---------+
%% '''
%% After a crash it stops the robot, so it always knows whether the robot may be moving. A path is
%% void for ever once its lease has ended; no later message brings it back.
%%
%% A request certifies that the robot stands at this point, and will not follow any answer to an
%% earlier request. So the coordinator may free the robot's reservation, even if messages are lost,
%% duplicated or late. An answer to any other request than the present one is dropped.
%%
%% The participant follows the coordinator of the highest term that it has heard of, and has a vote
%% ({@link starl_dpp_vote}). When it misses its coordinator, its own robot's coordinator machine tries to
%% lead.
%%
%% Calls: `{join, Coordinator}', `coordinator', `request', `wait', `{face, Id, N}', `{drive, Id, N}' (see
%% {@link starl_dpp}). Messages: {@link starl_dpp_message}. Trace: {@link event()}.
-module(starl_dpp_participant).
-behaviour(starl_machine).

-export([init/1, handle_event/5, accepts/2]).

-export_type([event/0]).

%% The trace of a participant.
-type event() ::
    %% an answer from this robot, in this term, to another request than the present one
    {stale_answer, starl:robot_id(), starl_dpp:term_id(), starl_dpp:request_id()}
    %% this robot says a term that is too far above to be believed at once, or another robot's
    | {doubted, starl:robot_id(), starl_dpp:term_id()}
    %% the lease to drive along the path of this answer has ended
    | {void, starl_dpp:request_id()}
    %% something is in its way on the line to this point
    | {blocked, starl_geometry:point()}
    %% its application asks for a path, and is answered
    | asks
    | {answered, assign | complete | incomplete | no_answer}.

-type where() :: starl_dpp_progress:where().

%% The time after which a request without an answer is repeated; likewise a look at the position.
-define(AGAIN_US, 40000000).
-define(LOOK_US, 500000).
%% The time after which a request fails with `no_answer' if no coordinator has shown that it hears the robot.
-define(PATIENCE_US, 120000000).
%% A robot that turns to a direction turns to a point so far away.
-define(AHEAD_MM, 1000.0).

-record(part, {
    self :: starl:robot_id(),
    now :: integer(),
    %% the identifier of the present request: the incarnation, or a higher number if the coordinator
    %% knows of one, and the number of the request
    series :: pos_integer(),
    n = 0 :: non_neg_integer(),
    %% the caller of the application's request, and of its drive
    from = none :: starl_machine:from() | none,
    drive = none ::
        {starl_machine:from(), face | drive | {face, Heading :: float()}, N :: pos_integer()}
        | none,
    track :: starl_dpp_progress:t(),
    follow :: starl_dpp_follower:t()
}).

-spec init(starl_machine:config()) -> {standing, #part{}, [starl_machine:action()]}.
init(#{robot := Self, incarnation := Life, now := Now} = Config) ->
    Follow = starl_dpp_follower:new(Config),
    Part = #part{
        self = Self,
        now = Now,
        series = Life,
        track = starl_dpp_progress:new(maps:get(slack, Config, 0.0)),
        follow = Follow
    },
    Stop = [starl_motion:stop() || Life > 1],
    {standing, Part, listen() ++ Stop ++ starl_dpp_follower:begins(Follow)}.

-spec handle_event(starl_machine:event_type(), term(), where(), #part{}, starl_machine:meta()) ->
    starl_machine:result().
handle_event(Type, Content, Where, Part, #{now := Now}) ->
    event(Type, Content, Where, Part#part{now = Now}).

event(cast, {message, Source, dpp_beat, {_, Seq, _} = Beat}, Where, Part) ->
    timed(Source, {Seq, true}, Where, Part, fun(At, Next) -> beat(Source, Beat, At, Next) end);
event({call, From}, request, Where, Part) ->
    request(From, Where, Part);
event({call, From}, wait, Where, Part) ->
    wait(From, Where, Part);
event({call, From}, {What, Id, N}, Where, Part) when
    What =:= face; What =:= drive; element(1, What) =:= face
->
    drive({From, What, N}, Id, Where, Part);
event({reply, {driven, What, Id, N}}, Outcome, Where, Part) ->
    driven(Outcome, {What, N}, Id, Where, Part);
event({timeout, leave}, _, Where, Part) ->
    lease_end(Where, Part);
event({reply, {halted, N}}, Outcome, _Where, #part{n = N} = Part) ->
    {keep_state, Part, distrust(Outcome) ++ look(Part)};
event({reply, {pose, N}}, {ok, {X, Y, _}}, Where, #part{n = N} = Part) ->
    stands({X, Y}, Where, Part);
event(cast, {message, Source, dpp_answer, {Term, Id, Answer, News}}, Where, Part) ->
    answer(Source, Term, Id, {Answer, News}, Where, Part);
event({timeout, again}, request, asking, Part) ->
    ask(Part);
event({timeout, look}, look, _Where, Part) ->
    {keep_state, Part, halt_and_look(Part)};
event({reply, {sent, N}}, {error, _}, asking, #part{n = N} = Part) ->
    {keep_state, Part, [{{timeout, again}, ?LOOK_US, request}]};
event({timeout, patience}, _, asking, #part{from = From} = Part) ->
    {next_state, standing, Part#part{from = none}, [
        {{timeout, again}, cancel},
        {trace, {answered, no_answer}},
        {reply, From, {error, no_answer}}
    ]};
event({timeout, missing}, _, _Where, #part{follow = Follow} = Part) ->
    {keep_state, Part, starl_dpp_follower:missing(Follow)};
event({Late, _}, _, _Where, _Part) when Late =:= timeout; Late =:= reply ->
    keep_state_and_data;
event({call, From}, {join, Coordinator}, _Where, #part{follow = Follow} = Part) ->
    {Joined, Actions} = starl_dpp_follower:join(Coordinator, Follow),
    {keep_state, Part#part{follow = Joined}, [{reply, From, ok} | Actions]};
event({call, From}, coordinator, _Where, Part) ->
    {keep_state_and_data, [{reply, From, coordinator(Part)}]};
event(cast, {message, Source, dpp_recover, {_, Seq, _} = Recover}, Where, Part) ->
    timed(Source, {Seq, false}, Where, Part, fun(At, #part{follow = F, now = Now} = Next) ->
        recovered(starl_dpp_follower:recover(Source, Recover, Now, F), At, Next)
    end);
event(cast, {message, Source, dpp_prevote, _N}, _Where, #part{follow = Follow, now = Now}) ->
    {keep_state_and_data, starl_dpp_follower:prevote(Source, Now, Follow)};
event(info, {restarted, sap}, asking, Part) ->
    {keep_state, Part, listen() ++ [{{timeout, again}, ?LOOK_US, request}]};
event(info, {restarted, sap}, _Where, _Part) ->
    {keep_state_and_data, listen()};
event(info, {restarted, motion}, Where, Part) ->
    {keep_state, Part, go_on(Where, Part)};
event(info, {restarted, dpp_coordinator}, _Where, #part{follow = Follow} = Part) ->
    {keep_state, Part, starl_dpp_follower:restarted(Follow)};
event(info, {restarted, _}, _Where, _Part) ->
    keep_state_and_data;
event(_, _, _, _) ->
    unknown_event.

%% @private What comes over the radio.
-spec accepts(starl_packet:type(), Body :: term()) -> boolean().
accepts(Type, Body) -> starl_dpp_message:accepts(Type, Body).

listen() ->
    [
        starl_sap:listen(Type, dpp)
     || Type <- [dpp_answer, dpp_recover, dpp_beat, dpp_prevote]
    ].

%% -- asking ---------------------------------------------------------------------------------

request(From, Where, Part) ->
    case coordinator(Part) of
        none ->
            {keep_state_and_data, [{reply, From, {error, no_coordinator}}]};
        _Robot ->
            Halted = starl_dpp_progress:halted(Where, Part#part.track),
            Asking = next(Part#part{from = From, drive = none, track = Halted}),
            {next_state, asking, Asking, [{trace, asks}, patience() | halt_and_look(Asking)]}
    end.

%% The caller has waited before. An answer that came too late for it then is given now.
wait(From, asking, Part) ->
    {keep_state, Part#part{from = From}};
wait(From, {moving, Id, Begin, Path} = Moving, #part{drive = none, track = Track} = Part) ->
    case starl_dpp_progress:last(Track) of
        Begin -> {keep_state_and_data, [{reply, From, {ok, {Id, Begin, Path}}}]};
        _Driven -> request(From, Moving, Part)
    end;
wait(From, Where, Part) ->
    request(From, Where, Part).

patience() -> {{timeout, patience}, ?PATIENCE_US, patience}.

coordinator(#part{follow = Follow}) -> starl_dpp_follower:coordinator(Follow).

term(#part{follow = Follow}) -> starl_dpp_follower:term(Follow).

next(#part{n = N} = Part) -> Part#part{n = N + 1}.

halt_and_look(#part{n = N}) ->
    [{call, motion, stop, {halted, N}}, {{timeout, look}, ?LOOK_US, look}].

look(#part{self = Self, n = N}) -> [starl_location:pose(Self, {pose, N})].

%% The robot stands at a known place.
stands(At, Where, #part{track = Track} = Part) when Where =:= asking; Where =:= standing ->
    {Told, Report} = tell(Where, Part#part{track = starl_dpp_progress:stands(At, Track)}),
    Seen = [{{timeout, look}, cancel} | Report],
    case Where of
        standing ->
            {keep_state, Told, Seen};
        asking ->
            {keep_state, Asked, Actions} = ask(Told),
            {keep_state, Asked, Seen ++ Actions}
    end;
stands(_At, _Where, Part) ->
    {keep_state, Part, [{{timeout, look}, cancel}]}.

%% A robot that does not hear its coordinator does not ask: the answer would hold space that nobody uses. The
%% next beat has it ask.
ask(#part{track = Track, now = Now, follow = Follow} = Part) ->
    Deaf = starl_dpp_follower:deaf(Now, Follow),
    case starl_dpp_progress:at(Track) of
        unknown ->
            {keep_state, Part, halt_and_look(Part)};
        _At when Deaf ->
            {keep_state, Part, []};
        _At ->
            #part{n = N} = Next = next(Part#part{follow = starl_dpp_follower:asked(Now, Follow)}),
            Body = starl_dpp_progress:request(term(Next), id(Next), Now, Track),
            {keep_state, Next, [
                starl_sap:send(coordinator(Next), dpp_request, Body, {sent, N}),
                {{timeout, again}, ?AGAIN_US, request}
            ]}
    end.

id(#part{series = Series, n = N}) -> {Series, N}.

answer(Source, Term, Id, {Answer, News}, Where, #part{follow = Follow, now = Now} = Part) ->
    Due =
        Where =:= asking andalso Id =:= id(Part) andalso
            starl_dpp_follower:answers(Source, Term, Follow),
    case Due of
        true ->
            Heard = Part#part{follow = starl_dpp_follower:heard(Now, Follow)},
            due_answer(Id, Answer, News, Heard);
        false ->
            {keep_state, Part, [{trace, {stale_answer, Source, Term, Id}}]}
    end.

due_answer(Id, {assign, From, Path}, News, Part) ->
    assigned({moving, Id, From, Path}, answered(News, Part));
due_answer(_Id, again, _News, Part) ->
    {keep_state, Part, [{{timeout, again}, ?LOOK_US, request}]};
due_answer(_Id, {above, {Series, N}}, _News, #part{n = Own} = Part) ->
    %% no answer to the request of that number may fit; what is too far above is not reached at once
    Above = Part#part{series = Series, n = starl_term:toward(N, Own) + 1},
    {keep_state, Above, [{{timeout, again}, ?LOOK_US, request}]};
due_answer(_Id, End, News, #part{from = Caller} = Part) ->
    Answered = (answered(News, Part))#part{from = none},
    {next_state, standing, Answered,
        stop_asking() ++ [{trace, {answered, End}}, {reply, Caller, End}]}.

answered(News, #part{track = Track} = Part) ->
    Part#part{track = starl_dpp_progress:answered(News, Track)}.

stop_asking() -> [{{timeout, T}, cancel} || T <- [again, patience]].

%% -- moving ---------------------------------------------------------------------------------

%% An assignment whose lease has ended on the way is void. So is one whose lease cannot be measured,
%% because the own clock stands still.
assigned({moving, Id, From, Path} = Moving, #part{track = Track, from = Caller} = Part) ->
    #part{follow = Follow, now = Now} = Part,
    Broken = starl_dpp_follower:in_no_time(Now, Follow),
    case lease_us(Part) of
        _ when Broken ->
            {keep_state, Part, [{{timeout, again}, ?LOOK_US, request}]};
        Us when Us > 0 ->
            Begun = Part#part{from = none, track = starl_dpp_progress:begins(From, Track)},
            Granted = [
                {{timeout, leave}, Us, leave},
                {trace, {answered, assign}},
                {reply, Caller, {ok, {Id, From, Path}}}
            ],
            {next_state, Moving, Begun, stop_asking() ++ Granted};
        _Ended ->
            ask(Part)
    end.

%% What is left of the lease to drive. (Its timer is called `leave'.)
lease_us(#part{follow = Follow, now = Now}) -> starl_dpp_follower:lease_us(Now, Follow).

%% At the end of its lease the robot stops, and its path is void.
lease_end({moving, Id, _, _} = Moving, #part{track = Track, drive = Drive} = Part) ->
    case lease_us(Part) of
        Us when Us > 0 ->
            {keep_state, Part, [{{timeout, leave}, Us, leave}]};
        _Ended ->
            Void = Part#part{drive = none, track = starl_dpp_progress:halted(Moving, Track)},
            Replies = [{reply, From, {error, void}} || {From, _, _} <- [Drive]],
            {next_state, standing, Void, [starl_motion:stop(), {trace, {void, Id}} | Replies]}
    end;
lease_end(_Where, Part) ->
    {keep_state, Part}.

drive({_, _, N} = Drive, Id, {moving, Id, _, Path} = Moving, Part) when N =< length(Path) ->
    Driving = Part#part{drive = Drive},
    case lease_us(Part) > 0 of
        true -> {keep_state, Driving, go_on(Moving, Driving)};
        false -> lease_end(Moving, Driving)
    end;
drive({From, _, _}, _Id, _Where, _Part) ->
    {keep_state_and_data, [{reply, From, {error, void}}]}.

go_on({moving, Id, _, Path}, #part{drive = {_From, What, N}, track = Track}) ->
    {Point, _} = lists:nth(N, Path),
    Last = starl_dpp_progress:last(Track),
    [{call, motion, towards(What, Last, Point), {driven, What, Id, N}}];
go_on(_Where, _Part) ->
    [].

towards(face, Last, Point) ->
    {face, {Last, Point}};
towards(drive, Last, Point) ->
    {go_along, {Last, Point}};
towards({face, Heading}, {X, Y} = Last, _Point) ->
    Ahead = {X + ?AHEAD_MM * math:cos(Heading), Y + ?AHEAD_MM * math:sin(Heading)},
    {face, {Last, Ahead}}.

driven(ok, {drive, N}, Id, {moving, Id, _, Path}, #part{drive = {From, drive, N}} = Part) ->
    Track = starl_dpp_progress:reached(N, lists:nth(N, Path), Part#part.track),
    {Told, Report} = report(Id, N, Part#part{drive = none, track = Track}),
    {keep_state, Told, Report ++ [{reply, From, ok}]};
driven(
    {error, blocked}, {drive, N}, Id, {moving, Id, _, Path}, #part{drive = {From, drive, N}} = Part
) ->
    {Towards, _} = lists:nth(N, Path),
    Track = starl_dpp_progress:blocked(Towards, Part#part.track),
    {keep_state, Part#part{drive = none, track = Track}, [
        {trace, {blocked, Towards}}, {reply, From, {error, void}}
    ]};
driven(
    ok, {What, N}, Id, {moving, Id, _, _}, #part{drive = {From, What, N}} = Part
) ->
    {keep_state, Part#part{drive = none}, [{reply, From, ok}]};
driven(
    {error, _} = Outcome, {What, N}, Id, {moving, Id, _, _}, #part{drive = {From, What, N}} = Part
) ->
    %% stopped, or out of time
    {keep_state, Part#part{drive = none}, distrust(Outcome) ++ [{reply, From, {error, void}}]};
driven(_Outcome, _What, _Id, _Where, _Part) ->
    keep_state_and_data.

%% The chassis shows that the robot's clock has stood still or was set: the own robot's coordinator
%% machine must not count leases by it.
distrust({error, out_of_time}) -> [{cast, dpp_coordinator, out_of_time}];
distrust(_Outcome) -> [].

%% The paper's Clear: reported now and then. Painted edges are reported with the next request.
report(Id, N, #part{track = Track} = Part) ->
    case starl_dpp_progress:is_report_due(Track) of
        true ->
            Report = starl_sap:post(coordinator(Part), dpp_passed, {term(Part), Id, N}),
            {Part#part{track = starl_dpp_progress:reported(Track)}, [Report]};
        false ->
            {Part, []}
    end.

%% -- the coordinator that it follows --------------------------------------------------------

%% If a coordinator's clock shows that the own one has stood still, all leases have ended.
timed(Source, Shown, Where, #part{follow = Follow, now = Now} = Part, Then) ->
    case starl_dpp_follower:timed(Source, Shown, Now, Follow) of
        {agrees, Timed} -> Then(Where, Part#part{follow = Timed});
        {lags, Ended} -> ended(Where, Part#part{follow = Ended}, Then)
    end.

ended({moving, _, _, _} = Moving, Part, Then) ->
    {next_state, standing, Void, Stop} = lease_end(Moving, Part),
    case Then(standing, Void) of
        {keep_state, Next, Actions} -> {next_state, standing, Next, Stop ++ Actions};
        {next_state, Where, Next, Actions} -> {next_state, Where, Next, Stop ++ Actions}
    end;
ended(Where, Part, Then) ->
    Then(Where, Part).

beat(Source, Beat, Where, #part{follow = Follow, now = Now} = Part) ->
    case starl_dpp_follower:beat(Source, Beat, Now, Follow) of
        {beaten, {Beaten, Actions}} ->
            Missed = starl_dpp_follower:missed(Now, Follow),
            Heard = starl_dpp_follower:returned(Beaten) > starl_dpp_follower:returned(Follow),
            {keep_state, Part#part{follow = Beaten}, Actions ++ awaited(Where, Heard, Missed)};
        Other ->
            recovered(Other, Where, Part)
    end.

%% A robot that asks goes on waiting if the coordinator has heard it since, and asks again if the
%% coordinator was silent for a lease.
awaited(asking, Heard, Missed) ->
    [patience() || Heard] ++ [{{timeout, again}, 1000, request} || Missed];
awaited(_Where, _Heard, _Missed) ->
    [].

recovered({refused, {Follow, Actions}}, _Where, Part) ->
    {keep_state, Part#part{follow = Follow}, Actions};
recovered({followed, {Follow, Actions}}, Where, Part) ->
    case tell_place(Where, Part#part{follow = Follow}) of
        {keep_state, Next, More} -> {keep_state, Next, Actions ++ More};
        {next_state, State, Next, More} -> {next_state, State, Next, Actions ++ More}
    end.

%% A robot that was paused may hear this before the end of its lease is noticed. Its path is void, and
%% its space may be another's.
tell_place({moving, _, _, _} = Moving, Part) ->
    case lease_us(Part) > 0 of
        true ->
            {Told, Report} = tell(Moving, Part),
            {keep_state, Told, Report};
        false ->
            {next_state, standing, Void, Stop} = lease_end(Moving, Part),
            {keep_state, Next, Look} = tell_place(standing, Void),
            {next_state, standing, Next, Stop ++ Look}
    end;
tell_place(standing, #part{track = Track} = Part) ->
    Next = next(Part#part{track = starl_dpp_progress:lost(Track)}),
    {keep_state, Next, halt_and_look(Next)};
tell_place(asking, #part{track = Track} = Part) ->
    case starl_dpp_progress:at(Track) of
        unknown ->
            {keep_state, Part, halt_and_look(Part)};
        _At ->
            {Told, Report} = tell(asking, Part),
            {keep_state, Told, Report ++ [{{timeout, again}, 1000, request}]}
    end.

tell({moving, Id, _, _} = Moving, Part) -> tell(Id, Moving, Part);
tell(Where, Part) -> tell(id(Part), Where, Part).

tell(Id, Where, #part{follow = Follow, track = Track, now = Now} = Part) ->
    Place = {starl_dpp_progress:place(Where, Track), starl_dpp_progress:painted(Track)},
    {Told, Report} = starl_dpp_follower:tell(Id, Place, Now, Follow),
    {Part#part{follow = Told}, Report}.
