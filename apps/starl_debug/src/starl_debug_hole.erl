%% @doc Finds holes in recordings: from what time a recording is incomplete, for which robots, and
%% what it lacks.
%%
%% Events in a hole may have changed what is true after it. So nothing after a hole is certain, and
%% "it never was" holds only up to the hole.
-module(starl_debug_hole).

-export([all/1, known_until/2, format/2]).

-export_type([t/0, gap/0, source/0]).

%% The end is missing, or events for some time or a number of them, or a recording of the same
%% robot: by its name, or an earlier one of this robot.
-type t() :: #{
    file := file:filename_all(),
    robots := [starl:robot_id()],
    from := integer(),
    lacks :=
        the_end
        | {until, integer()}
        | {events, pos_integer()}
        | {file, file:filename_all() | starl:robot_id()}
}.

%% What the recording itself says of it ({@link starl_trace_message:t()}).
-type gap() :: {AtUs :: integer(), Missing :: pos_integer() | starl_unjudged:why()}.

%% A recording: its first and last time, its gaps, and whether it was cut off.
-type source() :: #{
    file := file:filename_all(),
    facts := starl_trace_message:scenario(),
    first := integer(),
    last := integer(),
    gaps := [gap()],
    is_cut := boolean()
}.

%% @doc All holes of the recordings of a run. The end of one that was cut off may stand in the robot's
%% next one.
-spec all([source()]) -> [t()].
all(Sources) ->
    Own = [{File, Facts} || #{file := File, facts := #{told_by := _} = Facts} <- Sources],
    Continued = starl_trace_robot:continued(Own),
    Inside = [
        hole(At, Lacks, Source)
     || #{file := File, last := Last, is_cut := IsCut} = Source <- Sources,
        {At, Lacks} <-
            [{At, lacks(Why)} || {At, Why} <- maps:get(gaps, Source)] ++
                [{Last, the_end} || IsCut, not lists:member(File, Continued)]
    ],
    {Lacking, _Until} = starl_trace_robot:lacking(Own),
    Inside ++
        [hole(First, {file, Name}, S) || Name <- Lacking, {First, S} <- of_robot(Name, Sources)].

lacks({hole, To}) -> {until, To};
lacks(Events) when is_integer(Events) -> {events, Events};
lacks(_NoEnd) -> the_end.

%% The earliest recording of the robot of which one is missing: nothing behind that is sure.
of_robot(Name, Sources) ->
    Own = [
        {First, File, Source}
     || #{file := File, first := First, facts := #{told_by := [Robot]}} = Source <- Sources,
        Name =:= Robot orelse is_of(Name, Robot)
    ],
    [{First, Source} || {First, _, Source} <- lists:sublist(lists:sort(Own), 1)].

is_of(Name, Robot) when is_list(Name) ->
    lists:prefix(lists:concat(["robot-", Robot, "."]), Name);
is_of(_Name, _Robot) ->
    false.

hole(At, Lacks, #{file := File, facts := #{robots := Robots} = Facts}) ->
    All = [R || {R, _} <- Robots],
    #{file => File, robots => maps:get(told_by, Facts, All), from => At, lacks => Lacks}.

%% @doc The time until which all is known of these robots. What was in a hole may have changed what is
%% true behind it, and a token that nobody was seen to hold may have been held there: so without a
%% robot all of them count.
-spec known_until([starl:robot_id()], [t()]) -> integer() | infinity.
known_until(Robots, Holes) ->
    %% an atom is larger than any number
    lists:min([infinity | [From || #{from := From} = Hole <- Holes, is_hole_of(Robots, Hole)]]).

is_hole_of([], _Hole) -> true;
is_hole_of(Robots, #{robots := Of}) -> lists:any(fun(R) -> lists:member(R, Of) end, Robots).

%% @doc One line on what is missing.
-spec format(t(), BegunUs :: integer()) -> unicode:chardata().
format(#{file := File, from := From, lacks := Lacks}, Begun) ->
    At = fun(Us) -> io_lib:format("~.3f s", [(Us - Begun) / 1.0e6]) end,
    case Lacks of
        the_end ->
            [File, ": cut off at ", At(From), "; nothing is known after that"];
        {until, To} ->
            [File, ": a part is missing, from ", At(From), " to ", At(To)];
        {events, N} ->
            io_lib:format("~ts: ~b events are missing after ~ts", [File, N, At(From)]);
        {file, Robot} when is_integer(Robot) ->
            io_lib:format("~ts: an earlier recording of r~b is missing", [File, Robot]);
        {file, Name} ->
            [Name, " is missing, of the robot of ", File]
    end.
