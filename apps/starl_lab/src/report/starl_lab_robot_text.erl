%% @doc Texts on robots and their machines: states and data, with the names of records' fields.
-module(starl_lab_robot_text).

-export([robot/4, pretty/4, fields/1]).

-export_type([fields/0]).

-type fields() :: #{Record :: atom() => [Field :: atom()]}.

%% Terms are cut off below this depth.
-define(DEPTH, 60).
-define(WIDTH, 46).
-define(MOST_CHARS, 4000).

%% @doc A robot of a simulation as texts for the page, with its timers and its last events.
-spec robot(
    starl_sim_summary:t(),
    #{starl_machine:name() => starl_robot_tree:seen()},
    [starl_sim_timers:timer()],
    [{integer(), starl_machine:name(), Event :: term()}]
) -> #{atom() => starl_json:value()}.
robot(#{result := Result, events := Events, crashes := Crashes}, Machines, Timers, Last) ->
    #{
        result => starl_view_row:text(Result, 80),
        events => Events,
        crashes => [starl_view_row:text(Crash, 200) || Crash <- Crashes],
        machines => [
            timed(Name, Timers, machine(Name, Machine))
         || {Name, Machine} <- lists:sort(maps:to_list(Machines))
        ],
        last => [
            [T, Machine, starl_view_row:text(Event, 160)]
         || {T, Machine, Event} <- Last
        ]
    }.

timed(Name, Timers, Words) ->
    case [[starl_view_row:text(Timer, 80), Due] || {Of, Timer, Due} <- Timers, Of =:= Name] of
        [] -> Words;
        Own -> Words#{timers => Own}
    end.

%% A machine as texts for the page: its module, its state, its data or what it waits in.
-spec machine(starl_machine:name(), starl_robot_tree:seen()) ->
    #{atom() => starl_json:value()}.
machine(Name, waiting) ->
    #{name => Name, state => <<"not booted yet">>};
machine(Name, #{stack := Stack}) ->
    Calls = [io_lib:format("~tp:~tp/~b~n", [M, F, A]) || {M, F, A, _} <- Stack, is_integer(A)],
    #{name => Name, state => <<"sequential">>, data => cut(Calls)};
machine(Name, #{module := Module, state := State, data := Data}) ->
    Fields = fields(Module),
    #{
        name => Name,
        module => Module,
        state => cut(pretty(State, 0, ?WIDTH, Fields)),
        data => cut(pretty(Data, 0, ?WIDTH, Fields))
    }.

cut(Text) ->
    Binary = unicode:characters_to_binary(Text),
    case string:length(Binary) > ?MOST_CHARS of
        true -> <<(string:slice(Binary, 0, ?MOST_CHARS))/binary, " …"/utf8>>;
        false -> Binary
    end.

%% @doc A term that begins at a column. Later lines are indented to it; a long term is cut off.
-spec pretty(term(), Indent :: non_neg_integer(), Width :: pos_integer(), fields()) ->
    unicode:chardata().
pretty(Term, Indent, Width, Fields) ->
    io_lib_pretty:print(Term, [
        {column, Indent + 1},
        {line_length, max(Width, Indent + 20)},
        {depth, ?DEPTH},
        {encoding, unicode},
        {record_print_fun, fun(Name, Arity) -> named(Name, Arity, Fields) end}
    ]).

named(Name, Arity, Fields) ->
    case Fields of
        #{Name := Names} when length(Names) =:= Arity -> Names;
        #{} -> no
    end.

%% @doc The fields of a module's records, where it was compiled with its source.
-spec fields(module()) -> fields().
fields(Module) ->
    case abstract_code(code:get_object_code(Module)) of
        {ok, Forms} ->
            maps:from_list([{N, names(Defs)} || {attribute, _, record, {N, Defs}} <- Forms]);
        none ->
            #{}
    end.

abstract_code({_Module, Beam, _File}) ->
    case beam_lib:chunks(Beam, [abstract_code]) of
        {ok, {_, [{abstract_code, {_, Forms}}]}} -> {ok, Forms};
        {ok, {_, [{abstract_code, no_abstract_code}]}} -> none;
        {error, beam_lib, _} -> none
    end;
abstract_code(error) ->
    none.

names(Definitions) -> [name(Definition) || Definition <- Definitions].

name({typed_record_field, Field, _Type}) -> name(Field);
name({record_field, _, {atom, _, Name}}) -> Name;
name({record_field, _, {atom, _, Name}, _Default}) -> Name.
