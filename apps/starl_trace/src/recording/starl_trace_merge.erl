%% @doc Merges the recordings of a run's robots into one recording, ordered by time. A recording of
%% the world may be among them. Then the true motions, the deaths of robots and the verdicts come
%% from it, and what the robots did after the end of the run is left out. Memory holds some seconds
%% of each file.
%%
%% <em>Clocks.</em> The robots' computers must be synchronized to one clock. A packet that arrives
%% before it was sent shows that they were not. Then times are moved as far as the order of the
%% packets requires ({@link starl_trace_order}).
%%
%% <em>Holes.</em> If a robot's file is missing, or a file has no end, the merged recording has a
%% hole. Monitors report no violation that events in the hole might explain.
-module(starl_trace_merge).

-export([files/2, format_error/1]).

-export_type([merged/0, reason/0]).

%% `cut_off': the files whose ends are in no other; `missing': robots of the run without a file;
%% `lacking': the files of the other robots that are missing, by name, or the robots of whom an earlier
%% one is; `moved': the robots whose times were moved, and by how much at most.
-type merged() :: #{
    messages := non_neg_integer(),
    bytes := non_neg_integer(),
    begun_us := integer(),
    until_us := integer(),
    cut_off := [file:filename_all()],
    missing := [starl:robot_id()],
    lacking := [file:filename() | starl:robot_id()],
    clocks := [starl_trace_order:clock()],
    moved := [{starl:robot_id(), Us :: pos_integer()}]
}.

-type reason() ::
    starl_trace_reader:reason()
    | starl_mcap_part:reason()
    | {no_scenario, file:filename_all()}
    | {too_short, file:filename_all()}
    | {two_worlds, file:filename_all(), file:filename_all()}
    | {duplicate, starl:robot_id(), file:filename_all(), file:filename_all()}
    | {other_run, file:filename_all(), file:filename_all(), Key :: atom()}.

-record(source, {
    %% the world's comes first
    rank :: {0 | 1, pos_integer()},
    kind :: world | robot,
    file :: file:filename_all(),
    facts :: starl_trace_message:scenario(),
    share :: starl_trace_merge_selection:t() | none,
    %% the messages that wait
    messages :: [starl_trace_message:t()],
    cursor :: starl_trace_reader:cursor()
}).

-record(merge, {
    part :: starl_mcap_part:t(),
    writer :: starl_trace_writer:t(),
    has_world :: boolean(),
    %% messages that wait until the fates of packets are known, the latest first
    waiting = [] :: [starl_trace_message:t()],
    ways = starl_packet_fates:new() :: starl_packet_fates:t(),
    %% those whose place in the common order is not known yet
    order = starl_trace_order:new() :: starl_trace_order:t(),
    due = none :: integer() | none,
    messages = 0 :: non_neg_integer(),
    until = 0 :: integer(),
    %% the time until which each robot, and the world, has told
    told = #{} :: #{starl_trace_order:source() => integer()},
    ended = none :: starl_observer:ending() | none,
    cut_off = [] :: [file:filename_all()],
    %% the files behind which something is missing, and what
    holes = #{} :: #{file:filename_all() => starl_unjudged:why()}
}).

%% The longest delay of a packet, and the time after which it is looked for.
-define(DELAY_US, 1500000).
-define(STEP_US, 1000000).
%% Recordings of one run have the same facts.
-define(SAME, [app, kind, scenario, epoch_us, run]).

%% @doc Merges recordings into a file.
-spec files([file:filename_all(), ...], Out :: file:filename_all()) ->
    {ok, merged()} | {error, reason()}.
files(Files, Out) ->
    try
        Sources = [begun(N, File) || {N, File} <- lists:zip(lists:seq(1, length(Files)), Files)],
        try
            ok = checked(Sources),
            starl_mcap_part:make(Out, fun(Part) -> {ok, written(lists:sort(Sources), Part)} end)
        after
            lists:foreach(fun(#source{cursor = C}) -> starl_trace_reader:stop(C) end, Sources)
        end
    catch
        throw:{?MODULE, Reason} -> {error, Reason}
    end.

begun(N, File) ->
    case starl_trace_reader:start(File) of
        {ok, Cursor} -> first(starl_trace_reader:next(Cursor), N, File);
        {error, Reason} -> throw({?MODULE, Reason})
    end.

first({ok, [{scenario, _, Facts} | Messages], Next}, N, File) ->
    {Kind, Rank} =
        case Facts of
            #{told_by := _} -> {robot, {1, N}};
            #{} -> {world, {0, N}}
        end,
    #source{
        rank = Rank,
        kind = Kind,
        file = File,
        facts = Facts,
        share = none,
        messages = Messages,
        cursor = Next
    };
first({error, Reason}, _N, _File) ->
    throw({?MODULE, Reason});
first({ended, _}, _N, File) ->
    throw({?MODULE, {too_short, File}});
first(_Other, _N, File) ->
    throw({?MODULE, {no_scenario, File}}).

checked([#source{file = First, facts = Facts} | Others] = Sources) ->
    _ = [
        throw({?MODULE, {other_run, First, File, Key}})
     || #source{file = File, facts = Other} <- Others,
        Key <- ?SAME,
        maps:get(Key, Facts, none) =/= maps:get(Key, Other, none)
    ],
    case [File || #source{kind = world, file = File} <- Sources] of
        [A, B | _] -> throw({?MODULE, {two_worlds, A, B}});
        _ -> once(Sources)
    end.

%% Each time of a robot is told once.
once([]) ->
    ok;
once([#source{file = File} = Source | Others]) ->
    _ = [
        throw({?MODULE, {duplicate, Robot, File, Other#source.file}})
     || #source{facts = Facts} = Other <- Others,
        Robot <- lists:sublist(shares(Source#source.facts, Facts), 1),
        is_same_beginning(Source, Other) orelse is_same_time(Source, Other)
    ],
    once(Others).

shares(#{told_by := By}, #{told_by := Others}) -> [R || R <- By, lists:member(R, Others)];
shares(_OneOfThem, _IsTheWorld) -> [].

is_same_beginning(#source{messages = [_ | _] = Messages} = A, #source{messages = Messages} = B) ->
    maps:get(begun_us, A#source.facts, 0) =:= maps:get(begun_us, B#source.facts, 0);
is_same_beginning(_, _) ->
    false.

%% By their numbers two files follow each other, even if the clock was set back between them.
is_same_time(#source{file = A, facts = FactsA}, #source{file = B, facts = FactsB}) ->
    {NumberA, BegunA} = starl_trace_robot:order(A, FactsA),
    {NumberB, BegunB} = starl_trace_robot:order(B, FactsB),
    IsNumbered = NumberA > 0 andalso NumberB > 0 andalso NumberA =/= NumberB,
    not IsNumbered andalso BegunA < end_us(B) andalso BegunB < end_us(A).

end_us(File) ->
    case starl_trace_reader:tail(File) of
        {ok, #{until_us := Until}} -> Until;
        {error, Reason} -> throw({?MODULE, Reason})
    end.

written(Sources0, Part) ->
    HasWorld = has_world(Sources0),
    Sources = [shared(HasWorld, Source) || Source <- Sources0],
    {Head, Writer} = starl_trace_writer:new(),
    Begin = begin_us(Sources),
    Robots = [{File, Facts} || #source{kind = robot, facts = Facts, file = File} <- Sources],
    {Lacking, Until} = starl_trace_robot:lacking(Robots),
    Holes = maps:map(fun(_File, To) -> {hole, To} end, Until),
    Merge = put_bytes({Head, Writer}, #merge{
        part = Part,
        writer = Writer,
        has_world = HasWorld,
        holes = maps:merge(open_ends(Sources), maps:remove(none, Holes))
    }),
    First = [{gap, Begin, Why} || #{none := Why} <- [Holes]],
    Headed = put_messages([{scenario, Begin, facts(Sources)} | First], Merge),
    {Ready, Begun} = filled(Sources, Headed),
    #merge{cut_off = CutOff} = Merged = finished(all(Ready, Begun)),
    (sums(Merged))#{
        begun_us => Begin,
        cut_off => lists:reverse(CutOff) -- continued(Sources),
        missing => missing(Sources),
        lacking => Lacking
    }.

sums(#merge{messages = Messages, part = Part, until = End, order = Order}) ->
    #{
        messages => Messages,
        bytes => starl_mcap_part:written(Part),
        until_us => End,
        clocks => starl_trace_order:clocks(Order),
        moved => starl_trace_order:moved(Order)
    }.

shared(HasWorld, #source{kind = Kind, messages = Messages} = Source) ->
    taken(Messages, Source#source{share = starl_trace_merge_selection:new(Kind, HasWorld)}).

taken(Messages, #source{share = Share} = Source) ->
    {Taken, Next} = starl_trace_merge_selection:take(Messages, Share),
    Source#source{messages = Taken, share = Next}.

has_world(Sources) -> lists:any(fun(#source{kind = Kind}) -> Kind =:= world end, Sources).

begin_us(Sources) ->
    lists:min([maps:get(begun_us, Facts, 0) || #source{facts = Facts} <- Sources]).

%% The facts of the world, or those of the first robot.
facts([#source{facts = First} | _] = Sources) ->
    Facts = maps:remove(was_up, First),
    Facts#{
        told_by => robots(Sources), has_motions => has_world(Sources), begun_us => begin_us(Sources)
    }.

robots(Sources) ->
    lists:usort(lists:append([maps:get(told_by, Facts, []) || #source{facts = Facts} <- Sources])).

missing([#source{facts = #{robots := All}} | _] = Sources) ->
    [Id || {Id, _} <- All] -- robots(Sources).

%% What is missing of a robot's file that was cut off, if no next file has it.
open_ends(Sources) ->
    Files = [File || #source{file = File} <- Sources],
    maps:from_keys(Files -- continued(Sources), no_end).

continued(Sources) ->
    starl_trace_robot:continued([
        {File, Facts}
     || #source{facts = #{told_by := _} = Facts, file = File} <- Sources
    ]).

%% Takes the earliest messages of all files, file by file. Of a robot with several files a later one waits
%% until the one before has ended, whatever the clock was set to meanwhile.
all([], Merge) ->
    Merge;
all(_Sources, #merge{has_world = true, ended = #{}} = Merge) ->
    Merge;
all(Sources, Merge) ->
    {Waiting, Ready} = lists:partition(fun(Source) -> waits(Source, Sources) end, Sources),
    [#source{messages = Messages} = Source | Others] = lists:sort(fun earlier/2, Ready),
    Until =
        case Others of
            [] when Waiting =:= [] -> infinity;
            [] -> end_of(Messages);
            [#source{messages = [{_, At, _} | _]} | _] -> At
        end,
    {Now, Later} = lists:splitwith(fun({_, T, _}) -> T =< Until end, Messages),
    {Told, Known} = in_turn(Now, Source, Merge),
    {Left, Next} = filled([Source#source{messages = Later}], ordered(Source, Told, Known)),
    all(Left ++ Others ++ Waiting, Next).

end_of(Messages) -> element(2, lists:last(Messages)).

waits(#source{kind = world}, _Sources) ->
    false;
waits(#source{facts = #{told_by := By}} = Source, Sources) ->
    Order = order(Source),
    lists:any(
        fun
            (#source{facts = #{told_by := Same}} = Other) ->
                Same =:= By andalso order(Other) < Order;
            (#source{}) ->
                false
        end,
        Sources
    ).

order(#source{file = File, facts = Facts}) -> starl_trace_robot:order(File, Facts).

%% A robot does not go back in time.
in_turn(Messages, Source, #merge{told = Told} = Merge) ->
    Who = who(Source),
    {Raised, Until} = lists:mapfoldl(
        fun({Topic, At, What}, Last) -> {{Topic, max(At, Last), What}, max(At, Last)} end,
        maps:get(Who, Told, element(2, hd(Messages))),
        Messages
    ),
    {Raised, Merge#merge{told = Told#{Who => Until}}}.

who(#source{kind = world}) -> world;
who(#source{facts = #{told_by := By}}) -> By.

%% Puts those whose place is known. What comes behind the end of the world's run does not count.
ordered(Source, Messages, #merge{order = Order} = Merge) ->
    {Placed, Next} = starl_trace_order:take(who(Source), Messages, Order),
    put_placed(Placed, Merge#merge{order = Next}).

put_placed(Placed, #merge{has_world = true} = Merge) ->
    {Before, After} = lists:splitwith(fun(M) -> not is_end(M) end, Placed),
    put_messages(Before ++ lists:sublist(After, 1), Merge);
put_placed(Placed, Merge) ->
    put_messages(Placed, Merge).

earlier(#source{messages = [{_, A, _} | _]} = One, #source{messages = [{_, B, _} | _]} = Other) ->
    {A, One#source.rank} =< {B, Other#source.rank}.

%% The sources that have messages.
filled(Sources, Merge) -> lists:foldr(fun fill/2, {[], Merge}, Sources).

fill(#source{messages = [], cursor = Cursor, file = File} = Source, {Full, Merge}) ->
    case starl_trace_reader:next(Cursor) of
        {ok, Messages, Next} ->
            fill(taken(Messages, Source#source{cursor = Next}), {Full, Merge});
        {ended, closed} ->
            {Full, hole(Source, Merge, fun(Why) -> Why =/= no_end end)};
        {ended, _} ->
            Cut = Merge#merge{cut_off = [File | Merge#merge.cut_off]},
            {Full, hole(Source, Cut, fun(_Why) -> true end)};
        {error, Reason} ->
            throw({?MODULE, Reason})
    end;
fill(Source, {Full, Merge}) ->
    {[Source | Full], Merge}.

%% Behind a file that was closed there is a hole only if the next one is missing.
hole(#source{file = File} = Source, #merge{holes = Holes, told = Told} = Merge, Is) ->
    Until = maps:get(who(Source), Told, Merge#merge.until),
    ordered(Source, [{gap, Until, Why} || #{File := Why} <- [Holes], Is(Why)], Merge).

put_messages([], Merge) ->
    Merge;
put_messages(Messages, #merge{until = Until} = Merge0) ->
    {Ends, Others} = lists:partition(fun is_end/1, Messages),
    Merge = lists:foldl(fun kept/2, lists:foldl(fun ended/2, Merge0, Ends), Others),
    due(Merge#merge{until = lists:max([Until | [At || {_, At, _} <- Others]])}).

%% What robots know of packets becomes packets with their fates.
kept({ways, At, {Robot, Way}}, #merge{ways = Ways} = Merge) ->
    Merge#merge{ways = starl_packet_fates:report({At, Robot, radio, Way}, Ways)};
kept(Message, #merge{waiting = Waiting} = Merge) ->
    Merge#merge{waiting = [Message | Waiting]}.

due(#merge{due = none, until = Until} = Merge) ->
    Merge#merge{due = Until + ?DELAY_US + ?STEP_US};
due(#merge{due = Due, until = Until} = Merge) when Until < Due -> Merge;
due(#merge{until = Until} = Merge) ->
    told(Until - ?DELAY_US, Merge#merge{due = Until + ?STEP_US}).

%% Writes what has happened until then; an atom is larger than any number.
told(Until, #merge{waiting = Waiting, ways = Ways, writer = Writer, messages = N} = Merge) ->
    {Young, Old} = lists:splitwith(fun({_, At, _}) -> At > Until end, Waiting),
    {Packets, Left} = starl_packet_fates:due(Until, Ways),
    Fates = [
        {packets, At, {From, To, Brief, Bytes, Fate}}
     || {At, From, radio, {packet, To, Brief, Bytes, Fate}} <- Packets
    ],
    Messages = lists:keymerge(2, lists:reverse(Old), Fates),
    Put = put_bytes(starl_trace_writer:messages(Messages, Writer), Merge),
    Put#merge{waiting = Young, ways = Left, messages = N + length(Messages)}.

is_end({verdicts, _, {ended, _}}) -> true;
is_end(_) -> false.

%% The run has one end: the last, with what any of the files has found.
ended({_, _, {ended, Ending}}, #merge{ended = none} = Merge) ->
    Merge#merge{ended = Ending};
ended({_, _, {ended, #{violations := Violations} = Ending}}, #merge{ended = Known} = Merge) ->
    #{end_us := KnownEnd, violations := Found} = Known,
    Last =
        case Ending of
            #{end_us := End} when End > KnownEnd -> Ending;
            #{} -> Known
        end,
    Merge#merge{ended = Last#{violations := lists:usort(Found ++ Violations)}}.

finished(#merge{order = Order} = Merge) ->
    {Placed, Closed} = starl_trace_order:close(Order),
    Put = left_over(Placed, Merge#merge{order = Closed}),
    #merge{ended = Ended, until = Until} = Told = told(infinity, Put),
    End =
        case Ended of
            none -> [];
            #{end_us := EndUs} -> [{verdicts, max(EndUs, Until), {ended, Ended}}]
        end,
    Last = lists:max([Until | [At || {_, At, _} <- End]]),
    Whole = put_bytes(starl_trace_writer:messages(End, Told#merge.writer), Told),
    Finish = starl_trace_writer:finish(Whole#merge.writer),
    put_bytes({Finish, Whole#merge.writer}, Whole#merge{until = Last}).

left_over(_Placed, #merge{has_world = true, ended = #{}} = Merge) -> Merge;
left_over(Placed, Merge) -> put_placed(Placed, Merge).

put_bytes({Bytes, Writer}, #merge{part = Part} = Merge) ->
    Merge#merge{writer = Writer, part = starl_mcap_part:write(Bytes, Part)}.

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({write, _, _} = Reason) ->
    starl_mcap_part:format_error(Reason);
format_error({no_scenario, File}) ->
    io_lib:format("~ts: the recording does not begin with its scenario", [File]);
format_error({too_short, File}) ->
    starl_trace_chunks:format_error({too_short, File});
format_error({two_worlds, First, File}) ->
    Line = "~ts: like ~ts the recording of a whole run; merge takes those of its robots",
    io_lib:format(Line, [File, First]);
format_error({duplicate, Robot, First, File}) ->
    Line = "duplicate of robot ~b: ~ts, ~ts; both tell of it at the same time, give one of them",
    io_lib:format(Line, [Robot, First, File]);
format_error({other_run, First, File, Key}) ->
    Line = "~ts: not of the run of ~ts (another ~ts); merge takes the robots of one run",
    io_lib:format(Line, [File, First, Key]);
format_error(Reason) ->
    starl_trace_reader:format_error(Reason).
