%% The search with a bug planted, to show that its monitor finds it. `middle': the plan leaves the middle
%% of rooms unseen. `off': the ball is reported 5 m from where it is. `blind': what a camera that is
%% gone would have seen counts as seen. For the last two the application is compiled once more
%% from its debugging information under another name, with a function replaced; the one that is replaced
%% is left as `sound'.
-module(starl_search_planted).
-behaviour(starl_scene).

-export([options/0, scene/1, report/2]).

options() -> [{bug, string, "none", "which bug"} | starl_search:options()].

scene(#{options := #{bug := Bug} = Options} = Context) ->
    case starl_search:scene(Context#{options := maps:remove(bug, Options)}) of
        {ok, Scene} -> {ok, planted(Bug, Scene)};
        {error, _} = Error -> Error
    end.

report(Scene, Outcome) -> starl_search:report(Scene, Outcome).

planted("none", Scene) ->
    Scene;
planted("middle", #{app := {sequential, App, #{views := Views} = Task}, blocks := Blocks} = Scene) ->
    Sizes = lists:sort([{length(starl_search_cover:cells(View)), View} || View <- Views]),
    {Few, _Most} = lists:split(length(Sizes) div 2, Sizes),
    Left = [View || View <- Views, lists:keymember(View, 2, Few)],
    Lines = [Line || #{line := Line} <- Left],
    {Other, [{starl_dpp, Plan}]} = lists:split(length(Blocks) - 1, Blocks),
    Scene#{
        app := {sequential, App, Task#{views := Left}},
        blocks := Other ++ [{starl_dpp, Plan#{segments := Lines}}]
    };
planted(Bug, #{app := {sequential, App, Task}} = Scene) ->
    Scene#{app := {sequential, edited(App, Bug), Task}}.

edits("off") ->
    [
        "middle(Points) -> {X, Y} = sound(Points), {X + 5000, Y}."
    ];
edits("blind") ->
    [
        "search(Found, _Camera, Robot, Task) ->\n"
        "    sound(Found, {ok, []}, Robot, Task).",
        "glance(Robot) ->\n"
        "    case sound(Robot) of\n"
        "        gone -> nothing;\n"
        "        Seen -> Seen\n"
        "    end.",
        "looks(N, Robot) ->\n"
        "    case sound(N, Robot) of\n"
        "        gone -> lists:duplicate(N, []);\n"
        "        Looks -> Looks\n"
        "    end."
    ].

edited(App, Bug) ->
    Name = list_to_atom(atom_to_list(App) ++ "_" ++ Bug),
    case erlang:module_loaded(Name) of
        true -> Name;
        false -> built(App, Name, edits(Bug))
    end.

built(App, Name, Edits) ->
    {App, Beam, _} = code:get_object_code(App),
    {ok, {App, [{abstract_code, {raw_abstract_v1, Forms}}]}} =
        beam_lib:chunks(Beam, [abstract_code]),
    Edited = lists:foldl(fun edit/2, Forms, Edits),
    Renamed = [
        case Form of
            {attribute, Line, module, App} -> {attribute, Line, module, Name};
            _ -> Form
        end
     || Form <- Edited
    ],
    {ok, Name, Code} = compile:forms(Renamed, [nowarn_unused_function]),
    {module, Name} = code:load_binary(Name, atom_to_list(Name), Code),
    Name.

%% The new function stands where the sound one stood.
edit(Text, Forms) ->
    {ok, Tokens, _} = erl_scan:string(Text),
    {ok, {function, _, Name, Arity, _} = New} = erl_parse:parse_form(Tokens),
    IsOther = fun
        ({function, _, F, A, _}) -> {F, A} =/= {Name, Arity};
        (_) -> true
    end,
    {Before, [{function, Line, Name, Arity, Clauses} | After]} = lists:splitwith(IsOther, Forms),
    Before ++ [New, {function, Line, sound, Arity, Clauses} | After].
