%% @doc Encodes and decodes JSON. It serves recordings, reports, the rows and commands of the
%% window, and the messages of a body that is a program.
%% ```
%%   1> iolist_to_binary(starl_json:encode(#{op => drive, legs => [1, 2.5]})).
%%   <<"{\"legs\":[1,2.5],\"op\":\"drive\"}">>
%%   2> starl_json:decode(<<"[true]">>).
%%   {ok, [true]}
%% '''
%% The encoder is here, so its output is the same whatever library is available. Input from outside
%% is decoded by `jsx' or OTP's own `json' (OTP 27 and newer).
-module(starl_json).

-export([encode/1, encode/2, pretty/1, decode/1, codec/0]).

-export_type([value/0, key/0]).

-type value() ::
    number()
    | {float(), Decimals :: 0..15}
    | atom()
    | binary()
    | [value()]
    | #{key() => value()}
    | {[{key(), value()}]}
    | [{key(), value()}, ...]
    | {json, iodata()}.
%% Lists are arrays, binaries and atoms are texts, but `true', `false' and `null'. Objects are maps, which are
%% written in the order of their keys, or pairs, which keep theirs: a list that is not empty and does
%% not begin with a key `json', or any list in a tuple. A float may say its decimals; `json' is a text that is JSON already.

-type key() :: atom() | binary().

%% Larger numbers have an exponent; smaller whole ones are exact.
-define(READABLE, 1.0e15).

-define(PLAIN(C), (C >= $\s andalso C =/= $" andalso C =/= $\\ andalso C < 16#7f)).

%% @doc A value in one line; floats have as few digits as tell them apart.
-spec encode(value()) -> iodata().
encode(Value) -> written(Value, [short]).

%% @doc A value in one line; floats have at most so many decimals.
-spec encode(value(), Decimals :: 0..15) -> iodata().
encode(Value, Decimals) -> written(Value, [{decimals, Decimals}, compact]).

written(Number, _Floats) when is_integer(Number) -> integer_to_binary(Number);
written(Number, [short]) when is_float(Number) -> short(Number);
written(Number, Floats) when is_float(Number) -> float_to_binary(Number, Floats);
written(Text, _Floats) when is_binary(Text) -> text(Text);
written(Word, _Floats) when Word =:= true; Word =:= false; Word =:= null -> atom_to_binary(Word);
written(Word, _Floats) when is_atom(Word) -> text(atom_to_binary(Word));
written([{Key, _} | _] = Pairs, Floats) when is_binary(Key); is_atom(Key), Key =/= json ->
    object(Pairs, Floats);
written([], _Floats) ->
    <<"[]">>;
written([First | Others], Floats) ->
    [$[, written(First, Floats), [[$,, written(Other, Floats)] || Other <- Others], $]];
written(Map, Floats) when is_map(Map) -> object(lists:sort(maps:to_list(Map)), Floats);
written({json, Text}, _Floats) ->
    Text;
written({Number, Decimals}, _Floats) ->
    float_to_binary(Number, [{decimals, Decimals}, compact]);
written({Pairs}, Floats) ->
    object(Pairs, Floats).

%% Erlang writes 2.0e3, which people do not read as a length.
short(Number) when abs(Number) < ?READABLE, trunc(Number) == Number ->
    float_to_binary(Number, [{decimals, 1}]);
short(Number) ->
    float_to_binary(Number, [short]).

object([], _Floats) ->
    <<"{}">>;
object([First | Pairs], Floats) ->
    [${, pair(First, Floats), [[$,, pair(Pair, Floats)] || Pair <- Pairs], $}].

pair({Key, Value}, Floats) when is_atom(Key) ->
    [$", atom_to_binary(Key), $", $:, written(Value, Floats)];
pair({Key, Value}, Floats) ->
    [text(Key), $:, written(Value, Floats)].

%% Most texts need no escape.
text(Text) ->
    case is_plain(Text) of
        true -> [$", Text, $"];
        false -> [$", escaped(Text), $"]
    end.

is_plain(<<A, B, C, D, Rest/binary>>) when ?PLAIN(A), ?PLAIN(B), ?PLAIN(C), ?PLAIN(D) ->
    is_plain(Rest);
is_plain(<<C, Rest/binary>>) when ?PLAIN(C) -> is_plain(Rest);
is_plain(Rest) ->
    Rest =:= <<>>.

escaped(<<$", Rest/binary>>) -> [<<"\\\"">> | escaped(Rest)];
escaped(<<$\\, Rest/binary>>) -> [<<"\\\\">> | escaped(Rest)];
escaped(<<C/utf8, Rest/binary>>) when C >= $\s, C =/= 16#7f -> [<<C/utf8>> | escaped(Rest)];
escaped(<<C, Rest/binary>>) -> [io_lib:format("\\u~4.16.0b", [C]) | escaped(Rest)];
escaped(<<>>) -> [].

%% @doc An object, one line per pair.
-spec pretty([{atom(), value()}, ...]) -> iolist().
pretty(Object) ->
    Lines = [["  ", text(atom_to_binary(Key)), ": ", encode(Value)] || {Key, Value} <- Object],
    ["{\n", lists:join(",\n", Lines), "\n}\n"].

%% @doc Reads a text from outside; keys stay binaries.
-spec decode(binary()) -> {ok, value()} | error.
decode(Text) ->
    try read(codec(), Text) of
        Value -> {ok, Value}
    catch
        error:_ -> error
    end.

%% @doc The library at hand. A module that is not there is looked for in all directories each time, so only
%% one is asked for.
-spec codec() -> jsx | json.
codec() ->
    case code:ensure_loaded(jsx) of
        {module, jsx} -> jsx;
        {error, _} -> json
    end.

read(jsx = Jsx, Text) -> Jsx:decode(Text, [return_maps]);
read(json = Json, Text) -> Json:decode(Text).
