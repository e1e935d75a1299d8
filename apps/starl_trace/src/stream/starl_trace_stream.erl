%% @doc Turns the reports of a run ({@link starl_observer}) into messages
%% ({@link starl_trace_message}). A pure module.
-module(starl_trace_stream).

-export([new/0, new/1, news/2, state/1, head/1, close/1]).

-export_type([t/0]).

-define(SECOND_US, 1000000).
%% Between a robot's own places.
-define(SEEN_US, 50000).

-record(stream, {
    facts = none :: starl_trace_message:t() | none,
    poses = starl_trace_poses:new() :: starl_trace_poses:t(),
    %% the beginnings and ends of faults to come, by time
    faults = [] :: [starl_trace_message:t()],
    counts = #{events => 0, packets => 0, lost => 0, violations => 0} ::
        starl_trace_message:metrics(),
    %% the next time of metrics; the next time at which anything is due
    count_at = ?SECOND_US :: integer(),
    due = 0 :: integer(),
    now = 0 :: integer(),
    %% of a robot: is it up, with machines of which names? the time of its last place
    up = false :: boolean() | [starl_machine:name()],
    seen_at = none :: integer() | none
}).

-opaque t() :: #stream{}.

%% @doc Nothing is known of the run.
-spec new() -> t().
new() -> #stream{}.

%% @doc The same, with places of all robots in another period.
-spec new(PeriodUs :: pos_integer()) -> t().
new(Period) -> #stream{poses = starl_trace_poses:new(Period)}.

%% @doc The messages of these news.
-spec news(starl_observer:news(), t()) -> {[starl_trace_message:t()], t()}.
news({begun, Facts}, Stream) ->
    begun(Facts, Stream);
news({judged, Trace, Violations}, Stream) ->
    judged(Trace, Violations, Stream);
news({fault, At, What}, #stream{faults = Faults, due = Due, now = Now} = Stream) ->
    From = max(At, Now),
    Left = [F || F <- Faults, not is_end_of(What, F)],
    {[], Stream#stream{
        faults = lists:keymerge(2, Left, [{faults, From, What}]), due = min(Due, From)
    }};
news({ended, #{end_us := End} = Ending}, #stream{now = Now} = Stream) ->
    {Due, Next} = due(max(End, Now) + 1, Stream),
    {Due ++ [{verdicts, max(End, Now), {ended, Ending}}], Next};
news({started, _At, Robot, Names}, Stream) ->
    {down(Robot, Names, Stream), Stream#stream{up = Names}};
news({seen, At, Robot, Pose}, Stream) ->
    seen(At, Robot, Pose, Stream);
news({unjudged, At, Why}, Stream) ->
    told(gap, At, Why, Stream);
news({logged, At, Robot, Level, Line}, Stream) ->
    told(log, At, {Level, Robot, Line}, Stream).

seen(At, Robot, Pose, #stream{seen_at = Last} = Stream) when
    Last =:= none; At >= Last + ?SEEN_US
->
    Place = #{full => false, robots => [{Robot, Pose, none, unknown}]},
    told(poses, At, Place, Stream#stream{seen_at = At});
seen(_At, _Robot, _Pose, Stream) ->
    {[], Stream}.

begun(#{scenario := Scenario} = Facts, Stream) ->
    Now = maps:get(begun_us, Facts, 0),
    Message = {scenario, Now, Facts#{versions => versions()}},
    Faults = lists:append([times(Fault) || Fault <- maps:get(faults, Scenario, [])]),
    {[Message], Stream#stream{
        facts = Message,
        faults = lists:keysort(2, Faults),
        count_at = Now div ?SECOND_US * ?SECOND_US + ?SECOND_US,
        now = Now,
        up = maps:get(was_up, Facts, false)
    }}.

judged(Trace, Violations, #stream{counts = Counts} = Stream) ->
    #{events := Events, violations := Broken} = Counts,
    Counted = Counts#{
        events := Events + length(Trace), violations := Broken + length(Violations)
    },
    {Messages, #stream{now = Now} = Next} = events(Trace, [], Stream#stream{counts = Counted}),
    {Messages ++ [{verdicts, Now, {violation, V}} || V <- Violations], Next}.

%% Several processes of a robot tell, and may overtake each other a little.
told(Topic, At0, Term, #stream{now = Now} = Stream) ->
    At = max(At0, Now),
    {Due, Next} = due(At, Stream),
    {Due ++ [{Topic, At, Term}], Next#stream{now = At}}.

%% @doc The last messages of a robot's reports: it goes down.
-spec close(t()) -> {[starl_trace_message:t()], t()}.
close(#stream{facts = {scenario, _, #{told_by := [Robot]}}, up = [_ | _] = Names} = Stream) ->
    {down(Robot, Names, Stream), Stream#stream{up = false}};
close(Stream) ->
    {[], Stream}.

%% As the world tells the end of a robot's start.
down(_Robot, _Names, #stream{up = false}) ->
    [];
down(Robot, Names, #stream{now = Now}) ->
    [
        {trace, Now, {Robot, robot, down}},
        {log, Now, {warning, Robot, "goes down"}}
        | [{trace, Now, {Robot, Name, crashed}} || Name <- Names]
    ].

%% @doc The state for a subscriber that has missed messages: the scenario, and where all robots are.
-spec state(t()) -> [starl_trace_message:t()].
state(#stream{facts = none}) ->
    [];
state(#stream{facts = Facts, poses = Poses, now = Now}) ->
    [Facts, starl_trace_poses:full(Now, Poses)].

%% @doc The first message of the next file of a robot's recording, which begins now.
-spec head(t()) -> [starl_trace_message:t()].
head(#stream{facts = none}) ->
    [];
head(#stream{facts = {scenario, _, Facts}, now = Now}) ->
    [{scenario, Now, maps:remove(was_up, Facts#{begun_us => Now})}].

versions() ->
    _ = application:load(starl_platform),
    Vsn =
        case application:get_key(starl_platform, vsn) of
            {ok, Known} -> Known;
            undefined -> "unknown"
        end,
    #{starl => Vsn, otp => erlang:system_info(otp_release)}.

times({_, FromMs, ToMs, _, _, _} = Fault) ->
    [{faults, 1000 * FromMs, {began, Fault}}] ++
        [{faults, 1000 * ToMs, {ended, Fault}} || is_integer(ToMs)];
times(_Other) ->
    [].

%% A fault that is healed by hand does not end again.
is_end_of({ended, Fault}, {faults, _, {ended, Other}}) -> element(1, Fault) =:= element(1, Other);
is_end_of(_, _) -> false.

%% -- events ---------------------------------------------------------------------------------

events([], Messages, Stream) ->
    {lists:reverse(Messages), Stream};
events([{At, _, _, _} | _] = Trace, Messages, #stream{due = Due} = Stream) when At > Due ->
    {More, Next} = due(At, Stream),
    events(Trace, lists:reverse(More, Messages), Next);
events([{At, _, _, _} = Late | Trace], Messages, #stream{now = Now} = Stream) when At < Now ->
    events([setelement(1, Late, Now) | Trace], Messages, Stream);
events([Event | Trace], Messages, Stream) ->
    {Own, Next} = event(Event, Stream#stream{now = element(1, Event)}),
    events(Trace, lists:reverse(Own, Messages), Next).

event({At, From, radio, {packet, To, What, Bytes, Fate}}, #stream{counts = Counts} = Stream) ->
    #{packets := Packets, lost := Lost, events := Events} = Counts,
    Counted = Counts#{
        events := Events - 1, packets := Packets + 1, lost := Lost + lost(Fate)
    },
    {[{packets, At, {From, To, What, Bytes, Fate}}], Stream#stream{counts = Counted}};
event({At, Robot, radio, Way}, #stream{counts = Counts} = Stream) when
    element(1, Way) =:= sent; element(1, Way) =:= came
->
    #{packets := Packets, lost := Lost, events := Events} = Counts,
    Counted =
        case Way of
            {sent, _, _, _, _} -> Counts#{packets := Packets + 1};
            {came, _, _, _, _, Fate} -> Counts#{lost := Lost + lost(Fate)}
        end,
    {[{ways, At, {Robot, Way}}], Stream#stream{counts = Counted#{events := Events - 1}}};
event({At, Robot, chassis, Event} = Traced, #stream{poses = Poses, due = Due} = Stream) ->
    %% a robot that begins to move is shown soon
    Next = starl_trace_poses:event(Traced, Poses),
    {[{trace, At, {Robot, chassis, Event}}], Stream#stream{
        poses = Next, due = min(Due, starl_trace_poses:due_us(Next))
    }};
event({At, Robot, Machine, Event}, Stream) ->
    {[{trace, At, {Robot, Machine, Event}} | log(At, Robot, Machine, Event)], Stream}.

lost({lost, _}) -> 1;
lost({arrives, _}) -> 0.

%% -- what is due before a time --------------------------------------------------------------

due(At, #stream{poses = Poses0} = Stream0) ->
    {Samples, Poses} = starl_trace_poses:sample(At, Poses0),
    {Faults, Stream} = faults(At, Stream0#stream{poses = Poses}),
    {Metrics, #stream{count_at = Count, faults = Left} = Next} = metrics(At, Stream),
    Due = lists:min([Count, starl_trace_poses:due_us(Poses) | [T || {_, T, _} <- Left]]),
    {lists:keymerge(2, lists:keymerge(2, Faults, Samples), Metrics), Next#stream{due = Due}}.

faults(At, #stream{faults = Faults} = Stream) ->
    {Due, Later} = lists:splitwith(fun({_, T, _}) -> T < At end, Faults),
    {Due, Stream#stream{faults = Later}}.

%% After a silence there is one message.
metrics(At, #stream{count_at = Due, counts = Counts} = Stream) when Due < At ->
    Last = (At - 1) div ?SECOND_US * ?SECOND_US,
    {[{metrics, Last, Counts}], Stream#stream{count_at = Last + ?SECOND_US}};
metrics(_At, Stream) ->
    {[], Stream}.

%% -- lines for people -----------------------------------------------------------------------

log(At, Robot, robot, down) ->
    [{log, At, {warning, Robot, "goes down"}}];
log(At, Robot, robot, up) ->
    [{log, At, {info, Robot, "is up again"}}];
log(At, Robot, robot, {died, Why}) ->
    [{log, At, {error, Robot, io_lib:format("died: ~ts", [Why])}}];
log(At, Robot, supervisor, {crashed, Name, Cause}) ->
    Text = io_lib:format("~ts crashed: ~ts", [Name, starl_crash:format(Cause)]),
    [{log, At, {error, Robot, Text}}];
log(At, Robot, supervisor, {given_up, Name}) ->
    [{log, At, {error, Robot, io_lib:format("~ts is not started again", [Name])}}];
log(At, Robot, app, {done, _}) ->
    [{log, At, {info, Robot, "done"}}];
log(_At, _Robot, _Machine, _Event) ->
    [].
