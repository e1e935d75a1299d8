%% @doc Runs shell commands (`sh'), several at a time.
-module(starl_fleet_shell).

-export([run/2]).

-type result() :: {ExitStatus :: integer() | timeout, Said :: string()}.

%% @doc Runs each command, all at the same time; the results come in the same order. What a command
%% says is cut beyond some thousand characters.
-spec run([{Key, Command :: string()}], TimeoutMs :: pos_integer()) -> [{Key, result()}].
run(Commands, Ms) ->
    Self = self(),
    Start = fun(Command) -> spawn_monitor(fun() -> Self ! {self(), one(Command, Ms)} end) end,
    Started = [{Key, Start(Command)} || {Key, Command} <- Commands],
    [{Key, await(Pid, Monitor)} || {Key, {Pid, Monitor}} <- Started].

await(Pid, Monitor) ->
    receive
        {Pid, Result} ->
            true = erlang:demonitor(Monitor, [flush]),
            Result;
        {'DOWN', Monitor, process, _, Why} ->
            {1, lists:flatten(io_lib:format("~0tp", [Why]))}
    end.

one(Command, Ms) ->
    %% nothing may ask
    Port = open_port({spawn_executable, "/bin/sh"}, [
        {args, ["-c", "exec </dev/null\n" ++ Command]},
        exit_status,
        stderr_to_stdout,
        binary,
        hide
    ]),
    Timer = erlang:send_after(Ms, self(), too_long),
    Result = said(Port, <<>>),
    _ = erlang:cancel_timer(Timer),
    Result.

said(Port, Text) ->
    receive
        {Port, {data, More}} -> said(Port, <<Text/binary, (cut(Text, More))/binary>>);
        {Port, {exit_status, Status}} -> {Status, text(Text)};
        too_long -> ended(erlang:port_info(Port, os_pid), Text)
    end.

ended({os_pid, Pid}, Text) ->
    _ = os:cmd("kill " ++ integer_to_list(Pid)),
    {timeout, text(Text)};
ended(undefined, Text) ->
    {timeout, text(Text)}.

cut(Text, More) when byte_size(Text) < 100_000 -> More;
cut(_Text, _More) -> <<>>.

text(Bytes) ->
    case unicode:characters_to_list(Bytes) of
        Text when is_list(Text) -> Text;
        _ -> binary_to_list(Bytes)
    end.
