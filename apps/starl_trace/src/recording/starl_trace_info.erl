%% @doc The figures of an MCAP file, ours or another.
-module(starl_trace_info).

-export([file/1]).

-export_type([t/0]).

%% Figures of any MCAP file. Times are those of its clock, in microseconds.
-type t() :: #{
    file := file:filename_all(),
    bytes := non_neg_integer(),
    library := binary(),
    ended := starl_trace_reader:ended(),
    chunks := non_neg_integer(),
    compressions := [binary()],
    from_us := integer(),
    to_us := integer(),
    topics := [{Topic :: binary(), Schema :: binary(), Messages :: non_neg_integer()}]
}.

%% @doc Reads a file and counts.
-spec file(file:filename_all()) -> {ok, t()} | {error, starl_mcap_reader:reason()}.
file(File) ->
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
            Answer = try_all(Reader, Info),
            ok = starl_mcap_reader:close(Reader),
            Answer;
        {error, _} = Error ->
            Error
    end.

try_all(Reader, Info) ->
    try
        scan(starl_mcap_reader:first(Reader), Reader, Info)
    catch
        throw:{?MODULE, Reason} -> {error, Reason}
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
    #{file := File, chunks := N, compressions := Known} = Info,
    Counted = Info#{chunks := N + 1, compressions := lists:usort([Compression | Known])},
    case starl_mcap_chunk:records(Chunk) of
        {ok, Records} -> lists:foldl(fun(R, I) -> seen(R, At, I) end, Counted, Records);
        {error, {packed, _, _} = Reason} -> throw({?MODULE, {damaged, File, At, Reason}});
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
