%% @doc Encodes a snapshot of a robot: its whole state between two events, as a term. A recording
%% keeps it, so that a simulation can go on from there.
%% ```
%%   {ok, Bytes} = starl_snapshot:encode(Robot),
%%   {ok, Robot} = starl_snapshot:of_term(binary_to_term(Bytes)).
%% '''
%% Only data are kept: a function or a process belongs to one VM. A snapshot that is larger than a bound
%% is not kept.
-module(starl_snapshot).

-export([encode/1, of_term/1, format_reason/1]).

-export_type([reason/0, result/0]).

%% Why a robot is not kept: what is too large, or no data; a machine runs code that was reloaded; the
%% application is in the middle of a step with more events than are kept, or it computes; it cannot be
%% asked; the bytes are of other code.
-type reason() ::
    {too_large, Bytes :: pos_integer()}
    | no_data
    | reloaded_code
    | long_step
    | at_work
    | gone
    | other_code.

%% The trace event of machine `snapshot' that reports a snapshot, with the kind of robot. Monitors
%% do not get it.
-type result() :: {ok, Bytes :: binary()} | {error, reason()}.

-define(MOST_BYTES, 1024 * 1024).
-define(LEVEL, 6).
-define(RANDOM, '$random').

%% @doc Encodes a snapshot as bytes.
-spec encode(term()) -> {ok, binary()} | {error, reason()}.
encode(Term) ->
    try as_data(Term) of
        Data -> bounded(term_to_binary(Data, [{compressed, ?LEVEL}]))
    catch
        throw:no_data -> {error, no_data}
    end.

bounded(Bytes) when byte_size(Bytes) =< ?MOST_BYTES -> {ok, Bytes};
bounded(Bytes) -> {error, {too_large, byte_size(Bytes)}}.

%% The state of a random stream holds functions, but has a form without them.
as_data({#{type := _, next := Next}, _} = Random) when is_function(Next) ->
    {?RANDOM, rand:export_seed_s(Random)};
as_data(Map) when is_map(Map) ->
    maps:from_list([{as_data(Key), as_data(Value)} || {Key, Value} <- maps:to_list(Map)]);
as_data([First | Rest]) ->
    [as_data(First) | as_data(Rest)];
as_data(Tuple) when is_tuple(Tuple) ->
    list_to_tuple([as_data(Part) || Part <- tuple_to_list(Tuple)]);
as_data(Term) when is_function(Term); is_pid(Term); is_port(Term); is_reference(Term) ->
    throw(no_data);
as_data(Term) ->
    Term.

%% @doc Decodes a snapshot from the term in its bytes. The term may come from anywhere: no function
%% is made of it.
-spec of_term(term()) -> {ok, term()} | {error, reason()}.
of_term(Term) ->
    try
        {ok, as_it_was(Term)}
    catch
        throw:no_data -> {error, no_data};
        error:_ -> {error, other_code}
    end.

as_it_was({?RANDOM, {_, _} = Exported}) ->
    rand:seed_s(Exported);
as_it_was(Map) when is_map(Map) ->
    maps:from_list([{as_it_was(Key), as_it_was(Value)} || {Key, Value} <- maps:to_list(Map)]);
as_it_was([First | Rest]) ->
    [as_it_was(First) | as_it_was(Rest)];
as_it_was(Tuple) when is_tuple(Tuple) ->
    list_to_tuple([as_it_was(Part) || Part <- tuple_to_list(Tuple)]);
as_it_was(Term) when is_function(Term); is_pid(Term); is_port(Term); is_reference(Term) ->
    throw(no_data);
as_it_was(Term) ->
    Term.

%% @doc Why a robot was not kept, for a sentence.
-spec format_reason(reason()) -> unicode:chardata().
format_reason({too_large, Bytes}) ->
    io_lib:format("its state takes ~b KiB, more than the ~b that are kept", [
        Bytes div 1024, ?MOST_BYTES div 1024
    ]);
format_reason(no_data) ->
    "its state holds a function or a process";
format_reason(reloaded_code) ->
    "it runs code that was reloaded";
format_reason(long_step) ->
    "its application is in a step with more events than are kept";
format_reason(at_work) ->
    "its application computed";
format_reason(gone) ->
    "its application was about to start";
format_reason(other_code) ->
    "its state is of other code".
