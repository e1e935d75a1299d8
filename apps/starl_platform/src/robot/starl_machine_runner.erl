%% @doc Runs a machine ({@link starl_machine}) in one version of its code: it starts the machine,
%% passes it events, and converts its state for other versions. {@link starl_machine} decides what
%% happens when new code fails.
-module(starl_machine_runner).

-export([new/3, step/4, module/1, state/1, data/1]).
-export([converts/1, moved_over/2, moved_down/2]).

-export_type([t/0]).

-type event_type() :: starl_machine:event_type().
-type meta() :: starl_machine:meta().
-type action() :: starl_machine:action().

-record(machine, {
    %% the callback, looked up once; a fun of this kind calls the latest version of its module;
    %% a faulty callback may return any term
    handle :: fun((event_type(), term(), State :: term(), Data :: term(), meta()) -> term()),
    %% likewise, for a machine that checks messages before it takes them
    accepts = all :: all | fun((starl_packet:type(), Body :: term()) -> boolean()),
    state :: term(),
    data :: term()
}).

%% A machine with its present state.
-type t() :: #machine{}.

%% @doc A machine in its first state, with the actions of its start.
-spec new(module(), Config :: map(), Base :: starl_machine:config()) -> {[action()], t()}.
new(Module, Config, Base) ->
    case Module:init(maps:merge(Config, Base)) of
        {State, Data, Actions} ->
            {checked(Actions), of_module(Module, State, Data)};
        Other ->
            bad_return(Module, init, Other)
    end.

of_module(Module, State, Data) ->
    #machine{
        handle = fun Module:handle_event/5, accepts = accepts(Module), state = State, data = Data
    }.

accepts(Module) ->
    case erlang:function_exported(Module, accepts, 2) of
        true -> fun Module:accepts/2;
        false -> all
    end.

%% @doc Handles one event; returns the actions in the order in which they are to take place.
-spec step(event_type(), Content :: term(), meta(), t()) -> {[action()], t()}.
step(cast, {message, From, Type, Body} = Message, Meta, #machine{accepts = Accepts} = Machine) when
    Accepts =/= all
->
    case Accepts(Type, Body) of
        true -> handle(cast, Message, Meta, Machine);
        false -> {[{trace, {malformed, From, Type, Body}}], Machine}
    end;
step(Type, Content, Meta, Machine) ->
    handle(Type, Content, Meta, Machine).

handle(Type, Content, Meta, #machine{handle = Handle, state = State, data = Data} = Machine) ->
    case Handle(Type, Content, State, Data, Meta) of
        {keep_state, NewData, Actions} ->
            {checked(Actions), Machine#machine{data = NewData}};
        {keep_state_and_data, Actions} ->
            {checked(Actions), Machine};
        {keep_state, NewData} ->
            {[], Machine#machine{data = NewData}};
        keep_state_and_data ->
            {[], Machine};
        {next_state, NewState, NewData, Actions} ->
            moved(NewState, NewData, checked(Actions), Machine);
        {next_state, NewState, NewData} ->
            moved(NewState, NewData, [], Machine);
        unknown_event when Type =:= info, element(1, Content) =:= given_up -> {[], Machine};
        unknown_event ->
            {[{trace, {unknown_event, Type, Content}}], Machine};
        Other ->
            bad_return(module(Machine), handle_event, Other)
    end.

%% The platform trusts the actions that it carries out: a mistake must be found here.
checked(Actions) ->
    ok = starl_action:check(Actions),
    Actions.

-spec bad_return(module(), init | handle_event, term()) -> no_return().
bad_return(Module, Function, Other) -> error({bad_return, {Module, Function}, Other}).

%% As in gen_statem, a state time-out does not outlive its state.
moved(State, Data, Actions, #machine{state = State} = Machine) ->
    {Actions, Machine#machine{data = Data}};
moved(State, Data, Actions, Machine) ->
    {[{state_timeout, cancel} | Actions], Machine#machine{state = State, data = Data}}.

%% -- other code -----------------------------------------------------------------------------

%% @doc Does the code of this module convert states?
-spec converts(module()) -> boolean().
converts(Module) -> erlang:function_exported(Module, code_change, 3).

%% @doc The machine in newer code.
-spec moved_over(New :: module(), t()) -> t().
moved_over(New, #machine{state = State0, data = Data0} = Machine) ->
    {module, New} = code:ensure_loaded(New),
    {ok, State, Data} =
        case converts(New) of
            true -> New:code_change(version(module(Machine)), State0, Data0);
            false -> {ok, State0, Data0}
        end,
    of_module(New, State, Data).

%% @doc The machine in former code, as its present code converts it back.
-spec moved_down(Former :: module(), t()) -> t().
moved_down(Former, #machine{state = State0, data = Data0} = Machine) ->
    New = module(Machine),
    {ok, State, Data} =
        case converts(New) of
            true -> New:code_change({down, version(Former)}, State0, Data0);
            false -> {ok, State0, Data0}
        end,
    of_module(Former, State, Data).

version(Module) -> Module:module_info(md5).

%% @doc The callback module.
-spec module(t()) -> module().
module(#machine{handle = Handle}) ->
    {module, Module} = erlang:fun_info(Handle, module),
    Module.

%% @doc The present state.
-spec state(t()) -> term().
state(#machine{state = State}) -> State.

%% @doc The present data.
-spec data(t()) -> term().
data(#machine{data = Data}) -> Data.
