%% @doc The robots as the world knows them: their bodies, the processes that drive them and take
%% their positions, and which of them are up. A pure module: the messages for other processes are
%% returned.
%%
%% A robot that is halted (its node stands still) may be in the middle of a step. If the step last
%% read the clock before the halt, its facts were true and in time then: they hold at the time that
%% they bear, whenever they arrive. If it read the clock after the halt, they hold from then on.
%% ```
%%     down -- started --> up -- traced ... --> result
%%       ^                  |
%%       +---- ended -------+
%% '''
-module(starl_world_team).

-export([new/2, embodied/4, tracked/3, untracked/2, hardware/2, free/2, watches/3, watching/1]).
-export([heard/5, advance/3, touched/4, on_floor/2, poses/4]).
-export([started/4, halted/4, traced/4, recalled/3, result/3, record/2, down/4, of_link/2]).
-export([ids/1, up/1, links/1, running/1, summaries/2]).

-export_type([t/0, change/0, effect/0, result/0]).

-type id() :: starl:robot_id().
-type result() :: running | given_up | {done, term()}.
-type answer() :: {Mark :: term(), starl_live_chassis:answer()}.

-record(robot, {
    body :: starl_world_vehicle:t(),
    chassis = none :: pid() | none,
    %% does the body go on without the link?
    is_free = false :: boolean(),
    %% does the chassis report where the body is?
    is_tracked = false :: boolean(),
    %% of free hardware: the time of its last report, its body then, and what the body has done since, as
    %% far as is known
    reported_us = 0 :: integer(),
    settled = none :: starl_world_vehicle:t() | none,
    since = [] :: [starl_monitor:trace_event()],
    answered = [] :: [answer()],
    sight = none :: pid() | none,
    link = none :: pid() | none,
    names = [] :: [starl_machine:name()],
    %% the file of its facts, and the last batch that has come
    record = none :: file:filename() | none,
    batch = 0 :: non_neg_integer(),
    %% the times of its halts, latest first
    halts = [] :: [integer()],
    %% when it went on with a step that a halt had cut in two
    went_on = 0 :: integer(),
    is_up = false :: boolean(),
    result = running :: result()
}).

-opaque t() :: #{id() => #robot{}}.

%% `send': a message for a process. `wake': the time at which a robot's body must be advanced. `undo':
%% reported facts that are wrong, because a late report changed what happened.
-type effect() ::
    {send, pid(), term()}
    | {wake, id(), DueUs :: integer()}
    | {undo, [starl_monitor:trace_event(), ...]}.

%% The new facts, the effects to carry out, and the robots.
-type change() :: {[starl_monitor:trace_event()], [effect()], t()}.

%% @doc Robots at these poses in the world of a simulation, all down, and the first facts of their
%% bodies.
-spec new([{id(), starl:pose()}], starl_sim_vehicle:world()) ->
    {[starl_monitor:trace_event()], t()}.
new(Poses, Sim) ->
    Bodies = [{Id, starl_world_vehicle:new(Id, Pose, Sim)} || {Id, Pose} <- Poses],
    Robots = maps:from_list([{Id, #robot{body = Body}} || {Id, {_, Body}} <- Bodies]),
    {lists:append([Traces || {_, {Traces, _}} <- Bodies]), Robots}.

%% @doc All robots, ascending.
-spec ids(t()) -> [id()].
ids(Robots) -> lists:sort(maps:keys(Robots)).

%% -- their processes ------------------------------------------------------------------------

%% @doc This process is a robot's chassis from now on; `IsFree': hardware, which goes on without the
%% robot's link.
-spec embodied(id(), Chassis :: pid(), IsFree :: boolean(), t()) -> {ok, t()} | {error, iolist()}.
embodied(Id, Chassis, IsFree, Robots) ->
    case Robots of
        #{Id := Robot} ->
            {ok, Robots#{Id := Robot#robot{chassis = Chassis, is_free = IsFree}}};
        #{} ->
            {error, io_lib:format("the world has no robot ~b", [Id])}
    end.

%% @doc Makes this process a robot's chassis that reports where its body is. Returns the place of
%% the body until then.
-spec tracked(id(), Chassis :: pid(), t()) -> {ok, starl:pose(), t()} | {error, iolist()}.
tracked(Id, Chassis, Robots) ->
    case embodied(Id, Chassis, true, Robots) of
        {ok, #{Id := #robot{reported_us = Us} = Robot} = Next} ->
            {ok, pose(Us, body(Robot)), Next#{Id := Robot#robot{is_tracked = true}}};
        {error, _} = Error ->
            Error
    end.

%% @doc Handles the end of a process. If it reported where a robot's body is, that body stands where
%% it was last.
-spec untracked(Chassis :: pid(), t()) -> change().
untracked(Chassis, Robots) ->
    case
        [
            R
         || {_, #robot{chassis = C, is_tracked = true}} = R <- maps:to_list(Robots), C =:= Chassis
        ]
    of
        [{Id, #robot{reported_us = At} = Robot}] ->
            Gone = Robot#robot{
                chassis = none,
                is_free = false,
                is_tracked = false,
                settled = none,
                since = [],
                answered = []
            },
            changed(Id, starl_world_vehicle:stop(At, body(Robot)), Gone, Robots);
        [] ->
            {[], [], Robots}
    end.

body(#robot{settled = none, body = Body}) -> Body;
body(#robot{settled = Body}) -> Body.

%% @doc The process of a robot's hardware.
-spec hardware(id(), t()) -> {ok, pid()} | {error, unicode:chardata()}.
hardware(Id, Robots) ->
    case Robots of
        #{Id := #robot{is_free = true, is_tracked = false, chassis = Hardware}} when
            is_pid(Hardware)
        ->
            {ok, Hardware};
        #{} ->
            {error, io_lib:format("robot ~b has no cable: it is no Create", [Id])}
    end.

%% @doc Those of these robots that have hardware, with its process.
-spec free([id()], t()) -> [{id(), Hardware :: pid()}].
free(Ids, Robots) ->
    [
        {Id, Hardware}
     || Id <- Ids, #{Id := #robot{is_free = true, chassis = Hardware}} <- [Robots], is_pid(Hardware)
    ].

%% @doc This process gets a robot's pictures from now on.
-spec watches(id(), Sight :: pid(), t()) -> t().
watches(Id, Sight, Robots) ->
    #{Id := Robot} = Robots,
    Robots#{Id := Robot#robot{sight = Sight}}.

%% @doc The processes that get pictures.
-spec watching(t()) -> [{id(), Sight :: pid()}].
watching(Robots) -> [{Id, S} || {Id, #robot{sight = S}} <- maps:to_list(Robots), is_pid(S)].

%% -- their bodies ---------------------------------------------------------------------------

%% @doc Applies a chassis report: of now, or late, of an earlier time (`{at, Us}'). A late report is applied
%% retroactively, at most as far back as the judge still waits, and not before the previous report. The body
%% moves as if the report had come at once: what it has done since then is undone. Returns the time that
%% counts; `unknown': that chassis is not the robot's any more.
-spec heard(id(), Chassis :: pid(), {now | {at, integer()}, What}, NowUs :: integer(), t()) ->
    {AtUs :: integer(), change()} | unknown
when
    What ::
        {drive, starl_chassis:script(), integer(), term()}
        | {actuate, term(), term()}
        | {moves, starl_trajectory:piece() | same}
        | stop.
heard(Id, Chassis, {Time, What}, Now, Robots) ->
    case Robots of
        #{Id := #robot{chassis = Chassis} = Robot} ->
            heard_at(Time, What, Now, {Id, Robot}, Robots);
        #{} ->
            unknown
    end.

heard_at(now, What, Now, {Id, #robot{body = Body} = Robot}, Robots) ->
    {Now, changed(Id, does(What, Now, Body), Robot, Robots)};
heard_at({at, Then}, What, Now, {Id, Robot}, Robots) ->
    #robot{reported_us = Before, body = Body, since = Since, answered = Answered} = Robot,
    At = lists:max([Before, Now - starl_world_judge:back_us(), min(Now, Then)]),
    Settled =
        case Robot of
            #robot{settled = none} -> Body;
            #robot{settled = Known} -> Known
        end,
    {Traces, Answers, Next} = does(What, At, Settled),
    {New, Effects, Changed} = changed(
        Id,
        {Traces -- Since, Answers -- Answered, Next},
        (settled(Next, Robot))#robot{reported_us = At},
        Robots
    ),
    Undone = [{undo, Events} || [_ | _] = Events <- [Since -- Traces]],
    {At, {New, Undone ++ Effects, Changed}}.

settled(Body, Robot) -> Robot#robot{settled = Body, since = [], answered = []}.

does({drive, Script, Until, Mark}, Now, Body) ->
    case starl_live_chassis:is_late(Script, Until, Now) of
        true -> starl_world_vehicle:advance(Now, Body);
        false -> starl_world_vehicle:drive(Script, Mark, Now, Body)
    end;
does({actuate, What, Mark}, Now, Body) ->
    starl_world_vehicle:actuate(What, Mark, Now, Body);
does({moves, Piece}, _Now, Body) ->
    starl_world_vehicle:moves(Piece, Body);
does(stop, Now, Body) ->
    starl_world_vehicle:stop(Now, Body).

%% @doc Lets everything happen to a robot's body that is due until now.
-spec advance(id(), NowUs :: integer(), t()) -> change().
advance(Id, Now, Robots) ->
    #{Id := #robot{body = Body} = Robot} = Robots,
    Advanced = starl_world_vehicle:advance(Now, Body),
    changed(Id, Advanced, since(Advanced, Robot), Robots).

%% What a body does by itself may be undone.
since(_Advanced, #robot{settled = none} = Robot) ->
    Robot;
since({Traces, Answers, _Body}, #robot{since = Since, answered = Answered} = Robot) ->
    Robot#robot{since = Since ++ Traces, answered = Answered ++ Answers}.

%% @doc Handles a change of what a robot touches: its hardware is notified, and the robot stops if
%% that is in its way.
-spec touched(id(), starl_world_floor:touch(), AtUs :: integer(), t()) -> change().
touched(Id, {_Bits, IsBlocked} = Touch, At, Robots) ->
    #{Id := #robot{chassis = Chassis, body = Body, reported_us = Before} = Robot} = Robots,
    Sends = [{send, Chassis, {starl_body_touches, Touch}} || is_pid(Chassis)],
    case IsBlocked of
        true ->
            Stands = max(At, Before),
            {_, _, Stopped} = Stop = starl_world_vehicle:stop(Stands, Body),
            Felt = (settled(Stopped, Robot))#robot{reported_us = Stands},
            {Traces, Effects, Next} = changed(Id, Stop, Felt, Robots),
            {Traces, Sends ++ Effects, Next};
        false ->
            {[], Sends, Robots}
    end.

changed(Id, {Traces, Answers, Body}, #robot{chassis = Chassis} = Robot, Robots) ->
    Sends = [{send, Chassis, {starl_body_says, Answers}} || Answers =/= [], is_pid(Chassis)],
    Wakes = [{wake, Id, Due} || Due <- [starl_world_vehicle:next_due(Body)], Due =/= none],
    {Traces, Sends ++ Wakes, Robots#{Id => Robot#robot{body = Body}}}.

%% @doc All bodies on the floor.
-spec on_floor(AtUs :: integer(), t()) -> [starl_world_floor:body()].
on_floor(At, Robots) ->
    [
        starl_world_vehicle:on_floor(Id, At, Body)
     || {Id, #robot{body = Body}} <- lists:sort(maps:to_list(Robots))
    ].

%% @doc The true poses of these robots, each with its time: now. Hardware has reported everything up to
%% `AtUs', so its pose is of then, or of its last report.
-spec poses([id()], AtUs :: integer(), NowUs :: integer(), t()) ->
    [{id(), starl:pose(), Us :: integer()}].
poses(Ids, At, Now, Robots) ->
    [pose(Id, At, Now, Robot) || Id <- Ids, #{Id := Robot} <- [Robots]].

pose(Id, At, _Now, #robot{is_free = true, settled = Body, reported_us = Us}) when Body =/= none ->
    Then = max(At, Us),
    {Id, pose(Then, Body), Then};
pose(Id, _At, Now, #robot{body = Body}) ->
    {Id, pose(Now, Body), Now}.

pose(Now, Body) ->
    {_, _, Caught} = starl_world_vehicle:advance(Now, Body),
    starl_world_vehicle:pose(Now, Caught).

%% -- their starts and ends ------------------------------------------------------------------

%% @doc A robot that was down has started, with these machines and this record of facts.
-spec started(id(), Link :: pid(), {[starl_machine:name()], file:filename() | none}, t()) -> t().
started(Id, Link, {Names, File}, Robots) ->
    #{Id := Robot} = Robots,
    Robots#{
        Id := Robot#robot{
            link = Link,
            names = Names,
            record = File,
            batch = 0,
            halts = [],
            went_on = 0,
            is_up = true
        }
    }.

%% @doc A robot stands still. These batches are in its record; some of them have not arrived.
-spec halted(id(), [starl_live_record:batch()], NowUs :: integer(), t()) ->
    {[starl_monitor:trace_event()], t()}.
halted(Id, Batches, Now, Robots) ->
    #{Id := Robot} = Robots,
    {Events, #robot{halts = Halts} = Known} = new_facts(Batches, Robot),
    {Events, Robots#{Id := Known#robot{halts = [Now | Halts]}}}.

%% @doc A batch of facts has come from a robot's link: returns the new facts.
-spec traced(id(), Link :: pid(), starl_live_record:batch(), t()) ->
    {[starl_monitor:trace_event()], t()}.
traced(Id, Link, Batch, Robots) ->
    case Robots of
        #{Id := #robot{link = Link} = Robot} ->
            {Events, Known} = new_facts([Batch], Robot),
            {Events, Robots#{Id := Known}};
        #{} ->
            {[], Robots}
    end.

%% @doc Adds batches from a robot's record, some of which have arrived: returns the new facts.
-spec recalled(id(), [starl_live_record:batch()], t()) -> {[starl_monitor:trace_event()], t()}.
recalled(Id, Batches, Robots) ->
    #{Id := Robot} = Robots,
    {Events, Known} = new_facts(Batches, Robot),
    {Events, Robots#{Id := Known}}.

new_facts(Batches, Robot) -> lists:foldl(fun new_batch/2, {[], Robot}, Batches).

new_batch({N, _, _}, {Events, #robot{batch = Last} = Robot}) when N =< Last ->
    {Events, Robot};
new_batch({N, _, _} = Batch, {Events, #robot{halts = Halts, went_on = Before} = Robot}) ->
    {New, WentOn} = after_halt(Batch, Halts, Before),
    {Events ++ New, Robot#robot{batch = N, went_on = WentOn}}.

%% A halt may cut a step in two. Facts after a look at the clock before the halt hold at their time. If
%% the look came after the halt, they hold when the robot went on: at the latest at the next fact, or at
%% the look. No later fact holds before that.
after_halt({_N, Looked, Events}, Halts, Before) ->
    {Cut, New} =
        case [At || At <- Halts, At < Looked] of
            [] -> {[], Events};
            [At | _] -> lists:splitwith(fun(Event) -> element(1, Event) =< At end, Events)
        end,
    WentOn = went_on(Cut, New, Looked, Before),
    Late = [setelement(1, Event, WentOn) || Event <- Cut],
    {Late ++ [setelement(1, Event, max(WentOn, element(1, Event))) || Event <- New], WentOn}.

went_on([], _New, _Looked, Before) -> Before;
went_on(_Cut, [First | _], _Looked, Before) -> max(element(1, First), Before);
went_on(_Cut, [], Looked, Before) -> max(Looked, Before).

%% @doc The application of a robot has ended.
-spec result(id(), result(), t()) -> t().
result(Id, Result, Robots) ->
    #{Id := Robot} = Robots,
    Robots#{Id := Robot#robot{result = Result}}.

%% @doc Where the facts of a robot are recorded, if it is up and they are, and the last batch that has
%% come.
-spec record(id(), t()) -> [{file:filename(), Batch :: non_neg_integer()}].
record(Id, Robots) ->
    #{Id := #robot{is_up = IsUp, record = File, batch = Batch}} = Robots,
    [{File, Batch} || IsUp, File =/= none].

%% @doc The link of a robot has ended, with these batches as its last: the robot is down. Its body stops,
%% unless hardware drives it.
-spec down(id(), Last :: [starl_live_record:batch()], NowUs :: integer(), t()) -> change().
down(Id, Last, Now, Robots) ->
    case Robots of
        #{Id := #robot{is_up = false}} ->
            {[], [], Robots};
        #{Id := #robot{body = Body, names = Names, is_free = IsFree} = Robot} ->
            {Facts, Known} = new_facts(Last, Robot),
            Left = Known#robot{is_up = false, link = none, halts = []},
            Gone = left(Now, IsFree, Body),
            {Traces, Effects, Next} = changed(Id, Gone, since(Gone, Left), Robots),
            Down = [{Now, Id, robot, down} | [{Now, Id, Name, crashed} || Name <- Names]],
            {Traces ++ Facts ++ Down, Effects, Next}
    end.

left(Now, true, Body) -> starl_world_vehicle:advance(Now, Body);
left(Now, false, Body) -> starl_world_vehicle:stop(Now, Body).

%% @doc The robot of this link.
-spec of_link(Link :: pid(), t()) -> {ok, id()} | none.
of_link(Link, Robots) ->
    case [Id || {Id, #robot{link = L}} <- maps:to_list(Robots), L =:= Link] of
        [Id] -> {ok, Id};
        [] -> none
    end.

%% @doc The robots that are up, ascending.
-spec up(t()) -> [id()].
up(Robots) -> lists:sort([Id || {Id, #robot{is_up = true}} <- maps:to_list(Robots)]).

%% @doc The links of the robots that are up.
-spec links(t()) -> [pid()].
links(Robots) -> [Link || #robot{is_up = true, link = Link} <- maps:values(Robots)].

%% @doc The robots whose applications have not ended.
-spec running(t()) -> [id()].
running(Robots) -> [Id || {Id, #robot{result = running}} <- maps:to_list(Robots)].

%% @doc The result, the true pose and the link of each robot, ascending.
-spec summaries(NowUs :: integer(), t()) ->
    [{id(), #{result := result(), pose := starl:pose(), link := pid() | none}}].
summaries(Now, Robots) ->
    [
        {Id, #{result => Result, pose => pose(Now, Body), link => Link}}
     || {Id, #robot{body = Body, result = Result, link = Link}} <- lists:sort(maps:to_list(Robots))
    ].
