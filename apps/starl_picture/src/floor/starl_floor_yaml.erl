%% @doc Reads the YAML file of an occupancy grid: one map of a few keys, whose values are scalars and
%% lists of scalars. What is nested deeper belongs to keys that nobody asks for, and is passed over.
%% What this reader does not understand is an error, and never read as something else.
-module(starl_floor_yaml).

-export([read/1, number/1, boolean/1]).

-export_type([entries/0, value/0]).

-type value() :: string() | [string()] | nested.
-type entries() :: #{Key :: string() => {Line :: pos_integer(), value()}}.

-define(BLANK, " \t\r").

%% @doc The keys, each with its line and its value, without quotes.
-spec read(binary()) -> {ok, entries()} | {error, starl_floor_text:problem()}.
read(<<16#EF, 16#BB, 16#BF, Bytes/binary>>) ->
    read(Bytes);
read(Bytes) ->
    case unicode:characters_to_list(Bytes) of
        Text when is_list(Text) -> parsed(lines(Text));
        _ -> {error, {none, "this is no text in UTF-8"}}
    end.

%% The lines of the document, with their indents and without remarks.
lines(Text) ->
    [
        {N, length(Line) - length(Bare), Bare}
     || {N, Raw} <- lists:enumerate(1, string:split(Text, "\n", all)),
        Line <- [string:trim(bare(Raw, none, $\s), trailing, ?BLANK)],
        Bare <- [string:trim(Line, leading, " ")],
        Bare =/= "",
        Bare =/= "---",
        Bare =/= "...",
        hd(Bare) =/= $%
    ].

%% A remark begins after a blank, outside of quotes.
bare([], _Quote, _Before) -> [];
bare([$# | _], none, Before) when Before =:= $\s; Before =:= $\t -> [];
bare([Q | Rest], none, _Before) when Q =:= $"; Q =:= $' -> [Q | bare(Rest, Q, Q)];
bare([Q | Rest], Q, _Before) -> [Q | bare(Rest, none, Q)];
bare([C | Rest], Quote, _Before) -> [C | bare(Rest, Quote, C)].

parsed([{N, _, "{" ++ _ = First} | Rest]) ->
    Flow = lists:append([First | [[$\s | Line] || {_, _, Line} <- Rest]]),
    case lists:last(Flow) of
        $} ->
            Parts = parts(lists:droplast(tl(Flow))),
            keyed([{N, 0, string:trim(Part)} || Part <- Parts, string:trim(Part) =/= ""], 0, #{});
        _ ->
            {error, {N, "the map that begins here has no end"}}
    end;
parsed([{_, Indent, _} | _] = Lines) ->
    keyed(Lines, Indent, #{});
parsed([]) ->
    {ok, #{}}.

keyed([], _Indent, Entries) ->
    {ok, Entries};
keyed([{N, Indent, Line} | Lines], Indent, Entries) ->
    {Below, Rest} = lists:splitwith(fun({_, I, L}) -> I > Indent orelse hd(L) =:= $- end, Lines),
    case entry(Line) of
        {ok, Key, _} when is_map_key(Key, Entries) ->
            {error, {N, ["the key ", Key, " is there twice"]}};
        {ok, Key, Given} ->
            keyed(Rest, Indent, Entries#{Key => {N, value(Given, Below)}});
        error ->
            {error, {N, ["this is no key with a value: ", Line]}}
    end;
keyed([{N, _, Line} | _], _Indent, _Entries) ->
    {error, {N, ["this is indented as nothing before it: ", Line]}}.

entry(Line) ->
    case
        re:run(Line, "^(\"[^\"]*\"|'[^']*'|[^\"'{}\\[\\]:#-][^:]*):(?:[ \t]+(.*))?$", [
            unicode, {capture, [1, 2], list}
        ])
    of
        {match, [Key, Given]} -> {ok, unquoted(Key), Given};
        nomatch -> error
    end.

value("", [{_, _, "-" ++ _} | _] = Items) ->
    case lists:all(fun({_, _, L}) -> lists:prefix("- ", L) end, Items) of
        true -> [unquoted(tl(L)) || {_, _, L} <- Items];
        false -> nested
    end;
value("", [_ | _]) ->
    nested;
value("[" ++ _ = Given, []) ->
    case lists:last(Given) of
        $] -> [unquoted(Part) || Part <- parts(lists:droplast(tl(Given)))];
        _ -> nested
    end;
value("{" ++ _, _) ->
    nested;
value(Given, []) ->
    unquoted(Given);
value(_Given, _Below) ->
    nested.

%% Between commas, outside of quotes and brackets.
parts(Text) -> parts(Text, none, 0, []).

parts([], _Quote, _Depth, Part) ->
    [lists:reverse(Part)];
parts([$, | Rest], none, 0, Part) ->
    [lists:reverse(Part) | parts(Rest, none, 0, [])];
parts([Q | Rest], none, Depth, Part) when Q =:= $"; Q =:= $' ->
    parts(Rest, Q, Depth, [Q | Part]);
parts([Q | Rest], Q, Depth, Part) ->
    parts(Rest, none, Depth, [Q | Part]);
parts([C | Rest], none, Depth, Part) when C =:= $[; C =:= ${ ->
    parts(Rest, none, Depth + 1, [C | Part]);
parts([C | Rest], none, Depth, Part) when C =:= $]; C =:= $} ->
    parts(Rest, none, Depth - 1, [C | Part]);
parts([C | Rest], Quote, Depth, Part) ->
    parts(Rest, Quote, Depth, [C | Part]).

unquoted(Text) ->
    case string:trim(Text, both, ?BLANK) of
        [Q | Rest] = Whole when Q =:= $"; Q =:= $' ->
            case Rest =/= [] andalso lists:last(Rest) =:= Q of
                true -> lists:droplast(Rest);
                false -> Whole
            end;
        Whole ->
            Whole
    end.

%% @doc A number as YAML writes it: `5', `.5', `5.', `5e-1'.
-spec number(value()) -> {ok, float()} | error.
number(Text) when is_list(Text) ->
    case
        io_lib:char_list(Text) andalso
            re:run(Text, "^([-+]?)(\\d*)(?:\\.(\\d*))?(?:[eE]([-+]?\\d{1,3}))?$", [
                {capture, all_but_first, list}
            ])
    of
        {match, [Sign, Whole | More]} -> number(Sign, Whole, More);
        _ -> error
    end;
number(_Other) ->
    error.

number(_Sign, "", []) ->
    error;
number(_Sign, "", ["" | _]) ->
    error;
number(Sign, Whole, More) ->
    [Part, Exponent] = lists:sublist(More ++ ["", ""], 2),
    try list_to_float(Sign ++ zero(Whole) ++ "." ++ zero(Part) ++ "e" ++ zero(Exponent)) of
        Number -> {ok, Number}
    catch
        error:badarg -> error
    end.

zero("") -> "0";
zero(Digits) -> Digits.

%% @doc A truth value as YAML writes it, or a number that stands for one.
-spec boolean(value()) -> {ok, boolean()} | error.
boolean(Text) when is_list(Text) ->
    case io_lib:char_list(Text) andalso string:lowercase(Text) of
        Yes when Yes =:= "1"; Yes =:= "true"; Yes =:= "yes"; Yes =:= "on" -> {ok, true};
        No when No =:= "0"; No =:= "false"; No =:= "no"; No =:= "off" -> {ok, false};
        _ -> error
    end;
boolean(_Other) ->
    error.
