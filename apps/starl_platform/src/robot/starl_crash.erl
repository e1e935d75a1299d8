%% @doc The crash of a machine or an application by itself: its reason, and where in its code it
%% happened. It reads the same whether the machine is a process or runs inline, and from run to run:
%% nothing of it depends on pids.
-module(starl_crash).

-export([reason/3, cause/1, format/1]).

-export_type([cause/0, frame/0]).

%% Where a function was called, the innermost first in a stack.
-type frame() :: {module(), Function :: atom(), arity(), File :: string(), Line :: integer()}.

%% The reason as a text, and the frames that are the machine's own.
-type cause() :: {Reason :: string(), [frame()]}.

-define(DEPTH, 20).
-define(MOST_CHARS, 400).

%% @doc What a process goes down with when this is raised in it: the stack comes along.
-spec reason(error | exit | throw, Reason :: term(), erlang:stacktrace()) -> term().
reason(error, Reason, Stack) -> {Reason, Stack};
reason(exit, Reason, Stack) -> {{exit, Reason}, Stack};
reason(throw, Value, Stack) -> {{nocatch, Value}, Stack}.

%% @doc The cause of an end with this reason; `none': it was ended from outside.
-spec cause(Reason :: term()) -> cause() | none.
cause(killed) -> none;
cause(store_full) -> none;
cause(shutdown) -> none;
cause({shutdown, _}) -> none;
cause({Reason, [Frame | _] = Stack}) when tuple_size(Frame) =:= 4 -> {text(Reason), own(Stack)};
cause(Reason) -> {text(Reason), []}.

%% @doc One line.
-spec format(cause()) -> unicode:chardata().
format({Reason, []}) -> Reason;
format({Reason, Stack}) -> [Reason, " at ", lists:join(", ", [frame(F) || F <- Stack])].

frame({Module, Function, Arity, File, Line}) ->
    io_lib:format("~ts:~ts/~b (~ts:~b)", [Module, Function, Arity, File, Line]).

%% Processes, references and functions are not the same in another run.
text(Reason) ->
    Text = io_lib:format("~0tP", [Reason, ?DEPTH], [{chars_limit, ?MOST_CHARS}]),
    Plain = re:replace(Text, "<[0-9.]+>", "<>", [global, unicode, {return, list}]),
    re:replace(Plain, "#Fun<([^>]*)\\.[0-9]+>", "#Fun<\\1>", [global, unicode, {return, list}]).

%% What lies below a machine is its interpreter; an application's own frames lie among those of the
%% runtime.
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
