%% @doc A driver for a chassis that is a program in any language; see `doc/chassis.md' for its
%% messages. Its configuration beside that of every chassis: `exec', the program with its arguments;
%% `at', where the robot stands, if that is known.
%% ```
%%             hello                drive                  done
%%     starts -------> stands ----------------> drives ----------> stands
%%                       ^                        |
%%                       +---- time is over, stop +
%% '''
%% A program ends the chassis if it ends, sends nothing for a second, or sends nonsense. With the
%% chassis ends the robot's link. The robot starts anew as after a reboot, with the program. Its
%% supervisor bounds how often.
-module(starl_live_exec).
-behaviour(starl_live_chassis).

-export([open/1, drive/4, actuate/4, stop/1, hear/2, close/1, look/1, rest/1]).

-record(exec, {
    name :: string(),
    robot :: starl:robot_id(),
    clock :: starl_live_clock:t(),
    axle_mm :: number(),
    program :: starl_live_program:t(),
    limits = none :: starl_live_program_message:limits() | none,
    %% where it stood when the program began, and the first pose that this said
    at :: starl:pose() | none,
    first = none :: starl:pose() | none,
    offset = starl_live_clock_offset:new() :: starl_live_clock_offset:t(),
    next = 1 :: pos_integer(),
    pings = 1 :: pos_integer(),
    %% commands without an answer
    open = #{} :: #{pos_integer() => command()},
    beat :: reference(),
    %% what it has said with its hello
    waiting = [] :: [starl_live_program:line()],
    %% beats since it has said anything
    silent = 0 :: non_neg_integer(),
    %% lines that were nothing, in this second
    nonsense = {0, 0} :: {Second :: integer(), non_neg_integer()},
    %% devices that it does not have, as the log knows
    lacks = [] :: [atom()]
}).

-type command() ::
    {drive, Mark :: term(), starl_chassis_differential:commands(), HeardUs :: integer() | none}
    | {set, {mark, Mark :: term()} | none, Device :: atom(), Value :: term()}.

-type outputs() :: [starl_live_chassis:output()].

%% A program may have to load much before it says hello.
-define(HELLO_MS, 10000).
-define(BEAT_MS, 250).
-define(SILENT_BEATS, 4).
-define(NONSENSE_A_SECOND, 10).
-define(SHOWN, 80).
%% The window of the clocks' offset. A program whose clock is off by so much has set it.
-define(OFFSET_US, 10000000).
-define(SET_US, 2000000).

%% -- opening --------------------------------------------------------------------------------

-spec open(map()) -> {ok, #exec{}} | {error, unicode:chardata()}.
open(#{exec := Command, robot := Robot, clock := Clock, profile := Profile} = Config) ->
    Words = starl_live_program:words(Command),
    case {kind(Profile), Words =/= [] andalso starl_live_program:start(Words)} of
        {{ok, Axle}, {ok, Program}} ->
            greeted(Profile, #exec{
                name = filename:basename(hd(Words)),
                robot = Robot,
                clock = Clock,
                axle_mm = Axle,
                program = Program,
                at = maps:get(at, Config, none),
                beat = make_ref()
            });
        {{ok, _}, {error, _} = Error} ->
            Error;
        {{ok, _}, false} ->
            {error, "exec: names no program; write exec:./my_robot.py"};
        {{error, _} = Error, Started} ->
            _ = [starl_live_program:stop(Program) || {ok, Program} <- [Started]],
            Error
    end.

kind(#{chassis := starl_chassis_differential, axle_mm := Axle}) -> {ok, Axle};
kind(#{chassis := Other}) -> {error, io_lib:format("a program has two wheels, not ~ts", [Other])}.

greeted(Profile, #exec{robot = Robot, at = At, program = Program} = Exec) ->
    Where = maps:from_list([{at, At} || At =/= none]),
    _ = say({hello, Where#{robot => Robot}}, Exec),
    _ = erlang:send_after(?HELLO_MS, self(), {?MODULE, Exec#exec.beat, no_hello}),
    case hello(Exec) of
        {ok, #exec{limits = Limits} = Greeted} ->
            case fits(Limits, Profile) of
                ok -> {ok, begun(Greeted)};
                {error, Why} -> refused(Why, Exec)
            end;
        {error, Why} ->
            _ = starl_live_program:stop(Program),
            {error, Why}
    end.

refused(Why, #exec{name = Name, program = Program}) ->
    _ = starl_live_program:stop(Program),
    {error, [Name, ": ", Why]}.

%% Nothing else of this process is handled meanwhile.
hello(#exec{beat = Ref} = Exec) ->
    receive
        {?MODULE, Ref, no_hello} ->
            {error, [Exec#exec.name, io_lib:format(": no hello within ~b s", [?HELLO_MS div 1000])]};
        {Port, _} = Message when is_port(Port) ->
            said_hello(Message, Exec);
        {'EXIT', Port, _} = Message when is_port(Port) ->
            said_hello(Message, Exec)
    end.

said_hello(Message, #exec{name = Name, program = Program} = Exec) ->
    case starl_live_program:hear(Message, Program) of
        unknown ->
            hello(Exec);
        {ended, Why} ->
            {error, [Name, ": ", Why, " before its hello"]};
        {[], Next} ->
            hello(Exec#exec{program = Next});
        {[long | _], _} ->
            {error, [Name, ": its first line is no hello, but a very long one"]};
        {[{line, Line} | Lines], Next} ->
            first_line(Line, Exec#exec{program = Next, waiting = Lines})
    end.

first_line(Line, #exec{name = Name} = Exec) ->
    case starl_live_program_message:decode(Line) of
        {ok, {hello, Limits}} ->
            {ok, Exec#exec{limits = Limits}};
        {ok, _} ->
            {error, [Name, ": its first line is no hello, but: ", shown(Line)]};
        {error, Why} ->
            {error, [Name, ": ", Why, ": ", shown(Line)]}
    end.

fits(#{vmax := Most}, #{speed := Speed}) when Speed > Most ->
    {error,
        io_lib:format("drives at most ~w mm/s, and the robot is to drive ~w; say --speed ~b", [
            Most, Speed, floor(Most)
        ])};
fits(_Limits, _Profile) ->
    ok.

begun(#exec{beat = Ref} = Exec) ->
    self() ! {?MODULE, Ref, beat},
    Exec.

beat(#exec{beat = Ref} = Exec) ->
    _ = erlang:send_after(?BEAT_MS, self(), {?MODULE, Ref, beat}),
    Exec.

%% -- commands -------------------------------------------------------------------------------

%% The robot waits for the answer to one script at most.
-spec drive(starl_chassis:script(), integer(), term(), #exec{}) -> {outputs(), #exec{}}.
drive({starl_chassis_differential, Commands}, _Until, Mark, #exec{next = Id} = Exec) ->
    #exec{open = Open, axle_mm = Axle, limits = Limits} = Exec,
    Legs = [leg(Command, Axle, Limits) || Command <- Commands],
    Others = maps:filter(fun(_, Command) -> element(1, Command) =/= drive end, Open),
    _ = say({drive, Id, Legs}, Exec),
    {[], Exec#exec{next = Id + 1, open = Others#{Id => {drive, Mark, Commands, none}}}};
drive({_Other, Commands}, _Until, Mark, Exec) ->
    {[{Mark, {not_understood, Commands}}], Exec}.

%% What is too fast for it takes longer.
leg({Left, Right, Us}, Axle, #{vmax := VMost, wmax := WMost}) ->
    {V, W} = {(Left + Right) / 2, (Right - Left) / Axle},
    Part = lists:max([1.0, abs(V) / VMost, abs(W) / WMost]),
    {V / Part, W / Part, Us * Part / 1000}.

-spec actuate(atom(), term(), {mark, term()} | none, #exec{}) -> {outputs(), #exec{}}.
actuate(Device, Value, Mark, #exec{next = Id, open = Open, limits = #{devices := Has}} = Exec) ->
    Name = atom_to_binary(Device),
    case {lists:member(Name, Has), starl_live_program_message:value(Value)} of
        {true, {ok, Given}} ->
            _ = say({set, Id, Name, Given}, Exec),
            {[], Exec#exec{next = Id + 1, open = Open#{Id => {set, Mark, Device, Value}}}};
        {_, _} ->
            {[], lacks(Device, Exec)}
    end.

lacks(Device, #exec{lacks = Known} = Exec) ->
    case lists:member(Device, Known) of
        true ->
            Exec;
        false ->
            Line = io_lib:format("~ts has no ~ts in its hello", [Exec#exec.name, Device]),
            logger:warning(#{what => no_device, why => unicode:characters_to_binary(Line)}),
            Exec#exec{lacks = [Device | Known]}
    end.

-spec stop(#exec{}) -> #exec{}.
stop(Exec) ->
    _ = say(stop, Exec),
    Exec#exec{open = #{}}.

%% @doc The program is asked for its pose.
-spec look(#exec{}) -> #exec{}.
look(Exec) -> ping(Exec).

-spec rest(#exec{}) -> #exec{}.
rest(Exec) ->
    _ = say(rest, Exec),
    Exec.

-spec close(#exec{}) -> ok.
close(#exec{program = Program}) ->
    _ = starl_live_program:stop(Program),
    ok.

ping(#exec{pings = N} = Exec) ->
    _ = say({ping, N}, Exec),
    Exec#exec{pings = N + 1}.

%% A program whose pipe is full does not read.
say(Command, #exec{program = Program, beat = Ref}) ->
    case starl_live_program:send(starl_live_program_message:encode(Command), Program) of
        ok -> ok;
        hung -> self() ! {?MODULE, Ref, hung}
    end.

%% -- what the program says ------------------------------------------------------------------

-spec hear(term(), #exec{}) -> {outputs(), #exec{}} | {stop, unicode:chardata()} | unknown.
hear({?MODULE, Ref, beat}, #exec{beat = Ref, silent = Beats} = Exec) when Beats < ?SILENT_BEATS ->
    waited([], ping(beat(Exec#exec{silent = Beats + 1})));
hear({?MODULE, Ref, beat}, #exec{beat = Ref} = Exec) ->
    Ms = ?SILENT_BEATS * ?BEAT_MS,
    broken(io_lib:format("has said nothing for ~b ms: it hangs", [Ms]), Exec);
hear({?MODULE, Ref, hung}, #exec{beat = Ref} = Exec) ->
    broken("does not read its commands: it hangs", Exec);
hear({?MODULE, _, _}, Exec) ->
    {[], Exec};
hear(Message, #exec{program = Program} = Exec) ->
    case starl_live_program:hear(Message, Program) of
        unknown -> unknown;
        {ended, Why} -> ends(Why, Exec);
        {Lines, Next} -> waited(Lines, Exec#exec{program = Next})
    end.

waited(Lines, #exec{waiting = Before} = Exec) ->
    lines(Before ++ Lines, [], Exec#exec{waiting = []}).

ends(Why, #exec{name = Name}) -> {stop, [Name, " ", Why]}.

%% It will not stop by a command.
broken(Why, #exec{program = Program} = Exec) ->
    ok = starl_live_program:kill(Program),
    ends(Why, Exec).

lines([], Outputs, Exec) ->
    {lists:append(lists:reverse(Outputs)), Exec};
lines([Line | Lines], Outputs, Exec) ->
    case line(Line, Exec) of
        {stop, _} = Stop -> Stop;
        {Said, Next} -> lines(Lines, [Said | Outputs], Next)
    end.

line(long, Exec) ->
    nonsense("a very long line", <<>>, Exec);
line({line, Line}, Exec) ->
    case starl_live_program_message:decode(Line) of
        {ok, Message} -> message(Message, Exec#exec{silent = 0});
        {error, Why} -> nonsense(Why, Line, Exec)
    end.

%% A stray line is logged; many of them are no robot.
nonsense(Why, Line, #exec{name = Name, nonsense = {Second, N}} = Exec) ->
    Said = ["says nonsense: ", Why, [[": ", shown(Line)] || Line =/= <<>>]],
    case erlang:monotonic_time(second) of
        Second when N >= ?NONSENSE_A_SECOND ->
            broken(Said, Exec);
        Second ->
            {[], Exec#exec{nonsense = {Second, N + 1}}};
        Now ->
            logger:warning(#{
                what => nonsense, why => unicode:characters_to_binary([Name, $\s, Said])
            }),
            {[], Exec#exec{nonsense = {Now, 1}}}
    end.

shown(Line) ->
    Text = [printable(C) || <<C>> <= binary:part(Line, 0, min(?SHOWN, byte_size(Line)))],
    case byte_size(Line) > ?SHOWN of
        true -> [Text, "..."];
        false -> Text
    end.

printable(C) when C >= $\s, C < 127 -> C;
printable(_) -> $?.

message({pose, Pose, At}, #exec{} = Exec) ->
    {Us, Timed} = said(At, Exec),
    posed(Us, Pose, Timed);
message({ack, Id, At}, Exec) ->
    {Us, Timed} = said(At, Exec),
    {[], begun(Id, Us, Timed)};
message({sense, Sense}, Exec) ->
    {[{sensed, Sense}], Exec};
message({log, Text}, Exec) ->
    ok = log(Text, Exec),
    {[], Exec};
message({What, Id, More}, #exec{open = Open} = Exec) when
    What =:= done; What =:= stalled; What =:= refuse
->
    case maps:take(Id, Open) of
        {Command, Left} -> answered(What, More, Command, Exec#exec{open = Left});
        %% of a command that another has replaced
        error -> {[], Exec}
    end;
message({hello, _}, Exec) ->
    nonsense("a second hello", <<>>, Exec);
message(_PongOrUnknown, Exec) ->
    {[], Exec}.

begun(Id, Us, #exec{open = Open} = Exec) ->
    case Open of
        #{Id := {drive, Mark, Commands, none}} ->
            Exec#exec{open = Open#{Id := {drive, Mark, Commands, Us}}};
        #{} ->
            Exec
    end.

%% When the program said this, by the robot's clock. A message without a time was said when it came.
said(none, #exec{clock = Clock} = Exec) ->
    {starl_live_clock:now_us(Clock), Exec};
said(At, #exec{clock = Clock, offset = Before} = Exec) ->
    {Their, Now} = {round(At), starl_live_clock:now_us(Clock)},
    Known =
        case starl_live_clock_offset:is_off(Their, Now, ?SET_US, Before) of
            true -> starl_live_clock_offset:new();
            false -> Before
        end,
    Offset = starl_live_clock_offset:add(Their, Now, ?OFFSET_US, Known),
    {starl_live_clock_offset:ours(Their, Now, Offset), Exec#exec{offset = Offset}}.

log(Text, #exec{name = Name}) ->
    Shown = unicode:characters_to_binary([Name, ": ", shown(Text)]),
    logger:notice(#{what => program_says, why => Shown}).

answered(done, At, {drive, Mark, _, none}, Exec) ->
    {Us, Timed} = said(At, Exec),
    {[{Mark, {driven, Us}}], Timed};
answered(done, _At, {drive, Mark, _, Heard}, Exec) ->
    {[{Mark, {driven, Heard}}], Exec};
answered(done, _At, {set, {mark, Mark}, Device, Value}, Exec) ->
    {[{Mark, {actuated, Device, Value}}], Exec};
answered(stalled, _At, {drive, Mark, Commands, _}, Exec) ->
    {[{Mark, {stalled, starl_chassis_differential:last(Commands)}}], Exec};
answered(refuse, Why, {What, _, _, _} = Command, #exec{name = Name} = Exec) ->
    Line = io_lib:format("~ts refuses to ~ts: ~ts", [Name, What, shown(Why)]),
    logger:warning(#{what => refused, why => unicode:characters_to_binary(Line)}),
    refused_command(Command, Exec);
answered(_Answer, _More, _Command, Exec) ->
    {[], Exec}.

refused_command({drive, _, _, _} = Drive, Exec) -> answered(stalled, none, Drive, Exec);
refused_command(_Set, Exec) -> {[], Exec}.

%% -- where it is ----------------------------------------------------------------------------

posed(Us, Pose, #exec{limits = #{frame := floor}} = Exec) ->
    {[{posed, Us, Pose}], Exec};
posed(_Us, _Pose, #exec{at = none} = Exec) ->
    {[], Exec};
posed(Us, Pose, #exec{first = none} = Exec) ->
    posed(Us, Pose, Exec#exec{first = Pose});
posed(Us, Pose, #exec{at = At, first = First} = Exec) ->
    {[{posed, Us, moved(Pose, First, At)}], Exec}.

%% A pose, as seen from where its robot began, from another beginning.
moved({X, Y, Heading}, {X0, Y0, H0}, {X1, Y1, H1}) ->
    {DX, DY} = {X - X0, Y - Y0},
    {Cos, Sin} = {math:cos(H1 - H0), math:sin(H1 - H0)},
    {X1 + DX * Cos - DY * Sin, Y1 + DX * Sin + DY * Cos, H1 + Heading - H0}.
