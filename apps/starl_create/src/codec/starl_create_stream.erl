%% @doc The sensor stream of the Open Interface: a frame each 15 ms, `19 N (id data)* checksum'. The
%% parser takes bytes in any pieces and finds the frames among any garbage.
%%
%% It knows the packets that it has asked for, so it knows each byte of a frame but the data and the
%% checksum. What does not fit is noise: one byte is dropped, and the search for a frame begins with
%% the next. So a damaged frame hides at most the frame after it.
%%
%% The sum of all bytes of a frame is 0 (mod 256). The document of the Create 1 leaves the header
%% byte out of the sum, its robots do not (reported for two drivers). The parser of a Create 1
%% believes neither before three frames in a row agree, and stays with that.
-module(starl_create_stream).

-export([frame/3, new/2, parse/2, checksum/1]).

-export_type([t/0, checksum/0, found/0]).

%% Does the checksum include the header byte? `undecided': not seen yet.
-type checksum() :: with_header | without_header | undecided.

%% What the bytes are, in their order.
-type found() :: {frame, starl_create_packet:readings()} | {noise, binary()}.

-define(HEADER, 19).
-define(AGREE, 3).

-record(stream, {
    ids :: [starl_create_packet:id()],
    %% N of a frame
    length :: byte(),
    checksum :: checksum(),
    %% the last frames' kind of checksum, and their number
    agree = {with_header, 0} :: {checksum(), non_neg_integer()},
    buffer = <<>> :: binary()
}).

-opaque t() :: #stream{}.

%% @doc A frame as a robot sends it.
-spec frame([starl_create_packet:id()], starl_create_packet:readings(), checksum()) -> binary().
frame(Ids, Readings, Checksum) ->
    Data = <<<<Id, (starl_create_packet:encode(Id, Readings))/binary>> || Id <- Ids>>,
    Body = <<(byte_size(Data)), Data/binary>>,
    Sum =
        case Checksum of
            without_header -> sum(Body);
            _ -> ?HEADER + sum(Body)
        end,
    <<?HEADER, Body/binary, (-Sum)>>.

sum(Bytes) -> lists:sum(binary_to_list(Bytes)).

%% @doc A parser of frames with these packets.
-spec new([starl_create_packet:id(), ...], starl_create_packet:model()) -> t().
new(Ids, Model) ->
    Checksum =
        case Model of
            1 -> undecided;
            2 -> with_header
        end,
    Length = length(Ids) + starl_create_packet:byte_count(Ids),
    #stream{ids = Ids, length = Length, checksum = Checksum}.

%% @doc The kind of checksum that it has found.
-spec checksum(t()) -> checksum().
checksum(#stream{checksum = Checksum}) -> Checksum.

%% @doc Takes bytes in; returns the whole frames and the noise among them.
-spec parse(binary(), t()) -> {[found()], t()}.
parse(Bytes, #stream{buffer = Before} = Stream) ->
    scan(<<Before/binary, Bytes/binary>>, <<>>, [], Stream).

scan(Buffer, Noise, Found, Stream) ->
    case candidate(Buffer, Stream) of
        no ->
            <<Byte, Rest/binary>> = Buffer,
            scan(Rest, <<Noise/binary, Byte>>, Found, Stream);
        more ->
            {lists:reverse(noise(Noise, Found)), Stream#stream{buffer = Buffer}};
        {yes, Payload, Rest} ->
            {New, Next} = summed(Payload, Stream),
            scan(Rest, <<>>, New ++ noise(Noise, Found), Next)
    end.

noise(<<>>, Found) -> Found;
noise(Noise, Found) -> [{noise, Noise} | Found].

%% Can a frame begin here?
candidate(<<?HEADER, N, Rest/binary>>, #stream{length = N, ids = Ids} = Stream) ->
    case fits(Ids, Rest) of
        yes -> whole(N, Rest, Stream);
        Other -> Other
    end;
candidate(<<?HEADER>>, _Stream) ->
    more;
candidate(<<>>, _Stream) ->
    more;
candidate(_, _Stream) ->
    no.

fits([], _Rest) ->
    yes;
fits([Id | Ids], <<Id, Rest/binary>>) ->
    Size = starl_create_packet:bytes(Id),
    case Rest of
        <<_:Size/binary, Left/binary>> -> fits(Ids, Left);
        _ -> more
    end;
fits(_, <<>>) ->
    more;
fits(_, _) ->
    no.

whole(N, Rest, #stream{checksum = Checksum}) ->
    case Rest of
        <<Data:N/binary, Sum, Left/binary>> ->
            case {(N + sum(Data) + Sum) rem 256, Checksum} of
                {16#ED, Kind} when Kind =/= without_header -> {yes, {with_header, Data}, Left};
                {0, Kind} when Kind =/= with_header -> {yes, {without_header, Data}, Left};
                _ -> no
            end;
        _ ->
            more
    end.

%% The first frames only tell the kind of checksum.
summed({Kind, Data}, #stream{checksum = undecided, agree = {Kind, N}} = Stream) when
    N + 1 >= ?AGREE
->
    {[{frame, readings(Data, Stream)}], Stream#stream{checksum = Kind}};
summed({Kind, _Data}, #stream{checksum = undecided, agree = {Kind, N}} = Stream) ->
    {[], Stream#stream{agree = {Kind, N + 1}}};
summed({Kind, _Data}, #stream{checksum = undecided} = Stream) ->
    {[], Stream#stream{agree = {Kind, 1}}};
summed({_Kind, Data}, Stream) ->
    {[{frame, readings(Data, Stream)}], Stream}.

readings(Data, #stream{ids = Ids}) -> readings(Ids, Data, #{}).

readings([], <<>>, Readings) ->
    Readings;
readings([Id | Ids], <<Id, Rest/binary>>, Readings) ->
    Size = starl_create_packet:bytes(Id),
    <<Own:Size/binary, Left/binary>> = Rest,
    readings(Ids, Left, maps:merge(Readings, starl_create_packet:decode(Id, Own))).
