%% @doc A participant of distributed path planning (the paper's Subroutines 2 and 4).
%% ```
%%              request: stop the robot, locate it        answer: a path
%%   standing -----------------------> asking ---------------------------> moving
%%      ^                                |  ^                                 |
%%      |            answer: complete    |  |       request: stop, locate     |
%%      +--------------------------------+  +---------------------------------+
%% '''
%% After a crash it is `unknown': the application may still be driving a path that this machine
%% no longer knows, so it says nothing of its place until the next request has stopped the robot.
%%
%% A request certifies: the robot stands at this point, and will not follow any answer to an
%% earlier request. So the coordinator may give free what the robot held, whatever was lost,
%% doubled or late on the air; and an answer to any other request than the present one is
%% dropped.
%%
%% Calls: `{join, Coordinator}', `coordinator', `request' (see {@link starl_dpp}). Cast:
%% `{passed, RequestId, N, Waypoint}'. Messages to the coordinator: `dpp_request {Id, At,
%% Painted}', `dpp_passed {Id, N}', `dpp_state {Epoch, Id, Where, Painted}'; from it:
%% `dpp_answer {Epoch, Id, Answer}', `dpp_recover Epoch'.
-module(starl_dpp_participant).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-type where() ::
    unknown
    | standing
    | asking
    | {moving, starl_dpp:request_id(), From :: starl_geometry:point(), starl_dpp_plan:path()}.

%% A request without an answer is made again after so long, once its own fate is known; likewise
%% a look at the position.
-define(AGAIN_US, 40000000).
%% After so many requests in a row that did not reach the coordinator it counts as dead.
-define(UNSENT, 3).
-define(LOOK_US, 500000).
%% How far the robot drives before it tells that space behind it is free.
-define(REPORT_MM, 400.0).

-record(part, {
    self :: starl:robot_id(),
    incarnation :: pos_integer(),
    n = 0 :: non_neg_integer(),
    coordinator = none :: starl:robot_id() | none,
    epoch = 0 :: non_neg_integer(),
    from = none :: starl_machine:from() | none,
    %% where the robot last certified to stand
    at = unknown :: starl_geometry:point() | unknown,
    %% how far from its path the robot may stand and still count as on it; what it held when it
    %% was last stopped, and the point of that which it stands at, for the plan
    slack = 0.0 :: float(),
    line = [] :: [starl_geometry:segment()],
    nominal = unknown :: starl_geometry:point() | unknown,
    %% waypoints passed, the last one's place, and how far it was driven since the last report
    passed = 0 :: non_neg_integer(),
    place = {0.0, 0.0} :: starl_geometry:point(),
    unreported_mm = 0.0 :: float(),
    %% all edges painted, and those not yet in a request that was answered
    painted = [] :: [pos_integer()],
    fresh = [] :: [pos_integer()],
    %% how many requests in a row did not reach the coordinator
    unsent = 0 :: non_neg_integer(),
    %% a coordinator that wants to know where the robot is
    wanted = none :: {starl:robot_id(), Epoch :: pos_integer()} | none
}).

-spec init(starl_machine:config()) -> {where(), #part{}, [starl_machine:action()]}.
init(#{robot := Self, incarnation := Incarnation} = Config) ->
    Where =
        case Incarnation of
            1 -> standing;
            _ -> unknown
        end,
    Slack = maps:get(slack, Config, 0.0),
    {Where, #part{self = Self, incarnation = Incarnation, slack = Slack}, listen()}.

-spec handle_event(starl_machine:event_type(), term(), where(), #part{}, starl_machine:meta()) ->
    starl_machine:result().
handle_event(cast, {passed, Id, N, Waypoint}, Where, Part, _Meta) ->
    passed(Id, N, Waypoint, Where, Part);
handle_event({call, From}, request, Where, Part, _Meta) ->
    request(From, Where, Part);
handle_event({reply, {halted, N}}, ok, _Where, #part{n = N} = Part, _Meta) ->
    {keep_state, Part, look(Part)};
handle_event({reply, {pose, N}}, {ok, {X, Y, _}}, Where, #part{n = N} = Part, _Meta) ->
    stands({X, Y}, Where, Part);
handle_event(cast, {message, Source, dpp_answer, {Epoch, Id, Answer}}, Where, Part, _Meta) ->
    answer(Source, Epoch, Id, Answer, Where, Part);
handle_event({timeout, again}, request, asking, Part, _Meta) ->
    ask(Part);
handle_event({timeout, look}, look, _Where, Part, _Meta) ->
    {keep_state, Part, halt_and_look(Part)};
handle_event({reply, {sent, N}}, {error, Why}, asking, #part{n = N} = Part, _Meta) ->
    unsent(Why, Part);
handle_event({reply, {sent, N}}, ok, asking, #part{n = N} = Part, _Meta) ->
    {keep_state, Part#part{unsent = 0}};
handle_event({reply, _}, _, _Where, _Part, _Meta) ->
    keep_state_and_data;
handle_event({call, From}, {join, Coordinator}, _Where, Part, _Meta) ->
    {keep_state, Part#part{coordinator = Coordinator}, [{reply, From, ok}]};
handle_event({call, From}, coordinator, _Where, #part{coordinator = Coordinator}, _Meta) ->
    {keep_state_and_data, [{reply, From, Coordinator}]};
handle_event(cast, {message, Source, dpp_recover, Epoch}, Where, Part, _Meta) ->
    recover(Source, Epoch, Where, Part);
handle_event(info, {restarted, sap}, asking, Part, _Meta) ->
    {keep_state, Part, listen() ++ [{{timeout, again}, ?LOOK_US, request}]};
handle_event(info, {restarted, sap}, _Where, _Part, _Meta) ->
    {keep_state_and_data, listen()};
handle_event(info, {restarted, _}, _Where, _Part, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

listen() -> [starl_sap:listen(dpp_answer, dpp), starl_sap:listen(dpp_recover, dpp)].

%% -- asking ---------------------------------------------------------------------------------

request(From, _Where, #part{coordinator = none}) ->
    {keep_state_and_data, [{reply, From, {error, no_coordinator}}]};
request(From, Where, Part) ->
    Asking = next(Part#part{from = From, at = unknown, line = line(Where, Part)}),
    {next_state, asking, Asking, halt_and_look(Asking)}.

next(#part{n = N} = Part) -> Part#part{n = N + 1}.

halt_and_look(#part{n = N}) ->
    [{call, motion, stop, {halted, N}}, {{timeout, look}, ?LOOK_US, look}].

look(#part{self = Self, n = N}) -> [starl_location:pose(Self, {pose, N})].

%% What the robot holds, as the coordinator sees it.
line({moving, _, _, _} = Moving, Part) ->
    case describe(Moving, Part) of
        {_, {moving, _, From, []}} -> [{From, From}];
        {_, {moving, _, From, Path}} -> segments(From, Path)
    end;
line(_Where, #part{line = Line}) ->
    Line.

segments(_From, []) -> [];
segments(From, [{Point, _} | Path]) -> [{From, Point} | segments(Point, Path)].

%% As in the plan: near what it holds, the robot counts as standing on it.
on_line(At, #part{line = Line, slack = Slack} = Part) ->
    Near = lists:sort([
        {starl_geometry:distance(At, P), P}
     || S <- Line, P <- [starl_geometry:closest_point(At, S)]
    ]),
    Nominal =
        case Near of
            [{Distance, P} | _] when Distance =< Slack -> P;
            _ -> At
        end,
    Part#part{at = At, nominal = Nominal, line = [{Nominal, Nominal}]}.

%% The robot stands at a known place.
stands(At, asking, Part) ->
    #part{nominal = Nominal} = Standing = on_line(At, Part),
    {keep_state, Asked, Actions} = ask(Standing),
    {Told, Report} = tell({standing, Nominal}, Asked),
    {keep_state, Told, [{{timeout, look}, cancel} | Report] ++ Actions};
stands(At, standing, Part) ->
    #part{nominal = Nominal} = Standing = on_line(At, Part),
    {Told, Report} = tell({standing, Nominal}, Standing),
    {keep_state, Told, [{{timeout, look}, cancel} | Report]};
stands(_At, _Where, Part) ->
    {keep_state, Part, [{{timeout, look}, cancel}]}.

ask(#part{at = unknown} = Part) ->
    {keep_state, Part, halt_and_look(Part)};
ask(Part) ->
    #part{n = N, coordinator = Coordinator, at = At, fresh = Fresh} = Next = next(Part),
    Body = {id(Next), At, Fresh},
    {keep_state, Next, [
        starl_sap:send(Coordinator, dpp_request, Body, {sent, N}),
        {{timeout, again}, ?AGAIN_US, request}
    ]}.

%% A coordinator that cannot be reached for long is taken for dead.
unsent(lost, #part{unsent = ?UNSENT, from = From} = Part) ->
    Timer = {{timeout, again}, cancel},
    Given = Part#part{unsent = 0, from = none},
    {next_state, standing, Given, [Timer, {reply, From, {error, no_answer}}]};
unsent(lost, #part{unsent = Unsent} = Part) ->
    {keep_state, Part#part{unsent = Unsent + 1}, [{{timeout, again}, ?LOOK_US, request}]};
unsent(_Why, Part) ->
    {keep_state, Part, [{{timeout, again}, ?LOOK_US, request}]}.

id(#part{incarnation = Incarnation, n = N}) -> {Incarnation, N}.

answer(Source, Epoch, Id, Answer, asking, Part) ->
    #part{coordinator = Coordinator, epoch = Known, from = From, nominal = At} = Part,
    case Source =:= Coordinator andalso Epoch >= Known andalso Id =:= id(Part) of
        true ->
            Got = Part#part{epoch = Epoch, from = none, fresh = []},
            Timer = {{timeout, again}, cancel},
            case Answer of
                {assign, Path} ->
                    Moving = Got#part{passed = 0, place = At, unreported_mm = 0.0},
                    Reply = {reply, From, {ok, {Id, Path}}},
                    {next_state, {moving, Id, At, Path}, Moving, [Timer, Reply]};
                End ->
                    {next_state, standing, Got, [Timer, {reply, From, End}]}
            end;
        false ->
            {keep_state, Part, [{trace, {stale_answer, Source, Epoch, Id}}]}
    end;
answer(Source, Epoch, Id, _Answer, _Where, Part) ->
    {keep_state, Part, [{trace, {stale_answer, Source, Epoch, Id}}]}.

%% -- moving ---------------------------------------------------------------------------------

%% The coordinator is told now and then; what is painted goes with the next request as well.
passed(Id, N, {Point, Pen}, Where, Part0) ->
    Part = painted(Pen, Part0),
    Driven = Part#part.unreported_mm + starl_geometry:distance(Part#part.place, Point),
    Passed = Part#part{passed = N, place = Point, unreported_mm = Driven},
    case {Where, Part#part.coordinator} of
        {{moving, Id, _, _}, Coordinator} when Driven >= ?REPORT_MM ->
            Report = starl_sap:post(Coordinator, dpp_passed, {Id, N}),
            {keep_state, Passed#part{unreported_mm = 0.0}, [Report]};
        {{moving, Id, _, _}, _} ->
            {keep_state, Passed};
        {_, none} ->
            {keep_state, Part};
        {_, Coordinator} ->
            %% this machine crashed meanwhile and does not know the path, but the application does
            {keep_state, Part, [starl_sap:post(Coordinator, dpp_passed, {Id, N})]}
    end.

painted(up, Part) ->
    Part;
painted({down, Edge}, #part{painted = Painted, fresh = Fresh} = Part) ->
    Part#part{painted = lists:umerge([Edge], Painted), fresh = lists:umerge([Edge], Fresh)}.

%% -- a coordinator that starts anew ---------------------------------------------------------

recover(Source, Epoch, _Where, #part{coordinator = Source, epoch = Known} = Part) when
    Epoch < Known
->
    {keep_state, Part};
recover(Source, Epoch, Where, Part) ->
    Known = Part#part{coordinator = Source, epoch = Epoch, wanted = {Source, Epoch}},
    case Where of
        {moving, _, _, _} = Moving ->
            {Told, Report} = tell(Moving, Known),
            {keep_state, Told, Report};
        standing ->
            Next = next(Known),
            {keep_state, Next, halt_and_look(Next)};
        asking ->
            {keep_state, Known, [{{timeout, again}, 1000, request} | where_asked(Known)]};
        unknown ->
            {keep_state, Known}
    end.

%% A robot that asks has been stopped; if its place is known already, it can be told at once.
where_asked(#part{at = unknown} = Part) -> halt_and_look(Part);
where_asked(#part{nominal = At} = Part) -> element(2, tell({standing, At}, Part)).

tell(_Where, #part{wanted = none} = Part) ->
    {Part, []};
tell(Where, #part{wanted = {Coordinator, Epoch}, painted = Painted} = Part) ->
    {Id, Place} = describe(Where, Part),
    Body = {Epoch, Id, Place, Painted},
    {Part#part{wanted = none}, [starl_sap:post(Coordinator, dpp_state, Body)]}.

describe({standing, At}, Part) ->
    {id(Part), {standing, At}};
describe({moving, Id, From, Path}, #part{passed = N, place = Place}) ->
    Here =
        case N of
            0 -> From;
            _ -> Place
        end,
    {Id, {moving, N, Here, lists:nthtail(N, Path)}}.
