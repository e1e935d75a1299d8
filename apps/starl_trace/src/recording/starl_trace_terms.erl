%% @doc Writes Erlang terms into a recording and reads them back unchanged. The form is the external
%% term format, compressed, in base64, as a JSON object `{"terms":"..."}'.
%%
%% A recording comes from anywhere. Reading creates no functions. It creates no new atoms either,
%% except a bounded number in this VM: those of an application that is not loaded here. A text that
%% claims to be larger unpacked than a bound is refused.
-module(starl_trace_terms).

-export([encode/1, decode/1]).

-export_type([reason/0]).

-type reason() :: not_terms | too_large | too_many_atoms.

-define(HEAD, "{\"terms\":\"").
-define(TAIL, "\"}").
%% The bytes of a term, which may take sixteen times as many in memory, and the new atoms.
-define(MOST_BYTES, 32 * 1024 * 1024).
-define(MOST_ATOMS, 10000).
-define(LEVEL, 4).

%% @doc The text of a term.
-spec encode(term()) -> iolist().
encode(Term) ->
    [?HEAD, base64:encode(term_to_binary(Term, [{compressed, ?LEVEL}])), ?TAIL].

%% @doc The term of a text.
-spec decode(binary()) -> {ok, term()} | {error, reason()}.
decode(<<?HEAD, Rest/binary>>) when byte_size(Rest) >= 2 ->
    case split_binary(Rest, byte_size(Rest) - 2) of
        {Text, <<?TAIL>>} -> bytes(Text);
        _ -> {error, not_terms}
    end;
decode(_Other) ->
    {error, not_terms}.

bytes(Text) ->
    try base64:decode(Text) of
        Bytes -> unpacked(Bytes)
    catch
        error:_ -> {error, not_terms}
    end.

unpacked(<<131, 80, Size:32, _/binary>>) when Size > ?MOST_BYTES -> {error, too_large};
unpacked(<<131, 80, Size:32, Packed/binary>>) -> inflated(Size, Packed);
unpacked(<<131, _/binary>> = Bytes) -> term(Bytes);
unpacked(_) -> {error, not_terms}.

%% Unpacked here, since the size in front may lie.
inflated(Size, Packed) ->
    Stream = zlib:open(),
    try
        ok = zlib:inflateInit(Stream),
        inflate(zlib:safeInflate(Stream, Packed), Size, [], Stream)
    catch
        error:_ -> {error, not_terms}
    after
        zlib:close(Stream)
    end.

inflate({More, Bytes}, Left0, Got, Stream) ->
    Left = Left0 - iolist_size(Bytes),
    case More of
        _ when Left < 0 -> {error, too_large};
        finished -> term(iolist_to_binary([131, lists:reverse(Got, [Bytes])]));
        continue -> inflate(zlib:safeInflate(Stream, []), Left, [Bytes | Got], Stream)
    end.

term(Bytes) ->
    try
        {ok, binary_to_term(Bytes, [safe])}
    catch
        error:badarg -> with_atoms(Bytes)
    end.

%% Atoms that are not known here are made, as long as there is room.
with_atoms(Bytes) ->
    case starl_trace_atoms:make(Bytes, ?MOST_ATOMS) of
        ok ->
            try
                {ok, binary_to_term(Bytes, [safe])}
            catch
                error:badarg -> {error, not_terms}
            end;
        {error, _} = Error ->
            Error
    end.
