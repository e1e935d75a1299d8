%% @doc The cause of a crash: its reason, and its place in the code. A cause reads the same whether
%% the machine is a process or runs inline, and from run to run: it does not depend on pids.
-module(starl_crash).

-export([reason/3, cause/1, format/1]).

-export_type([cause/0, frame/0]).

%% The place of a call; the innermost call comes first in a stack.
-type frame() :: {module(), Function :: atom(), arity(), File :: string(), Line :: integer()}.

%% The reason as text, and the frames of the machine's own code.
-type cause() :: {Reason :: string(), [frame()]}.

-define(DEPTH, 20).
-define(MOST_CHARS, 400).

%% @doc The exit reason for a raised exception, with its stack.
-spec reason(error | exit | throw, Reason :: term(), erlang:stacktrace()) -> term().
reason(error, Reason, Stack) -> {Reason, Stack};
reason(exit, Reason, Stack) -> {{exit, Reason}, Stack};
reason(throw, Value, Stack) -> {{nocatch, Value}, Stack}.

%% @doc The cause behind an exit reason; `none': the process was ended from outside.
-spec cause(Reason :: term()) -> cause() | none.
cause(killed) -> none;
cause(store_full) -> none;
cause(shutdown) -> none;
cause({shutdown, _}) -> none;
cause({Reason, [Frame | _] = Stack}) when tuple_size(Frame) =:= 4 -> {text(Reason), own(Stack)};
cause(Reason) -> {text(Reason), []}.

%% @doc A cause as one line.
-spec format(cause()) -> unicode:chardata().
format({Reason, []}) -> Reason;
format({Reason, Stack}) -> [Reason, " at ", lists:join(", ", [frame(F) || F <- Stack])].

frame({Module, Function, Arity, File, Line}) ->
    io_lib:format("~ts:~ts/~b (~ts:~b)", [Module, Function, Arity, File, Line]).

%% Process identifiers, references and functions differ from run to run.
text(Reason) ->
    Text = io_lib:format("~0tP", [Reason, ?DEPTH], [{chars_limit, ?MOST_CHARS}]),
    Plain = re:replace(Text, "<[0-9.]+>", "<>", [global, unicode, {return, list}]),
    re:replace(Plain, "#Fun<([^>]*)\\.[0-9]+>", "#Fun<\\1>", [global, unicode, {return, list}]).

%% The frames below a machine belong to its interpreter; the frames of an application lie between
%% those of the runtime.
own(Stack) ->
    Above = lists:takewhile(fun(Frame) -> not is_interpreter(Frame) end, Stack),
    [plain(Frame) || Frame <- Above, not is_runtime(element(1, Frame))].

is_interpreter({starl_machine, Function, _, _}) -> lists:member(Function, [new, step, handle]);
is_interpreter(_) -> false.

is_runtime(Module) ->
    lists:member(Module, [starl_app_proc, starl_machine_proc, gen_statem, proc_lib]).

plain({Module, Function, Args, Location}) when is_list(Args) ->
    plain({Module, Function, length(Args), Location});
plain({Module, Function, Arity, Location}) ->
    File = filename:basename(proplists:get_value(file, Location, "")),
    {Module, Function, Arity, File, proplists:get_value(line, Location, 0)}.
