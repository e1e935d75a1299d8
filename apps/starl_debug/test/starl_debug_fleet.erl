%% Recordings of the robots of a fleet, as they would have made them themselves, of a run in the simulator: each
%% robot has its own clock, and a file for each of its lives. What only the world knows, the schedule of the faults
%% among it, is in none of them.
-module(starl_debug_fleet).

-export([run/1, write/3]).

%% The run's time 0 on the clocks of the robots, as of computers that count from 1970.
-define(EPOCH, 1700000000000000).
%% A clock is corrected by 1 % at most ({@link starl_live_clock}).
-define(SLEW, 100).

%% The run of a scenario: what its robots tell, and the facts that they know of it.
run(Given) ->
    Self = self(),
    Observe = fun
        ({judged, Trace, _}) ->
            Self ! {?MODULE, Trace},
            ok;
        (_) ->
            ok
    end,
    {ok, Sim} = starl_sim:start(Given#{mode => inline}, #{observe => Observe, packets => true}),
    Ending = starl_sim:await(Sim),
    {#{end_us := End, violations := Violations}, _} = starl_sim:finish(Sim),
    {ok, Planned} = starl_run:plan(
        maps:without([faults, random_faults, heal, converge], Given), #{}
    ),
    Facts = starl_run_plan:facts(Planned, []),
    #{
        facts => Facts#{kind := live, epoch_us => 0, run => 1},
        trace => collected([]),
        ending => Ending,
        end_us => End,
        violations => Violations
    }.

collected(Traces) ->
    receive
        {?MODULE, Trace} -> collected([Trace | Traces])
    after 0 -> lists:append(lists:reverse(Traces))
    end.

%% Writes the recordings into a directory: the files. `clocks': how far that of a robot is off, a constant (us),
%% `{drift, Ppm}', or `{step, AtUs, Us}'; `ends': how its lives end, in turn: `closed'; `killed', with
%% no end, but its next file has that; `power', and up to a second is nowhere. The last file of each is closed but
%% with `last'.
write(Dir, #{facts := Facts, trace := Trace, end_us := End}, How) ->
    Own = own(Trace),
    lists:append([
        files(Dir, Robot, maps:get(Robot, Own, []), End, Facts, #{
            clock => maps:get(Robot, maps:get(clocks, How, #{}), 0),
            ends => maps:get(Robot, maps:get(ends, How, #{}), []),
            last => maps:get(Robot, maps:get(last, How, #{}), closed)
        })
     || {Robot, _} <- maps:get(robots, Facts), Robot =/= maps:get(without, How, none)
    ]).

%% What each robot tells, in the order of its times.
own(Trace) ->
    Away = away(Trace),
    Told = lists:append([told(Event, Away) || Event <- Trace]),
    Groups = maps:groups_from_list(fun({_, {_, Robot, _, _}}) -> Robot end, Told),
    maps:map(fun(_, Events) -> [E || {_, E} <- lists:keysort(1, Events)] end, Groups).

%% When robots are away.
away(Trace) ->
    lists:foldl(
        fun
            ({At, R, robot, down}, Away) ->
                maps:update_with(
                    R, fun(Spans) -> [{At, infinity} | Spans] end, [{At, infinity}], Away
                );
            ({At, R, robot, up}, Away) when is_map_key(R, Away) ->
                maps:update_with(R, fun([{From, _} | Spans]) -> [{From, At} | Spans] end, Away);
            (_, Away) ->
                Away
        end,
        #{},
        Trace
    ).

is_away(Robot, At, Away) ->
    [x || {From, To} <- maps:get(Robot, Away, []), From =< At, At =< To] =/= [].

told({_, _, chassis, _}, _Away) ->
    [];
told({At, From, radio, {packet, To, Brief, Bytes, Fate}}, Away) ->
    %% a packet names the lives of both
    Lives = [length([x || {Since, _} <- maps:get(R, Away, []), Since =< At]) || R <- [From, To]],
    Hash = erlang:phash2({Lives, Brief}),
    Came = [
        {{T, 0}, {T, To, radio, {came, From, Brief, Bytes, Hash, {arrives, [{T, intact}]}}}}
     || {arrives, Copies} <- [Fate], {T, intact} <- Copies, not is_away(To, T, Away)
    ],
    [{{At, 2}, {At, From, radio, {sent, To, Brief, Bytes, Hash}}} | Came];
told({_, _, robot, {died, _}}, _Away) ->
    [];
told({_, _, robot, store_set_back}, _Away) ->
    [];
told({At, _, _, _} = Event, _Away) ->
    [{{At, 1}, Event}].

%% -- the files of a robot -------------------------------------------------------------------

files(Dir, Robot, Events, End, Facts, How) ->
    Names = lists:usort([M || {_, _, M, crashed} <- Events] ++ [sap]),
    lives(Dir, {Robot, Names, 1}, parted(Events, []), End, Facts#{told_by => [Robot]}, How).

%% What comes with the end of a life is not told by the robot itself.
parted([{_, _, robot, down} = Down | Events], Life) ->
    Left = lists:dropwhile(fun({_, _, _, E}) -> E =:= crashed end, Events),
    [{lists:reverse(Life), element(1, Down)} | parted(Left, [])];
parted([Event | Events], Life) ->
    parted(Events, [Event | Life]);
parted([], Life) ->
    [{lists:reverse(Life), none}].

lives(_Dir, _Who, [], _End, _Facts, _How) ->
    [];
lives(Dir, {Robot, Names, N}, [{Life, Down} | Lives], End, Facts, #{clock := Clock} = How) ->
    {Ends, Later} = next(Down, How),
    Until = until(Ends, Life, Down, End),
    Kept = [retimed(Event, Clock) || {At, _, _, _} = Event <- Life, At =< Until],
    Begun = maps:get(begun_us, Facts, begun(Life, Clock)),
    News =
        [{begun, Facts#{begun_us => Begun}}, {started, shown(begun_at(Life), Clock), Robot, Names}] ++
            [{judged, [Event], []} || Event <- Kept],
    {Messages, Stream} = lists:mapfoldl(
        fun starl_trace_stream:news/2, starl_trace_stream:new(), News
    ),
    {Last, _} = starl_trace_stream:close(Stream),
    File = filename:join(Dir, name(Robot, N)),
    ok = written(File, lists:append(Messages), [Last || Ends =:= closed], Ends),
    Next =
        case Ends of
            closed ->
                maps:without([begun_us, was_up], Facts);
            _ ->
                Facts#{
                    was_up => true, begun_us => lists:max([Begun | [At || {At, _, _, _} <- Kept]])
                }
        end,
    [File | lives(Dir, {Robot, Names, N + 1}, Lives, End, Next, How#{ends := Later})].

next(none, #{last := Last}) -> {Last, []};
next(_Down, #{ends := []}) -> {closed, []};
next(_Down, #{ends := [Ends | Later]}) -> {Ends, Later}.

%% A computer that has lost its power has not written the last second.
until(power, _Life, none, End) -> End - 800000;
until(power, _Life, Down, _End) -> Down - 800000;
until(_Ends, _Life, _Down, _End) -> infinity.

begun([], _Clock) -> ?EPOCH;
begun(Life, Clock) -> shown(begun_at(Life), Clock).

begun_at([]) -> 0;
begun_at([{At, _, _, _} | _]) -> At.

name(Robot, 1) -> lists:concat(["robot-", Robot, ".mcap"]);
name(Robot, N) -> lists:concat(["robot-", Robot, ".", N, ".mcap"]).

written(File, Messages, Last, Ends) ->
    {Head, Writer0} = starl_trace_writer:new(),
    {Bytes, Writer1} = starl_trace_writer:messages(Messages ++ lists:append(Last), Writer0),
    {Flushed, Writer} = starl_trace_writer:flush(Writer1),
    Finish = [starl_trace_writer:finish(Writer) || Ends =:= closed],
    file:write_file(File, [Head, Bytes, Flushed, Finish]).

%% -- clocks ---------------------------------------------------------------------------------

retimed({At, Robot, radio, {came, From, Brief, Bytes, Hash, {arrives, Copies}}}, Clock) ->
    Arrives = {arrives, [{shown(T, Clock), How} || {T, How} <- Copies]},
    {shown(At, Clock), Robot, radio, {came, From, Brief, Bytes, Hash, Arrives}};
retimed({At, Robot, robot, {late, From, To}}, Clock) ->
    {shown(At, Clock), Robot, robot, {late, shown(From, Clock), shown(To, Clock)}};
retimed({At, Robot, Machine, Event}, Clock) ->
    {shown(At, Clock), Robot, Machine, Event}.

%% What a clock shows at a time of the run.
shown(At, Us) when is_integer(Us) -> ?EPOCH + At + Us;
shown(At, {drift, Ppm}) -> ?EPOCH + At + At * Ppm div 1000000;
shown(At, {step, From, _Us}) when At =< From -> ?EPOCH + At;
shown(At, {step, From, Us}) when Us < 0 -> ?EPOCH + At - min(-Us, (At - From) div ?SLEW);
shown(At, {step, From, Us}) -> ?EPOCH + At + min(Us, (At - From) div ?SLEW).
