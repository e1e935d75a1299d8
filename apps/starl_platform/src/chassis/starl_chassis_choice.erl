%% @doc The choice of the robots' chassis in a scenario or on a command line. It is one name, or a
%% list of names that the robots take in turn: `differential', `[create, holonomic]',
%% `"exec:./my_robot.py"'. A name stands for a kind of chassis ({@link starl_chassis}) and its
%% dimensions, in any world.
-module(starl_chassis_choice).

-export([option/0, names/0, profiles/2, in_turn/1, of_robot/2, own/1]).

-export_type([t/0, name/0, own/0]).

%% A chassis' name in a scenario.
%% `create' is the iRobot Create 2, `create_1' that of 2006: two wheels with the Create's measures; in
%% real time, an emulated Create that is driven byte by byte.
%% A text is a chassis of the user's own, two wheels here: `FILE.erl', perhaps with options, or `exec:PROGRAM'.
-type name() :: differential | holonomic | create | create_1 | own().
-type own() :: binary() | string() | {binary() | string(), #{atom() => term()}}.

-type t() :: mixed | name() | [name(), ...].

%% How late a command of a user's own chassis may be heard.
-define(OWN_LATENCY_MS, 50).

%% @doc The scenario's option for the chassis of its robots: one name for all, or a list of names
%% that the robots take in turn, robot 1 the first; `mixed' alternates between all kinds.
-spec option() -> starl_options:option().
option() ->
    {chassis,
        {term,
            lists:append([atom_to_list(Name) ++ ", " || Name <- names()]) ++
                "exec:PROGRAM, FILE.erl, or a list",
            fun is_choice/1},
        differential,
        "two wheels (differential; create and create_1: with the measures of an iRobot Create, in "
        "real time an emulated one), any direction (holonomic), the first and the last in turn "
        "(mixed), a list that the robots take in turn; exec:PROGRAM and FILE.erl are two wheels "
        "of your own, in real time driven by that program or module"}.

%% @doc The words of a choice.
-spec names() -> [atom(), ...].
names() -> [Name || {Name, _, _} <- kinds()] ++ [mixed].

is_choice(mixed) ->
    true;
is_choice([Letter | _] = Text) when is_integer(Letter) ->
    is_name(Text);
is_choice([Name | Names]) ->
    is_name(Name) andalso (Names =:= [] orelse is_list(Names) andalso is_choice(Names));
is_choice(Name) ->
    is_name(Name).

is_name(Name) when is_atom(Name) -> lists:keymember(Name, 1, kinds());
is_name({Name, #{}}) -> is_text(Name) andalso is_file(own(Name));
is_name(Name) -> is_text(Name) andalso own(Name) =/= none.

is_file({file, _, _}) -> true;
is_file(_) -> false.

is_text(Name) when is_binary(Name) -> is_text(unicode:characters_to_list(Name));
is_text(Name) -> io_lib:printable_unicode_list(Name).

%% @doc What a name stands for, if it is a chassis of the user's own: a program with its arguments, or an
%% Erlang source.
-spec own(name()) ->
    {exec, Command :: string()}
    | {file, file:filename(), Options :: #{atom() => term()}}
    | none.
own(Name) when is_atom(Name) ->
    none;
own({Name, Options}) ->
    {file, unicode:characters_to_list(Name), Options};
own(Name) ->
    case unicode:characters_to_list(Name) of
        "exec:" ++ Command -> {exec, Command};
        File -> own_file(filename:extension(File), File)
    end.

own_file(".erl", File) -> {file, File, #{}};
own_file(_Other, _File) -> none.

%% @doc The names of a choice, which the robots take in turn.
-spec in_turn(t()) -> [name(), ...].
in_turn(mixed) -> [differential, holonomic];
in_turn([First | _] = Names) when not is_integer(First) -> Names;
in_turn(Name) -> [Name].

%% @doc The name of a robot's chassis.
-spec of_robot(starl:robot_id(), t()) -> name().
of_robot(Robot, Choice) ->
    Names = in_turn(Choice),
    lists:nth(1 + (Robot - 1) rem length(Names), Names).

%% Name, chassis module, and what is known of its profile. A serial line delays a
%% command, a little differently each time.
kinds() ->
    [
        {differential, starl_chassis_differential, #{}},
        {holonomic, starl_chassis_holonomic, #{}},
        {create, starl_chassis_differential, #{
            axle_mm => 235.0, latency_ms => 25
        }},
        {create_1, starl_chassis_differential, #{
            axle_mm => 258.0, latency_ms => 25
        }}
    ].

%% @doc The profiles of a team with this choice.
-spec profiles(t(), map()) -> starl_chassis:profiles().
profiles(Choice, Overrides) -> [profile(Name, Overrides) || Name <- in_turn(Choice)].

profile(Name, Overrides) ->
    {_, Chassis, Known} = kind(Name),
    Profile = starl_chassis:profile(Chassis, maps:merge(Known, Overrides)),
    case {Known, Profile} of
        {#{latency_ms := Least}, #{latency_ms := Ms}} -> Profile#{latency_ms := max(Least, Ms)};
        _ -> Profile
    end.

%% A program has other work beside its line.
kind(Name) when is_atom(Name) ->
    lists:keyfind(Name, 1, kinds());
kind(Own) ->
    {Own, starl_chassis_differential, #{latency_ms => ?OWN_LATENCY_MS}}.
