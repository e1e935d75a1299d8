%% A camera's program: its pictures become readings; one that ends, talks nonsense or falls silent.
%%
%% Holds: A camera's program that ends or talks nonsense is started again; it ends with the robot;
%% an old reading is none
%% Red: `exec` before the command cut all but its first program off:
%% `the_program_ends_with_its_pipe`
-module(starl_live_camera_tests).
-include_lib("eunit/include/eunit.hrl").

%% The newest of several pictures counts, and half a picture waits for its rest.
pictures_become_readings_test() ->
    Dir = dir(),
    ok = file:write_file(at("left", Dir), picture(0.3)),
    ok = file:write_file(at("right", Dir), picture(-0.3)),
    Camera = opened(["cat ", at("left", Dir), " ", at("right", Dir), "; exec cat"]),
    {[#{bearing := B, colour := orange}], Next} = until_reading(Camera, fun is_right/1),
    ?assert(abs(B + 0.3) < 0.02, B),
    ok = starl_live_camera:close(Next).

is_right([#{bearing := B}]) -> B < 0;
is_right(_) -> false.

%% A program that ends, or that writes no pictures, is started again.
failures_test_() ->
    {timeout, 60, fun() ->
        [
            starl_platform_ct:quietly(fun() ->
                Failed = until_failed(opened([Command])),
                Again =
                    receive
                        start_again -> starl_live_camera:hear(start_again, Failed)
                    end,
                {nothing, Next} = Again,
                ok = starl_live_camera:close(Next)
            end)
         || Command <- [
                "exit 3",
                "echo JFIF; exec cat",
                "no-such-program-here",
                "printf 'P6 1 1 9 '; exec cat"
            ]
        ]
    end}.

%% The program ends with the camera: its pipe is closed. It tells that by a line in a fifo.
the_program_ends_with_its_pipe_test() ->
    Dir = dir(),
    Fifo = at("fifo", Dir),
    [] = os:cmd("mkfifo " ++ Fifo),
    Camera = opened(["cat >/dev/null; echo over > ", Fifo]),
    ok = starl_live_camera:close(Camera),
    ?assertEqual("over\n", os:cmd("cat " ++ Fifo)).

%% The process: asked before there is a picture, and after it.
asked_test() ->
    Dir = dir(),
    ok = file:write_file(at("one", Dir), picture(0.2)),
    Command = lists:append(["cat ", at("one", Dir), "; exec cat"]),
    Config = (config())#{command => Command, stale_ms => 3600000},
    {ok, Sense} = starl_live_sense:start_link(starl_live_camera, Config, self()),
    [#{bearing := B}] = asked(Sense),
    ?assert(abs(B - 0.2) < 0.02, B),
    ok = gen_server:stop(Sense).

%% Until the first picture there is none.
asked(Sense) ->
    Mark = make_ref(),
    ok = starl_live_sense:ask(Sense, Mark),
    receive
        {starl_felt, Sense, Mark, {ok, Reading}} -> Reading;
        {starl_felt, Sense, Mark, none} -> asked(Sense)
    end.

%% A reading that is older than it may be is none.
stale_test() ->
    Dir = dir(),
    ok = file:write_file(at("one", Dir), picture(0.2)),
    Command = lists:append(["cat ", at("one", Dir), "; exec cat"]),
    Config = (config())#{command => Command, stale_ms => 1},
    {ok, Sense} = starl_live_sense:start_link(starl_live_camera, Config, self()),
    ok = until_none(Sense, false),
    ok = gen_server:stop(Sense).

until_none(Sense, Seen) ->
    ok = starl_live_sense:ask(Sense, mark),
    receive
        {starl_felt, Sense, mark, {ok, _}} -> until_none(Sense, true);
        {starl_felt, Sense, mark, none} when Seen -> ok;
        {starl_felt, Sense, mark, none} -> until_none(Sense, Seen)
    end.

mistakes_are_one_line_test() ->
    Colour = #{orange => #{hue => {5, 40}}},
    [
        begin
            {error, Line} = starl_live_camera:options(Config),
            Text = unicode:characters_to_list(Line),
            ?assertNotEqual(nomatch, string:find(Text, Part), Text)
        end
     || {Config, Part} <- [
            {#{}, "command"},
            {#{command => ""}, "command"},
            {#{command => "x", colours => #{}}, "colours"},
            {#{command => "x", colours => #{red => {1, 2}}}, "red"},
            {#{command => "x", colours => #{red => #{hue => {1, 400}}}}, "red"},
            {#{command => "x", colours => #{red => #{hue => {1, 4}, glow => 3}}}, "red"},
            {#{command => "x", colours => Colour, field => 4.0}, "field"},
            {#{command => "x", colours => Colour, ball_mm => 0}, "ball_mm"},
            {#{command => "x", colours => Colour, most_mm => far}, "most_mm"},
            {#{command => "x", colours => Colour, least_px => 0}, "least_px"}
        ]
    ],
    ?assertMatch(
        {ok, "x", #{ball_mm := 100}}, starl_live_camera:options(#{command => "x", ball_mm => 100})
    ).

%% -- helpers --------------------------------------------------------------------------------

config() -> #{robot => 1, clock => none}.

opened(Command) ->
    {ok, Camera} = starl_live_camera:open((config())#{command => lists:flatten(Command)}),
    Camera.

until_reading(Camera, Is) ->
    receive
        Message ->
            case starl_live_camera:hear(Message, Camera) of
                {reading, Reading, Next} ->
                    case Is(Reading) of
                        true -> {Reading, Next};
                        false -> until_reading(Next, Is)
                    end;
                {nothing, Next} ->
                    until_reading(Next, Is);
                unknown ->
                    until_reading(Camera, Is)
            end
    end.

%% A failed camera has no program: it takes the word to start again.
until_failed(Camera) ->
    receive
        start_again ->
            self() ! start_again,
            Camera;
        Message ->
            case starl_live_camera:hear(Message, Camera) of
                {nothing, Next} -> until_failed(Next);
                unknown -> until_failed(Camera)
            end
    end.

picture(Bearing) ->
    starl_live_picture:ppm(
        starl_live_picture:frame({80, 60}, #{
            field => 1.05,
            ball_mm => 33.5,
            light => 1.0,
            sigma => 4,
            seed => 1,
            ball => {Bearing, 300}
        })
    ).

dir() ->
    Name = "starl_live_camera-" ++ integer_to_list(erlang:unique_integer([positive])),
    Dir = filename:join([filename:absname("_build"), "test", os:getpid(), Name]),
    ok = filelib:ensure_dir(filename:join(Dir, "x")),
    Dir.

at(Name, Dir) -> filename:join(Dir, Name).
