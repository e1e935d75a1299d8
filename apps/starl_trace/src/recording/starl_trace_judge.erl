%% @doc Judges a recording: all contracts of its run, by the monitors of the run, from its trace.
%% The verdicts are those of the run.
%%
%% Events after a hole in the recording are not judged, unless the judgement needs no earlier
%% events. If the recording has no end, clauses that need the end of the run are not judged.
%%
%% Recordings of the robots themselves know nothing of the true motions. The contracts that need
%% them are not judged. If robots of the run are missing, only what concerns each robot alone is.
-module(starl_trace_judge).

-export([file/1, format_error/1]).

-export_type([judged/0, reason/0]).

%% The judgement: the facts of the run, the violations, whether the recording knows its end and what
%% the run itself had found, the figures of the monitors, the monitors that could not judge, the parts
%% that are not judged, and how the file ends.
-type judged() :: #{
    scenario := starl_trace_message:scenario(),
    violations := [starl_monitor:violation()],
    found := [starl_monitor:violation()] | unknown,
    results := #{module() => map()},
    not_judged := [{module(), motions | robots}],
    unjudged := [starl_unjudged:t()],
    until_us := integer(),
    events := non_neg_integer(),
    missing := non_neg_integer(),
    ended := starl_trace_reader:ended()
}.

-type reason() ::
    starl_trace_reader:reason()
    | {no_scenario, file:filename_all()}
    | {too_short, file:filename_all()}
    | {no_monitor, file:filename_all(), module()}
    | {bad_monitor, file:filename_all(), module()}.

-record(judge, {
    file :: file:filename_all(),
    scenario = none :: starl_trace_message:scenario() | none,
    monitors = none :: starl_monitor:t() | none,
    not_judged = [] :: [{module(), motions | robots}],
    violations = [] :: [starl_monitor:violation()],
    found = unknown :: [starl_monitor:violation()] | unknown,
    until = 0 :: integer(),
    %% the robots of a live run that are halted, since when, and what happened meanwhile, latest first
    standing = #{} :: #{atom() => {starl:robot_id(), integer()}},
    waiting = [] :: [[starl_monitor:trace_event()]],
    %% what hands do to it, as long as it lasts
    lasting = starl_assumption_open_faults:new() :: starl_assumption_open_faults:t(),
    %% the windows in which computers were late, of which the monitors do not know yet
    late = [] :: [starl_assumption:window()],
    events = 0 :: non_neg_integer(),
    missing = 0 :: non_neg_integer()
}).

%% @doc Judges a recording.
-spec file(file:filename_all()) -> {ok, judged()} | {error, reason()}.
file(File) ->
    case starl_trace_reader:start(File) of
        {ok, Cursor} -> try_all(Cursor, #judge{file = File, late = late(File)});
        {error, _} = Error -> Error
    end.

%% A computer that stood still says so afterwards, and what it explains was before that. In the simulator a fault
%% says it before: such a recording is read once.
late(File) ->
    case starl_trace_chunks:open(File) of
        {ok, Chunks} ->
            try
                late(Chunks, [])
            after
                starl_trace_chunks:close(Chunks)
            end;
        {error, _} ->
            []
    end.

%% The positions, which the reader computes, are no matter here.
late(Chunks, Late) ->
    case starl_trace_chunks:next(Chunks) of
        {ok, [{scenario, _, #{kind := simulation}} | _], _Left} -> [];
        {ok, Messages, Left} -> late(Left, [starl_assumption:late(facts(Messages)) | Late]);
        _ -> lists:append(lists:reverse(Late))
    end.

try_all(Cursor, Judge) ->
    try
        all(Cursor, Judge)
    catch
        throw:{?MODULE, Reason} -> {error, Reason}
    after
        starl_trace_reader:stop(Cursor)
    end.

all(Cursor, Judge) ->
    case starl_trace_reader:next(Cursor) of
        {ok, Messages, Next} -> all(Next, messages(Messages, Judge));
        {ended, Ended} -> judged(Ended, Judge);
        {error, _} = Error -> Error
    end.

judged(closed, #judge{scenario = none, file = File}) ->
    {error, {no_scenario, File}};
judged(_Ended, #judge{scenario = none, file = File}) ->
    {error, {too_short, File}};
judged(Ended, #judge{standing = Standing, until = End} = Open) ->
    #judge{monitors = Monitors, violations = Violations, until = Until} =
        Judge = with_end(
            Ended,
            waited_for(
                lists:foldl(fun(Id, J) -> resumed(Id, End, J) end, Open, maps:keys(Standing))
            )
        ),
    {Late, Results, Unjudged} = starl_monitor:close(Until, Monitors),
    {ok, #{
        scenario => Judge#judge.scenario,
        violations => lists:reverse(Violations, Late),
        found => Judge#judge.found,
        results => Results,
        not_judged => Judge#judge.not_judged,
        unjudged => Unjudged,
        until_us => Until,
        events => Judge#judge.events,
        missing => Judge#judge.missing,
        ended => Ended
    }}.

with_end(closed, Judge) -> Judge;
with_end(_CutOff, Judge) -> hole(no_end, Judge).

%% The trace of a second is judged at once, like the windows of a run; a gap divides it.
messages(Messages, Judge) ->
    case lists:splitwith(fun(Message) -> element(1, Message) =/= gap end, Messages) of
        {Whole, []} -> piece(Whole, Judge);
        {Before, [Gap | After]} -> messages(After, gap(Gap, piece(Before, Judge)))
    end.

piece(Messages, Judge0) ->
    Judge = lists:foldl(fun message/2, Judge0, Messages),
    judge(facts(Messages), Judge).

facts(Messages) -> [{At, R, M, E} || {trace, At, {R, M, E}} <- Messages].

gap({gap, _, Missing}, #judge{missing = Before} = Judge) when is_integer(Missing) ->
    hole({missing, Missing}, Judge#judge{missing = Before + Missing});
gap({gap, _, Why}, Judge) ->
    hole(Why, Judge).

%% What waits for the end of a halt is judged without it: nobody knows when it ended.
hole(_Why, #judge{monitors = none} = Judge) ->
    Judge;
hole(Why, #judge{standing = Standing} = Judge0) ->
    Judge =
        #judge{monitors = Monitors} =
        case map_size(Standing) of
            0 -> waited_for(Judge0);
            _ -> Judge0
        end,
    Judge#judge{monitors = starl_monitor:blinded(Why, Monitors)}.

%% What a halt of a live robot explains is known when it is over: so long nothing is judged.
judge([_ | _] = Trace, #judge{standing = Standing} = Judge) when map_size(Standing) > 0 ->
    #judge{waiting = Waiting, until = Until} = Judge,
    Last = element(1, lists:last(Trace)),
    Judge#judge{waiting = [Trace | Waiting], until = max(Last, Until)};
judge([], #judge{standing = Standing} = Judge) when map_size(Standing) > 0 ->
    Judge;
judge(Trace, Judge) ->
    step(Trace, waited_for(Judge)).

waited_for(#judge{waiting = Waiting} = Judge) ->
    lists:foldl(fun step/2, Judge#judge{waiting = []}, lists:reverse(Waiting)).

message({scenario, At, Scenario}, #judge{scenario = none, file = File} = Judge) ->
    #{monitors := Monitors} = Scenario,
    Robots = maps:get(told_by, Scenario, []),
    lists:foreach(fun(Monitor) -> check(Monitor, File) end, Monitors),
    Needs = [{Monitor, needs(interests(Monitor), Scenario)} || Monitor <- Monitors],
    Judge#judge{
        scenario = Scenario,
        lasting = starl_assumption_open_faults:absent(Robots, At, Judge#judge.lasting),
        monitors = begin_at(At, Robots, [Monitor || {Monitor, nothing} <- Needs]),
        not_judged = [{Module, What} || {{Module, _}, What} <- Needs, What =/= nothing]
    };
message({verdicts, _, {ended, #{end_us := End, violations := Found} = Ending}}, Judge) ->
    Until = maps:get(judged_us, Ending, End),
    Judge#judge{found = Found, until = max(Until, Judge#judge.until)};
message({faults, At, {began, {Id, _, forever, pause, Robot, _}}}, Judge) ->
    Judge#judge{standing = (Judge#judge.standing)#{Id => {Robot, At}}};
message({faults, At, {ended, {Id, _, _, pause, _, _}}}, #judge{standing = Standing} = Judge) when
    is_map_key(Id, Standing)
->
    resumed(Id, At, Judge);
message({faults, _At, Told}, #judge{lasting = Lasting} = Judge) ->
    Judge#judge{lasting = starl_assumption_open_faults:report(Told, Lasting)};
message(_Message, Judge) ->
    Judge.

%% The times of robots on their own count from 1970: nothing was owed before their recordings begin.
begin_at(_At, [], Monitors) ->
    starl_monitor:guarded(Monitors);
begin_at(At, [_ | _], Monitors) ->
    starl_monitor:broken({all, At, At, fault}, starl_monitor:guarded(Monitors)).

resumed(Id, At, #judge{standing = Standing, monitors = Monitors} = Judge) ->
    {{Robot, From}, Left} = maps:take(Id, Standing),
    Told = starl_monitor:broken({Robot, From, max(From, At), pause}, Monitors),
    Judge#judge{standing = Left, monitors = Told}.

step([], Judge) ->
    Judge;
step(_Trace, #judge{monitors = none, file = File}) ->
    throw({?MODULE, {no_scenario, File}});
step(Trace, #judge{events = Events, until = Until} = Judge1) ->
    {Last, _, _, _} = lists:last(Trace),
    Lasting = starl_assumption_open_faults:traced(Trace, Judge1#judge.lasting),
    #judge{monitors = Monitors} = Judge0 = lasting(Last, Judge1#judge{lasting = Lasting}),
    Judge = Judge0#judge{events = Events + length(Trace), until = max(Last, Until)},
    case starl_monitor:step(Trace, Monitors) of
        {ok, Next} ->
            Judge#judge{monitors = Next};
        {violation, Violation, Next} ->
            Judge#judge{
                monitors = Next, violations = [Violation | Judge#judge.violations]
            }
    end.

%% What is judged now may rest on faults that still last, and on late computers.
lasting(Now, #judge{lasting = Before, late = Late, monitors = Monitors} = Judge) ->
    {Windows, Lasting} = starl_assumption_open_faults:windows(Now, Before),
    Told = lists:foldl(fun starl_monitor:broken/2, Monitors, Late ++ Windows),
    Judge#judge{lasting = Lasting, late = [], monitors = Told}.

%% A file names modules that are to be called: only monitors are, with data and no functions.
check({Module, Config}, File) when is_atom(Module), is_map(Config) ->
    case code:ensure_loaded(Module) of
        {module, Module} ->
            IsSound = is_monitor(Module) andalso is_data(Config),
            IsSound orelse throw({?MODULE, {bad_monitor, File, Module}});
        {error, _} ->
            throw({?MODULE, {no_monitor, File, Module}})
    end;
check(_Other, File) ->
    throw({?MODULE, {bad_monitor, File, unknown}}).

%% A monitor that does not even begin is put aside later.
interests({Module, Config}) ->
    case starl_monitor_check:start(Module, Config) of
        {ok, Interests, _State} -> Interests;
        {error, _Line} -> [supervisor]
    end.

%% What a monitor with these interests would need and the recording has not.
needs(Interests, #{told_by := By, robots := Robots} = Scenario) ->
    HasMotions = maps:get(has_motions, Scenario, false),
    HasAll = [Id || {Id, _} <- Robots] -- By =:= [],
    case Interests of
        [supervisor] -> nothing;
        _ when not HasAll -> robots;
        _ when HasMotions -> nothing;
        all -> motions;
        _ -> of_machines(lists:member(chassis, Interests))
    end;
needs(_Interests, _Scenario) ->
    nothing.

of_machines(true) -> motions;
of_machines(false) -> nothing.

is_monitor(Module) ->
    Attributes = Module:module_info(attributes),
    Behaviours = proplists:append_values(behaviour, Attributes),
    lists:member(starl_monitor, Behaviours ++ proplists:append_values(behavior, Attributes)).

is_data(Map) when is_map(Map) ->
    is_data(maps:to_list(Map));
is_data(Tuple) when is_tuple(Tuple) ->
    is_data(tuple_to_list(Tuple));
is_data([First | Rest]) ->
    is_data(First) andalso is_data(Rest);
is_data(Term) ->
    not (is_function(Term) orelse is_pid(Term) orelse is_port(Term) orelse is_reference(Term)).

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({no_scenario, File}) ->
    io_lib:format("~ts: the recording does not begin with its scenario", [File]);
format_error({too_short, File}) ->
    starl_trace_chunks:format_error({too_short, File});
format_error({no_monitor, File, Module}) ->
    Line =
        "~ts: the contract ~ts is not known here; compile ~ts.erl and put it into ERL_LIBS, or its source into inputs beside the recording",
    io_lib:format(Line, [File, Module, Module]);
format_error({bad_monitor, File, Module}) ->
    io_lib:format("~ts: ~ts, as it stands in the recording, is no contract", [File, Module]);
format_error(Reason) ->
    starl_trace_reader:format_error(Reason).
