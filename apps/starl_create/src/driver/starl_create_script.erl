%% @doc Converts the commands of {@link starl_chassis_differential} into bytes for the port, and the
%% times between them. Speeds are whole mm/s, and no command is shorter than the line can time.
%%
%% A command keeps its product of speed and time: if rounding lowers the speed, the time grows.
%%
%% <em>By the port.</em> Bytes may be late by the line's jitter, and a command then lasts longer or
%% shorter by that. So a command covers at most 6 mm in that time, and lasts at least three times as
%% long: if necessary, it is driven slower and for longer.
%%
%% <em>On the robot.</em> A Create 1 can store a script, and a robot that has lost its computer
%% should stop. So each command is divided into slices, and each slice is a script of the robot: the
%% speeds, a wait, stop. The next slice arrives while the robot waits. The robot reads it after the
%% wait and drives on; if nothing arrives, it stops. The script itself is sent with the first slice
%% of a command. Every other slice is the single byte that plays the script, so a line that breaks
%% between two bytes never leaves speeds without their stop.
%%
%% The documented wait lasts 100 ms. The robot checks every 15 ms, so a slice takes 105 ms. Some
%% robots are known to end a wait of zero length at the next check, because
%% {@link starl_create_doctor} has measured it. Their slices are three such waits, 45 ms, after one
%% wait that aligns the first slice with a check.
-module(starl_create_script).

-export([steps/2, steps/3, lasts_us/1, rest/0, rested/1]).

-export_type([step/0, told/0, way/0, waits/0]).

%% Bytes, the time until the next (us), and the speeds that they are about.
-type step() :: {told(), binary(), Us :: pos_integer()}.
-type told() :: {Left :: number(), Right :: number()}.

%% Who times a command: the port, on a line with this jitter, or a Create 1 itself, from rest or after
%% a slice of another script, whose next step is due.
-type way() :: {by_port, JitterUs :: pos_integer()} | {on_robot, waits(), rest | slice}.

%% The waits of a Create 1: of 100 ms, or of the 15 ms between its looks.
-type waits() :: long | short.

-define(FASTEST, 500.0).
%% What a late byte may add to the way of a wheel, mm; the least duration of a command, in jitters.
-define(CARE_MM, 6.0).
-define(LEAST, 3).
%% Drive Direct is the same for both generations.
-define(DIRECT, 145).
-define(SCRIPT, 152).
-define(PLAY, 153).
-define(WAIT, 155).

%% @doc The steps of a script.
-spec steps(starl_chassis_differential:commands(), way()) -> [step()].
steps(Commands, Way) -> steps(Commands, Way, {1.0, 1.0}).

%% @doc The steps for a robot whose true ways and turns are these parts of the commanded ones.
-spec steps(starl_chassis_differential:commands(), way(), starl_create_options:factors()) ->
    [step()].
steps(Commands, {by_port, Jitter}, Factors) ->
    [timed(Command, scaled(Command, Factors), Jitter) || Command <- Commands];
steps(Commands, {on_robot, Waits, From}, Factors) ->
    Slice = slice(Waits),
    Slices = lists:append([slices(C, scaled(C, Factors), Slice) || C <- Commands]),
    early(From, Slice, Slices).

scaled({Left, Right, Us}, {Straight, Turn}) ->
    {Ahead, Aside} = {(Left + Right) / 2 / Straight, (Right - Left) / 2 / Turn},
    slowed(Ahead - Aside, Ahead + Aside, Us, ?FASTEST).

%% No faster than this, and as much longer.
slowed(Left, Right, Us, Most) ->
    case max(abs(Left), abs(Right)) / Most of
        Part when Part > 1 -> {Left / Part, Right / Part, Us * Part};
        _ -> {Left, Right, Us}
    end.

%% @doc How long they last.
-spec lasts_us([step()]) -> non_neg_integer().
lasts_us([]) -> 0;
lasts_us([{_, _, Us} | Steps]) when is_integer(Us) -> Us + lasts_us(Steps).

%% @doc The bytes that stop the wheels.
-spec rest() -> binary().
rest() -> direct({0, 0}).

%% What lets the first slice begin, what ends each, how long it takes, and how much earlier than needed
%% the next slice leaves.
slice(long) -> #{begins => <<>>, wait => <<?WAIT, 1>>, us => 105000, early_us => 45000};
slice(short) -> #{begins => <<?WAIT, 0>>, wait => looks(3), us => 45000, early_us => 25000}.

looks(N) -> binary:copy(<<?WAIT, 0>>, N).

direct({Left, Right}) -> <<?DIRECT, Right:16, Left:16>>.

timed({Left0, Right0, _}, {Left1, Right1, Us1}, Jitter) ->
    {Left, Right, Us} = lengthened(slowed(Left1, Right1, Us1, ?CARE_MM * 1.0e6 / Jitter), Jitter),
    {Whole, Exact} = whole(Left, Right),
    {{Left0, Right0}, direct(Whole), max(1, round(Us * Exact))}.

lengthened({Left, Right, Us}, Jitter) ->
    Longer = max(Us, ?LEAST * Jitter),
    {Left * Us / Longer, Right * Us / Longer, Longer}.

%% The speeds in whole mm/s in about the same proportion, and the part by which they are slower.
whole(Left, Right) when Left == 0, Right == 0 ->
    {{0, 0}, 1.0};
whole(Left, Right) ->
    Fast = max(abs(Left), abs(Right)),
    Whole = max(1, round(Fast)),
    Part = Whole / Fast,
    {{round(Left * Part), round(Right * Part)}, 1 / Part}.

slices({Left0, Right0, _}, {Left, Right, Us}, #{us := SliceUs} = Slice) ->
    N = max(1, ceil(Us / SliceUs)),
    Part = Us / (N * SliceUs),
    Told = {Left0, Right0},
    Script = script({round(Left * Part), round(Right * Part)}, Slice),
    [
        {Told, <<Script/binary, ?PLAY>>, SliceUs}
        | lists:duplicate(N - 1, {Told, <<?PLAY>>, SliceUs})
    ].

script(Whole, #{wait := Wait}) ->
    Script = <<(direct(Whole))/binary, Wait/binary, (rest())/binary>>,
    <<?SCRIPT, (byte_size(Script)), Script/binary>>.

%% From rest the first slice begins now, and the others arrive before they are needed. After a slice all
%% do: the robot has not ended that when its next step is due.
early(_From, _Slice, []) ->
    [];
early(rest, #{begins := Begins, early_us := Early}, [{Told, Bytes, Us} | Slices]) ->
    First = <<Begins/binary, Bytes/binary>>,
    case Slices of
        [] -> [{Told, First, Us}];
        _ -> [{Told, First, Us - Early} | longer(Early, Slices)]
    end;
early(slice, #{early_us := Early}, Slices) ->
    longer(Early, Slices).

longer(Early, Slices) ->
    {Told, Bytes, Us} = lists:last(Slices),
    lists:droplast(Slices) ++ [{Told, Bytes, Us + Early}].

%% @doc The step after which a Create 1 has read the command to stop: its last slice is over.
-spec rested(waits()) -> [{binary(), Us :: pos_integer()}].
rested(Waits) ->
    #{early_us := Early} = slice(Waits),
    [{rest(), Early}].
