%% @doc Loads new code into a running simulation, on all its nodes at once. Code that cannot be
%% loaded yet, since a robot is in the middle of a step of the version before last ({@link
%% starl_code}), waits here; of one module, the newest version waits. It is tried again as the run
%% goes on.
-module(starl_sim_reload).

-export([new/1, load/4, retry/1, is_waiting/1]).

-export_type([t/0, answer/0, reason/0]).

-record(reload, {
    nodes :: [node()],
    waiting = #{} :: #{module() => {file:filename(), Beam :: binary()}}
}).

-opaque t() :: #reload{}.

-type reason() :: starl_code:reason() | {node(), unreachable}.

%% The code is loaded, or waits for these robots to end their steps.
-type answer() :: ok | {waits, [starl:robot_id()]} | {error, reason()}.

-define(NODE_MS, 30000).

%% @doc No code waits for these nodes.
-spec new([node()]) -> t().
new(Nodes) -> #reload{nodes = lists:usort(Nodes)}.

%% @doc Loads new code, or keeps it waiting.
-spec load(module(), file:filename(), Beam :: binary(), t()) -> {answer(), t()}.
load(Module, File, Beam, #reload{nodes = Nodes, waiting = Waiting} = Reload) ->
    Errors = [E || Node <- Nodes, {error, _} = E <- [on(Node, check, [Module, File, Beam])]],
    case Errors of
        [Error | _] ->
            {Error, Reload};
        [] ->
            case try_all(Module, File, Beam, Nodes) of
                ok ->
                    {ok, Reload#reload{waiting = maps:remove(Module, Waiting)}};
                waits ->
                    Robots = lists:usort([R || N <- Nodes, R <- users(N, Module)]),
                    ok = tell(#{what => code_waits, module => Module, steps_of_robots => Robots}),
                    {{waits, Robots}, Reload#reload{waiting = Waiting#{Module => {File, Beam}}}};
                {error, _} = Error ->
                    {Error, Reload}
            end
    end.

%% @doc Tries again to load the waiting code.
-spec retry(t()) -> t().
retry(#reload{waiting = Waiting, nodes = Nodes} = Reload) ->
    Reload#reload{
        waiting = maps:filter(
            fun(Module, {File, Beam}) -> still_waits(Module, File, Beam, Nodes) end, Waiting
        )
    }.

still_waits(Module, File, Beam, Nodes) ->
    case try_all(Module, File, Beam, Nodes) of
        waits ->
            true;
        Answer ->
            ok = tell(#{what => code_that_waited, module => Module, outcome => Answer}),
            false
    end.

%% @doc Does any code wait?
-spec is_waiting(t()) -> boolean().
is_waiting(#reload{waiting = Waiting}) -> Waiting =/= #{}.

%% The code is loaded on no node before it can be loaded on all.
try_all(Module, File, Beam, Nodes) ->
    case lists:all(fun(Node) -> on(Node, is_free, [Module]) =:= true end, Nodes) of
        true -> first_trouble([on(Node, load, [Module, File, Beam]) || Node <- Nodes]);
        false -> waits
    end.

first_trouble(Answers) ->
    case [Answer || Answer <- Answers, Answer =/= ok] of
        [] -> ok;
        [Trouble | _] -> Trouble
    end.

users(Node, Module) ->
    case on(Node, users, [Module]) of
        Robots when is_list(Robots) -> Robots;
        {error, _} -> []
    end.

on(Node, Function, Args) when Node =:= node() ->
    apply(starl_code, Function, Args);
on(Node, Function, Args) ->
    try
        erpc:call(Node, starl_code, Function, Args, ?NODE_MS)
    catch
        error:{erpc, _} -> {error, {Node, unreachable}}
    end.

tell(Event) -> logger:notice(Event, #{domain => [starl, sim]}).
