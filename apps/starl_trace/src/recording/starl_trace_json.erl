%% @doc Encodes JSON. A pure module; OTP has a codec of its own only from 27 on.
-module(starl_trace_json).

-export([encode/1]).

-export_type([json/0]).

-define(PLAIN(C), (C >= $\s andalso C =/= $" andalso C =/= $\\ andalso C < 16#7f)).

%% Objects are lists of pairs in a tuple; floats get so many decimals, or six; `json' is a text that
%% is JSON already.
-type json() ::
    integer()
    | float()
    | {float(), Decimals :: 0..15}
    | boolean()
    | binary()
    | {json, iodata()}
    | {[{Key :: binary() | atom(), json()}]}
    | [json()].

%% @doc The JSON text of a term.
-spec encode(json()) -> iodata().
encode(Number) when is_integer(Number) -> integer_to_binary(Number);
encode(Number) when is_float(Number) -> float_to_binary(Number, [{decimals, 6}, compact]);
encode({json, Text}) ->
    Text;
encode({Number, Decimals}) when is_float(Number) ->
    float_to_binary(Number, [{decimals, Decimals}, compact]);
encode(true) ->
    <<"true">>;
encode(false) ->
    <<"false">>;
encode(Text) when is_binary(Text) -> [$", escape(Text), $"];
encode({[]}) ->
    <<"{}">>;
encode({[First | Pairs]}) ->
    [${, pair(First), [[$,, pair(Pair)] || Pair <- Pairs], $}];
encode([]) ->
    <<"[]">>;
encode([First | Others]) ->
    [$[, encode(First), [[$,, encode(Other)] || Other <- Others], $]].

pair({Key, Value}) when is_atom(Key) -> [$", atom_to_binary(Key), $", $:, encode(Value)];
pair({Key, Value}) -> [encode(Key), $:, encode(Value)].

%% Most texts need no escape.
escape(Text) ->
    case is_plain(Text) of
        true -> Text;
        false -> escaped(Text)
    end.

is_plain(<<A, B, C, D, Rest/binary>>) when ?PLAIN(A), ?PLAIN(B), ?PLAIN(C), ?PLAIN(D) ->
    is_plain(Rest);
is_plain(<<C, Rest/binary>>) when ?PLAIN(C) -> is_plain(Rest);
is_plain(Rest) ->
    Rest =:= <<>>.

escaped(<<$", Rest/binary>>) ->
    [<<"\\\"">> | escaped(Rest)];
escaped(<<$\\, Rest/binary>>) ->
    [<<"\\\\">> | escaped(Rest)];
escaped(<<C/utf8, Rest/binary>>) when C >= $\s, C =/= 16#7f -> [<<C/utf8>> | escaped(Rest)];
escaped(<<C, Rest/binary>>) ->
    [io_lib:format("\\u~4.16.0b", [C]) | escaped(Rest)];
escaped(<<>>) ->
    [].
