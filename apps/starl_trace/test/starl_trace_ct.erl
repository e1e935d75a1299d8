%% Helpers of the suites on recordings.
-module(starl_trace_ct).

-export([events/2, recorded/2, facts/0, told/1, robots_own/2]).

%% A made-up trace: robots drive to and fro and trace something, one event every `Every' us.
events(N, Every) -> [event(I, I * Every) || I <- lists:seq(0, N - 1)].

event(I, At) ->
    Robot = I rem 3 + 1,
    case I rem 4 of
        0 ->
            %% for a while all stand still
            Speed = 100.0 * (I div 40 rem 2),
            {At, Robot, chassis, {motion, {piece, At, float(I rem 7), I / 3, 0.5, Speed, 0.0}}};
        1 ->
            {At, Robot, chassis, {actuated, pen, lists:nth(I div 4 rem 2 + 1, [up, down])}};
        2 ->
            {At, Robot, radio,
                {packet, 2, {data, {app, note}, I}, 40, {arrives, [{At + 5000, intact}]}}};
        3 ->
            {At, Robot, note, {said, I, #{<<"x">> => [I]}}}
    end.

facts() ->
    #{
        kind => simulation,
        app => nobody,
        scenario => #{seed => 1, faults => []},
        robots => [{1, {0.0, 0.0, 0.0}}],
        monitors => [],
        machines => #{},
        waypoints => #{}
    }.

%% The messages of a run with these events.
told(Events) ->
    {Begun, Stream0} = starl_trace_stream:news({begun, facts()}, starl_trace_stream:new()),
    {Messages, Stream} = starl_trace_stream:news({judged, Events, []}, Stream0),
    End = lists:max([0 | [At || {At, _, _, _} <- Events]]) + 1000,
    Ending = #{ending => done, end_us => End, violations => [], digest => <<>>},
    {Ended, _} = starl_trace_stream:news({ended, Ending}, Stream),
    Begun ++ Messages ++ Ended.

%% A recording of these messages.
recorded(File, Messages) ->
    {Head, Writer0} = starl_trace_writer:new(),
    {Bytes, Writer} = starl_trace_writer:messages(Messages, Writer0),
    file:write_file(File, [Head, Bytes, starl_trace_writer:finish(Writer)]).

%% The messages of the recording of a robot itself: several of its processes tell, a little out of
%% order.
robots_own(Robot, N) ->
    Facts = (facts())#{told_by => [Robot], robots => [{R, {0.0, 0.0, 0.0}} || R <- [1, 2]]},
    News =
        [{begun, Facts}, {started, 0, Robot, [note]}] ++
            lists:append([own(Robot, I, 20000 * I) || I <- lists:seq(1, N)]),
    {Messages, Stream} = lists:mapfoldl(
        fun starl_trace_stream:news/2, starl_trace_stream:new(), News
    ),
    {Last, _} = starl_trace_stream:close(Stream),
    lists:append(Messages) ++ Last.

own(Robot, I, At) ->
    Other = 3 - Robot,
    Hash = I,
    Arrives = {arrives, [{At + 3000, intact}]},
    [
        {judged, [{At + 9000, Robot, radio, {sent, Other, {data, note, I}, 40, Hash}}], []},
        {judged, [{At + 5000, Robot, note, {said, I, #{}}}], []},
        {seen, At + 2000, Robot, {float(I), 0.0, 0.1}},
        {judged, [{At + 2000, Robot, radio, {came, Other, {data, note, I}, 40, Hash, Arrives}}],
            []},
        {logged, At + 19000, Robot, info, "a line"}
    ].
