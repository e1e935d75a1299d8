%% @doc Makes the release of a fleet: a directory with everything that its robots need, the same for
%% all of them. First it lists the files in a manifest. The release's version follows from the
%% files' content, so it is known before anything is written.
%%
%% With `ours' the release includes Erlang: the VM, the OTP applications that it uses, and their
%% shared libraries (except those of glibc). With `there' it includes our compiled code, for the
%% Erlang on the robot; with `source' the sources, which are compiled there.
-module(starl_fleet_release).
-include_lib("kernel/include/file.hrl").

-export([manifest/2, version/1, size_kb/1, write/3]).

-export_type([what/0, kind/0, manifest/0, code/0]).

%% `code': modules that were compiled in memory; `run': the run of the team whose code is reloaded.
-type what() :: #{
    fleet := starl_fleet_file:t(),
    kind := kind(),
    code => [code()],
    run => non_neg_integer()
}.

-type kind() :: ours | there | source.
-type code() :: {module(), Source :: file:filename(), Beam :: binary()}.

-type manifest() :: [{Path :: file:filename(), content()}].
-type content() :: {file | strip | run, file:filename()} | {text, unicode:chardata()}.

%% The OTP application that the user's own modules become.
-define(OWN, fleet_code).
-define(OWN_VSN, "1").
-define(ERTS, ["beam.smp", "erlexec", "erl_child_setup", "inet_gethost"]).
-define(LIBC,
    "^(linux-|ld-|libc|libm|libdl|libpthread|librt|libresolv|libutil|libnss_\\w+)[.0-9-]"
).

%% @doc The files of a release. Needs the `Scratch' directory for OTP's `systools'.
-spec manifest(what(), Scratch :: file:filename()) ->
    {ok, manifest()} | {error, unicode:chardata()}.
manifest(#{fleet := #{app := App} = Fleet, kind := Kind} = What, Scratch) ->
    Code = maps:get(code, What, []),
    Drivers = lists:append([owner(Driver, []) || Driver <- starl_fleet_adapters:drivers(Fleet)]),
    Roots = [starl_fleet | lists:usort(Drivers)] ++ owner(App, Code),
    case with_called(App, Code, apps(Roots, [])) of
        {ok, All} ->
            Own = [A || A <- All, not is_otp(A)],
            Files = common(What) ++ inputs(Fleet) ++ own(Own, Code, Kind),
            with_erlang(Kind, All, Code, Files, Scratch);
        {error, _} = Error ->
            Error
    end.

common(#{fleet := Fleet} = What) ->
    Files = [{Key, inside(Key, File)} || {Key, File} <- starl_fleet_file:files(Fleet)],
    [
        {"fleet.term", {text, starl_fleet_file:portable(Fleet, maps:from_list(Files))}},
        {"vm.args", {text, starl_fleet_net:vm_args(Fleet)}},
        {"sys.config", {text, sys_config()}},
        {"bin/robot", {run, priv("robot")}}
    ] ++ [{"run", {text, integer_to_list(Run)}} || #{run := Run} <- [What]].

inputs(Fleet) -> [{inside(K, File), {file, File}} || {K, File} <- starl_fleet_file:files(Fleet)].

inside(Key, File) -> filename:join(["inputs", atom_to_list(Key), filename:basename(File)]).

priv(Name) -> filename:join(code:priv_dir(starl_fleet), Name).

sys_config() ->
    Template = [time, " ", level, ": ", msg, "\n"],
    Formatter = {logger_formatter, #{single_line => true, template => Template}},
    %% OTP's default filters would drop our log events, which have no `otp' domain
    Filters = [{remote_gl, {fun logger_filters:remote_gl/2, stop}}],
    Handler =
        {handler, default, logger_std_h, #{
            formatter => Formatter, filters => Filters, filter_default => log
        }},
    io_lib:format("~tp.~n", [[{kernel, [{logger, [Handler]}]}]]).

%% -- applications ---------------------------------------------------------------------------

%% The OTP application of a user's project, if it is one.
owner(App, Code) ->
    case lists:keymember(App, 1, Code) of
        true -> [];
        false -> [list_to_atom(filename:basename(F, ".app")) || F <- app_files(code:which(App))]
    end.

app_files(Beam) -> filelib:wildcard(filename:join(filename:dirname(Beam), "*.app")).

%% An application and those below it, lowest first.
apps([], All) ->
    {ok, lists:reverse(All)};
apps([App | Apps], All) ->
    case lists:member(App, All) orelse loaded(application:load(App)) of
        true ->
            apps(Apps, All);
        {error, Why} ->
            Line = "the application ~ts is missing here: ~0tp; see ./starl setup",
            {error, io_lib:format(Line, [App, Why])};
        false ->
            case apps(needed(App), All) of
                {ok, Lower} -> apps(Apps, [App | lists:reverse(Lower)]);
                {error, _} = Error -> Error
            end
    end.

%% What an application can do without is none of a robot's.
needed(App) ->
    {ok, Below} = application:get_key(App, applications),
    {ok, Optional} = application:get_key(App, optional_applications),
    Below -- Optional.

%% An optional application comes along if the team's program calls it: a team that paints reads pictures.
with_called(App, Code, {ok, All}) ->
    Beams = maps:from_list([{Module, Beam} || {Module, _Source, Beam} <- Code]),
    Called = called([App], #{}, Beams),
    IsCalled = fun(Module) -> is_map_key(Module, Called) end,
    Optional = [
        Other
     || Known <- All,
        {ok, Others} <- [application:get_key(Known, optional_applications)],
        Other <- Others,
        lists:any(IsCalled, modules(Other))
    ],
    apps(lists:usort(Optional), lists:reverse(All));
with_called(_App, _Code, {error, _} = Error) ->
    Error.

modules(App) ->
    _ = application:load(App),
    {ok, Modules} = application:get_key(App, modules),
    Modules.

%% The modules that a module calls, directly or not; those of OTP are no matter.
called([], Seen, _Beams) ->
    Seen;
called([Module | Modules], Seen, Beams) when is_map_key(Module, Seen) ->
    called(Modules, Seen, Beams);
called([Module | Modules], Seen, Beams) ->
    Own = maps:get(Module, Beams, code:which(Module)),
    called(imports(Own) ++ Modules, Seen#{Module => true}, Beams).

imports(File) when is_list(File) ->
    case lists:prefix(code:lib_dir() ++ "/", File) of
        true -> [];
        false -> imports_of(File)
    end;
imports(Beam) when is_binary(Beam) -> imports_of(Beam);
imports(_Preloaded) ->
    [].

imports_of(Beam) ->
    case beam_lib:chunks(Beam, [imports]) of
        {ok, {_, [{imports, Imports}]}} -> lists:usort([Module || {Module, _, _} <- Imports]);
        {error, beam_lib, _} -> []
    end.

loaded(ok) -> false;
loaded({error, {already_loaded, _}}) -> false;
loaded({error, _} = Error) -> Error.

is_otp(App) -> lists:prefix(code:lib_dir() ++ "/", code:lib_dir(App)).

folder(App) ->
    {ok, Vsn} = application:get_key(App, vsn),
    filename:join("lib", atom_to_list(App) ++ "-" ++ Vsn).

%% StarL's own and the user's applications.
own(Apps, Code, Kind) -> lists:append([app(App, Kind, file) || App <- Apps]) ++ user(Code, Kind).

app(App, source, _How) ->
    Ebin = [{Name, {file, File}} || {Name, File} <- tree(App, "ebin"), is_app_file(Name)],
    Rest = [{Name, {file, F}} || Dir <- ["src", "include"], {Name, F} <- tree(App, Dir)],
    Ebin ++ Rest ++ [{Name, {mode(File), File}} || {Name, File} <- tree(App, "priv")];
app(App, _Kind, How) ->
    Code = [{Name, {how(How, Name), File}} || {Name, File} <- tree(App, "ebin"), is_code(Name)],
    Code ++ [{Name, {mode(File), File}} || {Name, File} <- tree(App, "priv")].

how(How, Name) ->
    case filename:extension(Name) of
        ".beam" -> How;
        _ -> file
    end.

is_app_file(Name) -> filename:extension(Name) =:= ".app".
is_code(Name) -> lists:member(filename:extension(Name), [".beam", ".app"]).

%% A library, or a program such as that of a Create's port.
mode(File) ->
    case {filename:extension(File), is_executable(File)} of
        {".so", _} -> run;
        {_, true} -> run;
        {_, false} -> file
    end.

is_executable(File) ->
    {ok, #file_info{mode = Mode}} = file:read_file_info(File),
    Mode band 8#100 =/= 0.

tree(App, Dir) ->
    Root = filename:join(code:lib_dir(App), Dir),
    [
        {filename:join([folder(App), Dir, Name]), File}
     || Name <- filelib:wildcard("**", Root),
        File <- [filename:join(Root, Name)],
        filelib:is_regular(File)
    ].

user([], _Kind) ->
    [];
user(Code, Kind) ->
    Dir = filename:join("lib", atom_to_list(?OWN) ++ "-" ++ ?OWN_VSN),
    [{filename:join([Dir, "ebin", atom_to_list(?OWN) ++ ".app"]), {text, own_app(Code)}}] ++
        [module(Dir, Module, Kind) || Module <- Code].

module(Dir, {Module, Source, _Beam}, source) ->
    {filename:join([Dir, "src", atom_to_list(Module) ++ ".erl"]), {file, Source}};
module(Dir, {Module, _Source, Beam}, _Kind) ->
    {filename:join([Dir, "ebin", atom_to_list(Module) ++ ".beam"]), {text, Beam}}.

own_app(Code) ->
    Keys = [
        {description, "the application of this fleet"},
        {vsn, ?OWN_VSN},
        {modules, [Module || {Module, _, _} <- Code]},
        {registered, []},
        {applications, [kernel, stdlib, starl_platform]}
    ],
    io_lib:format("~tp.~n", [{application, ?OWN, Keys}]).

%% -- Erlang ---------------------------------------------------------------------------------

with_erlang(ours, All, Code, Files, Scratch) ->
    Otp = lists:append([app(App, ours, strip) || App <- All, is_otp(App)]),
    Erts = filename:join(code:root_dir(), "erts-" ++ erlang:system_info(version)),
    Vm = [
        {
            filename:join([filename:basename(Erts), "bin", Name]),
            {run, filename:join([Erts, "bin", Name])}
        }
     || Name <- ?ERTS
    ],
    With = Files ++ Otp ++ Vm,
    case boot(All, Code, Files, Scratch) of
        {ok, Boot} -> {ok, With ++ Boot ++ native([File || {_, {run, File}} <- With])};
        {error, _} = Error -> Error
    end;
with_erlang(_Kind, _All, _Code, Files, _Scratch) ->
    {ok, Files}.

%% OTP's systools reads the user's `.app' file from a directory.
boot(All, Code, Files, Scratch) ->
    ok = filelib:ensure_path(Scratch),
    Own = [{N, T} || {N, {text, T}} <- Files, lists:prefix("lib/", N)],
    _ = [to_file(filename:join(Scratch, filename:basename(Name)), Text) || {Name, Text} <- Own],
    Extra = [{?OWN, ?OWN_VSN} || Code =/= []],
    Versions = [{App, vsn(App)} || App <- All],
    Scripts = [
        {"start", Versions ++ Extra}, {"start_clean", [{A, vsn(A)} || A <- [kernel, stdlib]]}
    ],
    boot_files([script(Name, Apps, Scratch) || {Name, Apps} <- Scripts]).

boot_files([{ok, A}, {ok, B}]) -> {ok, [A, B]};
boot_files(Scripts) -> hd([Error || {error, _} = Error <- Scripts]).

vsn(App) ->
    {ok, Vsn} = application:get_key(App, vsn),
    Vsn.

script(Name, Apps, Scratch) ->
    Release = {release, {"starl", "1"}, {erts, erlang:system_info(version)}, Apps},
    Base = filename:join(Scratch, Name),
    to_file(Base ++ ".rel", io_lib:format("~tp.~n", [Release])),
    case systools:make_script(Base, [{path, [Scratch]}, {outdir, Scratch}, silent, no_warn_sasl]) of
        {ok, _, _} -> {ok, {Name ++ ".boot", {file, Base ++ ".boot"}}};
        {error, Module, Why} -> {error, ["OTP's systools: ", Module:format_error(Why)]}
    end.

to_file(File, Text) ->
    ok = file:write_file(File, bytes(Text)).

bytes(Beam) when is_binary(Beam) -> Beam;
bytes(Text) -> unicode:characters_to_binary(Text).

%% The shared libraries that our VM uses and another Linux may not have.
native(Executables) ->
    Binaries = [File || File <- Executables, is_elf(File)],
    Said = os:cmd("ldd " ++ lists:append(lists:join(" ", Binaries)) ++ " 2>/dev/null"),
    {match, Found} =
        case re:run(Said, "(\\S+) => (/\\S+)", [global, {capture, all_but_first, list}]) of
            nomatch -> {match, []};
            Match -> Match
        end,
    [
        {filename:join("native", Name), {run, File}}
     || [Name, File] <- lists:usort(Found), re:run(Name, ?LIBC, [{capture, none}]) =:= nomatch
    ].

is_elf(File) ->
    {ok, Device} = file:open(File, [read, binary, raw]),
    Head = file:read(Device, 4),
    ok = file:close(Device),
    Head =:= {ok, <<16#7F, "ELF">>}.

%% -- version, writing -----------------------------------------------------------------------

%% @doc The version of a release: StarL's, and a hash of all files.
-spec version(manifest()) -> string().
version(Manifest) ->
    {ok, Vsn} = application:get_key(starl_fleet, vsn),
    Sums = [[Path, 0, crypto:hash(sha256, content(C))] || {Path, C} <- lists:sort(Manifest)],
    <<Sum:5/binary, _/binary>> = crypto:hash(sha256, Sums),
    Vsn ++ "-" ++ string:lowercase(binary_to_list(binary:encode_hex(Sum))).

content({text, Text}) ->
    bytes(Text);
content({_, File}) ->
    {ok, Bytes} = file:read_file(File),
    Bytes.

%% @doc The size of a release, in kilobytes, before it is stripped.
-spec size_kb(manifest()) -> non_neg_integer().
size_kb([]) -> 0;
size_kb([{_, Content} | Rest]) -> 1 + size_of(Content) div 1024 + size_kb(Rest).

size_of({text, Text}) -> byte_size(bytes(Text));
size_of({_, File}) -> filelib:file_size(File).

%% @doc Writes a release into the directory of its version below `Dir', unless it is there.
-spec write(manifest(), Version :: string(), Dir :: file:filename()) ->
    {ok, file:filename()} | {error, unicode:chardata()}.
write(Manifest, Version, Dir) ->
    Release = filename:join(Dir, Version),
    New = Release ++ ".new",
    case filelib:is_dir(Release) of
        true -> {ok, Release};
        false -> written(all_written(Manifest, New), New, Release, Dir)
    end.

written({error, Why}, New, _Release, _Dir) ->
    _ = file:del_dir_r(New),
    {error, Why};
written(ok, New, Release, Dir) ->
    Old = [D || D <- filelib:wildcard(filename:join(Dir, "*-*")), D =/= New, filelib:is_dir(D)],
    lists:foreach(fun(D) -> ok = file:del_dir_r(D) end, Old),
    ok = file:rename(New, Release),
    {ok, Release}.

all_written([], _Dir) ->
    ok;
all_written([{Path, Content} | Rest], Dir) ->
    File = filename:join(Dir, Path),
    Made = filelib:ensure_dir(File),
    case one_written(Made, Content, File) of
        ok -> all_written(Rest, Dir);
        {error, Why} -> {error, [File, ": ", file:format_error(Why)]}
    end.

one_written({error, _} = Error, _Content, _File) ->
    Error;
one_written(ok, {strip, From}, File) ->
    %% of the bytes, since given a file beam_lib strips that file; lines stay: they tell of crashes
    {ok, Whole} = file:read_file(From),
    {ok, {_, Beam}} = beam_lib:strip(Whole, ["Line", "Attr"]),
    file:write_file(File, uncompressed(Beam));
one_written(ok, {run, _} = Content, File) ->
    first_error(file:write_file(File, content(Content)), fun() ->
        file:change_mode(File, 8#755)
    end);
one_written(ok, Content, File) ->
    file:write_file(File, content(Content)).

%% The boot loader reads no compressed code.
uncompressed(<<31, 139, _/binary>> = Beam) -> zlib:gunzip(Beam);
uncompressed(Beam) -> Beam.

first_error(ok, Next) -> Next();
first_error({error, _} = Error, _Next) -> Error.
