%% @doc Checks that a chassis keeps its contract ({@link starl_live_chassis}). It drives the chassis
%% a little, and checks its answers and, if it reports them, its poses. The chassis moves by less
%% than 200 mm, and turns by less than a radian.
%% ```
%%     [{ok, leg, "..."}, {broken, stop, "..."}] =
%%         starl_live_chassis_check:check({starl_live_exec, #{exec => "./my_robot.py"}})
%% '''
%% The driver is opened as on a robot. This module stands between the driver and its process, and
%% reports all outputs.
%%
%% A busy computer breaks no clause. The check measures how late its own timers are, and excuses a
%% delay of that length. The computer may lose more time while the chassis waits for a processor. So
%% if a command was heard late, the check sends more commands to stop; a chassis that is slow itself
%% hears these as late.
-module(starl_live_chassis_check).
-behaviour(starl_live_chassis).

-export([check/1, line/1, broken/1]).
-export([open/1, drive/4, actuate/4, stop/1, hear/2, close/1]).

-export_type([finding/0]).

%% `unknown': it tells no poses, so this cannot be seen.
-type finding() :: {ok | broken | unknown, Clause :: atom(), unicode:chardata()}.

-record(exam, {
    chassis :: pid(),
    clock :: starl_live_clock:t(),
    driver :: starl_live_link:adapter(),
    found = [] :: [finding()]
}).

-define(ROBOT, 1).
-define(SPEED, 100).
-define(LEG_US, 500000).
-define(TURN_US, 500000).
-define(LONG_US, 60000000).
%% A command is heard, and an answer comes, so late at most, but for what the computer loses.
-define(HEARD_US, 50000).
-define(ANSWER_US, 1000000).
-define(WAIT_MS, 3000).
-define(LOOK_MS, 1000).
-define(PART_MS, 200).
%% The time between two looks at how late the computer is, and the number of commands that may be heard late.
-define(TICK_MS, 5).
-define(LATE, 4).
%% What is no motion, and the error of a leg, as a part.
-define(STILL_MM, 0.5).
-define(STILL_RAD, 0.005).
-define(ERROR, 0.1).

%% -- the examination ------------------------------------------------------------------------

%% @doc Returns the findings, clause by clause. If the driver does not open, nothing else is
%% checked.
-spec check(starl_live_link:adapter()) -> [finding(), ...].
check({_Module, _Own} = Driver) ->
    Before = process_flag(trap_exit, true),
    Clock = starl_live_clock:new(erlang:system_time(microsecond), 1),
    Profile = starl_chassis:profile(starl_chassis_differential, #{
        %% what is slower than its order is driven for longer
        speed => 1.0,
        near_speed => 1.0,
        latency_ms => ?HEARD_US div 1000
    }),
    Config = #{
        robot => ?ROBOT, clock => Clock, profile => Profile, checked => Driver, to => self()
    },
    Found =
        case starl_live_chassis:start_link(?MODULE, Config, self()) of
            {ok, Chassis} ->
                Exam = #exam{chassis = Chassis, clock = Clock, driver = Driver},
                examined(found(ok, opens, "it opens", Exam));
            {error, {shutdown, {chassis, Why}}} ->
                [{broken, opens, Why}];
            {error, Reason} ->
                [{broken, opens, io_lib:format("it crashes when it is opened: ~0tP", [Reason, 12])}]
        end,
    _ = process_flag(trap_exit, Before),
    Found.

examined(Exam) ->
    Clauses = [
        fun legs/1,
        fun turns/1,
        fun replaces/1,
        fun stops/1,
        fun is_late/1,
        fun refuses/1,
        fun devices/1
    ],
    Ended = lists:foldl(fun clause/2, Exam, Clauses),
    lists:reverse((ends(closed(Ended)))#exam.found).

%% What has ended is not examined further.
clause(Clause, #exam{chassis = Chassis} = Exam) ->
    receive
        {'EXIT', Chassis, Reason} -> found(broken, ends, ended(Reason), Exam#exam{chassis = self()})
    after 0 ->
        case Chassis =:= self() of
            true -> Exam;
            false -> Clause(flushed(Exam))
        end
    end.

ended({shutdown, {chassis, Why}}) -> ["it has ended meanwhile: ", Why];
ended(Reason) -> io_lib:format("it has crashed meanwhile: ~0tP", [Reason, 12]).

found(How, Clause, Text, #exam{found = Found} = Exam) ->
    Exam#exam{found = [{How, Clause, Text} | Found]}.

flushed(Exam) ->
    receive
        {?MODULE, _, _} -> flushed(Exam)
    after 0 -> Exam
    end.

%% A leg ends by itself when its time is over: the dead man's time.
legs(Exam) ->
    From = place(Exam),
    {Ordered, Answer} = driven([{?SPEED, ?SPEED, ?LEG_US}], leg, Exam),
    Next = timed(leg, Ordered, Answer, ?LEG_US, Exam),
    Mm = ?SPEED * ?LEG_US / 1.0e6,
    moved(leg_way, From, place(Next), {Mm, 0.0}, stands(leg_stands, Next)).

turns(Exam) ->
    From = place(Exam),
    {Ordered, Answer} = driven([{-?SPEED, ?SPEED, ?TURN_US}], turn, Exam),
    Next = timed(turn, Ordered, Answer, ?TURN_US, Exam),
    Axle = 258.0,
    moved(turn_way, From, place(Next), {0.0, 2 * ?SPEED * ?TURN_US / 1.0e6 / Axle}, Next).

timed(Clause, Ordered, {driven, Heard, AtUs, Lost}, Us, Exam) ->
    Took = AtUs - Ordered,
    Lag = heard_after(excused(Heard - Ordered, Lost), ?LATE, Exam),
    Text = io_lib:format("~.1f s were over after ~.3f s; heard after ~.1f ms", [
        Us / 1.0e6, Took / 1.0e6, Lag / 1000
    ]),
    case {Took >= Us - ?HEARD_US, Took =< Us + ?ANSWER_US + Lost, abs(Lag) =< ?HEARD_US} of
        {true, true, true} ->
            found(ok, Clause, Text, Exam);
        {false, _, _} ->
            found(broken, Clause, [Text, ": it answers before the time is over"], Exam);
        {_, false, _} ->
            found(broken, Clause, [Text, ": it answers too late"], Exam);
        {_, _, false} ->
            found(broken, Clause, [Text, ": at most 50 ms"], Exam)
    end;
timed(Clause, _Ordered, Answer, _Us, Exam) ->
    found(broken, Clause, ["no answer \"driven\", but ", answer(Answer)], Exam).

%% After what time it was heard, or another command after it.
heard_after(Lag, Tries, Exam) when abs(Lag) > ?HEARD_US, Tries > 0 ->
    case driven([], {again, Tries}, Exam) of
        {Ordered, {driven, Heard, _, Lost}} ->
            heard_after(excused(Heard - Ordered, Lost), Tries - 1, Exam);
        {_, _NoAnswer} ->
            Lag
    end;
heard_after(Lag, _Tries, _Exam) ->
    Lag.

excused(Lag, Lost) when Lag > ?HEARD_US -> max(?HEARD_US, Lag - Lost);
excused(Lag, _Lost) -> Lag.

answer(none) -> "nothing";
answer(Other) -> io_lib:format("~0tp", [Other]).

%% A pose that it reported by itself may be from before it heard the last command; it has heard it
%% when it is asked again.
stands(Clause, Exam) ->
    Ordered = place(Exam),
    still(Clause, Ordered =/= none andalso place(Exam), Exam).

still(Clause, Unseen, Exam) when Unseen =:= false; Unseen =:= none ->
    found(unknown, Clause, "whether it stands cannot be seen: it tells no poses", Exam);
still(Clause, {X, Y, H}, Exam) ->
    pause(),
    case place(Exam) of
        {X1, Y1, H1} when
            abs(X - X1) < ?STILL_MM, abs(Y - Y1) < ?STILL_MM, abs(H - H1) < ?STILL_RAD
        ->
            found(ok, Clause, "it stands", Exam);
        _ ->
            found(broken, Clause, "it does not stand", Exam)
    end.

moved(Clause, From, To, _Wanted, Exam) when From =:= none; To =:= none ->
    found(unknown, Clause, "its way cannot be seen: it tells no poses", Exam);
moved(Clause, {X0, Y0, H0}, {X1, Y1, H1}, {Mm, Rad}, Exam) ->
    Driven = starl_geometry:distance({X0, Y0}, {X1, Y1}),
    Turn = starl_geometry:angle_diff(H1, H0),
    Text = io_lib:format("~.1f mm and ~.3f rad; ~.1f and ~.3f were told", [Driven, Turn, Mm, Rad]),
    case
        abs(Driven - Mm) =< ?ERROR * Mm + ?STILL_MM andalso abs(Turn - Rad) =< ?ERROR * Rad + 0.02
    of
        true -> found(ok, Clause, Text, Exam);
        false -> found(broken, Clause, Text, Exam)
    end.

%% A new script takes the place of the one before, which is answered no more.
replaces(Exam) ->
    _ = drive([{-?SPEED, -?SPEED, ?LONG_US}], before, Exam),
    pause(),
    {Ordered, Answer} = driven([{-?SPEED, -?SPEED, 100000}], then, Exam),
    stands(replaced_stands, timed(replaces, Ordered, Answer, 100000, Exam)).

stops(#exam{chassis = Chassis} = Exam) ->
    _ = drive([{?SPEED, ?SPEED, ?LONG_US}], stopped, Exam),
    pause(),
    ok = starl_live_chassis:stop(Chassis),
    pause(),
    stands(stops, Exam).

%% A script of a lease that is over is not begun.
is_late(#exam{chassis = Chassis, clock = Clock} = Exam) ->
    Script = {starl_chassis_differential, [{?SPEED, ?SPEED, ?LONG_US}]},
    Late = starl_live_clock:now_us(Clock) - 1,
    Level = logger:get_primary_config(),
    ok = logger:set_primary_config(level, none),
    ok = starl_live_chassis:drive(Chassis, Script, Late, late),
    Found = stands(late, Exam),
    ok = logger:set_primary_config(Level),
    Found.

refuses(#exam{chassis = Chassis} = Exam) ->
    Until = ?LONG_US + starl_live_clock:now_us(Exam#exam.clock),
    Script = {starl_chassis_holonomic, [{100.0, 0.0, ?LONG_US}]},
    ok = starl_live_chassis:drive(Chassis, Script, Until, other),
    case awaited(other, ?PART_MS) of
        {driven, _, _, _} -> found(broken, refuses, "it takes a script of another chassis", Exam);
        _ -> stands(refuses, Exam)
    end.

devices(#exam{chassis = Chassis} = Exam) ->
    ok = starl_live_chassis:actuate(Chassis, no_such_device, on, {mark, device}),
    case awaited(device, ?PART_MS) of
        none -> found(ok, devices, "a device that it has not is not set", Exam);
        _ -> found(broken, devices, "it sets a device that no robot has", Exam)
    end.

%% -- the end --------------------------------------------------------------------------------

closed(#exam{chassis = Chassis} = Exam) when Chassis =/= self() ->
    ok = gen_server:stop(Chassis, normal, 10000),
    Exam;
closed(Exam) ->
    Exam.

%% A program must end with its standard input: nobody is left to stop it.
ends(#exam{driver = {starl_live_exec, #{exec := Command}}} = Exam) ->
    case starl_live_program:start(starl_live_program:words(Command)) of
        {ok, Program} ->
            began(),
            case starl_live_program:stop(Program) of
                ended -> found(ok, input, "it ends with its standard input", Exam);
                killed -> found(broken, input, "it does not end with its standard input", Exam)
            end;
        {error, Why} ->
            found(broken, input, Why, Exam)
    end;
ends(Exam) ->
    Exam.

%% It has said its first line.
began() ->
    receive
        {Port, {data, _}} when is_port(Port) -> ok
    after ?WAIT_MS -> ok
    end.

%% -- asking ---------------------------------------------------------------------------------

driven(Commands, Mark, Exam) ->
    Ordered = drive(Commands, Mark, Exam),
    {Ordered, awaited(Mark, ?WAIT_MS)}.

drive(Commands, Mark, #exam{chassis = Chassis, clock = Clock}) ->
    Ordered = starl_live_clock:now_us(Clock),
    Script = {starl_chassis_differential, Commands},
    ok = starl_live_chassis:drive(Chassis, Script, Ordered + ?LONG_US, Mark),
    Ordered.

%% The answer to a command: when it was heard, when that was reported, and what the computer has lost
%% meanwhile.
awaited(Mark, Ms) -> awaited(Mark, Ms div ?TICK_MS, 0).

awaited(_Mark, 0, _Lost) ->
    none;
awaited(Mark, Ticks, Lost) ->
    Since = erlang:monotonic_time(microsecond),
    Late = fun() -> max(Lost, erlang:monotonic_time(microsecond) - Since - 1000 * ?TICK_MS) end,
    receive
        {?MODULE, Us, {Mark, {driven, Heard}}} -> {driven, Heard, Us, Late()};
        {?MODULE, _, {Mark, Answer}} -> Answer
    after ?TICK_MS -> awaited(Mark, Ticks - 1, Late())
    end.

place(#exam{chassis = Chassis, clock = Clock}) ->
    Asked = starl_live_clock:now_us(Clock),
    Chassis ! {?MODULE, look},
    seen(Asked).

seen(Asked) ->
    receive
        {?MODULE, _, {posed, Us, Pose}} when Us >= Asked -> Pose;
        {?MODULE, _, {posed, _, _}} -> seen(Asked)
    after ?LOOK_MS -> none
    end.

pause() ->
    receive
    after ?PART_MS -> ok
    end.

%% @doc A finding as a line.
-spec line(finding()) -> unicode:chardata().
line({How, Clause, Text}) ->
    io_lib:format("~-8ts~-17ts~ts", [atom_to_list(How), atom_to_list(Clause), Text]).

%% @doc The clauses that are broken.
-spec broken([finding()]) -> [atom()].
broken(Found) -> [Clause || {broken, Clause, _} <- Found].

%% -- between the driver and its process -----------------------------------------------------

-spec open(map()) -> {ok, map()} | {error, unicode:chardata()}.
open(#{checked := {Module, Own}, to := To, clock := Clock} = Config) ->
    Known = maps:merge(maps:without([checked, to], Config), Own),
    case Module:open(Known#{at => {0.0, 0.0, 0.0}}) of
        {ok, State} -> {ok, #{module => Module, state => State, to => To, clock => Clock}};
        {error, _} = Error -> Error
    end.

-spec drive(starl_chassis:script(), integer(), term(), map()) -> {[], map()}.
drive(Script, Until, Mark, #{module := Module, state := State} = Tap) ->
    reported(Module:drive(Script, Until, Mark, State), Tap).

-spec actuate(atom(), term(), {mark, term()} | none, map()) -> {[], map()}.
actuate(Device, Value, Mark, #{module := Module, state := State} = Tap) ->
    reported(Module:actuate(Device, Value, Mark, State), Tap).

-spec stop(map()) -> map().
stop(#{module := Module, state := State} = Tap) -> Tap#{state := Module:stop(State)}.

-spec hear(term(), map()) -> {[], map()} | {stop, unicode:chardata()} | unknown.
hear({?MODULE, look}, #{module := Module, state := State} = Tap) ->
    {[], Tap#{state := starl_callback:call(Module, look, [State], State)}};
hear(Message, #{module := Module, state := State} = Tap) ->
    case Module:hear(Message, State) of
        {Outputs, Next} when is_list(Outputs) -> reported({Outputs, Next}, Tap);
        Other -> Other
    end.

-spec close(map()) -> ok.
close(#{module := Module, state := State}) -> Module:close(State).

reported({Outputs, State}, #{to := To, clock := Clock} = Tap) ->
    Us = starl_live_clock:now_us(Clock),
    _ = [To ! {?MODULE, Us, Output} || Output <- Outputs],
    {[], Tap#{state := State}}.
