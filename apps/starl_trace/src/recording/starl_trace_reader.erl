%% @doc Reads a recording: its messages in the order of time.
%% ```
%%   {ok, Moves, _} = starl_trace_reader:fold(
%%       fun({poses, _, _}, N) -> N + 1; (_, N) -> N end, 0, "run.mcap")
%% '''
%% A file that was cut off is read to its last whole chunk. Positions that the recording leaves out,
%% since they follow from the motions in its trace, are computed here: the messages are those that
%% the run told.
-module(starl_trace_reader).

-export([fold/3, start/1, next/1, stop/1, info/1, format_error/1]).

-export_type([cursor/0, reason/0, ended/0, info/0]).

-record(cursor, {
    file :: file:filename_all(),
    reader :: starl_mcap_reader:t(),
    position :: starl_mcap_reader:position(),
    %% channels of the recording's own messages
    channels = [] :: [starl_mcap_record:id()],
    poses = starl_trace_poses:new() :: starl_trace_poses:t(),
    derived = false :: boolean(),
    count = 0 :: non_neg_integer(),
    last = 0 :: integer(),
    ended = closed :: ended()
}).

-opaque cursor() :: #cursor{}.

%% How the file ends: it was closed; it is cut off; from this byte on it is damaged.
-type ended() :: closed | cut_off | {damaged, starl_mcap_reader:position()}.

-type reason() ::
    starl_mcap_reader:reason()
    | {no_recording, file:filename_all()}
    | {terms, file:filename_all(), starl_trace_terms:reason()}.

%% Figures of any MCAP file. Times are those of its clock, in microseconds.
-type info() :: #{
    file := file:filename_all(),
    bytes := non_neg_integer(),
    library := binary(),
    ended := ended(),
    chunks := non_neg_integer(),
    compressions := [binary()],
    from_us := integer(),
    to_us := integer(),
    topics := [{Topic :: binary(), Schema :: binary(), Messages :: non_neg_integer()}]
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
    case starl_mcap_reader:open(File) of
        {ok, Reader} ->
            First = starl_mcap_reader:first(Reader),
            {ok, #cursor{file = File, reader = Reader, position = First}};
        {error, _} = Error ->
            Error
    end.

%% @doc Closes a recording.
-spec stop(cursor()) -> ok.
stop(#cursor{reader = Reader}) -> starl_mcap_reader:close(Reader).

%% @doc The next messages, of about a second.
-spec next(cursor()) ->
    {ok, [starl_trace_message:t()], cursor()} | {ended, ended()} | {error, reason()}.
next(#cursor{reader = Reader, position = Position} = Cursor) ->
    case starl_mcap_reader:next(Position, Reader) of
        {ok, {chunk, _, _, _, _, _, _} = Chunk, After} ->
            chunk(starl_mcap_chunk:records(Chunk), Cursor#cursor{position = After});
        {ok, {data_end, _}, _} ->
            ended(closed, Cursor);
        {ok, {footer, _, _, _}, _} ->
            ended(closed, Cursor);
        {ok, Record, After} ->
            messages([Record], Cursor#cursor{position = After});
        'end' ->
            ended(cut_off, Cursor);
        {cut, _} ->
            ended(cut_off, Cursor);
        {error, {damaged, _, At, _}} ->
            ended({damaged, At}, Cursor);
        {error, _} = Error ->
            Error
    end.

chunk({ok, Records}, Cursor) ->
    messages(Records, Cursor);
chunk({error, {compression, _} = Reason}, #cursor{file = File, position = Position}) ->
    {error, {damaged, File, Position, Reason}};
chunk({error, _}, #cursor{position = Position} = Cursor) ->
    ended({damaged, Position}, Cursor).

%% A file without one message is no recording of ours, unless it was cut off before the first.
ended(Ended, #cursor{count = 0, file = File, channels = []}) when Ended =:= closed ->
    {error, {no_recording, File}};
ended(Ended, _Cursor) ->
    {ended, Ended}.

messages(Records, #cursor{channels = Known} = Cursor) ->
    New = [Id || {channel, Id, _, <<"/starl">>, <<"json">>, _} <- Records],
    Channels = lists:usort(New ++ Known),
    Texts = [
        Data
     || {message, Channel, _, _, _, Data} <- Records, lists:member(Channel, Channels)
    ],
    terms(Texts, [], Cursor#cursor{channels = Channels}).

terms([], [], Cursor) ->
    next(Cursor);
terms([], Messages, Cursor) ->
    {ok, Messages, Cursor};
terms([Text | Texts], Before, #cursor{file = File} = Cursor) ->
    case starl_trace_terms:decode(Text) of
        {ok, Messages} ->
            case
                is_list(Messages) andalso lists:all(fun starl_trace_message:is_message/1, Messages)
            of
                true -> whole(Messages, Texts, Before, Cursor);
                false -> {error, {terms, File, not_terms}}
            end;
        {error, Reason} ->
            {error, {terms, File, Reason}}
    end.

whole(Messages, Texts, Before, #cursor{count = Count} = Cursor) ->
    {Whole, Next} = with_poses(Messages, [], Cursor#cursor{count = Count + length(Messages)}),
    terms(Texts, Before ++ Whole, Next).

%% -- positions ------------------------------------------------------------------------------

with_poses([], Messages, Cursor) ->
    {lists:reverse(Messages), Cursor};
with_poses([{poses, _, _} | Messages], Before, #cursor{derived = true} = Cursor) ->
    with_poses(Messages, Before, Cursor);
with_poses([{_, At, _} = Message | Messages], Before, #cursor{poses = Poses} = Cursor) ->
    {Samples, Sampled} = starl_trace_poses:sample(until(Message), Poses),
    {Next, Derived} = motion(Message, Sampled, Cursor#cursor.derived),
    With = [Message | lists:reverse(Samples, Before)],
    with_poses(Messages, With, Cursor#cursor{poses = Next, derived = Derived, last = At}).

%% The last sample of a run is at its very end.
until({verdicts, At, {ended, _}}) -> At + 1;
until({_, At, _}) -> At.

motion({trace, At, {Robot, chassis, {motion, _} = Motion}}, Poses, _Derived) ->
    {starl_trace_poses:event({At, Robot, chassis, Motion}, Poses), true};
motion({trace, At, {Robot, chassis, Event}}, Poses, Derived) ->
    {starl_trace_poses:event({At, Robot, chassis, Event}, Poses), Derived};
motion(_Message, Poses, Derived) ->
    {Poses, Derived}.

%% -- figures --------------------------------------------------------------------------------

%% @doc The figures of an MCAP file, ours or another.
-spec info(file:filename_all()) -> {ok, info()} | {error, reason()}.
info(File) ->
    case starl_mcap_reader:open(File) of
        {ok, Reader} ->
            Info = #{
                file => File,
                bytes => starl_mcap_reader:size(Reader),
                library => <<>>,
                ended => closed,
                chunks => 0,
                compressions => [],
                from_us => none,
                to_us => 0,
                schemas => #{},
                channels => #{},
                counts => #{}
            },
            Answer = scan(starl_mcap_reader:first(Reader), Reader, Info),
            ok = starl_mcap_reader:close(Reader),
            Answer;
        {error, _} = Error ->
            Error
    end.

scan(Position, Reader, Info) ->
    case starl_mcap_reader:next(Position, Reader) of
        {ok, {data_end, _}, _} -> {ok, figures(Info)};
        {ok, {footer, _, _, _}, _} -> {ok, figures(Info)};
        {ok, Record, After} -> scan(After, Reader, seen(Record, Position, Info));
        {error, {damaged, _, At, _}} -> {ok, figures(Info#{ended := {damaged, At}})};
        {error, _} = Error -> Error;
        _Cut -> {ok, figures(Info#{ended := cut_off})}
    end.

seen({header, _, Library}, _At, Info) ->
    Info#{library := Library};
seen({chunk, _, _, _, _, Compression, _} = Chunk, At, Info) ->
    #{chunks := N, compressions := Known} = Info,
    Counted = Info#{chunks := N + 1, compressions := lists:usort([Compression | Known])},
    case starl_mcap_chunk:records(Chunk) of
        {ok, Records} -> lists:foldl(fun(R, I) -> seen(R, At, I) end, Counted, Records);
        {error, _} -> Counted#{ended := {damaged, At}}
    end;
seen({schema, Id, Name, _, _}, _At, #{schemas := Schemas} = Info) ->
    Info#{schemas := Schemas#{Id => Name}};
seen({channel, Id, Schema, Topic, _, _}, _At, #{channels := Channels} = Info) ->
    Info#{channels := Channels#{Id => {Topic, Schema}}};
seen({message, Channel, _, Time, _, _}, _At, Info) ->
    #{counts := Counts, from_us := From, to_us := To} = Info,
    Us = Time div 1000,
    Info#{
        counts := Counts#{Channel => 1 + maps:get(Channel, Counts, 0)},
        %% an atom is larger than any number
        from_us := min(From, Us),
        to_us := max(To, Us)
    };
seen(_Other, _At, Info) ->
    Info.

figures(#{schemas := Schemas, channels := Channels, counts := Counts, from_us := From} = Info) ->
    Topics = lists:sort([
        {Topic, maps:get(Schema, Schemas, <<>>), maps:get(Id, Counts, 0)}
     || {Id, {Topic, Schema}} <- maps:to_list(Channels)
    ]),
    (maps:without([schemas, channels, counts], Info))#{
        topics => Topics,
        from_us :=
            if
                From =:= none -> 0;
                true -> From
            end
    }.

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({no_recording, File}) ->
    io_lib:format("~ts: an MCAP file, but not one of StarL: it has no topic /starl", [File]);
format_error({terms, File, not_terms}) ->
    io_lib:format("~ts: its topic /starl holds what no run of StarL records", [File]);
format_error({terms, File, too_large}) ->
    io_lib:format("~ts: a message of its topic /starl is too large", [File]);
format_error({terms, File, too_many_atoms}) ->
    io_lib:format("~ts: it names more than this VM takes from recordings", [File]);
format_error(Reason) ->
    starl_mcap_reader:format_error(Reason).
