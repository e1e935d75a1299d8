%% Machines, and a simulator, that trace one of their events under another name: in their abstract
%% code every event that is traced asks here what it is to be.
-module(starl_event_renamed).

-export([instrument/1, restore/1, rename/1, rename/2, event/2]).

%% Loads the modules so that they ask; those that trace nothing are left alone. Gives those that
%% ask.
instrument(Modules) ->
    ok = persistent_term:put(?MODULE, none),
    [Module || Module <- Modules, instrumented(Module)].

instrumented(Module) ->
    {ok, {Module, [{abstract_code, {_, Forms}}]}} =
        beam_lib:chunks(code:which(Module), [abstract_code]),
    case [asking(Form, Module) || Form <- Forms] of
        Forms ->
            false;
        Asking ->
            {ok, Module, Code} = compile:forms(Asking, []),
            {module, Module} = code:load_binary(Module, code:which(Module), Code),
            true
    end.

%% The modules as they are.
restore(Modules) ->
    [
        begin
            _ = code:purge(Module),
            {module, Module} = code:load_file(Module)
        end
     || Module <- Modules
    ],
    ok.

%% Nothing has another name.
rename(none) -> persistent_term:put(?MODULE, none).

%% From now on what modules of such names trace under this name has another one.
rename(Prefix, Name) -> persistent_term:put(?MODULE, {Prefix, Name}).

%% What is traced.
event(Module, Event) ->
    case persistent_term:get(?MODULE) of
        {Prefix, {Tag, Size}} ->
            Meant = lists:prefix(Prefix, atom_to_list(Module)),
            renamed(Meant, Event, Tag, Size);
        none ->
            Event
    end.

renamed(true, Tag, Tag, 0) ->
    renamed;
renamed(true, Event, Tag, Size) when element(1, Event) =:= Tag, tuple_size(Event) =:= Size + 1 ->
    setelement(1, Event, renamed);
renamed(_, Event, _Tag, _Size) ->
    Event.

%% What is traced where: as a machine's action, by the loop of a robot and its driver (`trace/3'), in
%% the list that the simulator keeps. Patterns stay as they are.
asking({function, _, _, _, Clauses} = Form, Module) ->
    setelement(5, Form, asking(Clauses, Module));
asking({clause, _, _, _, Body} = Clause, Module) ->
    setelement(5, Clause, asking(Body, Module));
asking({Bind, _, _, Term} = Form, Module) when Bind =:= match; Bind =:= generate ->
    setelement(4, Form, asking(Term, Module));
asking({tuple, At, [{atom, _, trace} = Trace, Event]}, Module) ->
    {tuple, At, [Trace, ask(At, Module, Event)]};
asking({tuple, At, [T, Robot, {atom, _, Machine} = Name, Event]}, Module) when
    Machine =:= chassis; Machine =:= radio
->
    {tuple, At, [T, Robot, Name, ask(At, Module, Event)]};
asking({call, At, {Kind, _, Name} = Trace, [Machine, Event, World]}, Module) when
    Kind =:= atom, Name =:= trace; Kind =:= var, Name =:= 'Trace'
->
    {call, At, Trace, [Machine, ask(At, Module, Event), asking(World, Module)]};
asking({attribute, _, _, _} = Form, _Module) ->
    Form;
asking(Form, Module) when is_tuple(Form) ->
    list_to_tuple([asking(Part, Module) || Part <- tuple_to_list(Form)]);
asking([Part | Parts], Module) ->
    [asking(Part, Module) | asking(Parts, Module)];
asking(Other, _Module) ->
    Other.

ask(At, Module, Event) ->
    {call, At, {remote, At, {atom, At, ?MODULE}, {atom, At, event}}, [{atom, At, Module}, Event]}.
