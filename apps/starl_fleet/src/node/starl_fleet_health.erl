%% @doc Judges whether a robot is well, by the status of its node: once for `./starl deploy F', its
%% trial of a release, `deploy F status' and `/health'. Pure.
-module(starl_fleet_health).

-export([problems/1, clock_us/0]).

%% A clock that is off by less is no clock to speak of.
-define(CLOCK_US, 1_000_000).

%% @doc What is wrong with the robot, each as the rest of a sentence about it; nothing if it is well.
-spec problems(starl_fleet_node:status()) -> [unicode:chardata()].
problems(#{result := Result, link := Link} = Status) ->
    ["has given up" || Result =:= given_up] ++
        ["does not answer: its link is silent" || Link =:= silent] ++
        reload(maps:get(reload, Status, none)) ++
        own_clock(maps:get(ahead_us, Status, 0)) ++
        lists:append([peer(Peer) || Peer <- maps:get(peers, Status, [])]) ++
        [
            "has a chassis that is not under control"
         || #{chassis := #{control := false}} <- [Status]
        ].

reload(#{failed := Why}) when Why =/= none -> [["has not taken the new code: ", Why]];
reload(_Well) -> [].

own_clock(Us) when abs(Us) >= ?CLOCK_US ->
    ["has a program whose clock is off its computer's, which was set since (restart it)"];
own_clock(_Us) ->
    [].

%% Whom it does not hear, and who is heard with a clock that is off.
peer(#{robot := Robot} = Peer) ->
    case {starl_live_hearing:complaint(Peer), Peer} of
        {none, #{ahead_ms := Ms}} when abs(Ms) >= ?CLOCK_US div 1000 ->
            [
                io_lib:format("hears robot ~b with a clock that is ~.1f s off", [
                    Robot, abs(Ms) / 1000
                ])
            ];
        {none, _} ->
            [];
        {Complaint, _} ->
            [Complaint]
    end.

%% @doc From so much on a clock is wrong, us.
-spec clock_us() -> pos_integer().
clock_us() -> ?CLOCK_US.
