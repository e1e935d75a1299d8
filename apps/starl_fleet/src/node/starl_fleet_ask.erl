%% @doc Answers the questions of `bin/robot'. A separate VM answers each question, and ends with an
%% exit status.
-module(starl_fleet_ask).

-export([main/0, health/2]).

-type answer() :: {0..255, unicode:chardata()}.

-define(ANSWER_MS, 10_000).
%% New versions are compiled there.
-define(RELOAD_MS, 120_000).
-define(PAUSE_MS, 250).

%% @doc Answers the arguments of the command line, and ends the VM.
-spec main() -> no_return().
main() ->
    {Status, Text} = answer(init:get_plain_arguments(), starl_fleet_place:here()),
    _ = io:setopts(standard_io, [{encoding, unicode}]),
    ok = io:put_chars(Text),
    erlang:halt(Status).

-spec answer([string()], starl_fleet_place:t()) -> answer().
answer(["check"], Place) ->
    case starl_fleet_node:prepare(Place) of
        {ok, _, _} -> {0, "sound\n"};
        {error, Lines} -> {1, [[Line, "\n"] || Line <- Lines]}
    end;
answer(["health", Seconds, TrialS], #{state := State, version := Version}) ->
    Now = erlang:monotonic_time(millisecond),
    Until = Now + 1000 * list_to_integer(Seconds),
    TrialMs = 1000 * list_to_integer(TrialS),
    watched(#{state => State, version => Version, until => Until, trial_ms => TrialMs}, none);
answer(Question, #{state := State}) ->
    case starl_fleet_control:ask(State, Question, limit_ms(Question)) of
        {ok, {error, Why}} -> {1, [Why, "\n"]};
        {ok, Answer} -> {0, starl_fleet_term:write(Answer)};
        none -> {3, ["the robot's node does not answer", why(State), "\n"]}
    end.

limit_ms(["reload" | _]) -> ?RELOAD_MS;
limit_ms(_) -> ?ANSWER_MS.

%% The node must be healthy, and the same, for the whole trial. A step may take longer than anybody waits.
watched(#{state := State, until := Until} = Watch, Since) ->
    Now = erlang:monotonic_time(millisecond),
    case health(starl_fleet_control:ask(State, ["status"], ?ANSWER_MS), Watch) of
        {ill, Why} when Now > Until -> {1, [Why, why(State), "\n"]};
        {waits, Why} when Now > Until -> {0, [Why, "\n"]};
        {waits, _} -> again(Watch, none);
        {dead, Why} -> {1, [Why, "\n"]};
        {ill, _} -> again(Watch, none);
        {healthy, Start} -> lasting(Start, Since, Now, Watch)
    end.

lasting(Start, {Start, At}, Now, #{trial_ms := Trial}) when Now - At >= Trial ->
    {0, "healthy\n"};
lasting(Start, {Start, At}, _Now, Watch) ->
    again(Watch, {Start, At});
lasting(_Start, _Since, Now, #{until := Until}) when Now > Until ->
    {1, "its node starts again and again\n"};
lasting(Start, _Since, Now, Watch) ->
    again(Watch, {Start, Now}).

again(Watch, Since) ->
    receive
    after ?PAUSE_MS -> watched(Watch, Since)
    end.

%% @doc Whether a robot of this release is well, by its answer. `dead': waiting does not help; `waits': it
%% has not taken new code yet.
-spec health({ok, term()} | none, #{version := string(), _ => _}) ->
    {healthy, Start :: term()} | {ill | dead | waits, Why :: unicode:chardata()}.
health({ok, #{release := Version, reload := #{failed := Why}}}, #{version := Version}) when
    Why =/= none
->
    {dead, Why};
health({ok, #{release := Version, link := answers, crashes := 0} = Status}, #{version := Version}) ->
    case {Status, starl_fleet_health:problems(Status)} of
        {#{result := given_up}, _} ->
            {dead, "its application has given up"};
        {#{reload := #{waiting := [_ | _]}}, []} ->
            {waits, "it is still in a step, and takes the new code after it"};
        {#{started := Started}, []} ->
            {healthy, Started};
        {#{}, Problems} ->
            {ill, ["it ", lists:join("; it ", Problems)]}
    end;
health({ok, #{release := Version, crashes := N, crash := Crash}}, #{version := Version}) when
    N > 0
->
    {dead, io_lib:format("~b crashes, the latest ~ts", [N, Crash])};
health({ok, #{release := Version, link := silent}}, #{version := Version}) ->
    {ill, "its link does not answer"};
health({ok, #{release := Other}}, #{version := _}) ->
    {ill, ["release ", Other, " still runs"]};
health(_, _) ->
    {ill, "its node does not answer"}.

why(State) ->
    case file:read_file(filename:join(State, "why")) of
        {ok, Why} -> [": ", string:trim(Why)];
        {error, _} -> ""
    end.
