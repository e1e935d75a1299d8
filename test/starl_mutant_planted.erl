%% Coordinators of path planning with one function of the planner replaced, for pitfalls that lie
%% too deep for a machine around the sound one. The modules that a coordinator consists of are
%% compiled once more from their debugging information under other names, so that the sound ones
%% stay as they are. The function that is replaced is left as `sound_' and its name.
-module(starl_mutant_planted).

-export([machine/1]).

%% What a coordinator is made of.
-define(PARTS, [
    starl_dpp_coordinator, starl_dpp_serve, starl_dpp_plan, starl_dpp_assign, starl_dpp_unsafe,
    starl_dpp_choice, starl_dpp_route, starl_dpp_search, starl_dpp_yield, starl_dpp_spots,
    starl_dpp_graph, starl_planar, starl_roadmap
]).

%% Module, function, its new text.
edits("captive") ->
    [{starl_dpp_route, space, "
        space(Ignored, #{robot := Robot} = View) -> sound_space(Ignored -- [Robot], View)."},
     {starl_dpp_route, obstacles, "
        obstacles(#{robot := Robot, unsafe := Unsafe, graph := Graph} = View) ->
            Mm = 2.0 * starl_dpp_graph:radius(Graph),
            Own = starl_dpp_unsafe:held(Robot, Unsafe),
            Box = starl_geometry:box(lists:append([[P, Q] || {P, Q} <- Own])),
            [{Mm, starl_geometry:grow(Box, Mm), Own} | sound_obstacles(View)]."}];
edits("blind_start") ->
    [{starl_dpp_unsafe, clear, "
        clear(_Segment, _Obstacles) -> true."}];
edits("hoarding") ->
    [{starl_dpp_unsafe, set, "
        set(Robot, Segments, Unsafe) ->
            sound_set(Robot, Segments ++ held(Robot, Unsafe), Unsafe)."}];
edits("short_edges") ->
    [{starl_dpp_graph, new, "
        new(Config) -> sound_new(Config#{edge_length := 1.0e9})."},
     {starl_dpp_choice, open_steps, "
        open_steps(V, Task, Used) ->
            [Step || {_, _, Mm, _} = Step <- sound_open_steps(V, Task, Used),
                     Mm =< Task#task.horizon]."}];
edits("crossed") ->
    [{starl_dpp_graph, new, "
        new(Config) -> sound_new(Config#{edge_length := 1.0e9})."},
     {starl_planar, planarise, "
        planarise(Segments, Options) ->
            Weld = #weld{tolerance = maps:get(tolerance, Options, 0.05)},
            {Lines, Welded} = lists:mapfoldl(fun weld_segment/2, Weld, Segments),
            divide(unique(Lines), Welded, infinity)."},
     {starl_dpp_graph, within, "
        within({P, Q}, {Mm, Wanted}, Graph) ->
            [E || E <- sound_within({P, Q}, {Mm, Wanted}, Graph), {A, B} <- [segment(E, Graph)],
                  lists:any(fun(End) -> starl_geometry:point_segment(End, {P, Q}) < Mm end, [A, B])
                  orelse lists:any(
                      fun(End) -> starl_geometry:point_segment(End, {A, B}) < Mm end, [P, Q])]."}].

%% The coordinator's module with the bug.
machine(Bug) ->
    Machine = renamed(starl_dpp_coordinator, Bug),
    case erlang:module_loaded(Machine) of
        true -> ok;
        false -> lists:foreach(fun(Part) -> build(Part, Bug) end, lists:reverse(?PARTS))
    end,
    Machine.

renamed(Part, Bug) -> list_to_atom(atom_to_list(Part) ++ "_" ++ Bug).

build(Part, Bug) ->
    {Part, Beam, _} = code:get_object_code(Part),
    {ok, {Part, [{abstract_code, {raw_abstract_v1, Forms}}]}} =
        beam_lib:chunks(Beam, [abstract_code]),
    Edits = [{Name, Text} || {Of, Name, Text} <- edits(Bug), Of =:= Part],
    Edited = lists:foldl(fun edit/2, Forms, Edits),
    Named = renamed(Part, Bug),
    {ok, Named, Code} = compile:forms(rename(Edited, Bug), [nowarn_unused_function]),
    {module, Named} = code:load_binary(Named, atom_to_list(Named), Code).

%% The new function stands where the sound one stood, which follows it.
edit({Name, Text}, Forms) ->
    {ok, Tokens, _} = erl_scan:string(Text),
    {ok, {function, _, Name, Arity, _} = New} = erl_parse:parse_form(Tokens),
    {Before, [{function, Line, Name, Arity, Clauses} | After]} =
        lists:splitwith(fun(Form) -> not defines(Name, Arity, Form) end, Forms),
    Sound = list_to_atom("sound_" ++ atom_to_list(Name)),
    Before ++ [New, {function, Line, Sound, Arity, Clauses} | After].

defines(Name, Arity, {function, _, Name, Arity, _}) -> true;
defines(_Name, _Arity, _Form) -> false.

%% Every mention of a part as an atom is meant for the part with the bug; types stay.
rename([], _Bug) -> [];
rename([{attribute, Line, module, Part} | Forms], Bug) ->
    [{attribute, Line, module, renamed(Part, Bug)} | rename(Forms, Bug)];
rename([{attribute, _, spec, _} | Forms], Bug) -> rename(Forms, Bug);
rename([{function, _, _, _, _} = Function | Forms], Bug) ->
    [mentions(Function, Bug) | rename(Forms, Bug)];
rename([Form | Forms], Bug) -> [Form | rename(Forms, Bug)].

mentions({atom, Line, Name}, Bug) ->
    case lists:member(Name, ?PARTS) of
        true -> {atom, Line, renamed(Name, Bug)};
        false -> {atom, Line, Name}
    end;
mentions(Term, Bug) when is_tuple(Term) -> list_to_tuple(mentions(tuple_to_list(Term), Bug));
mentions([Head | Tail], Bug) -> [mentions(Head, Bug) | mentions(Tail, Bug)];
mentions(Term, _Bug) -> Term.
