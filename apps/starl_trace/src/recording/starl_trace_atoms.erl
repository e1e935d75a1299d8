%% @doc Makes the atoms that a term of a recording needs, as far as their number in the life of this
%% VM stays within a bound: atoms are never freed. It reads the external term format and makes
%% nothing but atoms.
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

term(<<119, N, Name:N/binary, Rest/binary>>, Names) ->
    {Rest, Names#{Name => true}};
term(<<118, N:16, Name:N/binary, Rest/binary>>, Names) ->
    {Rest, Names#{Name => true}};
term(<<100, N:16, Name:N/binary, Rest/binary>>, Names) ->
    {Rest, Names#{utf8(Name) => true}};
term(<<115, N, Name:N/binary, Rest/binary>>, Names) ->
    {Rest, Names#{utf8(Name) => true}};
term(<<97, _, Rest/binary>>, Names) ->
    {Rest, Names};
term(<<98, _:32, Rest/binary>>, Names) ->
    {Rest, Names};
term(<<70, _:64, Rest/binary>>, Names) ->
    {Rest, Names};
term(<<110, N, _, _:N/binary, Rest/binary>>, Names) ->
    {Rest, Names};
term(<<111, N:32, _, _:N/binary, Rest/binary>>, Names) ->
    {Rest, Names};
term(<<106, Rest/binary>>, Names) ->
    {Rest, Names};
term(<<107, N:16, _:N/binary, Rest/binary>>, Names) ->
    {Rest, Names};
term(<<109, N:32, _:N/binary, Rest/binary>>, Names) ->
    {Rest, Names};
term(<<77, N:32, _, _:N/binary, Rest/binary>>, Names) ->
    {Rest, Names};
term(<<104, N, Rest/binary>>, Names) ->
    terms(N, Rest, Names);
term(<<105, N:32, Rest/binary>>, Names) ->
    terms(N, Rest, Names);
term(<<108, N:32, Rest/binary>>, Names) ->
    terms(N + 1, Rest, Names);
term(<<116, N:32, Rest/binary>>, Names) ->
    terms(2 * N, Rest, Names);
%% processes, ports, references: the name of a node, then numbers
term(<<88, Rest/binary>>, Names) ->
    identifier(12, Rest, Names);
term(<<103, Rest/binary>>, Names) ->
    identifier(9, Rest, Names);
term(<<89, Rest/binary>>, Names) ->
    identifier(8, Rest, Names);
term(<<120, Rest/binary>>, Names) ->
    identifier(12, Rest, Names);
term(<<90, N:16, Rest/binary>>, Names) ->
    identifier(4 + 4 * N, Rest, Names);
term(<<114, N:16, Rest/binary>>, Names) ->
    identifier(1 + 4 * N, Rest, Names);
%% functions
term(<<113, Rest/binary>>, Names) ->
    terms(3, Rest, Names);
term(<<112, Size:32, Rest/binary>>, Names) ->
    <<Body:(Size - 4)/binary, After/binary>> = Rest,
    <<_Arity, _Uniq:16/binary, _Index:32, Free:32, Terms/binary>> = Body,
    {<<>>, Known} = terms(4 + Free, Terms, Names),
    {After, Known}.

terms(0, Rest, Names) ->
    {Rest, Names};
terms(N, Bytes, Names) ->
    {Rest, Known} = term(Bytes, Names),
    terms(N - 1, Rest, Known).

identifier(Size, Bytes, Names) ->
    {Rest, Known} = term(Bytes, Names),
    <<_:Size/binary, After/binary>> = Rest,
    {After, Known}.

utf8(Latin1) -> unicode:characters_to_binary(Latin1, latin1).
