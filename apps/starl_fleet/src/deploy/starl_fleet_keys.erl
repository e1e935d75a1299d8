%% @doc Makes the keys of a fleet. They are the key that its robots share and, for Erlang
%% distribution, a certificate authority with a certificate for each robot. Nothing is ever
%% overwritten.
%% ```
%%     keys/fleet.key                  shared by all robots
%%     keys/ca.key, keys/ca.pem        the authority; ca.key stays on this computer
%%     keys/tls.config                 options of TLS
%%     keys/robot-1/robot.key, .pem    robot 1
%% '''
%% The program `openssl' makes the certificates, so a fleet's administrator can make, inspect and
%% renew them with the same program. OTP's own records of certificates change with each release
%% (`pkix_test_data' itself says that it is for tests).
-module(starl_fleet_keys).

-export([make/1, missing/1, dir/1]).

-type line() :: unicode:chardata().

-define(DAYS, "3650").

%% @doc The directory of the keys.
-spec dir(starl_fleet_file:t()) -> file:filename().
dir(#{keys := [$/ | _] = Keys}) -> Keys;
dir(#{keys := Keys, dir := Dir}) -> Dir ++ "/" ++ Keys.

%% @doc The files of keys that a deployment needs and that are not there.
-spec missing(starl_fleet_file:t()) -> [file:filename()].
missing(Fleet) -> [File || {File, _} <- wanted(Fleet), not filelib:is_regular(File)].

%% @doc Makes the keys that are not there yet; a line for each file.
-spec make(starl_fleet_file:t()) -> {ok, [line()]} | {error, [line(), ...]}.
make(Fleet) ->
    Dir = dir(Fleet),
    case filelib:ensure_path(Dir) of
        ok ->
            _ = file:change_mode(Dir, 8#700),
            all(wanted(Fleet), []);
        {error, Why} ->
            {error, [[Dir, ": ", file:format_error(Why)]]}
    end.

%% The files in the order of their making, and how each is made.
wanted(#{transport := Transport, robots := Robots} = Fleet) ->
    Dir = dir(Fleet),
    Key = filename:join(Dir, "fleet.key"),
    [{Key, fun() -> starl_live_key:generate(Key) end}] ++
        lists:append([
            authority(Dir, Fleet) ++
                lists:append([certificate(Dir, N, R) || {N, R} <- lists:sort(maps:to_list(Robots))])
         || Transport =:= dist
        ]).

authority(Dir, #{name := Name}) ->
    [Key, Pem, Config] = [filename:join(Dir, F) || F <- ["ca.key", "ca.pem", "tls.config"]],
    Subject = "/CN=StarL fleet " ++ Name,
    [
        {Key, fun() -> private(Key) end},
        {Pem, fun() -> signed_by_itself(Subject, Key, Pem) end},
        {Config, fun() -> written(Config, starl_fleet_net:tls()) end}
    ].

certificate(Dir, N, #{address := Address}) ->
    Own = filename:join(Dir, "robot-" ++ integer_to_list(N)),
    [Key, Pem] = [filename:join(Own, F) || F <- ["robot.key", "robot.pem"]],
    [
        {Key, fun() ->
            ok = filelib:ensure_dir(Key),
            private(Key)
        end},
        {Pem, fun() -> signed(Dir, N, Address, Key, Pem) end}
    ].

%% The key is never readable by others, not even for a moment.
private(File) ->
    openssl(["genpkey -algorithm EC -pkeyopt ec_paramgen_curve:P-256 -out", q(File)]).

%% The authority signs robots' certificates, and no further authorities.
signed_by_itself(Subject, Key, Pem) ->
    Extensions = Pem ++ ".cnf",
    ok = file:write_file(Extensions, [
        "[req]\ndistinguished_name=name\nx509_extensions=authority\n[name]\n[authority]\n"
        "basicConstraints=critical,CA:TRUE,pathlen:0\nkeyUsage=critical,keyCertSign,cRLSign\n"
        "subjectKeyIdentifier=hash\n"
    ]),
    Words = ["-key", q(Key), "-days", ?DAYS, "-subj", q(Subject), "-out", q(Pem)],
    Made = openssl(["req -x509 -new -config", q(Extensions) | Words]),
    _ = file:delete(Extensions),
    Made.

%% The robot's address is in its certificate: a node is who it says. It signs nothing.
signed(Dir, N, Address, Key, Pem) ->
    Request = Pem ++ ".csr",
    Extensions = Pem ++ ".ext",
    ok = file:write_file(Extensions, [
        "basicConstraints=critical,CA:FALSE\nkeyUsage=critical,digitalSignature\n"
        "extendedKeyUsage=serverAuth,clientAuth\nsubjectAltName=",
        names(Address),
        "\n"
    ]),
    Subject = "/CN=robot " ++ integer_to_list(N),
    Asked = openssl(["req -new -key", q(Key), "-subj", q(Subject), "-out", q(Request)]),
    Made = next(Asked, fun() -> certified(Dir, Request, Extensions, Pem) end),
    _ = [file:delete(File) || File <- [Request, Extensions]],
    Made.

certified(Dir, Request, Extensions, Pem) ->
    [Ca, CaKey] = [q(filename:join(Dir, F)) || F <- ["ca.pem", "ca.key"]],
    openssl([
        "x509 -req -in",
        q(Request),
        "-CA",
        Ca,
        "-CAkey",
        CaKey,
        "-set_serial",
        integer_to_list(serial()),
        "-days",
        ?DAYS,
        "-extfile",
        q(Extensions),
        "-out",
        q(Pem)
    ]).

serial() -> binary:decode_unsigned(crypto:strong_rand_bytes(15)).

%% OTP compares an address of a node with the names, not with the addresses, of a certificate.
names(Address) ->
    case inet:parse_ipv4strict_address(Address) of
        {ok, _} -> ["IP:", Address, ",DNS:", Address];
        {error, _} -> ["DNS:", Address]
    end.

openssl(Words) ->
    Command = lists:flatten(["umask 077; openssl ", lists:join(" ", Words)]),
    case starl_fleet_shell:run([{openssl, Command}], 60_000) of
        [{_, {0, _}}] -> ok;
        [{_, {127, _}}] -> {error, "openssl is missing here; say: apt install openssl"};
        [{_, {_, Said}}] -> {error, ["openssl: ", lists:last(["" | string:lexemes(Said, "\n")])]}
    end.

q(Word) -> starl_fleet_steps:quoted(Word).

written(File, Text) ->
    case file:write_file(File, Text) of
        ok -> ok;
        {error, Why} -> {error, [File, ": ", file:format_error(Why)]}
    end.

next(ok, Next) -> Next();
next({error, _} = Error, _Next) -> Error.

all([], Lines) ->
    {ok, lists:reverse(Lines)};
all([{File, Make} | Rest], Lines) ->
    case filelib:is_regular(File) orelse Make() of
        true -> all(Rest, [[File, ": kept, it was there"] | Lines]);
        ok -> all(Rest, [[File, ": made"] | Lines]);
        {error, Why} -> {error, [Why]}
    end.
