%% Flags: what is read, that every problem is found in one go, and that a value written out as an
%% argument is read back as itself.
-module(starl_cli_flags_tests).
-include_lib("eunit/include/eunit.hrl").

flags() ->
    [
        {quiet, switch, false, "says little"},
        {help, switch, false, "help"},
        {sizes, {list, {integer, 1, 99}}, [1], "sizes"}
        | starl_run_scenario:options(starl_painting)
    ].

parse(Args) -> starl_cli_flags:parse(Args, flags()).

flag(Key) -> starl_cli_flags:flag(Key).

problems(Args) ->
    {error, Problems} = parse(Args),
    [lists:flatten(io_lib:format("~ts", [starl_cli_flags:format_problem(P)])) || P <- Problems].

reads_every_type_test() ->
    ?assertEqual(
        {ok, #{
            robots => 8,
            loss => 0.2,
            delay => {5, 50},
            world => {9000, 8000.5},
            range => none,
            picture => "my.svg",
            safety_distance => 450,
            quiet => true,
            sizes => [1, 4, 16]
        }},
        parse([
            "--robots",
            "8",
            "--loss=0.2",
            "--delay",
            "5..50",
            "--world",
            "9000x8000.5",
            "--range",
            "none",
            "--picture",
            "my.svg",
            "--safety-distance",
            "450",
            "--quiet",
            "--sizes",
            "1,4,16"
        ])
    ).

nothing_given_is_nothing_test() -> ?assertEqual({ok, #{}}, parse([])).

all_problems_come_in_one_go_test() ->
    Lines = problems([
        "--robotz",
        "3",
        "--robots",
        "0",
        "--loss",
        "2",
        "--seed",
        "x",
        "stray",
        "--quiet=2",
        "--sizes",
        "1,b",
        "--delay"
    ]),
    Found = [
        Part
     || Part <- [
            "--robotz (did you mean --robots?)",
            "--robots: ",
            "--loss: ",
            "--seed: ",
            "\"stray\"",
            "--quiet takes no value",
            "--sizes: ",
            "--delay needs a value"
        ],
        lists:any(fun(Line) -> string:find(Line, Part) =/= nomatch end, Lines)
    ],
    ?assertEqual(8, length(Found)),
    ?assertEqual(8, length(Lines)).

bad_values_test_() ->
    [
        ?_assertMatch({error, [{bad_value, Key, Text, _}]}, parse([flag(Key), Text]))
     || {Key, Text} <- [
            {robots, "0"},
            {robots, "x"},
            {robots, "3.5"},
            {robots, ""},
            {robots, "-1"},
            {loss, "2"},
            {loss, "-0.1"},
            {delay, "50..5"},
            {delay, "0"},
            {world, "12000"},
            {seed, "-1"},
            {safety_distance, "100"},
            {faults, "{a,1,2}"},
            {faults, "["},
            {picture, ""},
            {sizes, "1,,2"},
            {sizes, "100"}
        ]
    ].

a_flag_is_no_value_test() ->
    ?assertMatch({error, [{no_value, picture, _} | _]}, parse(["--picture", "--seed", "7"])).

a_negative_number_is_a_value_test() ->
    ?assertMatch({error, [{bad_value, seed, "-5", _}]}, parse(["--seed", "-5"])).

an_unknown_flag_takes_its_value_along_test() ->
    ?assertMatch({error, [{unknown_flag, "--zig", []}]}, parse(["--zig", "3", "--seed", "4"])),
    ?assertMatch({error, [{unknown_flag, "--zig", []}]}, parse(["--zig=3", "--seed", "4"])).

defaults_survive_the_command_line_test_() ->
    [
        ?_assertEqual({Key, {ok, Default}}, {Key, starl_options:parse(Type, text(Type, Default))})
     || {Key, Type, Default, _} <- starl_run_scenario:options(starl_painting)
    ].

text(Type, Value) -> starl_cli_flags:text(Type, Value).

%% What replays a run must give the very values back, through a shell.
arguments_are_the_inverse_of_parse_test() ->
    Values = #{
        robots => 3,
        loss => 0.1 + 0.2,
        delay => {5, 50},
        range => 1.0e6,
        world => {9000, 7000.25},
        picture => "it's my pic $HOME.svg",
        faults => [{a, 1, 2, kill_machine, {2, sap}, #{}}, {'b c', 3, 3, kill_robot, 1, #{}}]
    },
    Line = lists:join(" ", starl_cli_flags:arguments(flags(), Values)),
    Shell = os:cmd(lists:flatten(["for a in ", Line, "; do printf '%s\\n' \"$a\"; done"])),
    ?assertEqual({ok, Values}, parse(string:lexemes(Shell, "\n"))).

help_fits_the_width_test_() ->
    [
        {integer_to_list(Width), fun() ->
            Text = unicode:characters_to_list(starl_cli_flags:help(flags(), Width)),
            Wide = [L || L <- string:split(Text, "\n", all), length(L) > Width],
            ?assertEqual([], Wide),
            [
                ?assertNotEqual(nomatch, string:find(Text, starl_cli_flags:flag(Key)))
             || {Key, _, _, _} <- flags()
            ]
        end}
     || Width <- [50, 80, 100]
    ].
