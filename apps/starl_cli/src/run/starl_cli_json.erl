%% @doc Writes JSON with the library at hand: `jsx', or OTP's own `json' (OTP 27 and newer). No
%% other module depends on this choice. Both libraries are called by name, because either may be
%% absent and xref would then report an unknown call.
%%
%% A non-empty list of pairs is an object, written in this order; any other list is an array. Texts
%% are binaries.
-module(starl_cli_json).

-export([encode/1, pretty/1, codecs/0, encode/2]).

-export_type([value/0, codec/0]).

-type value() :: [{atom(), value()}, ...] | [value()] | number() | boolean() | null | binary().
-type codec() :: jsx | json.

%% @doc A value in one line.
-spec encode(value()) -> iodata().
encode(Value) -> encode(starl_json:codec(), Value).

%% @doc An object, one line per pair.
-spec pretty([{atom(), value()}, ...]) -> iolist().
pretty(Object) ->
    Lines = [
        ["  ", encode(atom_to_binary(Key)), ": ", encode(Value)]
     || {Key, Value} <- Object
    ],
    ["{\n", lists:join(",\n", Lines), "\n}\n"].

%% @doc The libraries at hand, best first.
-spec codecs() -> [codec()].
codecs() -> [Codec || Codec <- [jsx, json], code:ensure_loaded(Codec) =:= {module, Codec}].

%% @doc A value in one line, written by the given library.
-spec encode(codec(), value()) -> iodata().
encode(jsx = Jsx, Value) -> Jsx:encode(Value);
encode(json = Json, Value) -> Json:encode(Value, fun(V, Encode) -> native(Json, V, Encode) end).

native(Json, [{_, _} | _] = Object, Encode) -> Json:encode_key_value_list(Object, Encode);
native(Json, Value, Encode) -> Json:encode_value(Value, Encode).
