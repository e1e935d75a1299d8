%% @doc Sets up Erlang distribution between the nodes of a fleet. It runs over TLS, with the
%% certificates of `./starl keys'. There is no port mapper: all nodes listen on the same port
%% ({@link vm_args/1}).
-module(starl_fleet_net).

-export([start/3, vm_args/1, tls/0]).

%% @doc Gives the node of a robot its name. The cookie follows from the fleet's key.
-spec start(starl:robot_id(), Keys :: file:filename(), starl_fleet_file:t()) ->
    ok | {error, unicode:chardata()}.
start(Robot, Keys, Fleet) ->
    Name = starl_fleet_adapters:node_name(Robot, Fleet),
    {ok, Key} = starl_live_key:load(filename:join(Keys, "fleet.key")),
    case net_kernel:start([Name, longnames]) of
        {ok, _} -> cookie(erlang:set_cookie(cookie(Key)));
        {error, Why} -> {error, io_lib:format("node ~ts cannot start: ~0tP", [Name, Why, 20])}
    end.

cookie(true) ->
    ok;
cookie(Key) ->
    binary_to_atom(binary:encode_hex(crypto:mac(hmac, sha256, Key(), <<"starl cookie 1">>))).

%% @doc The flags of the VM, for transport `dist'. Paths are relative to the robot's directory.
-spec vm_args(starl_fleet_file:t()) -> unicode:chardata().
vm_args(#{transport := dist, robots := #{1 := #{port := Port}}}) ->
    [
        "-proto_dist inet_tls\n-ssl_dist_optfile keys/tls.config\n-start_epmd false\n"
        "-kernel prevent_overlapping_partitions false\n-erl_epmd_port ",
        integer_to_list(Port),
        "\n"
    ];
vm_args(#{}) ->
    "".

%% @doc The file of TLS options. Each end must show a certificate that the fleet's own authority has
%% signed.
-spec tls() -> unicode:chardata().
tls() ->
    Own =
        "{certfile, \"keys/robot.pem\"}, {keyfile, \"keys/robot.key\"}, "
        "{cacertfile, \"keys/ca.pem\"}, {verify, verify_peer}, {depth, 0}",
    ["[{server, [", Own, ", {fail_if_no_peer_cert, true}]},\n {client, [", Own, "]}].\n"].
