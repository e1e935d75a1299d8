%% Each application that has `files' in its resource file is a package for Hex: its tarball is made and
%% read by rebar3's own hex_core, and its sources compile beside those of the packages that it names.
-module(starl_hex_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("common_test/include/ct.hrl").

-compile([export_all, nowarn_export_all]).

%% What the application `starl' stands for.
-define(LIBRARY, [starl, starl_platform, starl_blocks, starl_run, starl_sim, starl_check]).

suite() -> [{timetrap, {minutes, 5}}].

all() ->
    [
        metadata_is_complete,
        a_tarball_holds_what_the_build_needs,
        requirements_are_packages_with_versions,
        sources_find_what_they_need_in_the_tarballs,
        a_changed_byte_is_noticed
    ].

init_per_suite(Config) ->
    case has_hex_core() of
        true ->
            Apps = apps(),
            Dir = ?config(priv_dir, Config),
            [ok = file:write_file(file(App, Dir), tarball(App, Apps)) || App <- maps:keys(Apps)],
            %% Files: what is in Config is printed into the logs.
            [{apps, Apps}, {packages, Dir} | Config];
        false ->
            {skip, "rebar3 has no hex_core"}
    end.

end_per_suite(Config) -> Config.

file(App, Dir) -> filename:join(Dir, atom_to_list(App) ++ ".tar").

tarballs(Config) ->
    maps:map(
        fun(App, _) ->
            {ok, Tarball} = file:read_file(file(App, ?config(packages, Config))),
            Tarball
        end,
        ?config(apps, Config)
    ).

metadata_is_complete(Config) ->
    Apps = ?config(apps, Config),
    ?assertEqual([], ?LIBRARY -- maps:keys(Apps)),
    {ok, License} = file:read_file(filename:join(root(), "LICENSE")),
    [
        begin
            Description = maps:get(description, Keys),
            ?assertMatch({App, N} when N > 40 andalso N =< 300, {App, length(Description)}),
            ?assertEqual({App, ["Apache-2.0"]}, {App, maps:get(licenses, Keys)}),
            ?assertMatch({App, [{_, "https://" ++ _} | _]}, {App, maps:get(links, Keys)}),
            ?assertMatch({match, _}, re:run(maps:get(vsn, Keys), "^\\d+\\.\\d+\\.\\d+$")),
            ?assertEqual(
                {App, {ok, License}}, {App, file:read_file(filename:join(Dir, "LICENSE"))}
            ),
            {ok, Readme} = file:read_file(filename:join(Dir, "README.md")),
            ?assert(byte_size(Readme) > 60, App)
        end
     || {App, #{dir := Dir} = Keys} <- maps:to_list(Apps)
    ].

%% All that is in the repository but tests and mix, which builds from the repository alone.
a_tarball_holds_what_the_build_needs(Config) ->
    maps:foreach(
        fun(App, Tarball) ->
            {ok, #{contents := Files, metadata := Metadata}} = r3_hex_tarball:unpack(
                Tarball, memory
            ),
            Held = lists:sort([Name || {Name, _} <- Files]),
            ?assertEqual({App, needed(App, Config)}, {App, Held}),
            Named = [binary_to_list(Name) || Name <- maps:get(<<"files">>, Metadata)],
            ?assertEqual(Held, lists:sort(Named)),
            ?assertEqual(checksum(Tarball), inner(Tarball))
        end,
        tarballs(Config)
    ).

needed(starl, _Config) ->
    ["CHANGELOG.md", "LICENSE", "README.md", "src/starl.app.src"];
needed(App, Config) ->
    #{App := #{dir := Dir}} = ?config(apps, Config),
    {0, Text} = starl_first_hour_ct:sh("git ls-files -co --exclude-standard", Dir),
    lists:sort([
        Name
     || Name <- string:lexemes(Text, "\n"),
        not lists:prefix("test/", Name),
        Name =/= "mix.exs",
        filename:basename(Name) =/= ".gitignore"
    ]).

requirements_are_packages_with_versions(Config) ->
    Apps = ?config(apps, Config),
    maps:foreach(
        fun(App, Tarball) ->
            {ok, #{metadata := #{<<"requirements">> := Wanted}}} = r3_hex_tarball:unpack(
                Tarball, memory
            ),
            Needed = [A || A <- maps:get(applications, maps:get(App, Apps)), not is_otp(A)],
            ?assertEqual(
                {App, lists:sort(Needed)},
                {App, lists:sort([binary_to_existing_atom(Name) || Name <- maps:keys(Wanted)])}
            ),
            [
                ?assertEqual(list_to_binary(version(A, Apps)), Version)
             || A <- Needed,
                #{<<"requirement">> := Version} <- [maps:get(atom_to_binary(A), Wanted)]
            ]
        end,
        tarballs(Config)
    ).

%% Headers and behaviours: those of the packages that a package names, directly or not.
sources_find_what_they_need_in_the_tarballs(Config) ->
    Lib = filename:join(?config(priv_dir, Config), "lib"),
    maps:foreach(
        fun(App, Tarball) -> {ok, _} = r3_hex_tarball:unpack(Tarball, filename:join(Lib, App)) end,
        maps:with(?LIBRARY, tarballs(Config))
    ),
    Apps = ?config(apps, Config),
    Lacking = [
        {App, filename:basename(File), What}
     || App <- ?LIBRARY,
        Needed <- [needed_by(App, Apps)],
        Known <- [modules(Needed, Lib)],
        File <- sources(App, Lib),
        What <- lacking(File, [{includes, [filename:join(Lib, A) || A <- Needed] ++ [Lib]}], Known)
    ],
    ?assertEqual([], Lacking).

needed_by(App, Apps) ->
    Direct = [A || A <- maps:get(applications, maps:get(App, Apps)), is_map_key(A, Apps)],
    lists:usort([App | lists:flatmap(fun(A) -> needed_by(A, Apps) end, Direct)]).

sources(App, Lib) -> filelib:wildcard(filename:join([Lib, App, "src", "**", "*.erl"])).

modules(Apps, Lib) ->
    [list_to_atom(filename:basename(File, ".erl")) || App <- Apps, File <- sources(App, Lib)].

lacking(File, Options, Known) ->
    {ok, Forms} = epp:parse_file(File, Options),
    [Error || {error, Error} <- Forms] ++
        [
            Behaviour
         || {attribute, _, behaviour, Behaviour} <- Forms,
            not lists:member(Behaviour, Known),
            not is_otp_module(Behaviour)
        ].

is_otp_module(Module) ->
    case code:which(Module) of
        File when is_list(File) -> lists:prefix(code:lib_dir(), File);
        _ -> false
    end.

%% In the contents, in the metadata and in the padding of the outer tar, which only the outer sum covers.
a_changed_byte_is_noticed(Config) ->
    #{starl_platform := Tarball} = tarballs(Config),
    {ok, #{outer_checksum := Outer}} = r3_hex_tarball:unpack(Tarball, memory),
    [
        ?assertMatch(
            {error, {tarball, {inner_checksum_mismatch, _, _}}},
            r3_hex_tarball:unpack(Changed, memory)
        )
     || Part <- ["contents.tar.gz", "metadata.config"],
        Changed <- [changed(Part, Tarball)]
    ],
    ?assertEqual(Outer, crypto:hash(sha256, Tarball)).

changed(Part, Tarball) ->
    <<First:8/binary, _, Others/binary>> = bytes(Part, Tarball),
    Other = <<First/binary, $#, Others/binary>>,
    iolist_to_binary(binary:replace(Tarball, bytes(Part, Tarball), Other)).

%% -- tarballs -------------------------------------------------------------------------------

%% Loads rebar3's hex_core, whose modules have other names there.
has_hex_core() ->
    case os:find_executable("rebar3") of
        false -> false;
        Rebar -> load(escript:extract(Rebar, []))
    end.

load({ok, Parts}) ->
    {archive, Zip} = lists:keyfind(archive, 1, Parts),
    IsWanted = fun(File) ->
        re:run(element(2, File), "ebin/(r3_|safe).*[.]beam$", [{capture, none}]) =:= match
    end,
    {ok, Files} = zip:extract(Zip, [memory, {file_filter, IsWanted}]),
    [
        {module, _} = code:load_binary(list_to_atom(filename:basename(File, ".beam")), File, Beam)
     || {File, Beam} <- Files
    ],
    erlang:function_exported(r3_hex_tarball, create, 2);
load(_) ->
    false.

%% The applications that are packages, with what their resource files say.
apps() ->
    maps:from_list([
        {App, Keys#{dir => filename:dirname(filename:dirname(File))}}
     || Pattern <- ["src/*.app.src", "apps/*/src/*.app.src"],
        File <- filelib:wildcard(filename:join(root(), Pattern)),
        {ok, [{application, App, List}]} <- [file:consult(File)],
        Keys <- [maps:from_list(List)],
        is_map_key(files, Keys)
    ]).

tarball(App, Apps) ->
    #{App := #{dir := Dir, vsn := Version, files := Wanted, links := Links} = Keys} = Apps,
    Files = lists:append([files(Name, Dir) || Name <- Wanted]),
    Metadata = #{
        <<"name">> => atom_to_binary(App),
        <<"app">> => atom_to_binary(App),
        <<"version">> => list_to_binary(Version),
        <<"description">> => list_to_binary(maps:get(description, Keys)),
        <<"licenses">> => [list_to_binary(Name) || Name <- maps:get(licenses, Keys)],
        <<"links">> => maps:from_list([
            {list_to_binary(Name), list_to_binary(Url)}
         || {Name, Url} <- Links
        ]),
        <<"build_tools">> => [<<"rebar3">>],
        <<"files">> => [list_to_binary(Name) || {Name, _} <- Files],
        <<"requirements">> => requirements(maps:get(applications, Keys), Apps)
    },
    {ok, #{tarball := Tarball}} = r3_hex_tarball:create(Metadata, Files),
    Tarball.

files(Name, Dir) ->
    Path = filename:join(Dir, Name),
    case filelib:is_dir(Path) of
        true -> lists:append([files(filename:join(Name, N), Dir) || N <- listed(Path)]);
        false -> [{Name, Path}]
    end.

listed(Dir) ->
    {ok, Names} = file:list_dir(Dir),
    lists:sort(Names).

%% Siblings by their version: they are made for each other.
requirements(Applications, Apps) ->
    maps:from_list([
        {atom_to_binary(App), #{
            <<"app">> => atom_to_binary(App),
            <<"optional">> => false,
            <<"requirement">> => list_to_binary(version(App, Apps))
        }}
     || App <- Applications, not is_otp(App)
    ]).

version(App, Apps) when is_map_key(App, Apps) ->
    maps:get(vsn, maps:get(App, Apps));
version(App, _Apps) ->
    {ok, Terms} = file:consult(filename:join(root(), "rebar.config")),
    proplists:get_value(App, proplists:get_value(deps, Terms)).

is_otp(App) ->
    case code:lib_dir(App) of
        {error, bad_name} -> false;
        Dir -> lists:prefix(code:lib_dir(), Dir)
    end.

%% -- a tarball by its own rules ---------------------------------------------------------------

bytes(Part, Tarball) ->
    {ok, Parts} = erl_tar:extract({binary, Tarball}, [memory]),
    proplists:get_value(Part, Parts).

inner(Tarball) -> bytes("CHECKSUM", Tarball).

checksum(Tarball) ->
    Parts = [bytes(Part, Tarball) || Part <- ["VERSION", "metadata.config", "contents.tar.gz"]],
    binary:encode_hex(crypto:hash(sha256, Parts)).

root() -> starl_first_hour_ct:root().
