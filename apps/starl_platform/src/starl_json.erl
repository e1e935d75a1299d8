%% @doc JSON between StarL and programs: the rows of the window and its commands, the words of a body
%% that is a program.
%%
%% Lists are arrays, maps are objects, binaries and atoms are texts, but `true', `false' and
%% `null'. What is written has few numbers and short texts, so it is written here; what comes from
%% outside is read by the library at hand, `jsx' or OTP's own `json' (OTP 27 and newer).
-module(starl_json).

-export([encode/1, decode/1, codec/0]).

-export_type([value/0]).

-type value() :: number() | atom() | binary() | [value()] | #{atom() | binary() => value()}.

%% @doc A value in one line.
-spec encode(value()) -> iodata().
encode(Number) when is_integer(Number) -> integer_to_binary(Number);
encode(Number) when is_float(Number) -> float_to_binary(Number, [short]);
encode(Text) when is_binary(Text) -> [$", escape(Text, Text), $"];
encode(Word) when Word =:= true; Word =:= false; Word =:= null -> atom_to_binary(Word);
encode(Word) when is_atom(Word) -> encode(atom_to_binary(Word));
encode(List) when is_list(List) -> [$[, commas([encode(V) || V <- List]), $]];
encode(Map) when is_map(Map) ->
    [${, commas([[key(K), $:, encode(V)] || {K, V} <- lists:sort(maps:to_list(Map))]), $}].

commas(Parts) -> lists:join($,, Parts).

key(Key) when is_atom(Key) -> encode(atom_to_binary(Key));
key(Key) -> encode(Key).

%% Most texts have nothing to escape.
escape(<<C, Rest/binary>>, Whole) when C >= 32, C < 127, C =/= $", C =/= $\\ ->
    escape(Rest, Whole);
escape(<<>>, Whole) ->
    Whole;
escape(_, Whole) ->
    [escaped(C) || C <- unicode:characters_to_list(Whole)].

escaped($") -> <<"\\\"">>;
escaped($\\) -> <<"\\\\">>;
escaped(C) when C < 32; C =:= 127 -> io_lib:format("\\u~4.16.0b", [C]);
escaped(C) -> <<C/utf8>>.

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
