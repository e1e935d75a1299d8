%% @doc Reads recordings for the trace debugger. For each robot it collects the states and places by
%% the robot's own clock, and the packets, which bound the differences of the clocks.
%%
%% One file of a run may hold all robots. The robots' own files hold one robot each, and a robot may
%% have several. If these are given, the world's file is left out, because its clock is no robot's
%% clock.
-module(starl_debug_recording).

-export([read/2, known/2, format_error/1]).

-export_type([t/0, reason/0, packet/0, limits/0]).

%% `how': `exact', as the simulator knew it, or `told' by the robots; `begun': the time that is
%% shown as 0; `extent': from the first to the last time of any robot; `too_fast': samples that a
%% robot cannot have reached;
%% `left_out': files that were not needed.
-type t() :: #{
    how := exact | told,
    app := module(),
    monitors := [{module(), map()}],
    robots := [starl:robot_id(), ...],
    begun := integer(),
    extent := starl_debug_set:interval(),
    states := #{starl:robot_id() => starl_debug_state:t()},
    tracks := #{starl:robot_id() => starl_debug_track:t()},
    packets := [packet()],
    tokens := [starl_debug_parser:name()],
    elections := [starl_debug_parser:name()],
    geocasts := [starl_debug_state:cast()],
    vocabulary := starl_debug_names:vocabulary(),
    missing := [starl:robot_id()],
    too_fast := [{starl:robot_id(), pos_integer()}],
    holes := [starl_debug_hole:t()],
    left_out := [file:filename_all()]
}.

%% A packet by the sender's and the receiver's clock; or one end of it, with its number.
-type packet() ::
    {packet, From :: starl:robot_id(), To :: starl:robot_id(), SentUs :: integer(),
        CameUs :: integer()}
    | {
        sent | came,
        From :: starl:robot_id(),
        To :: starl:robot_id(),
        Hash :: integer(),
        AtUs :: integer()
    }.

%% `speed' (mm/s) and `error' (mm) of places, in the place of those of the run; `pose_age': how old
%% a pose is at most when a robot tells it (ms); `until': nothing is
%% read behind that time (us from the beginning of the recording).
-type limits() :: #{
    speed => number(), error => number(), pose_age => number(), until => integer()
}.

-type reason() ::
    starl_trace_reader:reason()
    | {no_scenario, file:filename_all()}
    | {empty, file:filename_all()}
    | {other_run, file:filename_all(), file:filename_all(), Key :: atom()}
    | {two_worlds, file:filename_all(), file:filename_all()}
    | {twice, file:filename_all()}
    | {overlap, file:filename_all(), file:filename_all(), starl:robot_id()}.

-record(file, {
    name :: file:filename_all(),
    facts = none :: none | starl_trace_message:scenario(),
    %% by robot and machine, the latest first
    events = #{} :: #{starl:robot_id() => #{starl_machine:name() => [{integer(), term()}]}},
    seen = #{} :: #{starl:robot_id() => [{integer(), starl_geometry:point()}]},
    packets = [] :: [packet()],
    first = none :: none | integer(),
    last = none :: none | integer(),
    until = infinity :: integer() | infinity,
    %% what is missing in it, the latest first
    gaps = [] :: [starl_debug_hole:gap()],
    is_cut = false :: boolean()
}).

-define(SAME, [app, kind, scenario, epoch_us, run]).
-define(SPEED, 500).
-define(ERROR_MM, 1.0).
-define(POSE_AGE_MS, 100).
-define(MARGIN_MM, 4.0).
%% The events of these machines count; of others only the last is asked for.
-define(NO_MACHINES, [sap, radio, supervisor]).

%% @doc Reads recordings of one run.
-spec read([file:filename_all(), ...], limits()) -> {ok, t()} | {error, reason()}.
read(Names, Limits) ->
    try
        _ = [throw({?MODULE, {twice, Name}}) || Name <- Names -- lists:usort(Names)],
        Files = [file(Name, Limits) || Name <- Names],
        ok = of_one_run(Files),
        {ok, recording(Files, Limits)}
    catch
        throw:{?MODULE, Reason} -> {error, Reason}
    end.

file(Name, Limits) ->
    case starl_trace_reader:start(Name) of
        {ok, Cursor} ->
            try
                all(Cursor, #file{name = Name}, Limits)
            after
                starl_trace_reader:stop(Cursor)
            end;
        {error, Reason} ->
            throw({?MODULE, Reason})
    end.

all(Cursor, #file{until = Until, last = Last} = File, _Limits) when
    is_integer(Last), Last > Until
->
    _ = Cursor,
    File;
all(Cursor, File, Limits) ->
    case starl_trace_reader:next(Cursor) of
        {ok, Messages, Next} ->
            all(
                Next,
                lists:foldl(fun(M, F) -> message(M, timed(M, F), Limits) end, File, Messages),
                Limits
            );
        {ended, _} when File#file.facts =:= none ->
            throw({?MODULE, {no_scenario, File#file.name}});
        {ended, closed} ->
            File;
        {ended, _} ->
            File#file{is_cut = true};
        {error, Reason} ->
            throw({?MODULE, Reason})
    end.

timed({_, At, _}, #file{first = First, last = Last} = File) ->
    %% an atom is larger than any number
    File#file{first = min(First, At), last = later(Last, At)}.

later(none, At) -> At;
later(Last, At) -> max(Last, At).

message({scenario, _, Facts}, #file{facts = none} = File, Limits) ->
    begun(File, Facts, Limits);
message(_Message, #file{facts = none, name = Name}, _Limits) ->
    throw({?MODULE, {no_scenario, Name}});
message({trace, At, {Robot, Machine, Event}}, File, _Limits) ->
    traced(lists:member(Machine, ?NO_MACHINES), {Robot, Machine}, {At, Event}, File);
message({poses, At, #{robots := Poses}}, #file{seen = Seen, facts = Facts} = File, _Limits) ->
    case is_told(Facts) of
        true -> File#file{seen = lists:foldl(fun(P, S) -> seen(At, P, S) end, Seen, Poses)};
        false -> File
    end;
message({packets, At, {From, To, _, _, {arrives, Copies}}}, #file{facts = Facts} = File, _) when
    not is_map_key(told_by, Facts)
->
    Came = lists:min([T || {T, _} <- Copies]),
    File#file{packets = [{packet, From, To, At, Came} | File#file.packets]};
message({ways, At, {Robot, {sent, To, _, _, Hash}}}, #file{packets = Packets} = File, _Limits) ->
    File#file{packets = [{sent, Robot, To, Hash, At} | Packets]};
message({ways, At, {Robot, {came, From, _, _, Hash, _}}}, #file{packets = Packets} = File, _Limits) ->
    File#file{packets = [{came, From, Robot, Hash, At} | Packets]};
message({gap, At, Why}, #file{gaps = Gaps} = File, _Limits) ->
    File#file{gaps = [{At, Why} | Gaps]};
message(_Other, File, _Limits) ->
    File.

traced(true, _NoMachine, _Event, File) ->
    File;
traced(false, {Robot, Machine}, Event, #file{events = Events} = File) ->
    Own = maps:get(Robot, Events, #{}),
    Before = maps:get(Machine, Own, []),
    File#file{events = Events#{Robot => Own#{Machine => [Event | Before]}}}.

begun(#file{first = First} = File, Facts, Limits) ->
    Begun = maps:get(begun_us, Facts, First),
    case Limits of
        #{until := Until} -> File#file{facts = Facts, first = Begun, until = Begun + Until};
        #{} -> File#file{facts = Facts, first = Begun}
    end.

seen(At, {Robot, {X, Y, _}, _, _}, Seen) ->
    Seen#{Robot => [{At, {X, Y}} | maps:get(Robot, Seen, [])]};
seen(_At, _Unknown, Seen) ->
    Seen.

is_told(Facts) -> is_map_key(told_by, Facts) andalso not maps:get(has_motions, Facts, false).

of_one_run([#file{name = First, facts = Facts} | Others] = Files) ->
    _ = [
        throw({?MODULE, {other_run, First, Name, Key}})
     || #file{name = Name, facts = Other} <- Others,
        Key <- ?SAME,
        maps:get(Key, Facts, none) =/= maps:get(Key, Other, none)
    ],
    case [Name || #file{facts = F, name = Name} <- Files, not is_map_key(told_by, F)] of
        [A, B | _] ->
            throw({?MODULE, {two_worlds, A, B}});
        _ ->
            _ = [
                apart(Before, File)
             || {N, File} <- lists:enumerate(Files), Before <- lists:sublist(Files, N - 1)
            ],
            ok
    end.

%% Two files that tell of one robot follow each other. By their numbers they do, also if its clock
%% was set back.
apart(#file{facts = #{told_by := Of1} = Facts1} = A, #file{facts = #{told_by := Of2} = Facts2} = B) ->
    {N1, _} = starl_trace_robot:order(A#file.name, Facts1),
    {N2, _} = starl_trace_robot:order(B#file.name, Facts2),
    IsNumbered = N1 > 0 andalso N2 > 0 andalso N1 =/= N2,
    case [R || R <- Of1, lists:member(R, Of2)] of
        [R | _] when not IsNumbered, A#file.first < B#file.last, B#file.first < A#file.last ->
            throw({?MODULE, {overlap, A#file.name, B#file.name, R}});
        _ ->
            ok
    end;
apart(_OneOfThem, _IsTheWorld) ->
    ok.

%% -- the whole ------------------------------------------------------------------------------

recording(All, Limits) ->
    {Own, Worlds} = lists:partition(fun(#file{facts = F}) -> is_map_key(told_by, F) end, All),
    {Files, LeftOut} = chosen(Own, Worlds),
    [#file{facts = Facts} | _] = Files,
    How = how(Files),
    Robots = robots(Files),
    Extents = maps:from_list([{R, extent(R, Files)} || R <- Robots]),
    Tracks = tracks(Extents, Files, Limits),
    Monitors = maps:get(monitors, Facts, []),
    (known(states(Extents, How, Files), Monitors))#{
        how => How,
        app => maps:get(app, Facts),
        monitors => Monitors,
        vocabulary => vocabulary(Monitors, Files),
        robots => Robots,
        begun => lists:min([First || #file{first = First} <- Files]),
        extent => common(maps:values(Extents), Files),
        tracks => maps:from_list([{R, Track} || {R, {Track, _}} <- Tracks]),
        packets => packets(Files),
        missing => [R || {R, _} <- maps:get(robots, Facts)] -- Robots,
        too_fast => [{R, N} || {R, {_, N}} <- Tracks, N > 0],
        holes => holes(Files),
        left_out => LeftOut
    }.

%% What robots have, and what they have traced.
vocabulary(Monitors, Files) ->
    Machines = lists:append([
        maps:keys(maps:get(machines, Facts, #{}))
     || #file{facts = Facts} <- Files
    ]),
    Events = [Own || #file{events = Robots} <- Files, Own <- maps:values(Robots)],
    Traced = lists:foldl(
        fun(Own, Acc) ->
            maps:merge_with(fun(_, A, B) -> A ++ B end, Acc, maps:map(fun tags/2, Own))
        end,
        #{},
        Events
    ),
    starl_debug_names:vocabulary(Monitors, [robot | Machines] -- ?NO_MACHINES, Traced).

tags(_Machine, Events) ->
    lists:usort([Tag || {_, E} <- Events, Tag <- [tag(E)], is_atom(Tag)]).

tag(Event) when tuple_size(Event) > 0 -> element(1, Event);
tag(Event) -> Event.

states(Extents, How, Files) ->
    maps:map(
        fun(R, Extent) -> starl_debug_state:new(R, events(R, Files), Extent, How) end, Extents
    ).

%% @doc What the states of robots say of the team, for {@link starl_debug_ground}.
-spec known(#{starl:robot_id() => starl_debug_state:t()}, [{module(), map()}]) -> map().
known(States, Monitors) ->
    Own = lists:sort(maps:to_list(States)),
    Margin = margin(proplists:get_value(starl_geocast_monitor, Monitors, #{})),
    #{
        states => States,
        tokens => lists:usort([T || {_, S} <- Own, T <- starl_debug_state:tokens(S)]),
        elections => lists:usort([E || {_, S} <- Own, E <- starl_debug_state:elections(S)]),
        geocasts => [C || {R, S} <- Own, C <- starl_debug_state:geocasts(R, S, Margin)]
    }.

%% As the run's monitor has it: the debugger does not rest on the blocks.
margin(Config) -> maps:get(margin_mm, Config, ?MARGIN_MM).

tracks(Extents, Files, Limits) ->
    [
        {R, Track}
     || {R, Extent} <- lists:sort(maps:to_list(Extents)),
        Track <- [track(R, Files, Extent, Limits)],
        Track =/= none
    ].

%% Behind a gap the earliest packet with a number need not be the first of its kind; nor if two
%% lives of a robot have sent the same.
packets(Files) ->
    Sent = lists:append([
        lists:usort([{A, B, Hash} || {sent, A, B, Hash, _} <- Packets])
     || #file{packets = Packets} <- Files
    ]),
    Twice = sets:from_list(Sent -- lists:usort(Sent), [{version, 2}]),
    [
        Packet
     || #file{packets = Packets, gaps = Gaps} <- Files,
        Packet <- Packets,
        is_first(Packet, Gaps =/= [], Twice)
    ].

is_first({sent, A, B, Hash, _}, HasGap, Twice) ->
    not HasGap andalso not sets:is_element({A, B, Hash}, Twice);
is_first(_Packet, _HasGap, _Twice) ->
    true.

holes(Files) ->
    starl_debug_hole:all([
        #{
            file => Name,
            facts => Facts,
            first => First,
            last => Last,
            gaps => lists:reverse(Gaps),
            is_cut => IsCut
        }
     || #file{name = Name, facts = Facts, first = First, last = Last, gaps = Gaps, is_cut = IsCut} <-
            Files
    ]).

chosen([], Worlds) -> {Worlds, []};
chosen(Own, Worlds) -> {Own, [Name || #file{name = Name} <- Worlds]}.

how(Files) ->
    case [x || #file{facts = Facts} <- Files, is_map_key(told_by, Facts)] of
        [] -> exact;
        _ -> told
    end.

robots(Files) ->
    lists:usort(
        lists:append([
            maps:get(told_by, F, [R || {R, _} <- maps:get(robots, F)])
         || #file{facts = F} <- Files
        ])
    ).

of_robot(R, Files) ->
    [F || #file{facts = Facts} = F <- Files, lists:member(R, maps:get(told_by, Facts, [R]))].

extent(R, Files) ->
    Own = of_robot(R, Files),
    {lists:min([A || #file{first = A} <- Own]), lists:max([B || #file{last = B} <- Own])}.

%% From the first word of any robot to the last of any; they must have some time in common.
common(Extents, Files) ->
    {Begins, Ends} = lists:unzip(Extents),
    case lists:max(Begins) =< lists:min(Ends) of
        true -> {lists:min(Begins), lists:max(Ends)};
        false -> throw({?MODULE, {empty, (hd(Files))#file.name}})
    end.

%% A robot with several files: in the order of their beginnings.
events(R, Files) ->
    Own = lists:sort([
        {A, maps:get(R, E, #{})}
     || #file{first = A, events = E} <- of_robot(R, Files)
    ]),
    lists:foldl(
        fun({_, Events}, Acc) ->
            maps:fold(
                fun(M, E, A) -> A#{M => maps:get(M, A, []) ++ lists:reverse(E)} end, Acc, Events
            )
        end,
        #{},
        Own
    ).

track(R, Files, {_, End}, Limits) ->
    Pieces = [P || {_, {motion, P}} <- maps:get(chassis, events(R, Files), [])],
    Samples = lists:sort(
        lists:append([maps:get(R, Seen, []) || #file{seen = Seen} <- of_robot(R, Files)])
    ),
    case {Pieces, Samples} of
        {[], []} -> none;
        {[], _} -> starl_debug_track:samples(Samples, limits(Files, Limits));
        {_, _} -> {starl_debug_track:motions(Pieces, End), 0}
    end.

%% A pose that was old when it was told is off by what the robot has driven since.
limits([#file{facts = Facts} | _], Limits) ->
    Scenario = maps:get(scenario, Facts, #{}),
    Speed = maps:get(speed, Limits, maps:get(speed, Scenario, ?SPEED)),
    Error = maps:get(error, Limits, maps:get(position_error, Scenario, ?ERROR_MM)),
    #{speed => Speed, error => Error + Speed * maps:get(pose_age, Limits, ?POSE_AGE_MS) / 1000}.

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({no_scenario, File}) ->
    io_lib:format("~ts: the recording does not begin with its scenario", [File]);
format_error({empty, File}) ->
    io_lib:format("~ts: the robots of this recording have no time in common", [File]);
format_error({other_run, First, File, Key}) ->
    Line = "~ts: not of the run of ~ts (another ~ts); give the recordings of one run",
    io_lib:format(Line, [File, First, Key]);
format_error({two_worlds, First, File}) ->
    Line = "~ts: like ~ts the recording of a whole run; give one of them, or those of the robots",
    io_lib:format(Line, [File, First]);
format_error({twice, File}) ->
    [File, ": given twice"];
format_error({overlap, First, File, Robot}) ->
    Line = "~ts: like ~ts it tells of r~b, and both tell of r~b at the same time; give one of them",
    io_lib:format(Line, [File, First, Robot, Robot]);
format_error(Reason) ->
    starl_trace_reader:format_error(Reason).
