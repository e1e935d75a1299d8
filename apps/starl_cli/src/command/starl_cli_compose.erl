%% @doc Computes what an application may rely on under some kinds of faults. It composes the
%% guarantees of the application's blocks ({@link starl_guarantee}, {@link starl_run_condition}).
-module(starl_cli_compose).

-export([told/3]).

%% @doc The text for an application, a width and the kinds of faults that may happen; or the problems.
-spec told(starl_cli_target:t(), [starl_run_fault:kind()], pos_integer()) ->
    {ok, unicode:chardata()} | {error, [unicode:chardata(), ...]}.
told(#{app := App}, Kinds, Width) ->
    case parts(App) of
        {ok, Parts} -> {ok, text(App, Parts, Kinds, Width)};
        {error, Why} -> {error, [Why]}
    end.

%% Every robot has SAP and motion.
parts(App) ->
    case blocks(App) of
        {ok, Blocks} ->
            Named = [
                {starl_block_catalogue:name(B), B}
             || B <- [starl_sap_block, starl_motion_block | Blocks]
            ],
            stated(Named ++ [{App, App}], []);
        {error, _} = Error ->
            Error
    end.

blocks(App) ->
    {ok, Options} = starl_options:check(#{}, starl_app:options(App)),
    starl_scene:blocks_of(App, (starl_block:example())#{options := Options}).

stated([{Name, Module} | Named], Parts) ->
    case starl_block:guarantees(Module) of
        {ok, Guarantees} -> stated(Named, [{Name, Guarantees} | Parts]);
        {error, _} = Error -> Error
    end;
stated([], Parts) ->
    {ok, lists:reverse(Parts)}.

text(App, Parts, Kinds, Width) ->
    Broken = [
        Condition
     || {Condition, _} <- starl_guarantee:conditions(),
        starl_run_condition:breakers(Condition, Kinds) =/= []
    ],
    Composed = starl_guarantee:composed(Parts, Broken),
    [
        starl_cli_terminal:wrap(heading(App, Parts, Kinds), 0, Width),
        section("Always", [One || One <- all(Composed), is_free(One)], Kinds, Width),
        section(
            "As long as what they assume holds",
            [One || One <- all(Composed), is_bound(One)],
            Kinds,
            Width
        ),
        section(
            "Not while such a fault lasts",
            [One || One <- all(Composed), is_open(One)],
            Kinds,
            Width
        ),
        silent(Parts, Width)
    ].

heading(App, Parts, []) ->
    [atom_to_list(App), " has ", listed([Name || {Name, _} <- Parts, Name =/= App]), ".\n"];
heading(App, Parts, Kinds) ->
    [heading(App, Parts, []), "Faults that may happen: ", listed(Kinds), ".\n"].

listed(Names) -> lists:join(", ", [atom_to_list(Name) || Name <- Names]).

all(Composed) -> [{Name, One, Verdict} || {Name, Own} <- Composed, {One, Verdict} <- Own].

is_free({_, {_, _, _, Assumed}, _}) -> Assumed =:= [].

is_bound({_, _, Verdict} = One) -> Verdict =:= holds andalso not is_free(One).

is_open({_, _, Verdict}) -> Verdict =/= holds.

section(_Title, [], _Kinds, _Width) ->
    [];
section(Title, Ones, Kinds, Width) ->
    ["\n", Title, ":\n" | [one(One, Kinds, Width) || One <- Ones]].

one({Name, {_, _, Says, Assumed}, Verdict}, Kinds, Width) ->
    [line("  ", [atom_to_list(Name), ": ", Says], Width), why(Verdict, Assumed, Kinds, Width)].

why(holds, [], _Kinds, _Width) ->
    [];
why(holds, Assumed, _Kinds, Width) ->
    line(
        "      ", ["if ", lists:join("; ", [starl_guarantee:text(Need) || Need <- Assumed])], Width
    );
why({open, Needs}, _Assumed, Kinds, Width) ->
    Broken = [[starl_guarantee:text(Need), by(Need, Kinds)] || Need <- Needs],
    line("      ", ["needs ", lists:join("; ", Broken)], Width).

by({any, Conditions}, Kinds) ->
    breakers(lists:append([starl_run_condition:breakers(One, Kinds) || One <- Conditions]));
by({_Block, _Guarantee}, _Kinds) ->
    "";
by(Condition, Kinds) ->
    breakers(starl_run_condition:breakers(Condition, Kinds)).

breakers(Kinds) -> [" (", listed(Kinds), ")"].

%% Of what does not say what it guarantees nothing is known.
silent(Parts, Width) ->
    [
        [
            "\n",
            line("", [atom_to_list(Name), " does not say what it guarantees (guarantees/0)"], Width)
        ]
     || {Name, []} <- Parts
    ].

%% Later lines are indented more than the first.
line(Indent, Text, Width) ->
    [Indent, starl_cli_terminal:wrap(Text, length(Indent) + 2, Width), "\n"].
