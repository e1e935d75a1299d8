%% @doc Checks that a term may go into a message: plain data within bounds. Numbers, atoms,
%% binaries, tuples, lists and maps mean the same on every computer; a process, a port, a reference
%% or a function does not.
%%
%% Each kind of payload leaves room for what is put around it:
%% ```
%%   packet        65,536 bytes    64 deep   what a robot's radio takes
%%   message       60,000 bytes    60 deep   the body that a machine hands to SAP
%%   content       50,000 bytes    50 deep   the term that an application hands to SAP or to a block
%%   label          1,000 bytes    50 deep   the name of a register, token, barrier or election
%%   kept      10,000,000 bytes   500 deep   a term for the robot's store
%% '''
%% A term is checked where it is handed over ({@link starl_caller}, {@link starl_action}). So a
%% mistake is found at the line that makes it, however the robot is run. The codec of the radio
%% checks packets against the same bounds.
-module(starl_payload).

-export([check/2, most_bytes/1, deepest/1, parts/1, expected/1, format_error/2]).

-export_type([kind/0, reason/0, odd/0]).

-type kind() :: packet | message | content | label | kept.

%% What a payload must not hold.
-type odd() :: pid | port | reference | function | bitstring | huge_integer | other.

%% Why a term is no payload.
-type reason() :: too_large | too_deep | {holds, odd()}.

%% Integers of this size are compared fast; integers from `HUGE' on take more than 255 bytes.
-define(SMALL, 16#7FFFFFFFFFFFFFF).
-define(HUGE, (1 bsl 2040)).
%% The most bytes for each byte that the walk counts: an atom has at most 255 characters.
-define(LONGEST, 1023).
%% The most bytes of a list in a message: those of a message, less what is around the list.
-define(PART, 56_000).

%% @doc Is the term a payload of this kind? No more of the term is looked at than the kind allows.
-spec check(kind(), term()) -> ok | {error, reason()}.
check(Kind, Term) ->
    Most = most_bytes(Kind),
    try Most - walk(Term, deepest(Kind), Most) of
        Counted when Counted * ?LONGEST =< Most -> ok;
        _ -> fits(Term, Most)
    catch
        throw:{?MODULE, Reason} -> {error, Reason}
    end.

%% OTP 25 counts the letters of an atom, not their bytes, of which there are two at most.
fits(Term, Most) ->
    Fits =
        2 * erlang:external_size(Term) =< Most orelse
            byte_size(term_to_binary(Term, [{minor_version, 2}])) =< Most,
    case Fits of
        true -> ok;
        false -> {error, too_large}
    end.

%% @doc The most bytes of a payload in Erlang's external term format.
-spec most_bytes(kind()) -> pos_integer().
most_bytes(packet) -> 65_536;
most_bytes(message) -> 60_000;
most_bytes(content) -> 50_000;
most_bytes(label) -> 1_000;
most_bytes(kept) -> 10_000_000.

%% @doc The deepest nesting of a payload.
-spec deepest(kind()) -> pos_integer().
deepest(packet) -> 64;
deepest(message) -> 60;
deepest(content) -> 50;
deepest(label) -> 50;
deepest(kept) -> 500.

%% @doc Splits the list into parts that each fit into a message, with a small term around it. A term
%% that is larger than that makes a part of its own.
-spec parts(List) -> [List, ...] when List :: [term()].
parts(List) ->
    case erlang:external_size(List) =< ?PART of
        true -> [List];
        false -> parts(List, [], 0)
    end.

parts([], Part, _Bytes) ->
    [lists:reverse(Part)];
parts([Term | Terms], Part, Bytes) ->
    case Bytes + erlang:external_size(Term) of
        Most when Most > ?PART, Part =/= [] ->
            [lists:reverse(Part) | parts(Terms, [Term], erlang:external_size(Term))];
        More ->
            parts(Terms, [Term | Part], More)
    end.

%% @doc What a term of this kind is.
-spec expected(kind()) -> string().
expected(Kind) ->
    Format = "numbers, atoms, binaries, tuples, lists and maps, at most ~b bytes, ~b deep",
    lists:flatten(io_lib:format(Format, [most_bytes(Kind), deepest(Kind)])).

%% @doc What is wrong with a term, and what to do.
-spec format_error(kind(), reason()) -> string().
format_error(Kind, too_large) ->
    advice("it takes more than ~b bytes", [most_bytes(Kind)], smaller(Kind));
format_error(Kind, too_deep) ->
    advice("it is nested more than ~b deep", [deepest(Kind)], "make it flatter");
format_error(_Kind, {holds, Odd}) ->
    advice("it holds ~ts", [odd(Odd)], "take numbers, atoms, binaries, tuples, lists and maps").

smaller(label) -> "take a shorter one";
smaller(kept) -> "keep less";
smaller(_) -> "send it in parts".

advice(Format, Values, Advice) -> lists:flatten([io_lib:format(Format, Values), "; ", Advice]).

odd(pid) -> "a process identifier, which means nothing to another robot, nor after a reboot";
odd(port) -> "a port, which means nothing to another robot, nor after a reboot";
odd(reference) -> "a reference, which means nothing to another robot, nor after a reboot";
odd(function) -> "a function";
odd(bitstring) -> "a bit string that is not of whole bytes";
odd(huge_integer) -> "an integer of more than 255 bytes";
odd(other) -> "a term of another kind".

%% -- the walk -------------------------------------------------------------------------------

%% Returns what is left of the bytes, if each term takes one, beside binaries and large integers.
walk(Term, _Deeper, Left) when is_atom(Term); is_float(Term); Term =:= [] -> Left - 1;
walk(Term, _Deeper, Left) when is_integer(Term) -> Left - integer_bytes(Term);
walk(Term, _Deeper, Left) when is_binary(Term) -> Left - byte_size(Term) - 1;
walk([_ | _] = List, Deeper, Left) when Deeper > 0 -> each(List, Deeper - 1, Left - 1);
walk(Tuple, Deeper, Left) when is_tuple(Tuple), tuple_size(Tuple) >= Left, Deeper > 0 ->
    refuse(too_large);
walk(Tuple, Deeper, Left) when is_tuple(Tuple), Deeper > 0 ->
    each(tuple_to_list(Tuple), Deeper - 1, Left);
walk(Map, Deeper, Left) when is_map(Map), 2 * map_size(Map) >= Left, Deeper > 0 ->
    refuse(too_large);
walk(Map, Deeper, Left) when is_map(Map), Deeper > 0 ->
    pairs(maps:next(maps:iterator(Map)), Deeper - 1, Left - 1);
walk(Term, _Deeper, _Left) when is_list(Term); is_tuple(Term); is_map(Term) -> refuse(too_deep);
walk(Term, _Deeper, _Left) ->
    refuse({holds, kind(Term)}).

each([Term | Terms], Deeper, Left) when Left > 0 ->
    each(Terms, Deeper, walk(Term, Deeper, Left));
each([], _Deeper, Left) ->
    Left;
each(_Terms, _Deeper, Left) when Left =< 0 -> refuse(too_large);
each(Tail, Deeper, Left) ->
    walk(Tail, Deeper, Left).

pairs({Key, Value, Next}, Deeper, Left) when Left > 0 ->
    pairs(maps:next(Next), Deeper, walk(Value, Deeper, walk(Key, Deeper, Left)));
pairs(none, _Deeper, Left) ->
    Left;
pairs(_More, _Deeper, _Left) ->
    refuse(too_large).

integer_bytes(N) when N >= -?SMALL, N =< ?SMALL -> 1;
integer_bytes(N) when N > -?HUGE, N < ?HUGE -> 9;
integer_bytes(_) -> refuse({holds, huge_integer}).

kind(Term) when is_pid(Term) -> pid;
kind(Term) when is_port(Term) -> port;
kind(Term) when is_reference(Term) -> reference;
kind(Term) when is_function(Term) -> function;
kind(Term) when is_bitstring(Term) -> bitstring;
kind(_Term) -> other.

-spec refuse(reason()) -> no_return().
refuse(Reason) -> throw({?MODULE, Reason}).
