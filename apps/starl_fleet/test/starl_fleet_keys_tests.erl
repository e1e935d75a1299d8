%% The keys of a fleet: made once, never over another; certificates that openssl finds sound, and by which
%% nodes hear each other, and nobody whom a robot has signed.
-module(starl_fleet_keys_tests).
-include_lib("eunit/include/eunit.hrl").
-include_lib("kernel/include/file.hrl").

keys_test_() ->
    case os:find_executable("openssl") of
        false -> [];
        _ -> {timeout, 60, fun keys/0}
    end.

keys() ->
    Dir = filename:join("/tmp", "starl-keys-" ++ os:getpid()),
    Fleet = fleet(Dir, #{1 => #{host => "10.0.0.1"}}),
    ?assertMatch([_ | _], starl_fleet_keys:missing(Fleet)),
    {ok, Made} = starl_fleet_keys:make(Fleet),
    ?assertEqual([], starl_fleet_keys:missing(Fleet)),
    ?assertEqual(6, length([L || L <- flat(Made), lists:suffix(": made", L)])),
    Keys = filename:join(Dir, "keys"),
    {ok, First} = file:read_file(filename:join(Keys, "fleet.key")),
    %% a further robot: the others keep theirs
    More = fleet(Dir, #{1 => #{host => "10.0.0.1"}, 2 => #{host => "r2.lab"}}),
    {ok, Again} = starl_fleet_keys:make(More),
    ?assertEqual(2, length([L || L <- flat(Again), lists:suffix(": made", L)])),
    ?assertEqual({ok, First}, file:read_file(filename:join(Keys, "fleet.key"))),
    [sound(N, Host, Keys) || {N, Host} <- [{"1", "10.0.0.1"}, {"2", "r2.lab"}]],
    [limited(N, Keys) || N <- ["1", "2"]],
    ?assertEqual({ok, ok}, shaken({"1", "10.0.0.1"}, own("2", Keys), Keys)),
    ?assertMatch({error, _}, shaken({"1", "10.0.0.1"}, impostor(Keys), Keys)),
    [private(filename:join(Keys, F)) || F <- ["fleet.key", "ca.key", "robot-1/robot.key"]],
    ok = file:del_dir_r(Dir).

sound(N, Host, Keys) ->
    Pem = filename:join([Keys, "robot-" ++ N, "robot.pem"]),
    Line =
        "openssl verify -CAfile " ++ filename:join(Keys, "ca.pem") ++ " -verify_hostname " ++ Host,
    ?assertEqual(Pem ++ ": OK\n", os:cmd(Line ++ " " ++ Pem)).

%% A robot's certificate speaks for a node at either end of a connection, and signs nothing.
limited(N, Keys) ->
    Robot = text(filename:join([Keys, "robot-" ++ N, "robot.pem"])),
    [
        ?assertMatch({Part, {match, _}}, {Part, re:run(Robot, Part)})
     || Part <- [
            "Basic Constraints: critical\\s+CA:FALSE\\s",
            "X509v3 Key Usage: critical\\s+Digital Signature\n",
            "Extended Key Usage:\\s+TLS Web Server Authentication, TLS Web Client Authentication\n"
        ]
    ],
    Ca = text(filename:join(Keys, "ca.pem")),
    [
        ?assertMatch({Part, {match, _}}, {Part, re:run(Ca, Part)})
     || Part <- ["CA:TRUE, pathlen:0\n", "Key Usage: critical\\s+Certificate Sign"]
    ].

text(Pem) -> os:cmd("openssl x509 -noout -text -in " ++ Pem).

%% A connection as of Erlang distribution from a client to a robot's node: what each end says of it.
shaken({N, Host}, Client, Keys) ->
    {ok, _} = application:ensure_all_started(ssl),
    [{server, Common}, {client, Other}] = consulted(starl_fleet_net:tls()),
    {ok, Listening} = ssl:listen(0, placed(Common, own(N, Keys), Keys)),
    {ok, {_, Port}} = ssl:sockname(Listening),
    Test = self(),
    Name = [{server_name_indication, Host}],
    spawn_link(fun() ->
        Test !
            {client, heard(ssl:connect({127, 0, 0, 1}, Port, Name ++ placed(Other, Client, Keys)))}
    end),
    {ok, Socket} = ssl:transport_accept(Listening),
    Server = heard(ssl:handshake(Socket)),
    receive
        {client, ok} -> {Server, ok};
        {client, {error, _} = Error} -> Error
    end.

%% TLS 1.3: a client learns only afterwards that the server refuses it.
heard({ok, Socket}) ->
    _ = ssl:send(Socket, "hello"),
    case ssl:recv(Socket, 5) of
        {ok, _} -> ok;
        {error, _} = Error -> Error
    end;
heard({error, _} = Error) ->
    Error.

own(N, Keys) ->
    Dir = filename:join(Keys, "robot-" ++ N),
    {filename:join(Dir, "robot.pem"), filename:join(Dir, "robot.key")}.

%% A certificate that robot 1 has signed.
impostor(Keys) ->
    {Pem, Key} = own("1", Keys),
    [Request, New, Chain] = [filename:join(Keys, F) || F <- ["new.csr", "new.key", "new.pem"]],
    _ = os:cmd(
        "openssl req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj '/CN=robot 2' -keyout " ++
            New ++ " -out " ++ Request
    ),
    Signed = os:cmd(
        "openssl x509 -req -set_serial 7 -in " ++ Request ++ " -CA " ++ Pem ++ " -CAkey " ++ Key ++
            " 2>/dev/null"
    ),
    {ok, Own} = file:read_file(Pem),
    ok = file:write_file(Chain, [Signed, Own]),
    {Chain, New}.

placed(Options, {Pem, Key}, Keys) ->
    Files = [{certfile, Pem}, {keyfile, Key}, {cacertfile, filename:join(Keys, "ca.pem")}],
    [{active, false}, {log_level, none} | Files] ++
        [O || O <- Options, not lists:keymember(element(1, O), 1, Files)].

consulted(Text) ->
    {ok, Tokens, _} = erl_scan:string(lists:flatten(Text)),
    {ok, Terms} = erl_parse:parse_term(Tokens),
    Terms.

private(File) ->
    {ok, #file_info{mode = Mode}} = file:read_file_info(File),
    ?assertEqual(8#600, Mode band 8#777).

fleet(Dir, Robots) ->
    Given = #{name => "lab", app => starl_exercise, robots => Robots, transport => dist},
    {ok, Fleet} = starl_fleet_file:check(filename:join(Dir, "f.term"), Given, starl_exercise),
    Fleet.

flat(Lines) -> [unicode:characters_to_list(Line) || Line <- Lines].
