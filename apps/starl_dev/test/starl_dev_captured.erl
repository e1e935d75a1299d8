%% What a function prints.
-module(starl_dev_captured).

-export([of_call/1]).

%% Gives the answer of the function and its text.
of_call(Fun) ->
    Before = group_leader(),
    Reader = spawn_link(fun() -> read([]) end),
    true = group_leader(Reader, self()),
    try Fun() of
        Answer -> {Answer, text(Reader)}
    after
        true = group_leader(Before, self())
    end.

text(Reader) ->
    Reader ! {text, self()},
    receive
        {Reader, Text} -> Text
    end.

read(Texts) ->
    receive
        {io_request, From, Ref, {put_chars, unicode, Text}} ->
            taken(From, Ref, Text, Texts);
        {io_request, From, Ref, {put_chars, unicode, M, F, As}} ->
            taken(From, Ref, apply(M, F, As), Texts);
        {text, From} ->
            true = unlink(From),
            From ! {self(), unicode:characters_to_list(lists:reverse(Texts))}
    end.

taken(From, Ref, Text, Texts) ->
    From ! {io_reply, Ref, ok},
    read([Text | Texts]).
