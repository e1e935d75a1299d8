%% @doc Creates the atoms that a recorded term needs, up to a limit. Atoms are never freed, so the
%% limit counts all atoms that recordings have made in this VM. The module parses the external term
%% format and creates nothing but atoms.
-module(starl_trace_atoms).

-export([make/2]).

%% @doc Makes the atoms of these bytes, which are not compressed.
-spec make(binary(), Most :: pos_integer()) -> ok | {error, not_terms | too_many_atoms}.
make(<<131, Bytes/binary>>, Most) ->
    try
        {<<>>, Names} = term(Bytes, #{}),
        New = [Name || Name <- maps:keys(Names), not exists(Name)],
        made(New, Most)
    catch
        error:_ -> {error, not_terms}
    end.

made(New, Most) ->
    Room = counter(),
    case counters:get(Room, 1) + length(New) =< Most of
        true ->
            counters:add(Room, 1, length(New)),
            lists:foreach(fun binary_to_atom/1, New);
        false ->
            {error, too_many_atoms}
    end.

exists(Name) ->
    try
        is_atom(binary_to_existing_atom(Name))
    catch
        error:badarg -> false
    end.

%% One for the VM, as its table of atoms is.
counter() ->
    case persistent_term:get(?MODULE, none) of
        none ->
            ok = persistent_term:put(?MODULE, counters:new(1, [])),
            counter();
        Counter ->
            Counter
    end.

%% -- the external term format ---------------------------------------------------------------

%% What follows a tag: an atom's name after its length; bytes after their number, and some more;
%% bytes; so many terms for each that is counted, and some more; the name of a node, then numbers.
layout(119) -> {atom, 8, utf8};
layout(118) -> {atom, 16, utf8};
layout(100) -> {atom, 16, latin1};
layout(115) -> {atom, 8, latin1};
layout(97) -> {bytes, 0, 1};
layout(98) -> {bytes, 0, 4};
layout(70) -> {bytes, 0, 8};
layout(110) -> {bytes, 8, 1};
layout(111) -> {bytes, 32, 1};
layout(106) -> {bytes, 0, 0};
layout(107) -> {bytes, 16, 0};
layout(109) -> {bytes, 32, 0};
layout(77) -> {bytes, 32, 1};
layout(104) -> {terms, 8, 1, 0};
layout(105) -> {terms, 32, 1, 0};
layout(108) -> {terms, 32, 1, 1};
layout(116) -> {terms, 32, 2, 0};
layout(88) -> {node, 0, 0, 12};
layout(103) -> {node, 0, 0, 9};
layout(89) -> {node, 0, 0, 8};
layout(120) -> {node, 0, 0, 12};
layout(90) -> {node, 16, 4, 4};
layout(114) -> {node, 16, 4, 1};
layout(113) -> {terms, 0, 0, 3};
layout(112) -> function.

term(<<Tag, Bytes/binary>>, Names) -> term(layout(Tag), Bytes, Names).

term({atom, Bits, Encoding}, Bytes, Names) ->
    <<N:Bits, Name:N/binary, Rest/binary>> = Bytes,
    {Rest, Names#{unicode:characters_to_binary(Name, Encoding) => true}};
term({bytes, Bits, More}, Bytes, Names) ->
    <<N:Bits, _:N/binary, _:More/binary, Rest/binary>> = Bytes,
    {Rest, Names};
term({terms, Bits, Each, More}, Bytes, Names) ->
    <<N:Bits, Rest/binary>> = Bytes,
    terms(Each * N + More, Rest, Names);
term({node, Bits, Each, More}, Bytes, Names) ->
    <<N:Bits, Node/binary>> = Bytes,
    {Rest, Known} = term(Node, Names),
    Size = Each * N + More,
    <<_:Size/binary, After/binary>> = Rest,
    {After, Known};
term(function, <<Size:32, Rest/binary>>, Names) ->
    <<Body:(Size - 4)/binary, After/binary>> = Rest,
    <<_Arity, _Uniq:16/binary, _Index:32, Free:32, Terms/binary>> = Body,
    {<<>>, Known} = terms(4 + Free, Terms, Names),
    {After, Known}.

terms(0, Rest, Names) ->
    {Rest, Names};
terms(N, Bytes, Names) ->
    {Rest, Known} = term(Bytes, Names),
    terms(N - 1, Rest, Known).
