%% @doc Informs the user when an application crashes for the first time. It is a monitor that judges
%% nothing.
-module(starl_lab_first_crash).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

%% @doc No crash yet. `tell' is called with the line on the first crash.
-spec init(#{tell := fun((unicode:chardata()) -> term())}) -> fun() | told.
init(#{tell := Tell}) -> Tell.

%% @doc The events of a robot's supervisors.
-spec interests() -> [supervisor].
interests() -> [supervisor].

%% @doc Tells of the first crash.
-spec step(starl_monitor:trace_event(), fun() | told) -> {ok, fun() | told}.
step({AtUs, Robot, supervisor, {crashed, app, Cause}}, Tell) when is_function(Tell) ->
    _ = Tell(starl_lab_phrase:crash({AtUs, Robot, app, Cause})),
    {ok, told};
step(_Event, State) ->
    {ok, State}.

%% @doc Has nothing to report.
-spec finish(integer(), fun() | told) -> {ok, #{}}.
finish(_EndUs, _State) -> {ok, #{}}.
