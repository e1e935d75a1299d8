%% @doc Identifies a build of StarL. Two commits may have the same version number but different
%% code.
%%
%% The identifier is a hash of what the compiler made of the modules that decide a run. These are
%% the modules of the platform, the blocks, the simulator, the applications that ship, and the
%% program that runs.
%% ```
%%   1> starl_build:code([]).
%%   "51f3c0a8be42"
%% '''
%% It is the same in every directory, in a checkout and in an image made of it. Another release of
%% OTP, or other compiler options, produce other code from the same commit.
-module(starl_build).

-export([code/1]).

-export_type([code/0]).

%% Twelve digits, lower-case hexadecimal.
-type code() :: string().

-define(DIGITS, 12).

%% The applications whose code decides a run; a project may have fewer of them.
-define(APPS, [starl_platform, starl_blocks, starl_run, starl_sim, starl_apps]).

%% The parts of a compiled module that say what it does. The others hold the names of directories, lines
%% and what debuggers need.
-define(PARTS, [<<"AtU8">>, <<"Code">>, <<"StrT">>, <<"ImpT">>, <<"ExpT">>, <<"FunT">>, <<"LitT">>]).

%% @doc The name of the code that is in the path, together with these modules, compiled.
-spec code([Beam :: binary()]) -> code().
code(Beams) ->
    Own = [hash(Beam) || Beam <- Beams],
    %% A module of StarL's may be named as the program that runs.
    Hashes = lists:usort(Own ++ [Hash || App <- ?APPS, Hash <- hashes(code:lib_dir(App))]),
    lists:sublist(binary_to_list(string:lowercase(binary:encode_hex(erlang:md5(Hashes)))), ?DIGITS).

hashes({error, bad_name}) ->
    [];
hashes(Dir) ->
    [
        hash(Beam)
     || File <- filelib:wildcard(filename:join([Dir, "ebin", "*.beam"])),
        {ok, Beam} <- [file:read_file(File)]
    ].

hash(<<"FOR1", _Size:32, "BEAM", Parts/binary>>) -> erlang:md5(telling(Parts));
hash(Other) -> erlang:md5(Other).

telling(<<Name:4/binary, Size:32, Part:Size/binary, Others/binary>>) ->
    Padding = -Size band 3,
    <<_:Padding/binary, More/binary>> = Others,
    [[Name, Part] || lists:member(Name, ?PARTS)] ++ telling(More);
telling(_End) ->
    [].
