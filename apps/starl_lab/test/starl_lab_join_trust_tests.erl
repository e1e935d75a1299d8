%% To join the slices of a sweep loads the application that they name: only of a sweep that was begun here.
-module(starl_lab_join_trust_tests).
-include_lib("eunit/include/eunit.hrl").

a_sweep_that_was_begun_elsewhere_test_() -> {timeout, 120, fun begun_elsewhere/0}.

begun_elsewhere() ->
    Base = string:trim(os:cmd("mktemp -d")),
    Before = os:getenv("XDG_CONFIG_HOME"),
    Key = fun(Name) -> os:putenv("XDG_CONFIG_HOME", filename:join(Base, Name)) end,
    Dir = filename:join(Base, "study"),
    Marker = filename:join(Base, "ran"),
    {ok, Cwd} = file:get_cwd(),
    #{run := Join} = starl_lab_join:command(),
    App = filename:join(Base, "starl_evil_sweep.erl"),
    try
        ok = file:write_file(App, [
            "-module(starl_evil_sweep).\n-on_load(go/0).\n-export([init/2, step/2]).\n",
            "go() -> file:write_file(\"",
            Marker,
            "\", \"\").\n",
            "init(_, _) -> 1.\nstep(_, S) -> {done, S}.\n"
        ]),
        true = Key("stranger"),
        ok = slice(Dir, [App, "--seeds", "2"]),
        ?assert(starl_lab_sweep_study:is_ours([Dir])),
        true = Key("mine"),
        ?assertNot(starl_lab_sweep_study:is_ours([Dir])),
        ok = filelib:ensure_path(filename:join(Base, "src")),
        {ok, _} = file:copy(App, filename:join([Base, "src", "starl_evil_sweep.erl"])),
        ok = file:set_cwd(Base),
        [
            begin
                ok = slice(Dir, Args),
                %% a mark of somebody else
                true = Key("mine"),
                {error, [Line | _]} = Join(#{
                    subject => [Dir], values => #{out => none}
                }),
                ?assertMatch({Args, {match, _}}, {Args, re:run(Line, "say --trust")}),
                ?assertNot(filelib:is_regular(Marker))
            end
         || Args <- [
                [App],
                ["starl_evil_sweep"],
                ["src"],
                ["painting", "--choice", App ++ ",ink"],
                ["painting", "--choice=ink," ++ App ++ ",ink"]
            ],
            Key("stranger")
        ],
        %% an application that ships needs no trust
        ok = slice(filename:join(Base, "other"), ["painting", "--loss", "0.2"]),
        true = Key("third"),
        Shipped = Join(#{
            subject => [filename:join(Base, "other")], values => #{out => none}
        }),
        ?assertEqual(
            nomatch, string:find(lists:flatten(io_lib:format("~tp", [Shipped])), "--trust")
        )
    after
        ok = file:set_cwd(Cwd),
        case Before of
            false -> os:unsetenv("XDG_CONFIG_HOME");
            _ -> os:putenv("XDG_CONFIG_HOME", Before)
        end,
        file:del_dir_r(Base)
    end.

%% Slices that never end are none; nor is a source that would be looked into for its purpose.
endless_files_test_() ->
    {timeout, 30, fun() ->
        Dir = string:trim(os:cmd("mktemp -d")),
        {ok, Cwd} = file:get_cwd(),
        try
            ok = file:set_cwd(Dir),
            [
                begin
                    "" = os:cmd(
                        Make ++ " runs.csv; " ++ Make ++ " x.erl; mkdir -p src; " ++ Make ++
                            " src/y.erl"
                    ),
                    ?assertMatch(
                        {Make, {error, {file, _, _}}},
                        {Make, starl_lab_sweep_rows:read("runs.csv", none)}
                    ),
                    ?assert(is_list(starl_cli_target:purposes())),
                    "" = os:cmd("rm runs.csv x.erl src/y.erl")
                end
             || Make <- ["mkfifo", "ln -s /dev/zero", "truncate -s 5T"]
            ]
        after
            ok = file:set_cwd(Cwd),
            file:del_dir_r(Dir)
        end
    end}.

slice(Dir, Args) ->
    ok = filelib:ensure_path(Dir),
    File = filename:join(Dir, "slice-1-of-1"),
    ok = file:write_file(File ++ ".csv", ""),
    Text = starl_lab_sweep_study:note(Args, "x"),
    file:write_file(File ++ ".term", unicode:characters_to_binary(Text)).
