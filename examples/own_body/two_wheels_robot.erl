%% The robot of two_wheels.erl, emulated: it hears wheel speeds by UDP, and answers with its pose, and how long it drives.
-module(two_wheels_robot).

-export([start/1]).

-define(AXLE_MM, 258).

%% Starts one at a pose; it ends with who started it. Gives its port.
start(At) ->
    Owner = self(),
    Robot = spawn(fun() ->
        _ = monitor(process, Owner),
        {ok, Socket} = gen_udp:open(0, [binary, {ip, {127, 0, 0, 1}}, {active, true}]),
        {ok, Port} = inet:port(Socket),
        Owner ! {self(), Port},
        roll(Socket, At, {0, 0, now_us(), now_us()})
    end),
    receive
        {Robot, Port} -> Port
    end.

%% It moves with these wheel speeds from one time to another, and then stands.
roll(Socket, Pose, {Left, Right, From, Until} = Moves) ->
    receive
        {udp, Socket, Ip, Port, Text} ->
            Now = now_us(),
            Here = moved(Pose, Left, Right, max(0, min(Now, Until) - From)),
            Values = tuple_to_list(Here) ++ [max(0, Until - Now) / 1000],
            ok = gen_udp:send(Socket, Ip, Port, io_lib:format("~.6f ~.6f ~.9f ~.3f", Values)),
            case string:lexemes(Text, " ") of
                [] ->
                    roll(Socket, Here, {Left, Right, min(Now, Until), Until});
                Words ->
                    [L, R, Ms] = [number(Word) || Word <- Words],
                    roll(Socket, Here, {L, R, Now, Now + round(1000 * Ms)})
            end;
        {'DOWN', _, process, _, _} ->
            Moves
    end.

number(Word) ->
    case string:to_float(Word) of
        {error, no_float} -> binary_to_integer(Word);
        {Number, _} -> Number
    end.

moved({X, Y, Heading}, Left, Right, Us) ->
    Piece = starl_trajectory:piece(
        0, {X, Y}, Heading, (Left + Right) / 2, (Right - Left) / ?AXLE_MM
    ),
    starl_trajectory:pose(Us, Piece).

now_us() -> erlang:monotonic_time(microsecond).
