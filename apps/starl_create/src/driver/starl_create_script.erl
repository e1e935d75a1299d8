%% @doc Turns the commands of {@link starl_chassis_differential} into bytes and the times between
%% them, for the port to write: speeds in whole mm/s, no command shorter than the line can time.
%%
%% A command keeps its product of speed and time: what rounding takes off the speed, its time gets.
%%
%% <em>By the port.</em> Bytes may be late by the line's jitter, and a command then lasts longer or
%% shorter by that. So no command is faster than 6 mm in that time, and none is shorter than three
%% times that: it is driven slower, and for longer.
%%
%% <em>On the robot.</em> A Create 1 can hold a script, and a robot whose computer is gone should
%% stop. Its script is: wait 100 ms, then stop. Each command is a number of slices: the speeds, then
%% the script. The next slice arrives while the robot waits, which reads it as soon as it has
%% waited; so it drives on, and if nothing arrives it stands. It waits in steps of 15 ms, so a slice
%% takes 105 ms.
-module(starl_create_script).

-export([steps/2, steps/3, lasts_us/1, rest/0, on_robot/0]).

-export_type([step/0, told/0, way/0]).

%% Bytes, the time until the next (us), and the speeds that they are about.
-type step() :: {told(), binary(), Us :: pos_integer()}.
-type told() :: {Left :: number(), Right :: number()}.

%% Who times a command: the port, on a line with this jitter, or a Create 1 itself.
-type way() :: {by_port, JitterUs :: pos_integer()} | on_robot.

-define(FASTEST, 500.0).
%% What a late byte may add to the way of a wheel, mm; the least duration of a command, in jitters.
-define(CARE_MM, 6.0).
-define(LEAST, 3).
%% A slice; how much earlier than needed the next slice leaves.
-define(SLICE_US, 105000).
-define(EARLY_US, 45000).
%% Drive Direct is the same for both generations.
-define(DIRECT, 145).
-define(PLAY, 153).

%% @doc The steps of a script.
-spec steps(starl_chassis_differential:commands(), way()) -> [step()].
steps(Commands, Way) -> steps(Commands, Way, {1.0, 1.0}).

%% @doc The steps for a robot whose true ways and turns are these parts of the commanded ones.
-spec steps(starl_chassis_differential:commands(), way(), starl_create_options:factors()) ->
    [step()].
steps(Commands, {by_port, Jitter}, Factors) ->
    [timed(Command, scaled(Command, Factors), Jitter) || Command <- Commands];
steps(Commands, on_robot, Factors) ->
    early(lists:append([slices(Command, scaled(Command, Factors)) || Command <- Commands])).

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

%% @doc The script that a Create 1 holds.
-spec on_robot() -> binary().
on_robot() ->
    Script = starl_create_command:encode_all([{wait_time, 1}, {drive_direct, 0, 0}], 1),
    starl_create_command:encode({script, Script}, 1).

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

slices({Left0, Right0, _}, {Left, Right, Us}) ->
    N = max(1, ceil(Us / ?SLICE_US)),
    Part = Us / (N * ?SLICE_US),
    Whole = {round(Left * Part), round(Right * Part)},
    lists:duplicate(N, {{Left0, Right0}, <<(direct(Whole))/binary, ?PLAY>>, ?SLICE_US}).

%% The first slice begins now; the others arrive before they are needed.
early([]) ->
    [];
early([One]) ->
    [One];
early([{Told, Bytes, Us} | More]) ->
    {Last, Before} = {lists:last(More), lists:droplast(More)},
    {ToldLast, BytesLast, UsLast} = Last,
    [{Told, Bytes, Us - ?EARLY_US} | Before] ++ [{ToldLast, BytesLast, UsLast + ?EARLY_US}].
