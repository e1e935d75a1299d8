%% @doc Declares motion as a block. Every robot has the service, and its contract judges every run.
%% So no application lists this block. It is exercised like the others.
-module(starl_motion_block).
-behaviour(starl_block).
-behaviour(starl_block_exercise).

-export([
    options/0,
    machines/1,
    monitors/2,
    everywhere/0,
    guarantees/0,
    propositions/0,
    contract/0,
    exercise/0
]).
-export([work/3, final/3, promise/3, within_ms/1, hindered_by/0]).

%% The exercise takes place on this part of the floor, mm.
-define(FLOOR_MM, 3000).
-define(FASTEST, 600).
%% The longest dead-man's time, and the longest time until the next command, ms.
-define(DEAD_MAN_MS, 1500).
-define(NEXT_MS, 1000).
%% No drive on this floor takes so long, ms.
-define(WITHIN_MS, 3600000).

-spec options() -> [starl_options:option()].
options() -> [].

-spec machines(starl_block:options()) -> [].
machines(_Options) -> [].

-spec monitors(starl_block:options(), starl_block:context()) -> [].
monitors(_Options, _Context) -> [].

-spec everywhere() -> [module()].
everywhere() -> [starl_motion_monitor].

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {line, safety,
            "a robot that drives along a line stays within r(v) of it: L·(ε + δ) + 3s + 3.5 mm, for a "
            "last leg of length L, heading errors up to ε, distance errors up to δ, positions known to "
            "within s (11 mm at 500 mm/s with the default errors; a holonomic robot: 12 mm)", [
                positions, grip
            ]},
        {ends, safety, "it begins and ends a given line within 2 mm along it", [positions, grip]},
        {stops, safety,
            "it stops by itself at the end of its leg, or of the dead-man's time of its velocity, even "
            "if its program crashes", []},
        {arrives, progress, "arrives", [
            positions, grip, devices, ways, prompt, clock_rate, no_restart
        ]}
    ].

-spec propositions() -> [starl_guarantee:proposition()].
propositions() ->
    [
        {"Assumption II.1", line, [off_line]},
        {"Assumption II.1, progress", arrives, [not_arrived]}
    ].

-spec contract() -> string().
contract() ->
    "a robot stays within r(v) of its line and arrives, or stands when its time is up; judged in every run".

-spec exercise() -> module().
exercise() -> ?MODULE.

%% -- the exercise --------------------------------------------------------------------------

%% The exercise of motion: drives to points, along lines, and with velocities that are given anew
%% before their time is up, or are not, or are ended by another command.
%%
%% The promise: a drive ends as it should, with `ok'; a drive that has not obeyed may refuse one velocity
%% more. How long a drive takes is judged by the contract of motion, in every run.

-spec work(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
work(Robot, _Turn, _Use) ->
    case starl_block_exercise:pick(Robot, 4) of
        1 -> go_to(Robot);
        2 -> go_along(Robot);
        3 -> stop_after(velocity(Robot), Robot);
        4 -> [velocity(Robot) || _ <- lists:seq(1, starl_block_exercise:pick(Robot, 4))]
    end.

-spec final(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
final(Robot, _N, _Use) ->
    _ = velocity(Robot),
    go_to(Robot).

go_to(Robot) ->
    Point = point(Robot),
    call(Robot, go_to, fun() -> starl:go_to(Robot, Point) end).

%% A robot that does not know where it stands does not know a line that begins there.
go_along(Robot) ->
    case starl:position(Robot) of
        {ok, {X, Y, _}} ->
            Line = {{X, Y}, point(Robot)},
            _ = call(Robot, face, fun() -> motion(Robot, {face, Line}) end),
            call(Robot, go_along, fun() -> motion(Robot, {go_along, Line}) end);
        {error, _} = Unknown ->
            Unknown
    end.

motion(Robot, Command) ->
    case starl:call(Robot, motion, Command, infinity) of
        {ok, Answer} -> Answer;
        {error, _} = Error -> Error
    end.

velocity(Robot) ->
    [VX, VY] = [?FASTEST * (2 * starl:random(Robot) - 1) || _ <- [x, y]],
    Ms = starl_block_exercise:pick(Robot, ?DEAD_MAN_MS),
    Outcome = call(Robot, velocity, fun() -> starl:velocity(Robot, {VX, VY}, Ms) end),
    ok = starl:sleep(Robot, starl_block_exercise:pick(Robot, ?NEXT_MS)),
    Outcome.

stop_after(_Outcome, Robot) -> call(Robot, stop, fun() -> starl:stop(Robot) end).

call(Robot, What, Call) -> starl_block_exercise:call(Robot, What, Call).

point(Robot) ->
    {?FLOOR_MM * starl:random(Robot), ?FLOOR_MM * starl:random(Robot)}.

-spec within_ms(starl_block_exercise:use()) -> pos_integer().
within_ms(_Use) -> ?WITHIN_MS.

%% It needs no radio. A robot whose drive does not obey tries again as long as that lasts.
-spec hindered_by() -> [starl_monitor:fault_class()].
hindered_by() -> [clock, process, store, location, actuation, serial, sense, floor].

-spec promise(starl_promise:call(), starl_promise:team(), Seen :: term()) -> starl_promise:t().
promise(#{what := velocity}, _Team, _Seen) ->
    {never, fun(Outcome) -> Outcome =:= ok orelse Outcome =:= {error, stalled} end};
promise(_Call, _Team, _Seen) ->
    {never, fun starl_promise:is_ok/1}.
