%% @doc Encodes packets as bytes: a version, then the packet in Erlang's external term format.
%%
%% Only plain data may travel, within the bounds of {@link starl_payload}. A message was checked
%% against these bounds when it was handed over. The receiver scans the bytes before it decodes
%% them, so that a packet costs no more memory than a small multiple of its bytes. Compressed terms,
%% processes, functions and unknown atoms are refused. The sender scans its own bytes as well, so
%% the receiver's scan accepts whatever it sends.
-module(starl_live_codec).

-export([encode/1, decode/2, format_error/2]).

-export_type([refusal/0]).

%% The first byte.
-define(VERSION, 1).

%% Why bytes are no packet: another version, not the plain data of a payload, cut short or longer
%% than the term in them, an atom that this computer does not know (or a map with a key twice), no
%% packet of SAP, or one in another robot's name.
-type refusal() :: version | term | unknown_atom | packet | sender.

%% @doc The packet's bytes.
-spec encode(starl_packet:t()) -> {ok, binary()} | {error, starl_payload:reason()}.
encode(Packet) ->
    Bytes = term_to_binary(Packet, [{minor_version, 2}]),
    case walk(Bytes) of
        ok -> {ok, <<?VERSION, Bytes/binary>>};
        {error, _} = Error -> Error
    end.

%% @doc The packet in bytes that came from a robot, which must be the packet's source.
-spec decode(From :: starl:robot_id(), binary()) -> {ok, starl_packet:t()} | {error, refusal()}.
decode(From, <<?VERSION, Bytes/binary>>) ->
    case walk(Bytes) of
        ok -> known(From, term(Bytes));
        {error, _} -> {error, term}
    end;
decode(_From, _Bytes) ->
    {error, version}.

term(Bytes) ->
    try
        {term, binary_to_term(Bytes, [safe])}
    catch
        error:badarg -> unknown_atom
    end.

known(_From, unknown_atom) ->
    {error, unknown_atom};
known(From, {term, Packet}) ->
    case starl_packet:source(Packet) of
        From -> {ok, Packet};
        malformed -> {error, packet};
        _Other -> {error, sender}
    end.

%% @doc One line that says why a packet cannot be sent.
-spec format_error(starl_packet:t(), starl_payload:reason()) -> unicode:chardata().
format_error(Packet, Reason) ->
    [content(Packet), " cannot be sent: ", starl_payload:format_error(packet, Reason)].

content({starl, _, data, {_, _, _, _, _, Type, _}}) -> io_lib:format("a message ~tp", [Type]);
content({starl, _, shout, _, Type, _}) -> io_lib:format("a datagram ~tp", [Type]);
content(_) -> "a packet".

%% -- the walk -------------------------------------------------------------------------------

%% Tags of the external term format (ERTS User's Guide, chapter 13).
-define(START, 131).
-define(SMALL_INTEGER, 97).
-define(INTEGER, 98).
-define(SMALL_BIG, 110).
-define(FLOAT, 70).
-define(SMALL_ATOM, 119).
-define(ATOM, 118).
-define(BINARY, 109).
-define(SMALL_TUPLE, 104).
-define(LARGE_TUPLE, 105).
-define(NIL, 106).
-define(STRING, 107).
-define(LIST, 108).
-define(MAP, 116).

%% Is this exactly one term of plain data, within the bounds?
walk(Bytes) ->
    case byte_size(Bytes) =< starl_payload:most_bytes(packet) of
        true -> started(Bytes);
        false -> {error, too_large}
    end.

started(<<?START, Term/binary>>) -> walk(Term, 1, [], starl_payload:deepest(packet));
started(_Bytes) -> {error, {holds, other}}.

%% Count: the terms still to come at this depth; Open: those at the depths around it; Deeper: the
%% depths that are left. Each step takes a byte at least, so absurd counts come to nothing.
walk(<<Bytes/binary>>, 0, [Count | Open], Deeper) ->
    walk(Bytes, Count, Open, Deeper + 1);
walk(<<>>, 0, [], _Deeper) ->
    ok;
walk(<<_/binary>>, 0, [], _Deeper) ->
    {error, {holds, other}};
walk(<<?SMALL_INTEGER, _, Rest/binary>>, Count, Open, Deeper) ->
    walk(Rest, Count - 1, Open, Deeper);
walk(<<?INTEGER, _:32, Rest/binary>>, Count, Open, Deeper) ->
    walk(Rest, Count - 1, Open, Deeper);
walk(<<?FLOAT, _:64, Rest/binary>>, Count, Open, Deeper) ->
    walk(Rest, Count - 1, Open, Deeper);
walk(<<?SMALL_ATOM, Size, _:Size/binary, Rest/binary>>, Count, Open, Deeper) ->
    walk(Rest, Count - 1, Open, Deeper);
walk(<<?NIL, Rest/binary>>, Count, Open, Deeper) ->
    walk(Rest, Count - 1, Open, Deeper);
walk(<<?STRING, Size:16, _:Size/binary, Rest/binary>>, Count, Open, Deeper) ->
    walk(Rest, Count - 1, Open, Deeper);
walk(<<?BINARY, Size:32, _:Size/binary, Rest/binary>>, Count, Open, Deeper) ->
    walk(Rest, Count - 1, Open, Deeper);
walk(<<?SMALL_BIG, Size, _Sign, _:Size/binary, Rest/binary>>, Count, Open, Deeper) ->
    walk(Rest, Count - 1, Open, Deeper);
walk(<<?ATOM, Size:16, _:Size/binary, Rest/binary>>, Count, Open, Deeper) ->
    walk(Rest, Count - 1, Open, Deeper);
walk(Bytes, Count, Open, Deeper) ->
    descend(Bytes, Count, Open, Deeper).

%% Into a term that holds others.
descend(<<?SMALL_TUPLE, Inner, Rest/binary>>, Count, Open, Deeper) when Deeper > 0 ->
    walk(Rest, Inner, [Count - 1 | Open], Deeper - 1);
descend(<<?LIST, Inner:32, Rest/binary>>, Count, Open, Deeper) when Deeper > 0 ->
    walk(Rest, Inner + 1, [Count - 1 | Open], Deeper - 1);
descend(<<?MAP, Inner:32, Rest/binary>>, Count, Open, Deeper) when Deeper > 0 ->
    walk(Rest, 2 * Inner, [Count - 1 | Open], Deeper - 1);
descend(<<?LARGE_TUPLE, Inner:32, Rest/binary>>, Count, Open, Deeper) when Deeper > 0 ->
    walk(Rest, Inner, [Count - 1 | Open], Deeper - 1);
descend(<<Tag, _/binary>>, _Count, _Open, 0) when
    Tag =:= ?SMALL_TUPLE; Tag =:= ?LIST; Tag =:= ?MAP; Tag =:= ?LARGE_TUPLE
->
    {error, too_deep};
descend(<<Tag, _/binary>>, _Count, _Open, _Deeper) ->
    {error, {holds, tag(Tag)}};
descend(<<>>, _Count, _Open, _Deeper) ->
    {error, {holds, other}}.

%% Those that OTP writes: only a sender learns what its packet holds.
tag(88) -> pid;
tag(Tag) when Tag =:= 89; Tag =:= 120 -> port;
tag(90) -> reference;
tag(Tag) when Tag =:= 112; Tag =:= 113 -> function;
tag(77) -> bitstring;
tag(111) -> huge_integer;
tag(_) -> other.
