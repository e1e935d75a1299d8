%% @doc A chassis or a source of positions of the user's own: is this module one, and does it take these
%% options? The module has been compiled and loaded.
%%
%% It exports the callbacks of its behaviour ({@link starl_live_chassis}, {@link
%% starl_live_positioning}) and, if it takes options, their table, `options/0' ({@link starl_options}).
-module(starl_live_own).

-export([check/3]).

-type behaviour() :: starl_live_chassis | starl_live_positioning.

%% @doc The options, completed with their defaults; or one line on the first problem, with its place.
-spec check(module(), behaviour(), Given :: #{atom() => term()}) ->
    {ok, #{atom() => term()}} | {error, unicode:chardata()}.
check(Module, Behaviour, Given) ->
    {module, Module} = code:ensure_loaded(Module),
    Optional = Behaviour:behaviour_info(optional_callbacks),
    Needed = lists:sort(Behaviour:behaviour_info(callbacks) -- Optional),
    case [Callback || {F, A} = Callback <- Needed, not erlang:function_exported(Module, F, A)] of
        [] -> options(Module, Given);
        [Missing | _] -> {error, missing(Module, Missing, Needed, Behaviour)}
    end.

missing(Module, {Function, Arity}, Needed, Behaviour) ->
    All = lists:join(", ", [io_lib:format("~ts/~b", [F, A]) || {F, A} <- Needed]),
    {Place, Why} =
        case starl_code:line(Module, Function, Arity) of
            {ok, _, _} -> {starl_app:place(Module, Function, Arity), "is not exported"};
            none -> {starl_app:place(Module, none, 0), "is missing"}
        end,
    io_lib:format("~ts: ~ts/~b ~ts; ~ts exports ~ts", [
        Place, Function, Arity, Why, what(Behaviour), All
    ]).

what(starl_live_chassis) -> "a chassis";
what(starl_live_positioning) -> "a source of positions".

options(Module, Given) ->
    case
        erlang:function_exported(Module, options, 0) andalso starl_app:declared(Module, options, [])
    of
        false when map_size(Given) =:= 0 -> {ok, #{}};
        false ->
            {error, [starl_app:place(Module, none, 0), ": takes no options: it has no options/0"]};
        {ok, Table} ->
            checked(starl_options:check_table(Table, []), Table, Module, Given);
        {error, _} = Error ->
            Error
    end.

checked({error, Why}, _Table, Module, _Given) ->
    {error, [starl_app:place(Module, options, 0), ": options/0: ", Why]};
checked(ok, Table, Module, Given) ->
    case starl_options:check(Given, Table) of
        {ok, Values} ->
            {ok, Values};
        {error, Problems} ->
            Lines = [starl_options:format_problem(Problem) || Problem <- Problems],
            {error, [starl_app:place(Module, options, 0), ": ", lists:join("; ", Lines)]}
    end.
