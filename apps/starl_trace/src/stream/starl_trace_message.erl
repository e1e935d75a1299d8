%% @doc The messages of a run: what recordings hold and windows show. A message is a topic, a time
%% and a term. The same messages come from a running simulation, from a live run and from a
%% recording.
%% ```
%%   scenario   once, first: the facts of the run
%%   poses      where robots are; at most 20 a second, with all robots at least each second
%%   places     only in files: the motions of all robots at a time, for who begins to read there
%%   trace      each event, as the monitors get it
%%   packets    each packet when it is sent, with its fate
%%   ways       of a robot's own recording: what it knows of a packet, sent or come
%%   faults     a fault begins or ends
%%   verdicts   a contract is broken; at the end, how the run ended
%%   log        a line for people
%%   metrics    counts, once a second
%%   gap        messages are missing after this time: their number, or why it is not judged further
%% '''
%% Messages are in the order of their times.
-module(starl_trace_message).

-export([topics/0, is_message/1]).

-export_type([t/0, topic/0, scenario/0, poses/0, pose/0, packet/0, verdict/0, level/0, metrics/0]).

%% Time in microseconds, virtual or live.
-type t() ::
    {scenario, AtUs :: integer(), scenario()}
    | {poses, integer(), poses()}
    | {trace, integer(), {starl:robot_id(), starl_machine:name(), Event :: term()}}
    | {places, integer(), starl_trace_poses:places()}
    | {packets, integer(), packet()}
    | {ways, integer(), {starl:robot_id(), starl_observer:packet_report()}}
    | {faults, integer(), {began | ended, Fault :: tuple()}}
    | {verdicts, integer(), verdict()}
    | {log, integer(), {level(), starl:robot_id() | none, unicode:chardata()}}
    | {metrics, integer(), metrics()}
    | {gap, integer(), Missing :: pos_integer() | starl_unjudged:why()}.

-type topic() ::
    scenario
    | poses
    | places
    | trace
    | packets
    | ways
    | faults
    | verdicts
    | log
    | metrics
    | gap.

%% The facts of a run ({@link starl_observer:facts()}), with its versions.
-type scenario() :: #{
    kind := simulation | live,
    app := module(),
    scenario := map(),
    robots := [{starl:robot_id(), starl:pose()}],
    monitors := [{module(), map()}],
    machines := #{starl_machine:name() => module()},
    waypoints := #{atom() => starl_geometry:point()},
    floor => starl_floor:t(),
    versions := #{atom() => string()},
    epoch_us => integer(),
    begun_us => integer(),
    run => non_neg_integer(),
    told_by => [starl:robot_id(), ...],
    has_motions => boolean(),
    was_up => boolean()
}.

%% The robots in ascending order; not `full': only those that changed since the last message.
-type poses() :: #{full := boolean(), robots := [pose()]}.

%% Position and heading (mm, radians) as far as known from outside, whether the pen is down (`none':
%% it has never been set), and the position and heading in the simulated world.
-type pose() :: {
    starl:robot_id(),
    starl:pose(),
    Pen :: up | down | none,
    True :: starl:pose() | unknown
}.

%% Sender, receiver, what it is, bytes, fate ({@link starl_observer:packet()}).
-type packet() :: {
    From :: starl:robot_id(),
    To :: starl:robot_id(),
    starl_packet:brief(),
    Bytes :: pos_integer(),
    starl_observer:fate()
}.

%% A broken contract; the end of the run.
-type verdict() :: {violation, starl_monitor:violation()} | {ended, starl_observer:ending()}.

-type level() :: info | warning | error.

%% Counts since the beginning.
-type metrics() :: #{
    events := non_neg_integer(),
    packets := non_neg_integer(),
    lost := non_neg_integer(),
    violations := non_neg_integer()
}.

%% @doc All topics.
-spec topics() -> [topic()].
topics() ->
    [scenario, poses, places, trace, packets, ways] ++
        [faults, verdicts, log, metrics, gap].

%% @doc Has a term the outer shape of a message? Asked of what comes from a file.
-spec is_message(term()) -> boolean().
is_message({scenario, At, #{app := App, kind := _, monitors := Monitors, robots := Robots} = S}) ->
    is_integer(At) andalso is_atom(App) andalso is_list(Monitors) andalso is_list(Robots) andalso
        is_map(maps:get(scenario, S, none));
is_message({trace, At, {Robot, Machine, _Event}}) ->
    is_integer(At) andalso is_integer(Robot) andalso is_atom(Machine);
is_message({poses, At, #{full := _, robots := Robots}}) ->
    is_integer(At) andalso is_list(Robots);
is_message({places, At, Places}) ->
    is_integer(At) andalso is_list(Places);
is_message({packets, At, {From, To, _, Bytes, _}}) ->
    is_integer(At) andalso is_integer(From) andalso is_integer(To) andalso is_integer(Bytes);
is_message({ways, At, {Robot, Way}}) ->
    is_integer(At) andalso is_integer(Robot) andalso is_way(Way);
is_message({verdicts, At, {violation, #{contract := _, at_us := _}}}) ->
    is_integer(At);
is_message({verdicts, At, {ended, #{end_us := End, violations := Violations}}}) ->
    is_integer(At) andalso is_integer(End) andalso is_list(Violations);
is_message({metrics, At, #{events := _}}) ->
    is_integer(At);
is_message({faults, At, {_, Fault}}) ->
    is_integer(At) andalso is_tuple(Fault);
is_message({log, At, {_, _, _}}) ->
    is_integer(At);
is_message({gap, At, Missing}) ->
    is_integer(At) andalso (is_integer(Missing) orelse starl_unjudged:is_why(Missing));
is_message(_) ->
    false.

is_way({sent, To, _, Bytes, Hash}) ->
    is_integer(To) andalso is_integer(Bytes) andalso is_integer(Hash);
is_way({came, From, _, Bytes, Hash, _Fate}) ->
    is_integer(From) andalso is_integer(Bytes) andalso is_integer(Hash);
is_way(_) ->
    false.
