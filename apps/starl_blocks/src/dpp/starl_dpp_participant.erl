%% @doc A participant of distributed path planning (the paper's Subroutines 2 and 4). It drives the
%% robot, and only while it has leave to.
%% ```
%%              request: stop the robot, locate it        answer: a path
%%   standing -----------------------> asking ---------------------------> moving
%%      ^ ^                              |  ^                                | |
%%      | |          answer: complete    |  |       request: stop, locate    | |
%%      | +------------------------------+  +--------------------------------+ |
%%      +------------------ its leave has ended: the robot is stopped ---------+
%% '''
%% After a crash it stops the robot, so it always knows whether the robot may be on its way. A path
%% is void for ever once its leave has ended, whatever comes later.
%%
%% A request certifies: the robot stands at this point, and will not follow any answer to an
%% earlier request. So the coordinator may give free what the robot held, whatever was lost,
%% doubled or late on the air; and an answer to any other request than the present one is dropped.
%%
%% It follows the coordinator of the highest term it has heard of, and has a vote
%% ({@link starl_dpp_vote}). When it misses its coordinator, its own robot's claims a term.
%%
%% Calls: `{join, Coordinator}', `coordinator', `request', `{drive, Id, N}' (see
%% {@link starl_dpp}). Messages to the coordinator: `dpp_request {Term, Id, At, Painted, Stamp}',
%% `dpp_passed {Term, Id, N}', `dpp_state {Term, Id, Place, Painted, Ballot}', `dpp_here {Term,
%% Ballot}', with Ballot = {Seq, Stamp, Vote}, and `dpp_refused Term'; from it: `dpp_answer {Term,
%% Id, Answer, News}', `dpp_recover {Term, Seq, Leads}', `dpp_beat {Term, Seq, Stamps}'.
-module(starl_dpp_participant).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-type where() :: starl_dpp_track:where().

%% A request without an answer is made again after so long; likewise a look at the position.
-define(AGAIN_US, 40000000).
-define(LOOK_US, 500000).
%% So long after the last word of any coordinator a robot that asks is told that there is none.
-define(PATIENCE_US, 120000000).
%% Beats are answered so often.
-define(HERE_US, 2000000).
%% How far the robot drives before it tells that space behind it is free.
-define(REPORT_MM, 400.0).

-record(part, {
    self :: starl:robot_id(),
    team :: [starl:robot_id()],
    incarnation :: pos_integer(),
    now :: integer(),
    n = 0 :: non_neg_integer(),
    coordinator = none :: starl:robot_id() | none,
    vote :: starl_dpp_vote:t(),
    %% the highest term heard of; the beat of it that wants to know where the robot is
    term = {0, 0} :: starl_dpp:term_id(),
    wanted = none :: starl_dpp_lease:seq() | none,
    %% when the coordinator was last heard, and last answered
    heard = none :: integer() | none,
    here = none :: integer() | none,
    %% the application's request or drive
    from = none :: starl_machine:from() | none,
    drive = none :: {starl_machine:from(), N :: pos_integer()} | none,
    track :: starl_dpp_track:t(),
    %% leave lasts so long from these: the latest of its own stamps that came back in a beat, and
    %% the stamp of the latest request
    short_us :: pos_integer(),
    granted :: integer(),
    asked :: integer()
}).

-spec init(starl_machine:config()) -> {standing, #part{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Life, now := Now} = Config) ->
    Short = starl_dpp_lease:short_us(Config),
    Part = #part{
        self = Self, team = starl_team:members(Team), incarnation = Life, now = Now,
        track = starl_dpp_track:new(maps:get(slack, Config, 0.0)),
        vote = starl_dpp_vote:new(Config),
        short_us = Short, granted = Now - Short, asked = Now - Short
    },
    {standing, Part, listen() ++ [starl_motion:stop() || Life > 1]}.

-spec handle_event(starl_machine:event_type(), term(), where(), #part{}, starl_machine:meta()) ->
    starl_machine:result().
handle_event(Type, Content, Where, Part, #{now := Now}) ->
    event(Type, Content, Where, Part#part{now = Now}).

event(cast, {message, Source, dpp_beat, Beat}, Where, Part) ->
    beat(Source, Beat, Where, Part);
event({call, From}, request, Where, Part) ->
    request(From, Where, Part);
event({call, From}, {drive, Id, N}, Where, Part) ->
    drive(From, Id, N, Where, Part);
event({reply, {driven, Id, N}}, Outcome, Where, Part) ->
    driven(Outcome, Id, N, Where, Part);
event({timeout, leave}, _, Where, Part) ->
    leave(Where, Part);
event({reply, {halted, N}}, ok, _Where, #part{n = N} = Part) ->
    {keep_state, Part, look(Part)};
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
        {{timeout, again}, cancel}, {reply, From, {error, no_answer}}
    ]};
event({timeout, missing}, _, _Where, #part{term = {N, _}} = Part) ->
    {keep_state, Part, [{cast, dpp_coordinator, {lead, N}} | missing(Part)]};
event({timeout, _}, _, _Where, _Part) ->
    keep_state_and_data;
event({reply, _}, _, _Where, _Part) ->
    keep_state_and_data;
event({call, From}, {join, Coordinator}, _Where, #part{term = {0, 0}} = Part) ->
    Joined = Part#part{coordinator = Coordinator},
    {keep_state, Joined, [{reply, From, ok} | missing(Joined)]};
event({call, From}, {join, _Coordinator}, _Where, _Part) ->
    {keep_state_and_data, [{reply, From, ok}]};
event({call, From}, coordinator, _Where, #part{coordinator = Coordinator}) ->
    {keep_state_and_data, [{reply, From, Coordinator}]};
event(cast, {message, Source, dpp_recover, {Term, Seq, Leads}}, Where, Part) ->
    recover(Source, Term, Seq, Leads, Where, Part);
event(info, {restarted, sap}, asking, Part) ->
    {keep_state, Part, listen() ++ [{{timeout, again}, ?LOOK_US, request}]};
event(info, {restarted, sap}, _Where, _Part) ->
    {keep_state_and_data, listen()};
event(info, {restarted, motion}, Where, Part) ->
    {keep_state, Part, go_on(Where, Part)};
event(info, {restarted, dpp_coordinator}, _Where, #part{self = Self, coordinator = Self} = Part) ->
    {N, _} = Part#part.term,
    {keep_state_and_data, [{cast, dpp_coordinator, {lead, N}}]};
event(info, {restarted, _}, _Where, _Part) ->
    keep_state_and_data;
event(_, _, _, _) ->
    unknown_event.

listen() -> [starl_sap:listen(Type, dpp) || Type <- [dpp_answer, dpp_recover, dpp_beat]].

%% -- asking ---------------------------------------------------------------------------------

request(From, _Where, #part{coordinator = none}) ->
    {keep_state_and_data, [{reply, From, {error, no_coordinator}}]};
request(From, Where, Part) ->
    Halted = starl_dpp_track:halted(Where, Part#part.track),
    Asking = next(Part#part{from = From, drive = none, track = Halted}),
    Patience = {{timeout, patience}, ?PATIENCE_US, patience},
    {next_state, asking, Asking, [Patience | halt_and_look(Asking)]}.

next(#part{n = N} = Part) -> Part#part{n = N + 1}.

halt_and_look(#part{n = N}) ->
    [{call, motion, stop, {halted, N}}, {{timeout, look}, ?LOOK_US, look}].

look(#part{self = Self, n = N}) -> [starl_location:pose(Self, {pose, N})].

%% The robot stands at a known place.
stands(At, Where, #part{track = Track} = Part) when Where =:= asking; Where =:= standing ->
    {Told, Report} = tell(Where, Part#part{track = starl_dpp_track:stands(At, Track)}),
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

ask(#part{track = Track, now = Now, coordinator = Coordinator} = Part) ->
    case starl_dpp_track:at(Track) of
        unknown ->
            {keep_state, Part, halt_and_look(Part)};
        At ->
            #part{n = N} = Next = next(Part#part{asked = Now}),
            Body = {Next#part.term, id(Next), At, starl_dpp_track:fresh(Track), Now},
            {keep_state, Next, [
                starl_sap:send(Coordinator, dpp_request, Body, {sent, N}),
                {{timeout, again}, ?AGAIN_US, request}
            ]}
    end.

id(#part{incarnation = Incarnation, n = N}) -> {Incarnation, N}.

answer(Source, Term, Id, {Answer, News}, asking, #part{coordinator = Source, term = Term} = Part) ->
    case {Id =:= id(Part), Answer} of
        {false, _} ->
            {keep_state, Part, [{trace, {stale_answer, Source, Term, Id}}]};
        {true, {assign, From, Path}} ->
            assigned({moving, Id, From, Path}, answered(News, Part));
        {true, End} ->
            #part{from = Caller} = Part,
            Answered = (answered(News, Part))#part{from = none},
            {next_state, standing, Answered, stop_asking() ++ [{reply, Caller, End}]}
    end;
answer(Source, Term, Id, _Answer, _Where, Part) ->
    {keep_state, Part, [{trace, {stale_answer, Source, Term, Id}}]}.

answered(News, #part{track = Track} = Part) ->
    Part#part{track = starl_dpp_track:answered(starl_dpp_track:learn(News, Track))}.

stop_asking() -> [{{timeout, T}, cancel} || T <- [again, patience]].

%% -- moving ---------------------------------------------------------------------------------

%% An assignment whose leave has ended on the way is void.
assigned({moving, Id, From, Path} = Moving, #part{track = Track, from = Caller} = Part) ->
    case leave_us(Part) of
        Us when Us > 0 ->
            Begun = Part#part{from = none, track = starl_dpp_track:begins(From, Track)},
            {next_state, Moving, Begun, stop_asking() ++ [
                {{timeout, leave}, Us, leave}, {reply, Caller, {ok, {Id, Path}}}
            ]};
        _Ended ->
            ask(Part)
    end.

%% How long the robot may still drive.
leave_us(#part{granted = Granted, asked = Asked, short_us = Short, now = Now}) ->
    max(Granted, Asked) + Short - Now.

%% At the end of its leave the robot stops, and its path is void.
leave({moving, Id, _, _} = Moving, #part{track = Track, drive = Drive} = Part) ->
    case leave_us(Part) of
        Us when Us > 0 ->
            {keep_state, Part, [{{timeout, leave}, Us, leave}]};
        _Ended ->
            Void = Part#part{drive = none, track = starl_dpp_track:halted(Moving, Track)},
            Replies = [{reply, From, {error, void}} || {From, _} <- [Drive]],
            {next_state, standing, Void, [starl_motion:stop(), {trace, {void, Id}} | Replies]}
    end;
leave(_Where, Part) ->
    {keep_state, Part}.

drive(From, Id, N, {moving, Id, _, Path} = Moving, Part) when N =< length(Path) ->
    Driving = Part#part{drive = {From, N}},
    {keep_state, Driving, go_on(Moving, Driving)};
drive(From, _Id, _N, _Where, _Part) ->
    {keep_state_and_data, [{reply, From, {error, void}}]}.

go_on({moving, Id, _, Path}, #part{drive = {_From, N}}) ->
    {Point, _} = lists:nth(N, Path),
    [{call, motion, {go_to, Point}, {driven, Id, N}}];
go_on(_Where, _Part) ->
    [].

driven(Outcome, Id, N, {moving, Id, _, Path}, #part{drive = {From, N}} = Part) ->
    case Outcome of
        ok ->
            Track = starl_dpp_track:reached(N, lists:nth(N, Path), Part#part.track),
            {Told, Report} = report(Id, N, Part#part{drive = none, track = Track}),
            {keep_state, Told, Report ++ [{reply, From, ok}]};
        {error, stopped} ->
            {keep_state, Part#part{drive = none}, [{reply, From, {error, void}}]}
    end;
driven(_Outcome, _Id, _N, _Where, _Part) ->
    keep_state_and_data.

%% Clear: the coordinator is told now and then. What is painted goes with the next request.
report(Id, N, #part{track = Track, term = Term, coordinator = Coordinator} = Part) ->
    case starl_dpp_track:unreported_mm(Track) >= ?REPORT_MM of
        true ->
            Report = starl_sap:post(Coordinator, dpp_passed, {Term, Id, N}),
            {Part#part{track = starl_dpp_track:reported(Track)}, [Report]};
        false ->
            {Part, []}
    end.

%% -- whom it follows ------------------------------------------------------------------------

recover(Source, Term, _Seq, _Leads, _Where, #part{term = Known} = Part) when Term < Known ->
    {keep_state, Part, [starl_sap:post(Source, dpp_refused, Known)]};
recover(Source, Term, Seq, Leads, Where, #part{term = Known, vote = Vote, now = Now} = Part) ->
    case Term =:= Known orelse Leads orelse starl_dpp_vote:may(Source, Now, Vote) of
        true -> tell_place(Where, follow(Source, Term, Part#part{wanted = Seq}));
        false -> {keep_state, Part, [starl_sap:post(Source, dpp_refused, Known)]}
    end.

follow(Source, Term, #part{self = Self} = Part) ->
    Following = Part#part{coordinator = Source, term = Term, heard = Part#part.now},
    Led = [{cast, dpp_coordinator, {led, Term}} || Source =/= Self],
    {Following, Led ++ missing(Following)}.

tell_place({moving, _, _, _} = Moving, {Part, Actions}) ->
    {Told, Report} = tell(Moving, Part),
    {keep_state, Told, Actions ++ Report};
tell_place(standing, {Part, Actions}) ->
    Next = next(Part#part{track = starl_dpp_track:lost(Part#part.track)}),
    {keep_state, Next, Actions ++ halt_and_look(Next)};
tell_place(asking, {Part, Actions}) ->
    case starl_dpp_track:at(Part#part.track) of
        unknown ->
            {keep_state, Part, Actions ++ halt_and_look(Part)};
        _At ->
            {Told, Report} = tell(asking, Part),
            {keep_state, Told, Actions ++ Report ++ [{{timeout, again}, 1000, request}]}
    end.

%% The vote goes with it.
tell(_Where, #part{wanted = none} = Part) ->
    {Part, []};
tell(Where, #part{wanted = Seq, term = Term, track = Track} = Part) ->
    {Ballot, Voted} = ballot(Seq, Part),
    Id = case Where of {moving, Of, _, _} -> Of; _ -> id(Part) end,
    Place = starl_dpp_track:place(Where, Track),
    Body = {Term, Id, Place, starl_dpp_track:painted(Track), Ballot},
    {Voted#part{wanted = none}, [starl_sap:post(Part#part.coordinator, dpp_state, Body)]}.

ballot(Seq, #part{vote = Vote0, coordinator = Coordinator, now = Now} = Part) ->
    {Given, Vote} = starl_dpp_vote:give(Coordinator, Now, Vote0),
    {{Seq, Now, Given}, Part#part{vote = Vote, here = Now}}.

%% The own robot claims when nothing is heard of the coordinator.
missing(#part{coordinator = Coordinator, self = Self, team = Team, vote = Vote}) ->
    [{{timeout, missing}, starl_dpp_vote:missing_us(Coordinator, Self, {Team, Vote}), missing}].

%% -- beats ----------------------------------------------------------------------------------

beat(Source, {Term, Seq, _}, Where, #part{term = Known} = Part) when Term =/= Known ->
    recover(Source, Term, Seq, true, Where, Part);
beat(Source, {Term, Seq, Stamps}, Where, #part{self = Self, granted = Granted} = Part0) ->
    Missed = Part0#part.now - Part0#part.heard > Part0#part.short_us,
    {Part, Actions} = follow(Source, Term, Part0#part{
        granted = max(Granted, proplists:get_value(Self, Stamps, Granted))
    }),
    {Answered, Here} = here(Seq, Part),
    Awaited = [{{timeout, patience}, ?PATIENCE_US, patience} || Where =:= asking],
    Again = [{{timeout, again}, 1000, request} || Where =:= asking, Missed],
    {keep_state, Answered, Actions ++ Here ++ Awaited ++ Again}.

%% A robot that has not told its place does so first.
here(Seq, #part{wanted = none, here = Last, now = Now, term = Term} = Part) when
    Last =:= none; Now - Last >= ?HERE_US
->
    {Ballot, Voted} = ballot(Seq, Part),
    {Voted, [starl_sap:post(Part#part.coordinator, dpp_here, {Term, Ballot})]};
here(_Seq, Part) ->
    {Part, []}.
