%% @doc Puts the reason of a crash into words. What Erlang itself calls by a short word, such as
%% `undef', is said in a sentence; any other reason is shown as a term.
-module(starl_crash_text).

-export([text/2]).

-define(DEPTH, 20).
-define(MOST_CHARS, 400).
-define(ARGUMENT_CHARS, 60).

%% @doc The reason of an exception with this stack, in words.
-spec text(Reason :: term(), erlang:stacktrace()) -> unicode:chardata().
text({bad_return, {_Module, Function}, Value}, _Stack) ->
    returned(Function, Value);
text({step_never_blocks, #{actions_and_steps := Most}}, _Stack) ->
    io_lib:format(
        "step/2 lets no time pass: ~b actions and steps in one moment; "
        "starl:sleep(Robot, Ms) lets it pass",
        [Most]
    );
text({no_such_machine, Name, add_it_to_blocks}, Stack) ->
    [
        io_lib:format("this robot has no machine ~tp; ", [Name]),
        case callers_block(Stack) of
            {ok, Block} -> io_lib:format("list its block: blocks() -> [~tp]", [Block]);
            none -> "is its block in the list of blocks/0?"
        end
    ];
text({unknown_state, State}, _Stack) ->
    [
        "the code to which it went back does not know the state that new code has left: ",
        term(State)
    ];
text({no_way_back, Former}, _Stack) ->
    io_lib:format("its state cannot be converted back for ~ts: it starts anew", [
        starl_version:original(Former)
    ]);
text({given_up, Name, it_crashed_too_often}, _Stack) ->
    io_lib:format("this robot's machine ~tp crashed too often and was given up", [Name]);
text({bad_argument, #{function := {M, F, A}, argument := Argument, why := Why}}, _Stack) ->
    io_lib:format("~tp:~tp/~b cannot take this ~ts: ~ts", [M, F, A, Argument, Why]);
text({bad_argument, #{function := {M, F, A}, argument := Argument} = Mistake}, _Stack) ->
    #{given := Given, expected := Expected} = Mistake,
    io_lib:format("~tp:~tp/~b takes as ~ts ~ts, not ~ts", [
        M, F, A, Argument, Expected, term(Given)
    ]);
text({bad_payload, What, Why}, _Stack) ->
    io_lib:format("~ts cannot be sent or kept: ~ts", [term(What), Why]);
text({unknown_event, Type, Content}, _Stack) ->
    ["it does not know an event that the former code knows: ", term({Type, Content})];
text({bad_action, Action, Expected}, _Stack) ->
    io_lib:format("~ts is no action; expected: ~ts", [term(Action), Expected]);
text(Reason, Stack) ->
    of_erlang(Reason, Stack).

of_erlang({exit, Reason}, _Stack) ->
    ["exit with ", term(Reason)];
of_erlang({nocatch, Value}, _Stack) ->
    ["thrown and not caught: ", term(Value)];
of_erlang(undef, [{Module, Function, Args, _} | _]) ->
    undefined(Module, Function, arity(Args));
of_erlang(function_clause, [{Module, Function, Args, _} | _]) when is_list(Args) ->
    io_lib:format("no clause of ~tp:~tp/~b takes (~ts)", [
        Module, Function, length(Args), lists:join(", ", [argument(Arg) || Arg <- Args])
    ]);
of_erlang({badmatch, Value}, _Stack) ->
    ["no match of the value ", term(Value)];
of_erlang({case_clause, Value}, _Stack) ->
    ["no clause of a case takes ", term(Value)];
of_erlang(if_clause, _Stack) ->
    "no branch of an if is true";
of_erlang({try_clause, Value}, _Stack) ->
    ["no clause of a try takes ", term(Value)];
of_erlang({badkey, Key}, _Stack) ->
    ["the map has no key ", term(Key)];
of_erlang({badmap, Value}, _Stack) ->
    ["this is no map: ", term(Value)];
of_erlang({badrecord, Value}, _Stack) ->
    ["this is not the expected record: ", term(Value)];
of_erlang({badfun, Value}, _Stack) ->
    ["this is no function: ", term(Value)];
of_erlang({badarity, {_Fun, Args}}, _Stack) ->
    io_lib:format("a function is called with ~b arguments, which it does not take", [length(Args)]);
of_erlang(badarith, [{Module, Function, Args, _} | _]) when is_list(Args) ->
    calculation(Module, Function, Args);
of_erlang(badarith, _Stack) ->
    "no calculation with these values: is each of them a number?";
of_erlang(badarg, [{Module, Function, Args, _} | _]) when is_list(Args) ->
    io_lib:format("bad argument: ~tp:~tp(~ts)", [
        Module, Function, lists:join(", ", [argument(Arg) || Arg <- Args])
    ]);
of_erlang(Reason, _Stack) ->
    term(Reason).

returned(step, Value) ->
    ["step/2 returned ", term(Value), "; it returns {continue, State} or {done, Result}"];
returned(Function, Value) ->
    io_lib:format(
        "~tp returned ~ts; it returns {State, Data, Actions} or the like (starl_machine)", [
            Function, term(Value)
        ]
    ).

calculation(erlang, Operator, [A, B]) ->
    [argument(A), $\s, atom_to_list(Operator), $\s, argument(B), " cannot be calculated"];
calculation(Module, Function, Args) ->
    Shown = lists:join(", ", [argument(Arg) || Arg <- Args]),
    io_lib:format("~tp:~tp(~ts) cannot be calculated", [Module, Function, Shown]).

%% A function of a block is the innermost of the stack that is not the robot's own interface.
callers_block(Stack) ->
    Modules = [M || {M, _, _, _} <- Stack, M =/= starl, not starl_code:is_runtime(M)],
    case [M || M <- lists:sublist(Modules, 1), starl_block:is_block(M)] of
        [Block] -> {ok, Block};
        [] -> none
    end.

%% -- undefined functions --------------------------------------------------------------------

undefined(Module, Function, Arity) ->
    case code:ensure_loaded(Module) of
        {module, Module} -> no_function(Module, Function, Arity);
        {error, _} -> ["there is no module ", name(Module), meant(starl_code:resembling(Module))]
    end.

no_function(Module, Function, Arity) ->
    Exports = [E || {F, _} = E <- Module:module_info(exports), F =/= module_info],
    [
        io_lib:format("there is no function ~ts:~ts/~b", [name(Module), name(Function), Arity]),
        case [N || {F, N} <- Exports, F =:= Function] of
            [] -> meant(starl_options:suggestion(Function, lists:usort([F || {F, _} <- Exports])));
            Arities -> [" (but ", lists:join(", ", [[$/, integer_to_list(N)] || N <- Arities]), ")"]
        end
    ].

meant([]) -> "";
meant([Near | _]) -> [" (did you mean ", name(Near), "?)"].

name(Atom) -> io_lib:format("~tp", [Atom]).

%% -- terms ----------------------------------------------------------------------------------

arity(Args) when is_list(Args) -> length(Args);
arity(Arity) -> Arity.

term(Term) -> shown(Term, ?MOST_CHARS).

%% The handle of a robot says nothing to its owner.
argument(Robot) when element(1, Robot) =:= robot, tuple_size(Robot) =:= 3 -> "Robot";
argument(Term) -> shown(Term, ?ARGUMENT_CHARS).

shown(Term, Chars) -> io_lib:format("~0tP", [Term, ?DEPTH], [{chars_limit, Chars}]).
