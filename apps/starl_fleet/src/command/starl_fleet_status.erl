%% @doc Formats the status of a real robot as one line.
-module(starl_fleet_status).

-export([line/3, is_well/1, releases/1]).

-define(SHOWN, 200).
-define(LATELY_MS, 60_000).
%% No robot's line is longer, in characters.
-define(LONGEST, 20_000).

%% @doc The line on a robot, from what its computer answered.
-spec line(starl:robot_id(), starl_fleet_file:robot(), Said :: string()) -> unicode:chardata().
line(N, Robot, Said) ->
    case starl_fleet_term:read(Said) of
        {ok, Status} ->
            written(N, Robot, Status, Said);
        _ ->
            other(is_stopped(Said), N, Robot, Said)
    end.

%% @doc Is the robot well, or was it stopped? Who says what we do not know is not.
-spec is_well(Said :: string()) -> boolean().
is_well(Said) ->
    case starl_fleet_term:read(Said) of
        {ok, #{result := _, link := _} = Status} ->
            try starl_fleet_health:problems(Status) of
                Problems -> Problems =:= []
            catch
                error:_ -> false
            end;
        _ ->
            is_stopped(Said)
    end.

is_stopped(Said) -> lists:suffix("\nstopped\n", "\n" ++ Said).

%% @doc One line, if robots run different releases: they do not hear each other.
-spec releases([{starl:robot_id(), Said :: string()}]) -> unicode:chardata() | none.
releases(Answers) ->
    Known = [
        {Release, N}
     || {N, Said} <- Answers, {ok, #{release := Release}} <- [starl_fleet_term:read(Said)]
    ],
    case maps:to_list(maps:groups_from_list(fun({R, _}) -> R end, fun({_, N}) -> N end, Known)) of
        [_, _ | _] = Groups ->
            [
                "the robots run different releases: ",
                lists:join("; ", [release(Group) || Group <- lists:sort(Groups)])
            ];
        _ ->
            none
    end.

release({Release, Robots}) ->
    Which = lists:join(", ", [integer_to_list(N) || N <- Robots]),
    io_lib:format("~ts on robot ~ts", [Release, Which]).

%% What a computer says is data: an answer that cannot be written as a line is none of ours.
written(N, Robot, Status, Said) ->
    try unicode:characters_to_list(known(N, Robot, Status)) of
        Line when is_list(Line), length(Line) =< ?LONGEST -> Line;
        _Other -> unknown(N, Robot, Said)
    catch
        error:_ -> unknown(N, Robot, Said)
    end.

other(true, N, Robot, _Said) ->
    io_lib:format("robot ~b (~ts): stopped\n", [N, starl_fleet_steps:target(Robot)]);
other(false, N, Robot, Said) ->
    unknown(N, Robot, Said).

known(N, Robot, #{release := Release, app := App, started := At, link := Link} = Status) ->
    #{result := Result, crashes := Crashes} = Status,
    Line = "robot ~b (~ts): ~ts ~ts, release ~ts, for ~ts~ts~ts~ts~ts~ts~ts\n",
    Who = starl_fleet_steps:target(Robot),
    io_lib:format(Line, [
        N,
        Who,
        App,
        doing(Result),
        Release,
        since(At),
        silent(Link),
        crashes(Crashes, Status),
        reload(maps:get(reload, Status, none)),
        clock(maps:get(ahead_us, Status, 0)),
        peers(maps:get(peers, Status, [])),
        chassis(maps:get(chassis, Status, #{}))
    ]).

%% Another version of ours, or a computer that says something else.
unknown(N, Robot, Said) ->
    Line = "robot ~b (~ts): its node says nothing that we know: ~0tp\n",
    io_lib:format(Line, [N, starl_fleet_steps:target(Robot), string:slice(Said, 0, ?SHOWN)]).

doing(running) -> "runs";
doing(given_up) -> "has given up";
doing({done, Result}) -> ["is done: ", Result].

%% The latest one, as long as it is not well on this robot.
reload(#{failed := Why}) when Why =/= none -> [", the reload has failed: ", Why];
reload(#{waiting := [_ | _]}) -> ", still in a step, takes the new code after it";
reload(_Well) -> "".

silent(answers) -> "";
silent(silent) -> ", its link does not answer".

%% The VM follows by 1 %: of an hour it goes wrong for four days.
clock(Us) ->
    Line = ", its program's clock is ~.1f s ~ts its computer's, which was set since (restart it)",
    case abs(Us) < starl_fleet_health:clock_us() of
        true -> "";
        false -> io_lib:format(Line, [abs(Us) / 1.0e6, ahead(Us)])
    end.

ahead(Us) when Us > 0 -> "ahead of";
ahead(_Us) -> "behind".

%% Whom it hears, and whom not, and why.
peers([]) ->
    "";
peers(Peers) ->
    Lines = [Line || Peer <- Peers, Line <- [starl_live_hearing:complaint(Peer)], Line =/= none],
    Well = length([P || #{is_silent := false, heard_ms := Ms} = P <- Peers, Ms =/= never]),
    [
        io_lib:format(", hears ~b of ~b others~ts", [Well, length(Peers), trip(Peers)])
        | [[", ", Line] || Line <- Lines ++ off(Peers) ++ refusals(Peers)]
    ].

%% The longest round trip.
trip(Peers) ->
    case [Us || #{round_trip_us := Us, is_silent := false} <- Peers] of
        [] -> "";
        Trips -> io_lib:format(" (round trip ~.1f ms)", [lists:max(Trips) / 1000])
    end.

%% A clock that is off, while the robot is still heard.
off(Peers) ->
    [
        io_lib:format("the clock of robot ~b is ~.1f s ~ts its own", [
            Robot, abs(Ms) / 1000, ahead(Ms)
        ])
     || #{robot := Robot, ahead_ms := Ms, is_silent := false} <- Peers,
        abs(Ms) >= starl_fleet_health:clock_us() div 1000
    ].

%% What was refused of robots lately.
refusals(Peers) ->
    [
        io_lib:format("refused of robot ~b: ~ts", [Robot, lists:join(", ", Counts)])
     || #{robot := Robot, refused := Refused} <- Peers,
        Counts <- [
            [
                io_lib:format("~b ~ts", [Count, Reason])
             || {Reason, #{count := Count, ago_ms := Ago}} <- lists:sort(maps:to_list(Refused)),
                Ago < ?LATELY_MS
            ]
        ],
        Counts =/= []
    ].

%% What of its body needs somebody.
chassis(Condition) ->
    Senses = maps:get(senses, Condition, []),
    Parts =
        ["its chassis is not under control" || #{control := false} <- [Condition]] ++
            [["battery ", integer_to_list(N), " %"] || #{charge := N} <- [Condition], is_integer(N)] ++
            ["low battery: charge it" || {battery, low} <- Senses] ++
            ["on its dock" || {docked, true} <- Senses] ++
            [io_lib:format("bump ~ts", [Where]) || {bump, Where} <- Senses, Where =/= none] ++
            ["a wheel hangs down" || {drop, Bits} <- Senses, Bits =/= 0] ++
            ["at a cliff" || {cliff, [_ | _]} <- Senses] ++
            [
                "its port program has no real-time priority (LimitRTPRIO=1)"
             || #{priority := Priority} <- [Condition],
                Priority =:= raised orelse Priority =:= ordinary
            ],
    [[", ", Part] || Part <- Parts].

crashes(0, _) -> "";
crashes(N, #{crash := Crash}) -> io_lib:format(", ~b crashes, the latest ~ts", [N, Crash]).

%% By both computers' clocks.
since(At) ->
    Seconds = max(0, erlang:system_time(second) - At),
    case {Seconds div 86400, Seconds div 3600 rem 24, Seconds div 60 rem 60, Seconds rem 60} of
        {0, 0, 0, S} -> io_lib:format("~b s", [S]);
        {0, 0, M, S} -> io_lib:format("~b min ~b s", [M, S]);
        {0, H, M, _} -> io_lib:format("~b h ~b min", [H, M]);
        {D, H, _, _} -> io_lib:format("~b d ~b h", [D, H])
    end.
