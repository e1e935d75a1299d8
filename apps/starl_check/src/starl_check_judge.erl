%% @doc Runs the monitor of a model. It may be a user's monitor, and have mistakes. Some are found
%% before the search. A mistake that occurs during the search ends it, with a line that begins with
%% its place.
-module(starl_check_judge).

-export([check/2, read/3, timeless/2]).

%% @doc Checks the monitor of a model whose robots have these machines.
-spec check({module(), Config :: map()}, [starl_machine:name()]) ->
    ok | {error, unicode:chardata()}.
check({Module, _} = Monitor, Machines) ->
    case starl_monitor_check:check([Monitor], Machines) of
        ok -> can_be_checked(starl_callback:exported(Module, timeless, 1), Module);
        {error, {listed, Module, Why}} -> {error, Why};
        {error, {mistake, Line}} -> {error, Line}
    end.

can_be_checked(true, _Module) ->
    ok;
can_be_checked(false, Module) ->
    Place = starl_app:place(Module, none, 0),
    {error, [Place, ": timeless/1 is missing; the checker needs it of a monitor"]}.

%% @doc The monitor's state after these events, or the first violation. Exits with `{mistake, Line}' if
%% the monitor crashes or gives no answer.
-spec read([starl_monitor:trace_event()], module(), starl_monitor:state()) ->
    {ok, starl_monitor:state()} | {violation, starl_monitor:violation()}.
read([], _Module, State) ->
    {ok, State};
read([Event | Events], Module, State) ->
    try Module:step(Event, State) of
        {ok, Next} ->
            read(Events, Module, Next);
        {violation, Violation, _} ->
            starl_monitor_check:is_violation(Violation) orelse
                mistake(Module, step, [Event, State]),
            {violation, Violation};
        _ ->
            mistake(Module, step, [Event, State])
    catch
        error:_ -> mistake(Module, step, [Event, State])
    end.

%% @doc What of a monitor's state decides on later events. Exits as {@link read/3} does.
-spec timeless(module(), starl_monitor:state()) -> term().
timeless(Module, State) ->
    try
        Module:timeless(State)
    catch
        error:_ -> mistake(Module, timeless, [State])
    end.

%% It does the same again, and the line is made of that.
-spec mistake(module(), Callback :: atom(), Args :: [term()]) -> no_return().
mistake(Module, Callback, Args) ->
    {error, Line} = starl_monitor_check:call(Module, Callback, Args),
    exit({mistake, unicode:characters_to_binary(Line)}).
