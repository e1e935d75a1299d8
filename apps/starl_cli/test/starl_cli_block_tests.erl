%% Building blocks on the command line: those that ship, from their one table, and one of a user's
%% own, with its machine and its monitor, which the project knows nothing of.
-module(starl_cli_block_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_cli_vm, [says/3, contains/2, in_directory/1]).

-define(PATIENCE_S, 90).

commands_test_() ->
    patient([
        {"blocks", fun all_are_listed/0},
        {"blocks --help", fun() -> says(0, "Usage: ./starl blocks", ["blocks", "--help"]) end},
        {"blocks mutx", fun() -> says(2, "did you mean mutex?", ["blocks", "mutx"]) end},
        {"blocks a b", fun() -> says(2, "unexpected argument \"b\"", ["blocks", "sap", "b"]) end},
        {"blocks FILE", fun() ->
            Text = says(0, "no more greetings are heard", ["blocks", own("my_relay")]),
            contains("contracts: my_relay", Text),
            contains("greeting => hello", Text)
        end},
        {"blocks of an application", fun() ->
            says(2, "this is no building block", ["blocks", own("my_relay_app")])
        end}
    ]).

%% Every block with its guarantee, its contracts, what it can and its options.
all_are_listed() ->
    Text = says(0, "no two robots hold one token", ["blocks"]),
    [
        contains(["\n", atom_to_list(Name), " ("], "\n" ++ Text)
     || {Name, _} <- starl_block_catalogue:known()
    ],
    contains("contracts: mutex", Text),
    contains("can: exercise, check, bench", Text),
    contains("lease_ms => 8000", Text).

%% The example of CONTRIBUTING.md.
counter_test_() ->
    patient([
        {"soak", fun() ->
            Args = ["soak", "counter", "--seeds", "6", "--from", "3", "--jobs", "1"],
            contains("counter          6          0         0", says(0, "seeds/min/core", Args))
        end},
        {"check", fun() ->
            Args = ["check", "counter", "--robots", "2", "--quiet"],
            says(0, "The contract of counter holds in every state.", Args)
        end},
        {"run", fun() ->
            in_directory(fun(Dir) ->
                Out = filename:join(Dir, "run"),
                Args = ["run", "exercise", "--block", "counter", "--final", "2", "--out", Out],
                says(0, "complete", Args),
                {ok, Report} = file:read_file(filename:join(Out, "report.txt")),
                contains("counter, crash, exercise, motion, sap", binary_to_list(Report)),
                %% agreement was judged
                ?assertMatch({match, _}, re:run(Report, "agreed +[1-9]"))
            end)
        end}
    ]).

%% Beside its application, a block is found; what judged stands in the report.
own_run_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            Out = filename:join(Dir, "run"),
            says(0, "my_relay_app: complete", ["run", own("my_relay_app"), "--out", Out]),
            {ok, Report} = file:read_file(filename:join(Out, "report.json")),
            contains(
                "\"contracts\": [\"my_relay\",\"crash\",\"motion\",\"sap\"]", binary_to_list(Report)
            ),
            says(0, "same digest", ["replay", Out])
        end)
    end}.

own_soak_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        Args = ["soak", own("my_relay"), "--seeds", "4", "--jobs", "1"],
        contains("my_relay         4          0         0", says(0, "seeds/min/core", Args))
    end}.

own_check_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        Args = ["check", own("my_relay"), "--robots", "2", "--quiet"],
        says(0, "The contract of my_relay holds in every state.", Args)
    end}.

%% Its monitor judges: with its bug the run breaks its contract, and a command replays it.
own_is_judged_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            Bug = ["--with", "#{greeting => twice}"],
            Out = ["--out", filename:join(Dir, "run")],
            Text = says(3, "heard too often", ["run", own("my_relay") | Bug ++ Out]),
            contains("my_relay.erl --robots 4 --seed 1 --block my_relay --with", Text)
        end)
    end}.

%% What it promises its callers is judged, too: by soak, and from a recording.
%% Holds: A block of a user's own that says what it promises its callers is judged by it, in soak
%% and from a recording
%% Red: with the models of the blocks that ship alone, in `starl_lab_soak` and in
%% `starl_lab_recording`, run
%% Holds: What only histories accuse is run again, compared and shrunk with `--judge-histories`
%% Red: before the flag was there, run
own_histories_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            Out = filename:join(Dir, "run"),
            says(0, "complete", ["run", own("my_relay"), "--record", "--out", Out]),
            says(0, "my_relay greetings: ", ["histories", Out]),
            [
                {ok, _} = file:copy(own(Name), filename:join(Dir, Name ++ ".erl"))
             || Name <- ["my_relay_monitor", "my_relay_history"]
            ],
            {ok, Sound} = file:read_file(own("my_relay")),
            Lying = string:replace(Sound, "{reply, From, Greeting}", "{reply, From, twice}"),
            File = filename:join(Dir, "my_relay.erl"),
            ok = file:write_file(File, Lying),
            Soak = ["soak", File, "--seeds", "1", "--jobs", "1", "--shrink", "0"],
            says(3, "history broken at ", Soak),
            %% what only histories accuse is run again, and made small, if they are judged
            Judged = filename:join(Dir, "judged"),
            Small = filename:join(Dir, "small.term"),
            says(0, "complete", ["run", File, "--out", filename:join(Dir, "blind")]),
            says(3, "history broken at ", ["run", File, "--judge-histories", "--out", Judged]),
            says(0, "same digest ", ["replay", Judged, "--judge-histories"]),
            says(0, "history broken at ", [
                "shrink", Judged, "--judge-histories", "--out", Small, "--seconds", "5"
            ]),
            says(3, "history broken at ", [
                "run", Small, "--judge-histories", "--out", filename:join(Dir, "again")
            ])
        end)
    end}.

%% One line that names the application, the block and the key.
mistakes_test_() ->
    patient([
        {Part, fun() -> mistaken(Blocks, Part) end}
     || {Blocks, Part} <- [
            {"[{starl_mutex, #{lease_m => 2000}}]",
                "mine.erl:4: blocks/0: block starl_mutex: unknown key lease_m (did you mean lease_ms?)\n"},
            {"[{starl_mutex, #{lease_ms => soon}}]",
                "mine.erl:4: blocks/0: block starl_mutex: lease_ms: a whole number from"},
            {"[starl_mutex, {starl_mutex, #{}}]",
                "mine.erl:4: blocks/0: block starl_mutex is listed twice\n"},
            {"[starl_election, starl_bully]",
                "mine.erl:4: blocks/0: block starl_election and block starl_bully have a machine of the same "
                "name, election\n"},
            {"[starl_mutx]",
                "mine.erl:4: blocks/0: starl_mutx is no building block: there is no such"},
            {"[starl_sap]",
                "mine.erl:4: blocks/0: starl_sap is no building block: it does not export"},
            {"[\"mutex\"]", "mine.erl:4: blocks/0: a building block is listed as Module or"},
            {"starl_mutex", "mine.erl:4: blocks/0: a list of building blocks expected"},
            {"[{sap, starl_sap, #{}}]", "the machine sap: every robot has a machine sap already\n"}
        ]
    ]).

mistaken(Blocks, Part) ->
    in_directory(fun(Dir) ->
        File = filename:join(Dir, "mine.erl"),
        ok = file:write_file(File, [
            "-module(mine).\n-behaviour(starl_app).\n-export([blocks/0, init/2, step/2]).\n",
            "blocks() -> ",
            Blocks,
            ".\ninit(_, _) -> 0.\nstep(_, _) -> {done, 0}.\n"
        ]),
        Text = says(2, Part, ["run", File, "--out", filename:join(Dir, "run")]),
        ?assertEqual(1, length(string:lexemes(Text, "\n")), Text)
    end).

%% What is wrong in a file beside is told with that file's name.
beside_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            Write = fun(Name, Text) -> file:write_file(filename:join(Dir, Name), Text) end,
            ok = Write("mine.erl", [
                "-module(mine).\n-behaviour(starl_app).\n-export([blocks/0, init/2, step/2]).\n",
                "blocks() -> [other].\ninit(_, _) -> 0.\nstep(_, _) -> {done, 0}.\n"
            ]),
            ok = Write("other.erl", "-module(other).\nf( -> ok.\n"),
            says(2, "other.erl:2: syntax error", ["run", filename:join(Dir, "mine.erl")])
        end)
    end}.

%% The line_up example is held to the contract of its election.
line_up_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            Out = filename:join(Dir, "run"),
            says(0, "complete", [
                "run", filename:join([root(), "examples", "line_up.erl"]), "--out", Out
            ]),
            {ok, Report} = file:read_file(filename:join(Out, "report.txt")),
            contains("crash, election, motion, sap", binary_to_list(Report))
        end)
    end}.

%% Each in a VM of its own, which takes its time.
patient(Tests) -> [{Title, {timeout, ?PATIENCE_S, Test}} || {Title, Test} <- Tests].

own(Name) -> filename:join([root(), "examples", "own_block", Name ++ ".erl"]).

root() -> hd(string:split(code:which(?MODULE), "/_build/")).
