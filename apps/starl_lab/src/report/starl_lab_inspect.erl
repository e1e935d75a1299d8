%% @doc Describes a stopped simulation: one or two lines for each robot and all details of selected
%% robots, wrapped to a width in columns.
-module(starl_lab_inspect).

-export([overview/3, robot/4, term/3]).

-type machines() :: #{starl_machine:name() => starl_robot_tree:seen()}.
-type robot() :: {starl:robot_id(), starl_sim_summary:t(), machines()}.

%% @doc All robots at a virtual time: the time of the last event, the number of events, the pose
%% (m, degrees), the activity of the application, and the states of the machines.
-spec overview(starl_sim_queue:time(), [robot()], Width :: pos_integer()) -> unicode:chardata().
overview(NowUs, Robots, Width) ->
    Head = io_lib:format("~5ts ~10ts ~9ts ~8ts ~8ts ~7ts  ~ts~n", [
        "robot", "last, s", "events", "x, m", "y, m", "heading", "application"
    ]),
    [
        io_lib:format("at ~.6f s~n", [NowUs / 1.0e6]),
        Head
        | [[line(Robot), states(Robot, Width)] || Robot <- Robots]
    ].

line({Id, #{at_us := At, events := Events, pose := {X, Y, Heading}} = Summary, Machines}) ->
    Degrees = Heading * 180 / math:pi(),
    io_lib:format("~5b ~10.6f ~9b ~8.3f ~8.3f ~7.1f  ~ts~n", [
        Id,
        At / 1.0e6,
        Events,
        X / 1000,
        Y / 1000,
        Degrees - 360 * math:floor(Degrees / 360),
        application(Summary, Machines)
    ]).

application(#{result := {done, _}}, _Machines) -> "done";
application(#{result := died}, _Machines) -> "died";
application(#{result := given_up}, _Machines) -> "given up: it crashed too often";
application(#{result := running}, #{app := #{stack := [Frame | _]}}) -> ["in ", frame(Frame)];
application(#{result := running}, #{app := _}) -> "running";
application(#{result := running}, #{}) -> "down".

frame({Module, Function, Arity, Where}) ->
    Line =
        case proplists:get_value(line, Where) of
            undefined -> "";
            N -> io_lib:format(", line ~b", [N])
        end,
    io_lib:format("~tp:~tp/~b~ts", [Module, Function, Arity, Line]).

states({_, _, Machines}, Width) ->
    States = [
        unicode:characters_to_list(io_lib:format("~tp ~ts", [Name, state(Machine)]))
     || {Name, Machine} <- lists:sort(maps:to_list(Machines)), not is_sequential(Machine)
    ],
    case States of
        [] -> "";
        _ -> ["      ", starl_cli_terminal:wrap(lists:join(", ", States), 6, Width), "\n"]
    end.

is_sequential(#{state := sequential}) -> true;
is_sequential(_) -> false.

%% The name of the state only; {@link robot/4} shows the whole state.
state(waiting) ->
    "not booted";
state(#{state := State}) when is_tuple(State), is_atom(element(1, State)) ->
    io_lib:format("~tp(...)", [element(1, State)]);
state(#{state := State}) ->
    io_lib:format("~0tP", [State, 6]).

%% @doc All details of a robot: its application's result, its crashes, and every machine's state and
%% data.
-spec robot(starl:robot_id(), starl_sim_summary:t(), machines(), Width :: pos_integer()) ->
    unicode:chardata().
robot(Id, #{result := Result, crashes := Crashes}, Machines, Width) ->
    [
        io_lib:format("robot ~b~n", [Id]),
        field("result", Result, Width),
        [field("crashed", Crash, Width) || Crash <- lists:reverse(Crashes)],
        [machine(Machine, Width) || Machine <- lists:sort(maps:to_list(Machines))]
    ].

machine({Name, waiting}, _Width) ->
    io_lib:format("  ~tp: not booted yet~n", [Name]);
machine({Name, #{stack := []}}, _Width) ->
    io_lib:format("  ~tp: waits for nothing~n", [Name]);
machine({Name, #{stack := Frames}}, _Width) ->
    Lines = [["    ", frame(Frame), "\n"] || Frame <- Frames],
    [io_lib:format("  ~tp, innermost call first~n", [Name]), Lines];
machine({Name, #{module := Module, state := State, data := Data}}, Width) ->
    Fields = starl_lab_robot_text:fields(Module),
    [
        io_lib:format("  ~tp (~tp)~n", [Name, Module]),
        ["    state ", starl_lab_robot_text:pretty(State, 10, Width, Fields), "\n"],
        ["    data  ", starl_lab_robot_text:pretty(Data, 10, Width, Fields), "\n"]
    ].

field(Name, Value, Width) ->
    [io_lib:format("  ~-8ts", [Name]), term(Value, 10, Width), "\n"].

%% @doc A term that begins at a column. Later lines are indented to it; a long term is cut off.
-spec term(term(), Indent :: non_neg_integer(), Width :: pos_integer()) -> unicode:chardata().
term(Term, Indent, Width) -> starl_lab_robot_text:pretty(Term, Indent, Width, #{}).
