%% @doc Makes one recording of those of several robots of a run, by time. The robots must share a
%% clock: their recordings have one scenario and one beginning. Memory holds about a second of each
%% file.
-module(starl_trace_merge).

-export([files/2, format_error/1]).

-export_type([merged/0, reason/0]).

-type merged() :: #{
    messages := non_neg_integer(),
    bytes := non_neg_integer(),
    until_us := integer(),
    cut_off := [file:filename_all()]
}.

-type reason() ::
    starl_trace_reader:reason()
    | {write, file:filename_all(), file:posix() | badarg | terminated | system_limit}
    | {no_scenario, file:filename_all()}
    | {other_run, file:filename_all(), file:filename_all(), Key :: atom()}.

%% A file: its number, the messages that wait, its cursor.
-type source() :: {
    pos_integer(), file:filename_all(), [starl_trace_message:t()], starl_trace_reader:cursor()
}.

-record(merge, {
    out :: file:filename_all(),
    device :: file:io_device(),
    writer :: starl_trace_writer:t(),
    messages = 0 :: non_neg_integer(),
    bytes = 0 :: non_neg_integer(),
    until = 0 :: integer(),
    ended = none :: starl_observer:ending() | none,
    cut_off = [] :: [file:filename_all()]
}).

%% @doc Merges recordings into a file.
-spec files([file:filename_all(), ...], Out :: file:filename_all()) ->
    {ok, merged()} | {error, reason()}.
files(Files, Out) ->
    try
        Sources = [begun(N, File) || {N, File} <- lists:zip(lists:seq(1, length(Files)), Files)],
        try
            checked(Sources, Out)
        after
            lists:foreach(fun({_, _, _, Cursor}) -> starl_trace_reader:stop(Cursor) end, Sources)
        end
    catch
        throw:{?MODULE, Reason} -> {error, Reason}
    end.

-spec begun(pos_integer(), file:filename_all()) -> source().
begun(N, File) ->
    case starl_trace_reader:start(File) of
        {ok, Cursor} -> first(starl_trace_reader:next(Cursor), N, File);
        {error, Reason} -> throw({?MODULE, Reason})
    end.

first({ok, [{scenario, _, _} | _] = Messages, Next}, N, File) -> {N, File, Messages, Next};
first({error, Reason}, _N, _File) -> throw({?MODULE, Reason});
first(_Other, _N, File) -> throw({?MODULE, {no_scenario, File}}).

%% The recordings of one run have the same facts.
checked([{_, First, [{scenario, _, Facts} | _], _} | Others] = Sources, Out) ->
    _ = [
        throw({?MODULE, {other_run, First, File, Key}})
     || {_, File, [{scenario, _, Other} | _], _} <- Others,
        Key <- [app, kind, scenario, epoch_us],
        maps:get(Key, Facts, none) =/= maps:get(Key, Other, none)
    ],
    Part = unicode:characters_to_list([Out, ".part"]),
    case file:open(Part, [write, raw, binary]) of
        {ok, Device} -> written(Sources, Part, Out, Device);
        {error, Posix} -> {error, {write, Out, Posix}}
    end.

written([{_, _, [Scenario | _], _} | _] = Sources, Part, Out, Device) ->
    {Head, Writer} = starl_trace_writer:new(),
    Merge = put_bytes(Head, #merge{out = Out, device = Device, writer = Writer}),
    Rests = [{N, File, Rest, Cursor} || {N, File, [_ | Rest], Cursor} <- Sources],
    try
        Merged = all([S || R <- Rests, S <- filled(R)], put_messages([Scenario], Merge)),
        placed(finished(Merged), Part)
    catch
        throw:{?MODULE, _} = Thrown ->
            _ = file:delete(Part),
            throw(Thrown)
    after
        file:close(Device)
    end.

placed(#merge{out = Out} = Merge, Part) ->
    case file:rename(Part, Out) of
        ok ->
            {ok, #{
                messages => Merge#merge.messages,
                bytes => Merge#merge.bytes,
                until_us => Merge#merge.until,
                cut_off => lists:reverse(Merge#merge.cut_off)
            }};
        {error, Posix} ->
            {error, {write, Out, Posix}}
    end.

%% Takes the earliest messages of all files, file by file.
all([], Merge) ->
    Merge;
all(Sources, Merge) ->
    [{N, File, Messages, Cursor} | Others] = lists:sort(fun earlier/2, Sources),
    Until =
        case Others of
            [] -> infinity;
            [{_, _, [{_, At, _} | _], _} | _] -> At
        end,
    {Now, Later} = lists:splitwith(fun({_, T, _}) -> T =< Until end, Messages),
    {Left, Next} = refilled({N, File, Later, Cursor}, put_messages(Now, Merge)),
    all(Left ++ Others, Next).

earlier({N, _, [{_, A, _} | _], _}, {M, _, [{_, B, _} | _], _}) -> {A, N} =< {B, M}.

filled(Source) ->
    case more(Source) of
        {ok, Filled} -> [Filled];
        {ended, _} -> []
    end.

refilled({_, File, _, _} = Source, #merge{cut_off = CutOff} = Merge) ->
    case more(Source) of
        {ok, Filled} -> {[Filled], Merge};
        {ended, closed} -> {[], Merge};
        {ended, _} -> {[], Merge#merge{cut_off = [File | CutOff]}}
    end.

more({_, _, [_ | _], _} = Source) ->
    {ok, Source};
more({N, File, [], Cursor}) ->
    case starl_trace_reader:next(Cursor) of
        {ok, Messages, Next} -> more({N, File, wanted(Messages), Next});
        {ended, Ended} -> {ended, Ended};
        {error, Reason} -> throw({?MODULE, Reason})
    end.

%% Counts of one robot do not add up to those of the team.
wanted(Messages) -> [M || M <- Messages, element(1, M) =/= metrics, element(1, M) =/= scenario].

put_messages(Messages, Merge) ->
    {Ends, Others} = lists:partition(fun is_end/1, Messages),
    #merge{writer = Writer, messages = N, until = Until} =
        Ended = lists:foldl(fun ended/2, Merge, Ends),
    {Bytes, Next} = starl_trace_writer:messages(Others, Writer),
    put_bytes(Bytes, Ended#merge{
        writer = Next,
        messages = N + length(Others),
        until = lists:max([Until | [At || {_, At, _} <- Others]])
    }).

is_end({verdicts, _, {ended, _}}) -> true;
is_end(_) -> false.

%% The run has one end: the last, with what any of the files has found.
ended({_, _, {ended, Ending}}, #merge{ended = none} = Merge) ->
    Merge#merge{ended = Ending};
ended(
    {_, _, {ended, #{end_us := End, violations := Violations} = Ending}}, #merge{ended = Known} = M
) ->
    #{end_us := KnownEnd, violations := Found} = Known,
    Last =
        case End > KnownEnd of
            true -> Ending;
            false -> Known
        end,
    M#merge{ended = Last#{violations := lists:usort(Found ++ Violations)}}.

finished(#merge{ended = none, writer = Writer} = Merge) ->
    put_bytes(starl_trace_writer:finish(Writer), Merge);
finished(#merge{ended = #{end_us := End} = Ending, until = Until} = Merge) ->
    Message = {verdicts, max(End, Until), {ended, Ending}},
    {Bytes, Writer} = starl_trace_writer:messages([Message], Merge#merge.writer),
    Put = put_bytes(Bytes, Merge#merge{until = max(End, Until)}),
    put_bytes(starl_trace_writer:finish(Writer), Put).

put_bytes(Bytes, #merge{device = Device, bytes = Written, out = Out} = Merge) ->
    case file:write(Device, Bytes) of
        ok -> Merge#merge{bytes = Written + iolist_size(Bytes)};
        {error, Posix} -> throw({?MODULE, {write, Out, Posix}})
    end.

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({write, Out, Posix}) ->
    io_lib:format("~ts: ~ts", [Out, file:format_error(Posix)]);
format_error({no_scenario, File}) ->
    io_lib:format("~ts: the recording does not begin with its scenario", [File]);
format_error({other_run, First, File, Key}) ->
    Line = "~ts: not of the run of ~ts (another ~ts); merge takes the robots of one run",
    io_lib:format(Line, [File, First, Key]);
format_error(Reason) ->
    starl_trace_reader:format_error(Reason).
