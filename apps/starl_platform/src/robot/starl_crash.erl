%% @doc Describes the cause of a crash: its reason, and its place in the code. A cause reads the
%% same whether the machine is a process or runs inline, and from run to run: it does not depend on
%% pids.
-module(starl_crash).

-export([
    reason/3,
    with_steps/2,
    steps/1,
    is_endless/1,
    cause/1,
    format/1,
    frames/1,
    frames_of/1,
    place/1,
    format_frame/1
]).

-export_type([cause/0, frame/0]).

%% The place of a call; the innermost call comes first in a stack.
-type frame() :: {module(), Function :: atom(), arity(), File :: string(), Line :: integer()}.

%% The reason as text, and the frames of the machine's own code.
-type cause() :: {Reason :: string(), [frame()]}.

-define(DEPTH, 20).
-define(MOST_CHARS, 400).
-define(ARGUMENT_CHARS, 60).

%% @doc The exit reason for a raised exception, with its stack.
-spec reason(error | exit | throw, Reason :: term(), erlang:stacktrace()) -> term().
reason(error, Reason, Stack) -> {Reason, Stack};
reason(exit, Reason, Stack) -> {{exit, Reason}, Stack};
reason(throw, Value, Stack) -> {{nocatch, Value}, Stack}.

%% @doc The exit reason of an application, with the number of steps that it had completed.
-spec with_steps(non_neg_integer(), Reason :: term()) -> term().
with_steps(Steps, Reason) -> {crashed_after, Steps, Reason}.

%% @doc The number of steps that an application had completed, if it is known.
-spec steps(Reason :: term()) -> non_neg_integer() | unknown.
steps({crashed_after, Steps, _}) -> Steps;
steps(_) -> unknown.

%% @doc Did a step of an application never let time pass?
-spec is_endless(Reason :: term()) -> boolean().
is_endless({crashed_after, _, {{step_never_blocks, _}, _}}) -> true;
is_endless(_) -> false.

%% @doc The cause behind an exit reason; `none': the process was ended from outside.
-spec cause(Reason :: term()) -> cause() | none.
cause(killed) ->
    none;
cause(store_full) ->
    none;
cause(shutdown) ->
    none;
cause({shutdown, _}) ->
    none;
cause({crashed_after, _Steps, Reason}) ->
    cause(Reason);
cause({Reason, [Frame | _] = Stack}) when tuple_size(Frame) =:= 4 ->
    {text(Reason, Stack), own(Stack)};
cause(Reason) ->
    {text(Reason, []), []}.

%% @doc A cause as one line.
-spec format(cause()) -> unicode:chardata().
format({Reason, []}) -> Reason;
format({Reason, Stack}) -> [Reason, " at ", lists:join(", ", [format_frame(F) || F <- Stack])].

%% @doc A frame as text: the function, and its file and line where they are known.
-spec format_frame(frame()) -> unicode:chardata().
format_frame({Module, Function, Arity, "", _}) ->
    io_lib:format("~tp:~tp/~b", [Module, Function, Arity]);
format_frame({Module, Function, Arity, File, Line}) ->
    io_lib:format("~tp:~tp/~b (~ts:~b)", [Module, Function, Arity, File, Line]).

%% @doc The frames of a machine or an application in a stack.
-spec frames(erlang:stacktrace()) -> [frame()].
frames(Stack) -> own(Stack).

%% @doc The frames of a machine or an application that a process of this node is in; none, if it has
%% ended.
-spec frames_of(pid()) -> [frame()].
frames_of(Pid) ->
    case erlang:process_info(Pid, current_stacktrace) of
        {current_stacktrace, Stack} -> frames(Stack);
        undefined -> []
    end.

%% @doc The place in a stack that its reader can mend: the innermost that belongs neither to Erlang
%% nor to StarL; or else the innermost that is known.
-spec place([frame()]) -> frame() | none.
place(Stack) ->
    Known = [Frame || {_, _, _, File, _} = Frame <- Stack, File =/= ""],
    case [Frame || {M, _, _, _, _} = Frame <- Known, not starl_code:is_library(M)] ++ Known of
        [Frame | _] -> Frame;
        [] -> none
    end.

%% Process identifiers, references and functions differ from run to run.
text(Reason, Stack) ->
    Text = in_words(Reason, Stack),
    Plain = re:replace(Text, "<[0-9.]+>", "<>", [global, unicode, {return, list}]),
    re:replace(Plain, "#Fun<([^>]*)\\.[0-9]+>", "#Fun<\\1>", [global, unicode, {return, list}]).

%% The frames below a machine belong to its interpreter; the frames of an application lie between
%% those of the runtime.
own(Stack) ->
    Above = lists:takewhile(fun(Frame) -> not is_interpreter(Frame) end, Stack),
    [plain(Frame) || Frame <- Above, not starl_code:is_runtime(element(1, Frame))].

is_interpreter({starl_machine_runner, Function, _, _}) ->
    lists:member(Function, [new, step, handle, moved_over, moved_down]);
is_interpreter({starl_machine, Function, _, _}) ->
    lists:member(Function, [new, step]);
is_interpreter(_) ->
    false.

plain({Module, Function, Args, Location}) when is_list(Args) ->
    plain({Module, Function, length(Args), Location});
plain({Module, Function, Arity, Location}) ->
    File = filename:basename(proplists:get_value(file, Location, "")),
    Line = proplists:get_value(line, Location, 0),
    {starl_version:original(Module), Function, Arity, File, Line}.

%% -- words ------------------------------------------------------------------------------------

%% Puts the reason of a crash into words. What Erlang itself calls by a short word, such as
%% `undef', is said in a sentence; any other reason is shown as a term.

%% The reason of an exception with this stack, in words.
-spec in_words(Reason :: term(), erlang:stacktrace()) -> unicode:chardata().
in_words({bad_return, {_Module, Function}, Value}, _Stack) ->
    returned(Function, Value);
in_words({step_never_blocks, #{actions_and_steps := Most}}, _Stack) ->
    io_lib:format(
        "step/2 lets no time pass: ~b actions and steps in one moment; "
        "starl:sleep(Robot, Ms) lets it pass",
        [Most]
    );
in_words({unknown_state, State}, _Stack) ->
    [
        "the code to which it went back does not know the state that new code has left: ",
        term(State)
    ];
in_words({no_way_back, Former}, _Stack) ->
    io_lib:format("its state cannot be converted back for ~ts: it starts anew", [
        starl_version:original(Former)
    ]);
in_words({unknown_event, Type, Content}, _Stack) ->
    ["it does not know an event that the former code knows: ", term({Type, Content})];
in_words(Reason, Stack) ->
    of_call(Reason, Stack).

%% What it calls cannot take it, or is not there.
of_call({no_such_machine, Name, add_it_to_blocks}, Stack) ->
    [
        io_lib:format("this robot has no machine ~tp; ", [Name]),
        case callers_block(Stack) of
            {ok, Block} -> io_lib:format("list its block: blocks() -> [~tp]", [Block]);
            none -> "is its block in the list of blocks/0?"
        end
    ];
of_call({given_up, Name, it_crashed_too_often}, _Stack) ->
    io_lib:format("this robot's machine ~tp crashed too often and was given up", [Name]);
of_call({bad_argument, #{function := {M, F, A}, argument := Argument, why := Why}}, _Stack) ->
    io_lib:format("~tp:~tp/~b cannot take this ~ts: ~ts", [M, F, A, Argument, Why]);
of_call({bad_argument, #{function := {M, F, A}, argument := Argument} = Mistake}, _Stack) ->
    #{given := Given, expected := Expected} = Mistake,
    io_lib:format("~tp:~tp/~b takes as ~ts ~ts, not ~ts", [
        M, F, A, Argument, Expected, term(Given)
    ]);
of_call({bad_payload, What, Why}, _Stack) ->
    io_lib:format("~ts cannot be sent or kept: ~ts", [term(What), Why]);
of_call({bad_action, Action, Expected}, _Stack) ->
    io_lib:format("~ts is no action; expected: ~ts", [term(Action), Expected]);
of_call(Reason, Stack) ->
    of_erlang(Reason, Stack).

of_erlang(undef, [{Module, Function, Args, _} | _]) ->
    undefined(Module, Function, arity(Args));
of_erlang(function_clause, [{Module, Function, Args, _} | _]) when is_list(Args) ->
    io_lib:format("no clause of ~tp:~tp/~b takes (~ts)", [
        Module, Function, length(Args), lists:join(", ", [argument(Arg) || Arg <- Args])
    ]);
of_erlang(if_clause, _Stack) ->
    "no branch of an if is true";
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
of_erlang({Kind, Value} = Reason, _Stack) ->
    case of_value() of
        #{Kind := Words} -> [Words, term(Value)];
        #{} -> term(Reason)
    end;
of_erlang(Reason, _Stack) ->
    term(Reason).

%% The words before a value that did not fit.
of_value() ->
    #{
        exit => "exit with ",
        nocatch => "thrown and not caught: ",
        badmatch => "no match of the value ",
        case_clause => "no clause of a case takes ",
        try_clause => "no clause of a try takes ",
        badkey => "the map has no key ",
        badmap => "this is no map: ",
        badrecord => "this is not the expected record: ",
        badfun => "this is no function: "
    }.

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
            [] -> meant(starl_similar:atoms(Function, lists:usort([F || {F, _} <- Exports])));
            Arities -> [" (but ", lists:join(", ", [[$/, integer_to_list(N)] || N <- Arities]), ")"]
        end
    ].

meant(Similar) -> starl_similar:meant(Similar, "").

name(Atom) -> io_lib:format("~tp", [Atom]).

%% -- terms ----------------------------------------------------------------------------------

arity(Args) when is_list(Args) -> length(Args);
arity(Arity) -> Arity.

term(Term) -> shown(Term, ?MOST_CHARS).

%% The handle of a robot says nothing to its owner.
argument(Robot) when element(1, Robot) =:= robot, tuple_size(Robot) =:= 3 -> "Robot";
argument(Term) -> shown(Term, ?ARGUMENT_CHARS).

shown(Term, Chars) -> io_lib:format("~0tP", [Term, ?DEPTH], [{chars_limit, Chars}]).
