%% @doc Reads a recording: its messages in the order of time.
%% ```
%%   {ok, Moves, _} = starl_trace_reader:fold(
%%       fun({poses, _, _}, N) -> N + 1; (_, N) -> N end, 0, "run.mcap"),
%%   {ok, Cursor} = starl_trace_reader:start("run.mcap", 60000000),
%%   {ok, Messages, Next} = starl_trace_reader:next(Cursor)
%% '''
%% A file that was cut off is read to its last whole chunk. The recording leaves out positions that
%% follow from the motions in its trace. They are computed here, so the messages are those that the
%% run reported.
%%
%% Reading may begin at any time. Then only the chunks are opened that are needed: the first, which
%% holds the scenario, those since the last account of all motions ({@link
%% starl_trace_poses:places()}), which a recording has every ten seconds, and those that are read.
-module(starl_trace_reader).

-export([fold/3, start/1, start/2, next/1, stop/1, opened/1, tail/1, format_error/1]).

-export_type([cursor/0, reason/0, ended/0, tail/0]).

-record(cursor, {
    chunks :: starl_trace_chunks:t(),
    %% messages that were read already
    ready = [] :: [starl_trace_message:t()],
    poses = starl_trace_poses:new() :: starl_trace_poses:t(),
    derived = false :: boolean()
}).

-opaque cursor() :: #cursor{}.

-type ended() :: starl_trace_chunks:ended().

-type reason() :: starl_trace_chunks:reason().

%% The end of a recording: its scenario, the last trace events of its machines, and the time of its
%% last message.
-type tail() :: #{
    scenario := starl_trace_message:scenario(),
    trace := [starl_trace_lost_facts:traced()],
    until_us := integer(),
    ended := ended()
}.

%% @doc Folds a function over the messages of a recording.
-spec fold(fun((starl_trace_message:t(), Acc) -> Acc), Acc, file:filename_all()) ->
    {ok, Acc, ended()} | {error, reason()}.
fold(Fun, Acc, File) ->
    case start(File) of
        {ok, Cursor} -> folded(Fun, Acc, Cursor);
        {error, _} = Error -> Error
    end.

folded(Fun, Acc, Cursor) ->
    case next(Cursor) of
        {ok, Messages, Next} ->
            folded(Fun, lists:foldl(Fun, Acc, Messages), Next);
        {ended, Ended} ->
            ok = stop(Cursor),
            {ok, Acc, Ended};
        {error, _} = Error ->
            ok = stop(Cursor),
            Error
    end.

%% @doc Opens a recording at its beginning, to read it piece by piece.
-spec start(file:filename_all()) -> {ok, cursor()} | {error, reason()}.
start(File) ->
    case starl_trace_chunks:open(File) of
        {ok, Chunks} -> {ok, #cursor{chunks = Chunks}};
        {error, _} = Error -> Error
    end.

%% @doc Closes a recording.
-spec stop(cursor()) -> ok.
stop(#cursor{chunks = Chunks}) -> starl_trace_chunks:close(Chunks).

%% @doc The number of chunks that were opened so far.
-spec opened(cursor()) -> non_neg_integer().
opened(#cursor{chunks = Chunks}) -> starl_trace_chunks:opened(Chunks).

%% @doc The next messages, of about a second.
-spec next(cursor()) ->
    {ok, [starl_trace_message:t()], cursor()} | {ended, ended()} | {error, reason()}.
next(#cursor{ready = [_ | _] = Messages} = Cursor) ->
    {ok, Messages, Cursor#cursor{ready = []}};
next(#cursor{chunks = Chunks} = Cursor) ->
    case starl_trace_chunks:next(Chunks) of
        {ok, Messages, Left} -> whole(Messages, Cursor#cursor{chunks = Left});
        Other -> Other
    end.

whole(Messages, Cursor) ->
    case with_poses(Messages, [], Cursor) of
        {[], Next} -> next(Next);
        {Whole, Next} -> {ok, Whole, Next}
    end.

%% -- positions ------------------------------------------------------------------------------

with_poses([], Messages, Cursor) ->
    {lists:reverse(Messages), Cursor};
with_poses([{poses, _, _} | Messages], Before, #cursor{derived = true} = Cursor) ->
    with_poses(Messages, Before, Cursor);
with_poses([{places, _, _} | Messages], Before, Cursor) ->
    with_poses(Messages, Before, Cursor);
with_poses([Message | Messages], Before, #cursor{poses = Poses} = Cursor) ->
    {Samples, Sampled} = starl_trace_poses:sample(until(Message), Poses),
    {Next, Derived} = motion(Message, Sampled, Cursor#cursor.derived),
    With = [Message | lists:reverse(Samples, Before)],
    with_poses(Messages, With, Cursor#cursor{poses = Next, derived = Derived}).

%% The last sample of a run is at its very end.
until({verdicts, At, {ended, _}}) -> At + 1;
until({_, At, _}) -> At.

motion({trace, At, {Robot, chassis, {motion, _} = Motion}}, Poses, _Derived) ->
    {starl_trace_poses:event({At, Robot, chassis, Motion}, Poses), true};
motion({trace, At, {Robot, chassis, Event}}, Poses, Derived) ->
    {starl_trace_poses:event({At, Robot, chassis, Event}, Poses), Derived};
motion(_Message, Poses, Derived) ->
    {Poses, Derived}.

%% -- from a time on -------------------------------------------------------------------------

%% @doc Opens a recording at a time. The scenario comes first, then the places of all robots at that
%% time, if they follow from their motions; then come the messages from that time on.
-spec start(file:filename_all(), FromUs :: integer()) -> {ok, cursor()} | {error, reason()}.
start(File, From) ->
    first(File, fun(Scenario, Chunks) ->
        {All, _Ended} = starl_trace_chunks:list(Chunks),
        {Before, Later} = lists:splitwith(fun({_, End, _}) -> End < 1000 * From end, All),
        Needed = lists:sublist(Later, 1) ++ lists:reverse(Before),
        HasPlaces = fun(Messages) -> has_places(From, Messages) end,
        {Messages, After} = back(Needed, HasPlaces, Chunks),
        {ok, begun(From, Scenario, Messages, #cursor{chunks = After})}
    end).

has_places(From, Messages) ->
    lists:any(fun(M) -> element(1, M) =:= places andalso element(2, M) =< From end, Messages).

%% Opens a recording and reads its first chunk.
first(File, Fun) ->
    case starl_trace_chunks:open(File) of
        {ok, Chunks} -> first(starl_trace_chunks:next(Chunks), Chunks, Fun);
        {error, _} = Error -> Error
    end.

first({ok, [{scenario, _, _} = Scenario | _], Next}, _Chunks, Fun) ->
    Fun(Scenario, Next);
first(Other, Chunks, _Fun) ->
    ok = starl_trace_chunks:close(Chunks),
    case Other of
        {error, _} = Error -> Error;
        _ -> {error, {no_recording, starl_trace_chunks:file(Chunks)}}
    end.

%% Reads chunks, the latest first, until one has what is wanted: the messages of all of them, and the
%% file at the place after the latest.
back(List, IsEnough, Chunks) -> back(List, IsEnough, [], here, Chunks).

back([], _IsEnough, Later, Place, Chunks) ->
    {Later, resumed(Place, Chunks)};
back([{_, _, Position} | Earlier], IsEnough, Later, Place, Chunks) ->
    case starl_trace_chunks:chunk(starl_trace_chunks:at(Position, Chunks)) of
        {ok, Messages, After} when Place =:= here ->
            back(Messages, Earlier, IsEnough, Later, starl_trace_chunks:place(After), After);
        {ok, Messages, After} ->
            back(Messages, Earlier, IsEnough, Later, Place, After);
        _Damaged when Place =:= here ->
            {Later, starl_trace_chunks:at(Position, Chunks)};
        _Damaged ->
            {Later, resumed(Place, Chunks)}
    end.

back(Messages, Earlier, IsEnough, Later, Place, Chunks) ->
    case IsEnough(Messages) of
        true -> {Messages ++ Later, resumed(Place, Chunks)};
        false -> back(Earlier, IsEnough, Messages ++ Later, Place, Chunks)
    end.

resumed(here, Chunks) -> Chunks;
resumed(Place, Chunks) -> starl_trace_chunks:at(Place, Chunks).

%% The messages before that time only tell where the robots are.
begun(From, Scenario, Messages, Cursor0) ->
    {Before, After} = lists:partition(fun(M) -> is_before(From, M) end, Messages),
    {Since, Restored} = restored(lists:reverse(Before), [], Cursor0),
    {_, #cursor{poses = Poses} = Cursor} = with_poses(Since, [], Restored),
    {_, Sampled} = starl_trace_poses:sample(From, Poses),
    Places = [starl_trace_poses:full(From, Sampled) || Cursor#cursor.derived],
    {Later, Next} = with_poses(
        [M || M <- After, element(1, M) =/= scenario], [], Cursor#cursor{poses = Sampled}
    ),
    Next#cursor{ready = [Scenario | Places] ++ Later}.

is_before(From, {places, At, _}) -> At =< From;
is_before(From, {_, At, _}) -> At < From.

%% The messages since the last account of the motions.
restored([], Since, Cursor) ->
    {Since, Cursor};
restored([{places, At, Places} | _], Since, Cursor) ->
    {Since, Cursor#cursor{poses = starl_trace_poses:restore(At, Places), derived = true}};
restored([Message | Earlier], Since, Cursor) ->
    restored(Earlier, [Message | Since], Cursor).

%% -- the end --------------------------------------------------------------------------------

%% @doc The end of a recording, read from its last chunks.
-spec tail(file:filename_all()) -> {ok, tail()} | {error, reason()}.
tail(File) ->
    first(File, fun(Scenario, Chunks) ->
        {All, Ended} = starl_trace_chunks:list(Chunks),
        HasTrace = fun(Messages) -> lists:keymember(trace, 1, Messages) end,
        {Messages, After} = back(lists:reverse(All), HasTrace, Chunks),
        ok = starl_trace_chunks:close(After),
        {scenario, _, Facts} = Scenario,
        {ok, #{
            scenario => Facts,
            trace => [{M, E} || {trace, _, {_, M, E}} <- Messages],
            until_us => lists:max([element(2, Message) || Message <- [Scenario | Messages]]),
            ended => Ended
        }}
    end).

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error(Reason) -> starl_trace_chunks:format_error(Reason).
