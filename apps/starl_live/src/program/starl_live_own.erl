%% @doc Checks a driver that a user has written, for a chassis or for a source of positions. It is a
%% module, compiled and loaded, or, for a chassis, a program.
%%
%% A module exports the callbacks of its behaviour ({@link starl_live_chassis}, {@link
%% starl_live_positioning}) and, if it takes options, their table, `options/0' ({@link starl_options}).
-module(starl_live_own).

-export([check/3, driver/2]).

-export_type([compile/0]).

%% Compiles the source of a driver.
-type compile() :: fun(
    (file:filename()) -> {ok, module(), [starl_version:code()]} | {error, [unicode:chardata(), ...]}
).

-type behaviour() :: starl_live_chassis | starl_live_positioning.

%% @doc The driver of a chassis of the user's own.
-spec driver(starl_chassis_choice:name(), compile()) ->
    {ok, starl_live_link:adapter(), [starl_version:code()]} | {error, [unicode:chardata(), ...]}.
driver(Name, Compile) ->
    case starl_chassis_choice:own(Name) of
        {exec, Command} -> {ok, {starl_live_exec, #{exec => absolute(Command)}}, []};
        {file, File, Options} -> compiled(Compile(File), Options)
    end.

%% The nodes of a cluster may have another working directory.
absolute(Command) ->
    case starl_live_program:words(Command) of
        [Name | Args] ->
            Path =
                case lists:member($/, Name) of
                    true -> filename:absname(Name);
                    false -> Name
                end,
            lists:append(lists:join(" ", [Path | Args]));
        [] ->
            ""
    end.

compiled({ok, Module, Code}, Options) ->
    case check(Module, starl_live_chassis, Options) of
        {ok, Values} -> {ok, {Module, Values}, Code};
        {error, Why} -> {error, [Why]}
    end;
compiled({error, _} = Error, _Options) ->
    Error.

%% @doc The options, completed with their defaults; or one line on the first problem, with its place.
-spec check(module(), behaviour(), Given :: #{atom() => term()}) ->
    {ok, #{atom() => term()}} | {error, unicode:chardata()}.
check(Module, Behaviour, Given) ->
    Optional = Behaviour:behaviour_info(optional_callbacks),
    Needed = lists:sort(Behaviour:behaviour_info(callbacks) -- Optional),
    case [Callback || {F, A} = Callback <- Needed, not starl_callback:exported(Module, F, A)] of
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
        starl_callback:exported(Module, options, 0) andalso starl_app:declared(Module, options, [])
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
