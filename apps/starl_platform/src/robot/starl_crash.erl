%% @doc The cause of a crash: its reason, and its place in the code. A cause reads the same whether
%% the machine is a process or runs inline, and from run to run: it does not depend on pids.
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

%% @doc A frame in words: the function, and its file and line where they are known.
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
    Text = starl_crash_text:text(Reason, Stack),
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
