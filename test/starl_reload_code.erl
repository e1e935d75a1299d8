%% New code for the tests of reloads, made of the code that there is: an application's `step/2' or a
%% machine's `handle_event/5' is renamed, and other code is put around it.
-module(starl_reload_code).

-export([make/2, variants/1, fails/1]).

%% @doc The variants: for an application, for a machine.
variants(app) ->
    [good, converts, crashes_at_once, crashes_later, crashes_after_a_step, no_migration];
variants(machine) ->
    [good, converts, crashes_at_once, crashes_converted, no_migration, no_way_back].

fails(Variant) -> not lists:member(Variant, [good, converts]).

%% @doc The code of a variant of a module, as compiled in memory.
make(Module, Variant) ->
    {Module, Beam, File} = code:get_object_code(Module),
    {ok, {Module, [{abstract_code, {raw_abstract_v1, Forms}}]}} =
        beam_lib:chunks(Beam, [abstract_code]),
    Around = parsed(around(kind(Module), Variant)),
    Exported = [
        {attribute, 1, export, [{N, A} || {function, _, N, A, _} <- Around, N =:= code_change]}
    ],
    {Head, Rest} = lists:splitwith(fun(F) -> element(1, F) =/= function end, Forms),
    All = Head ++ Exported ++ former(Rest, Around),
    {ok, Module, New} = compile:forms(All, [binary, debug_info]),
    {Module, File, New}.

kind(Module) ->
    case erlang:function_exported(Module, handle_event, 5) of
        true -> machine;
        false -> app
    end.

%% Only what is replaced is renamed.
former(Forms, Around) ->
    New = [{Name, Arity} || {function, _, Name, Arity, _} <- Around],
    Kept = [
        case Form of
            {function, _, Name, Arity, _} ->
                case lists:member({Name, Arity}, New) of
                    true -> former(Form);
                    false -> Form
                end;
            _ ->
                Form
        end
     || Form <- Forms, element(1, Form) =/= eof
    ],
    Kept ++ Around.

former({function, At, step, 2, Clauses}) -> {function, At, step_former, 2, Clauses};
former({function, At, init, 2, Clauses}) -> {function, At, init_former, 2, Clauses};
former({function, At, handle_event, 5, Clauses}) -> {function, At, former, 5, Clauses};
former(Form) -> Form.

parsed(Texts) ->
    [
        begin
            {ok, Tokens, _} = erl_scan:string(Text),
            {ok, Form} = erl_parse:parse_form(Tokens),
            Form
        end
     || Text <- Texts
    ].

around(app, good) ->
    ["step(R, S) -> step_former(R, S)."];
around(app, converts) ->
    [
        "code_change(S, _) -> {new, S}.",
        "step(R, {new, S}) -> case step_former(R, S) of"
        " {continue, N} -> {continue, {new, N}}; Done -> Done end."
    ];
around(app, crashes_at_once) ->
    ["step(R, S) -> case is_tuple(R) of true -> error(planted); false -> step_former(R, S) end."];
around(app, crashes_later) ->
    [
        "code_change(S, _) -> {0, S}.",
        "step(R, {N, S}) when N < 2 -> case step_former(R, S) of"
        " {continue, Next} -> {continue, {N + 1, Next}}; Done -> Done end;"
        "step(_, _) -> error(planted)."
    ];
around(app, crashes_after_a_step) ->
    [
        "step(R, S) -> case step_former(R, S) of"
        " {continue, _} -> error(planted); Done -> Done end."
    ];
around(app, no_start) ->
    [
        "init(R, A) -> starl:trace(R, started_anew), init_former(R, A).",
        "step(R, S) -> step_former(R, S)."
    ];
around(app, no_migration) ->
    ["code_change(_, _) -> error(planted).", "step(R, S) -> step_former(R, S)."];
around(machine, good) ->
    ["handle_event(T, C, S, D, M) -> former(T, C, S, D, M)."];
around(machine, crashes_at_once) ->
    [
        "handle_event(T, C, S, D, M) -> case is_map(M) of true -> error(planted);"
        " false -> former(T, C, S, D, M) end."
    ];
around(machine, no_migration) ->
    [
        "code_change(_, _, _) -> error(planted).",
        "handle_event(T, C, S, D, M) -> former(T, C, S, D, M)."
    ];
around(machine, no_way_back) ->
    ["code_change(Md5, S, D) when is_binary(Md5) -> {ok, S, {new, D}}." | converted()];
around(machine, converts) ->
    [both_ways() | converted()];
around(machine, crashes_converted) ->
    [
        both_ways(),
        "handle_event(T, C, S, {3, D}, M) -> case D of none -> former(T, C, S, D, M);"
        " _ -> error(planted) end;"
        "handle_event(T, C, S, {new, D}, M) -> news(former(T, C, S, D, M), D, 1);"
        "handle_event(T, C, S, {N, D}, M) -> news(former(T, C, S, D, M), D, N + 1).",
        news()
    ].

both_ways() ->
    "code_change({down, _}, S, {_, D}) -> {ok, S, D}; code_change(_, S, D) -> {ok, S, {new, D}}.".

converted() ->
    ["handle_event(T, C, S, {new, D}, M) -> news(former(T, C, S, D, M), D, new).", news()].

news() ->
    "news(Result, D0, N) -> case Result of"
    " {next_state, S, D} -> {next_state, S, {N, D}};"
    " {next_state, S, D, A} -> {next_state, S, {N, D}, A};"
    " {keep_state, D} -> {keep_state, {N, D}};"
    " {keep_state, D, A} -> {keep_state, {N, D}, A};"
    " keep_state_and_data -> {keep_state, {N, D0}};"
    " {keep_state_and_data, A} -> {keep_state, {N, D0}, A};"
    " unknown_event -> unknown_event end.".
