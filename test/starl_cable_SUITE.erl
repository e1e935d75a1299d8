%% The cable between a robot and its computer is pulled and put back, again and again, while a team of
%% Creates paints: driver, port program, pty, emulator, world. The picture is complete and no contract
%% is broken. A Create 1 drives by scripts of its own, and is unplugged at any time; a Create 2 would
%% drive on, and is unplugged when it stands.
-module(starl_cable_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1, pulled_while_painting/1]).

-define(PULLS, 10).
%% The latest moment of a pull after the robot has come under control; the time without a cable, in
%% which a robot that drove on would leave its path.
-define(SPAN_MS, 1400).
-define(OFF_MS, 500).

suite() -> [{timetrap, {minutes, 5}}].

all() -> [pulled_while_painting].

init_per_suite(Config) ->
    case starl_create_program:path() of
        {ok, _} -> Config;
        {error, Reason} -> {skip, lists:flatten(starl_create_program:format_error(Reason))}
    end.

end_per_suite(_Config) -> ok.

pulled_while_painting(Config) ->
    Dir = proplists:get_value(priv_dir, Config),
    Seed = starl_platform_ct:seed(),
    Picture = filename:join(Dir, "lines.svg"),
    ok = file:write_file(Picture, picture()),
    Scenario = #{
        app => starl_painting,
        robots => 2,
        picture => Picture,
        world => {4000.0, 4000.0},
        chassis => [create_1, create],
        seed => Seed
    },
    {ok, Run} = starl_world_run:start(Scenario, #{dir => Dir, chassis => lines(Dir)}),
    Self = self(),
    Waiter = spawn_link(fun() -> Self ! {ending, starl_world_run:await(Run)} end),
    Left = pulls(Run, #{1 => ?PULLS, 2 => ?PULLS}, #{}, rand:seed_s(exsss, Seed)),
    true = unlink(Waiter),
    {#{violations := Violations}, #{complete := Complete}} = starl_world_run:finish(Run),
    Lines = [lists:flatten(starl_violation:format(V)) || V <- Violations],
    ?assertEqual({[], true}, {Lines, Complete}),
    ?assertEqual(#{1 => 0, 2 => 0}, Left).

%% The lines of a run with Creates, whose events come here.
lines(Dir) ->
    Self = self(),
    Lines = starl_create:emulated([create_1, create], starl_create_on_pty:in(Dir)),
    fun(Robot, World) ->
        {Chassis, Options} = Lines(Robot, World),
        {Chassis, Options#{events => Self}}
    end.

%% A robot that has come under control is unplugged at a moment soon after; one that has lost control
%% is plugged in again. On a busy computer a robot may lose control by itself: then it is not unplugged,
%% since nothing would say when to plug it in again.
pulls(Run, Left, Controlled, Random) ->
    receive
        {ending, Ending} ->
            ?assertEqual(done, Ending),
            Left;
        {starl_create, Robot, ready} ->
            {Ms, Next} = rand:uniform_s(?SPAN_MS, Random),
            _ = erlang:send_after(Ms, self(), {pull, Robot}),
            pulls(Run, Left, Controlled#{Robot => true}, Next);
        {pull, Robot} when is_map_key(Robot, Controlled), map_get(Robot, Left) > 0 ->
            Pull = {serial_gone, Robot, #{in_time => true}, lasting},
            ok = starl_world_run:inject(Run, [Pull]),
            pulls(Run, maps:update_with(Robot, fun(N) -> N - 1 end, Left), Controlled, Random);
        {pull, _Robot} ->
            pulls(Run, Left, Controlled, Random);
        {starl_create, Robot, lost} ->
            _ = erlang:send_after(?OFF_MS, self(), {put_back, Robot}),
            pulls(Run, Left, maps:remove(Robot, Controlled), Random);
        {put_back, Robot} ->
            ok = starl_world_run:heal(Run, {serial_gone, Robot}),
            pulls(Run, Left, Controlled, Random);
        {starl_create, _Robot, _Event} ->
            pulls(Run, Left, Controlled, Random)
    end.

picture() ->
    [
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 100 100'>",
        [
            io_lib:format("<path stroke='red' d='M 20 ~b L 80 ~b'/>", [Y, Y])
         || Y <- [30, 70]
        ],
        "</svg>"
    ].
