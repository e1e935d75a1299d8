%% @doc Commands of other terminals to a running cluster. They come over a socket in a directory of
%% the user's own. This module parses them and makes the texts of the answers; the cluster carries
%% them out.
%% ```
%%   ./starl cluster kill 2 --- ask --> socket --> a process for the command -- parse --> handler
%%                           <-- "ok" or "error", and a text ---------------------------/
%% '''
-module(starl_cluster_command).

-export([start_link/1, close/0, ask/2, ask/3]).
-export([words/1, parse/1, described/2, done/2]).

-export_type([t/0, answer/0]).

-type t() ::
    status
    | stop
    | {heal, starl_run_manual_fault:heal()}
    | {reload, starl_version:source()}
    | {inject, [starl_run_manual_fault:t()]}.

-type answer() :: {ok, unicode:chardata()} | {error, unicode:chardata()}.

%% Each command, and the number of words after the first one.
-define(COMMANDS, [
    {"status", 0},
    {"kill", 1},
    {"pause", 2},
    {"lose-store", 1},
    {"set-back", 1},
    {"cut", 2},
    {"freeze", 1},
    {"fill", 1},
    {"unplug", 1},
    {"sense", 3},
    {"heal", 0},
    {"stop", 0},
    {"reload", 1}
]).

-define(TIMEOUT_MS, 70000).
%% A client sends its line at once.
-define(LINE_MS, 2000).

%% -- words and texts ------------------------------------------------------------------------

%% @doc The number of words after the first one of a command; `none': it is no command.
-spec words(string()) -> non_neg_integer() | none.
words(Word) -> proplists:get_value(Word, ?COMMANDS, none).

%% @doc The command that these words are.
-spec parse([string()]) -> {ok, t()} | {error, unicode:chardata()}.
parse(["status"]) -> {ok, status};
parse(["stop"]) -> {ok, stop};
parse(["heal"]) -> {ok, {heal, all}};
parse(["reload", What]) -> {ok, {reload, source(What)}};
parse(["pause" | Words]) -> pause(Words);
parse(["sense" | Words]) -> sense(Words);
parse([Word | Robots]) -> faults(Word, [string:to_integer(Robot) || Robot <- Robots]);
parse([]) -> {error, "a command expected, as cluster status"}.

pause([Robot, Seconds]) ->
    case {string:to_integer(Robot), number(Seconds)} of
        {{Id, []}, S} when is_integer(Id), is_number(S) ->
            {ok, {inject, [{pause, Id, #{}, round(1000 * S)}]}};
        _ ->
            pause([])
    end;
pause(_) ->
    {error, "pause: a robot by its number and seconds, as in pause 3 1.5"}.

sense([Robot, Sense, How]) ->
    Senses = [{atom_to_list(Kind), Kind} || Kind <- [all | [K || {K, _} <- starl_sense:kinds()]]],
    Faults = [{"well", well, #{}} | starl_live_sense_fault:known()],
    case
        {string:to_integer(Robot), lists:keyfind(Sense, 1, Senses), lists:keyfind(How, 1, Faults)}
    of
        {{Id, []}, {_, Of}, {_, well, _}} when is_integer(Id) ->
            {ok, {heal, {sense, Id, Of}}};
        {{Id, []}, {_, Of}, {_, Kind, Params}} when is_integer(Id) ->
            {ok, {inject, [{Kind, Id, Params#{sense => Of}, lasting}]}};
        {{Id, []}, false, _} when is_integer(Id) ->
            wrong_sense(["there is no sense ", Sense, "; there are ", words_of(Senses)]);
        {{Id, []}, _, false} when is_integer(Id) ->
            wrong_sense(["a sense can be ", words_of(Faults), ", not ", How]);
        _ ->
            sense([])
    end;
sense(_) ->
    wrong_sense("a robot by its number, a sense, and what it is, as in sense 2 camera frozen").

wrong_sense(Why) -> {error, ["sense: ", Why]}.

words_of(Known) -> lists:join(", ", [element(1, Each) || Each <- Known]).

number(Text) ->
    case {string:to_float(Text), string:to_integer(Text)} of
        {{Float, []}, _} -> Float;
        {_, {Integer, []}} -> Integer;
        _ -> none
    end.

faults("kill", [{Robot, []}]) ->
    {ok, {inject, [{reboot, Robot, #{}, 0}]}};
faults("lose-store", [{Robot, []}]) ->
    {ok, {inject, [{store_lost, Robot, #{}, 0}]}};
faults("set-back", [{Robot, []}]) ->
    {ok, {inject, [{store_set_back, Robot, #{}, 0}]}};
faults("freeze", [{Robot, []}]) ->
    {ok, {inject, [{location_frozen, Robot, #{}, lasting}]}};
faults("fill", [{Robot, []}]) ->
    {ok, {inject, [{store_full, Robot, #{}, lasting}]}};
faults("unplug", [{Robot, []}]) ->
    {ok, {inject, [{serial_gone, Robot, #{}, lasting}]}};
faults("cut", [{A, []}, {B, []}]) when A =/= B ->
    {ok, {inject, starl_run_manual_fault:cut(A, B, lasting)}};
faults(Word, _) ->
    {error, [Word, ": robots by their numbers, as in cut 1 2 or kill 3"]}.

%% A file, an application as users name it, or a module.
source(What) ->
    case filename:extension(What) of
        ".erl" -> What;
        _ -> module(["starl_" ++ What, What])
    end.

%% The first of these that there is, else the last. A user's own words: few atoms.
module([Name | Names]) ->
    Module = list_to_atom(Name),
    case Names =:= [] orelse code:which(Module) =/= non_existing of
        true -> Module;
        false -> module(Names)
    end.

%% @doc The answer to `status', with what each node that has answered knows of the other robots.
-spec described(starl_world_run:status(), #{starl:robot_id() => [starl_live_peers:peer()]}) ->
    unicode:chardata().
described(
    #{now_us := Now, running := Running, up := Up, restarts := Restarts, os_pids := Pids}, Peers
) ->
    [
        io_lib:format("~.1f s, ~b at work~n", [Now / 1.0e6, Running])
        | [
            io_lib:format("robot ~b  ~-5s process ~s, started ~b times~ts~n", [
                Id,
                up(lists:member(Id, Up)),
                maps:get(Id, Pids, "-"),
                N + 1,
                hears(maps:get(Id, Peers, []))
            ])
         || {Id, N} <- lists:sort(maps:to_list(Restarts))
        ]
    ].

up(true) -> "up";
up(false) -> "down".

%% Whom it hears, and whom not, and why.
hears([]) ->
    "";
hears(Peers) ->
    Complaints = [
        [", ", Line]
     || Peer <- Peers, Line <- [starl_live_hearing:complaint(Peer)], Line =/= none
    ],
    Heard = length([x || #{is_silent := false, heard_ms := Ms} <- Peers, Ms =/= never]),
    [io_lib:format(", hears ~b of ~b others", [Heard, length(Peers)]) | Complaints].

%% @doc The answer to a command after which nodes are notified, with those that have not answered.
-spec done(t(), {ok, Unheard :: [starl:robot_id()]} | {error, unicode:chardata()}) -> answer().
done({heal, _}, {ok, Unheard}) -> {ok, ["healed", unheard(Unheard), "\n"]};
done(_Command, {ok, Unheard}) -> {ok, ["done", unheard(Unheard), "\n"]};
done(_Command, {error, _} = Error) -> Error.

unheard([]) ->
    "";
unheard(Robots) ->
    Ids = lists:join(", ", [integer_to_list(Id) || Id <- lists:sort(Robots)]),
    Of =
        case Robots of
            [_] -> "the node of robot ";
            _ -> "the nodes of robots "
        end,
    ["; no answer yet from ", Of, Ids].

%% -- the socket of a cluster ----------------------------------------------------------------

%% @doc Opens the socket of this VM's cluster.
-spec start_link(fun((t()) -> answer())) -> {ok, pid()} | {error, unicode:chardata()}.
start_link(Handler) ->
    Caller = self(),
    Pid = spawn_link(fun() -> listen(Caller, Handler) end),
    receive
        {Pid, ok} -> {ok, Pid};
        {Pid, {error, Why}} -> {error, Why}
    end.

listen(Caller, Handler) ->
    File = file(os:getpid()),
    case opened(File) of
        {ok, Socket} ->
            Caller ! {self(), ok},
            serve(Socket, Handler);
        {error, Why} ->
            Caller ! {self(), {error, Why}}
    end.

%% A user without a home, as that of a service, may have no directory for it.
opened(File) ->
    _ = file:delete(File),
    case filelib:ensure_dir(File) of
        ok ->
            _ = file:change_mode(filename:dirname(File), 8#700),
            Options = [{ifaddr, {local, File}}, {active, false}, {packet, line}, binary],
            case gen_tcp:listen(0, Options) of
                {ok, Socket} -> {ok, Socket};
                {error, Posix} -> {error, [File, ": ", inet:format_error(Posix)]}
            end;
        {error, Posix} ->
            {error, [
                dir(),
                " cannot be made: ",
                file:format_error(Posix),
                "; set XDG_CACHE_HOME to a directory of yours"
            ]}
    end.

dir() -> filename:join(filename:basedir(user_cache, "starl"), "clusters").

file(OsPid) -> filename:join(dir(), OsPid ++ ".sock").

serve(Listening, Handler) ->
    case gen_tcp:accept(Listening) of
        {ok, Socket} ->
            Server = spawn(fun() -> served(Socket, Handler) end),
            _ = gen_tcp:controlling_process(Socket, Server),
            Server ! {Socket, yours},
            serve(Listening, Handler);
        {error, _} ->
            ok
    end.

%% Each command runs in its own process, so a slow or crashing one blocks nobody.
served(Socket, Handler) ->
    receive
        {Socket, yours} -> ok
    end,
    _ = answered(gen_tcp:recv(Socket, 0, ?LINE_MS), Socket, Handler),
    gen_tcp:close(Socket).

answered({ok, Line}, Socket, Handler) ->
    Words = string:lexemes(unicode:characters_to_list(Line), " \n"),
    Answer =
        case carried_out(parse(Words), Handler) of
            {ok, Text} -> ["ok\n", Text];
            {error, Why} -> ["error\n", Why]
        end,
    gen_tcp:send(Socket, unicode:characters_to_binary(Answer));
answered({error, _}, _Socket, _Handler) ->
    ok.

carried_out({ok, Command}, Handler) -> Handler(Command);
carried_out({error, _} = Error, _Handler) -> Error.

%% @doc Removes the socket of this VM's cluster.
-spec close() -> ok.
close() ->
    _ = file:delete(file(os:getpid())),
    ok.

%% -- the other terminal ----------------------------------------------------------------------

%% @doc Sends a command to the cluster of this process number, or to the only one.
-spec ask([string(), ...], OsPid :: pos_integer() | none) ->
    answer().
ask(Words, OsPid) -> ask(Words, OsPid, ?TIMEOUT_MS).

%% @doc The same, with a limit on the milliseconds without a message of the cluster.
-spec ask([string(), ...], OsPid :: pos_integer() | none, Ms :: pos_integer()) ->
    answer().
ask(Words, OsPid, Ms) ->
    Running = [Pid || Pid <- pids(), OsPid =:= none orelse integer_to_list(OsPid) =:= Pid],
    case [Open || Pid <- Running, {ok, Socket} <- [connect(Pid)], Open <- [{Pid, Socket}]] of
        [] ->
            {error, "no cluster runs; start one first, as in ./starl cluster painting"};
        [{_, Socket}] ->
            asked(Words, Socket, Ms);
        [_, _ | _] = Several ->
            Each = lists:join(", ", [[Pid, doing(Pid)] || {Pid, _} <- Several]),
            {error, ["several clusters run; name one by --pid: ", Each]}
    end.

%% What the process was started with; only Linux tells.
doing(Pid) ->
    case file:read_file(filename:join(["/proc", Pid, "cmdline"])) of
        {ok, Line} ->
            case string:split(Line, <<0, "-extra", 0>>, trailing) of
                [_, Args] -> [" (", lists:join(" ", string:lexemes(Args, [0])), ")"];
                [_] -> ""
            end;
        {error, _} ->
            ""
    end.

pids() -> [filename:rootname(File) || File <- filelib:wildcard("*.sock", dir())].

%% The socket of a cluster that was killed is still there.
connect(Pid) ->
    File = file(Pid),
    case gen_tcp:connect({local, File}, 0, [{active, false}, binary], ?TIMEOUT_MS) of
        {ok, Socket} ->
            {ok, Socket};
        {error, _} = Error ->
            _ = file:delete(File),
            Error
    end.

asked(Words, Socket, Ms) ->
    ok = gen_tcp:send(Socket, [lists:join(" ", Words), "\n"]),
    Answer = all(Socket, Ms, []),
    ok = gen_tcp:close(Socket),
    case Answer of
        <<"ok\n", Text/binary>> ->
            {ok, Text};
        <<"error\n", Why/binary>> ->
            {error, Why};
        timeout ->
            {error, io_lib:format("no answer within ~b s; the cluster may be busy", [Ms div 1000])};
        _ ->
            {error, "the cluster has ended"}
    end.

all(Socket, Ms, Read) ->
    case gen_tcp:recv(Socket, 0, Ms) of
        {ok, Bytes} -> all(Socket, Ms, [Read, Bytes]);
        {error, timeout} -> timeout;
        {error, _} -> iolist_to_binary(Read)
    end.
