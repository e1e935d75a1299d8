%% A command of the command line in this VM: its exit status and what it prints.
-module(starl_cli_said).

-export([said/1]).

%% What the command prints, on both outputs, and its exit status.
said(Args) ->
    Self = self(),
    {Pid, Ref} = spawn_monitor(fun() ->
        Errors = whereis(standard_error),
        Sink = spawn_link(fun() -> sink([]) end),
        true = unregister(standard_error),
        true = register(standard_error, Sink),
        true = group_leader(Sink, self()),
        Status =
            try
                starl_cli:command(Args)
            after
                true = unregister(standard_error),
                true = register(standard_error, Errors)
            end,
        Sink ! {said, self()},
        receive
            {Sink, Text} -> Self ! {self(), {Status, Text}}
        end
    end),
    receive
        {Pid, Said} ->
            true = demonitor(Ref, [flush]),
            Said;
        {'DOWN', Ref, process, Pid, Reason} ->
            error(Reason)
    end.

sink(Said) ->
    receive
        {said, Pid} ->
            Pid ! {self(), unicode:characters_to_list(lists:reverse(Said))};
        {io_request, From, Tag, {put_chars, unicode, Text}} ->
            From ! {io_reply, Tag, ok},
            sink([Text | Said]);
        {io_request, From, Tag, _} ->
            From ! {io_reply, Tag, {error, enotsup}},
            sink(Said)
    end.
