%% Nodes of this computer alone open nothing to the network: neither themselves nor Erlang's port mapper.
-module(starl_sim_net_tests).
-include_lib("eunit/include/eunit.hrl").

-define(LOOPBACK, "0100007F").

%% Where all that this starts listens, as Linux has it (elsewhere nothing is known of that).
the_port_mapper_listens_where_the_node_does_test_() ->
    {timeout, 60, fun() ->
        case filelib:is_regular("/proc/net/tcp") of
            true -> ?assertEqual({[?LOOPBACK], []}, listening());
            false -> ok
        end
    end}.

a_name_ends_where_its_line_does_test() ->
    [
        ?assertMatch({error, {bad_name, _}}, starl_sim_net:full_name(Text))
     || Text <- ["robots@host\n", "robots\n@host", "robots@ho st", "-@", "@", "a@b@c"]
    ].

listening() ->
    {ok, Socket} = gen_tcp:listen(0, []),
    {ok, Port} = inet:port(Socket),
    ok = gen_tcp:close(Socket),
    Epmd = integer_to_list(Port),
    Start =
        "ok = starl_sim_net:start(#{name => 'starl_net_test@127.0.0.1', cookie => c, loopback => true}),"
        "halt().",
    Paths = [filename:dirname(code:which(M)) || M <- [starl_sim_net]],
    Command = [
        "ERL_EPMD_PORT=",
        Epmd,
        " erl -noinput -pa ",
        lists:join(" ", Paths),
        " -eval \"",
        Start,
        "\" >/dev/null 2>&1"
    ],
    "" = os:cmd(lists:flatten(Command)),
    try
        {at(Port, "/proc/net/tcp"), [A || A <- at(Port, "/proc/net/tcp6"), is_open(A)]}
    after
        os:cmd("epmd -port " ++ Epmd ++ " -kill")
    end.

%% ::1 is this computer's own.
is_open(Address) -> Address =/= "00000000000000000000000001000000".

at(Port, File) ->
    {ok, Text} = file:read_file(File),
    Ending = io_lib:format(":~4.16.0B", [Port]),
    [
        lists:takewhile(fun(C) -> C =/= $: end, Local)
     || Line <- tl(string:split(binary_to_list(Text), "\n", all)),
        [_, Local, _, "0A" | _] <- [string:lexemes(Line, " ")],
        lists:suffix(lists:flatten(Ending), Local)
    ].
