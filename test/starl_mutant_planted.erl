%% Coordinators of path planning with one function of the planner replaced, for pitfalls that lie
%% too deep for a machine around the sound one. The modules that a coordinator consists of are
%% compiled once more from their debugging information under other names, so that the sound ones
%% stay as they are. The function that is replaced is left as `sound'.
-module(starl_mutant_planted).

-export([machine/1]).

%% Module, function, its new text.
edits("captive") ->
    [
        {starl_dpp_route, space,
            "\n"
            "        space(Ignored, #{robot := Robot} = View) -> sound(Ignored -- [Robot], View)."},
        {starl_dpp_route, obstacles,
            "\n"
            "        obstacles(#{robot := Robot, unsafe := Unsafe, graph := Graph} = View) ->\n"
            "            Mm = 2.0 * starl_dpp_graph:radius(Graph),\n"
            "            Own = starl_dpp_unsafe:held(Robot, Unsafe),\n"
            "            Box = starl_geometry:box(lists:append([[P, Q] || {P, Q} <- Own])),\n"
            "            [{Mm, starl_geometry:grow(Box, Mm), Own} | sound(View)]."}
    ];
edits("blind_start") ->
    [
        {starl_dpp_unsafe, clear,
            "\n"
            "        clear(_Segment, _Obstacles) -> true."}
    ];
edits("newest") ->
    [
        {starl_dpp_lease, voted,
            "\n"
            "        voted(Robot, Seq, Vote, #lease{sent = Sent} = Lease) ->\n"
            "            sound(Robot, hd(Sent ++ [Seq]), Vote, Lease)."}
    ];
edits("hoarding") ->
    [
        {starl_dpp_unsafe, set,
            "\n"
            "        set(Robot, Segments, Unsafe) ->\n"
            "            sound(Robot, Segments ++ held(Robot, Unsafe), Unsafe)."}
    ];
edits("short_edges") ->
    [
        {starl_dpp_choice, open_steps,
            "\n"
            "        open_steps(V, Task, Used) ->\n"
            "            [Step || {_, _, Mm, _} = Step <- sound(V, Task, Used),\n"
            "                     Mm =< Task#task.horizon]."}
    ];
edits("blind") ->
    [
        {starl_dpp_graph, new,
            "\n"
            "        new(#{segments := Segments} = Config) ->\n"
            "            Numbered = lists:zip(lists:seq(1, length(Segments)), Segments),\n"
            "            sound(Config#{segments := [S || {N, S} <- Numbered, N rem 2 =:= 1]})."}
    ];
edits("crossed") ->
    [
        {starl_dpp_graph, new,
            "\n"
            "        new(Config) -> sound(Config#{edge_length := 1.0e9})."},
        {starl_planar, planarise,
            "\n"
            "        planarise(Segments, Options) ->\n"
            "            Weld = #weld{tolerance = maps:get(tolerance, Options, 0.05)},\n"
            "            {Lines, Welded} = lists:mapfoldl(fun weld_segment/2, Weld, Segments),\n"
            "            divide(unique(Lines), Welded, infinity)."},
        {starl_dpp_graph, part,
            "\n"
            "        part({P, Q} = Segment, Mm, Near) ->\n"
            "            {Edges, _} = sound(Segment, Mm, Near),\n"
            "            {Ends, Others} = lists:partition(fun({E, {A, B} = Edge}) ->\n"
            "                lists:member(E, Edges) andalso Mm > lists:min(\n"
            "                    [starl_geometry:point_segment(End, Segment) || End <- [A, B]] ++\n"
            "                    [starl_geometry:point_segment(End, Edge) || End <- [P, Q]])\n"
            "            end, Near),\n"
            "            {[E || {E, _} <- Ends], Others}."}
    ].

%% The coordinator's module with the bug.
machine(Bug) ->
    %% no name is made for a bug that is not one of these
    [_ | _] = edits(Bug),
    Machine = renamed(starl_dpp_coordinator, Bug),
    case erlang:module_loaded(Machine) of
        true -> ok;
        false -> build_all(Bug)
    end,
    Machine.

build_all(Bug) ->
    _ = application:load(starl_blocks),
    Parts = parts([starl_dpp_coordinator], #{}),
    %% an edit of a module that the coordinator does not use would change nothing
    [] = [Part || {Part, _, _} <- edits(Bug), not is_map_key(Part, Parts)],
    maps:foreach(fun(Part, Forms) -> build(Part, Forms, Parts, Bug) end, Parts).

%% What a coordinator is made of, with their forms: the modules of its application that it names,
%% and that these name.
parts([], Parts) ->
    Parts;
parts([Part | Others], Parts) when is_map_key(Part, Parts) ->
    parts(Others, Parts);
parts([Part | Others], Parts) ->
    {ok, All} = application:get_key(starl_blocks, modules),
    Forms = forms(Part),
    Named = [Name || {function, _, _, _, Clauses} <- Forms, Name <- atoms(Clauses)],
    parts([Name || Name <- Named, lists:member(Name, All)] ++ Others, Parts#{Part => Forms}).

forms(Part) ->
    {Part, Beam, _} = code:get_object_code(Part),
    {ok, {Part, [{abstract_code, {raw_abstract_v1, Forms}}]}} =
        beam_lib:chunks(Beam, [abstract_code]),
    Forms.

atoms({atom, _, Name}) -> [Name];
atoms(Term) when is_tuple(Term) -> atoms(tuple_to_list(Term));
atoms([Head | Tail]) -> atoms(Head) ++ atoms(Tail);
atoms(_Term) -> [].

%% A new module needs a new name: at most as many as there are parts, for each bug of `edits/1'.
renamed(Part, Bug) -> list_to_atom(atom_to_list(Part) ++ "_" ++ Bug).

build(Part, Forms, Parts, Bug) ->
    Edits = [{Name, Text} || {Of, Name, Text} <- edits(Bug), Of =:= Part],
    Edited = lists:foldl(fun edit/2, Forms, Edits),
    Named = renamed(Part, Bug),
    {ok, Named, Code} = compile:forms(rename(Edited, Parts, Bug), [nowarn_unused_function]),
    {module, Named} = code:load_binary(Named, atom_to_list(Named), Code).

%% The new function stands where the sound one stood, which follows it.
edit({Name, Text}, Forms) ->
    {ok, Tokens, _} = erl_scan:string(Text),
    {ok, {function, _, Name, Arity, _} = New} = erl_parse:parse_form(Tokens),
    {Before, [{function, Line, Name, Arity, Clauses} | After]} =
        lists:splitwith(fun(Form) -> not defines(Name, Arity, Form) end, Forms),
    Before ++ [New, {function, Line, sound, Arity, Clauses} | After].

defines(Name, Arity, {function, _, Name, Arity, _}) -> true;
defines(_Name, _Arity, _Form) -> false.

%% Every mention of a part as an atom is meant for the part with the bug; types stay.
rename([], _Parts, _Bug) ->
    [];
rename([{attribute, Line, module, Part} | Forms], Parts, Bug) ->
    [{attribute, Line, module, renamed(Part, Bug)} | rename(Forms, Parts, Bug)];
rename([{attribute, _, spec, _} | Forms], Parts, Bug) ->
    rename(Forms, Parts, Bug);
rename([{function, _, _, _, _} = Function | Forms], Parts, Bug) ->
    [mentions(Function, Parts, Bug) | rename(Forms, Parts, Bug)];
rename([Form | Forms], Parts, Bug) ->
    [Form | rename(Forms, Parts, Bug)].

mentions({atom, Line, Name}, Parts, Bug) ->
    case is_map_key(Name, Parts) of
        true -> {atom, Line, renamed(Name, Bug)};
        false -> {atom, Line, Name}
    end;
mentions(Term, Parts, Bug) when is_tuple(Term) ->
    list_to_tuple(mentions(tuple_to_list(Term), Parts, Bug));
mentions([Head | Tail], Parts, Bug) ->
    [mentions(Head, Parts, Bug) | mentions(Tail, Parts, Bug)];
mentions(Term, _Parts, _Bug) ->
    Term.
