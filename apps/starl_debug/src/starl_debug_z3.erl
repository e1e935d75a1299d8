%% @doc Asks Z3, where it is installed (Debian: `z3'). Each query has a process of its own, so none
%% can disturb another; one that does not answer in time is killed, and its question stays
%% undecided.
-module(starl_debug_z3).

-export([find/0, solver/1, ask/3]).

-define(TIMEOUT_MS, 2000).
-define(MEMORY_MB, 512).
-define(END, "#end").

%% @doc The program, if it is there.
-spec find() -> {ok, file:filename()} | none.
find() ->
    case os:find_executable("z3") of
        false -> none;
        File -> {ok, File}
    end.

%% @doc A solver that asks this program.
-spec solver(file:filename()) -> starl_debug_cases:solver().
solver(File) -> fun(Query) -> ask(File, Query, ?TIMEOUT_MS) end.

%% @doc Asks one question, with a bound on the time.
-spec ask(file:filename(), iodata(), Ms :: pos_integer()) -> sat | unsat | undecided.
ask(File, Query, Ms) ->
    Arguments = [
        "-in", "-smt2", "-t:" ++ integer_to_list(Ms), "-memory:" ++ integer_to_list(?MEMORY_MB)
    ],
    try
        open_port({spawn_executable, File}, [
            {args, Arguments}, binary, stream, exit_status, stderr_to_stdout
        ])
    of
        Port ->
            %% the soft bound of Z3 does not hold in all its parts
            Watch = erlang:send_after(2 * Ms + 1000, self(), {?MODULE, Port}),
            Answer = asked(Port, [Query, "(check-sat)\n(echo \"", ?END, "\")\n(exit)\n"]),
            _ = erlang:cancel_timer(Watch),
            ok = flushed(Port),
            Answer
    catch
        error:_ -> undecided
    end.

asked(Port, Text) ->
    try port_command(Port, Text) of
        true -> heard(Port, <<>>)
    catch
        error:badarg -> undecided
    end.

heard(Port, Before) ->
    receive
        {Port, {data, Bytes}} -> heard(Port, <<Before/binary, Bytes/binary>>);
        {Port, {exit_status, _}} -> meaning(string:split(Before, "\n", all));
        {?MODULE, Port} -> killed(Port)
    end.

%% After an error Z3 goes on without what it did not understand: nothing that it says then counts.
meaning([<<"sat">>, <<?END>> | _]) -> sat;
meaning([<<"unsat">>, <<?END>> | _]) -> unsat;
meaning(_Other) -> undecided.

killed(Port) ->
    _ =
        case erlang:port_info(Port, os_pid) of
            {os_pid, Pid} -> os:cmd("kill -9 " ++ integer_to_list(Pid));
            undefined -> ok
        end,
    undecided.

%% What comes late from a port that is over.
flushed(Port) ->
    _ = [catch_closed(Port) || erlang:port_info(Port) =/= undefined],
    receive
        {Port, _} -> flushed(Port);
        {?MODULE, Port} -> flushed(Port)
    after 0 -> ok
    end.

catch_closed(Port) ->
    try
        port_close(Port)
    catch
        error:badarg -> true
    end.
