%% A broken mutex that tells nothing of itself: its monitor sees no event and has nothing to object to. The
%% application runs it in the place of the sound one; its callers notice.
-module(starl_mute_planted).
-behaviour(starl_machine).
-behaviour(starl_scene).

-export([init/1, handle_event/5]).
-export([options/0, scene/1, report/2]).

-define(BROKEN, starl_mutex_planted).

init(Config) ->
    {State, Data, Actions} = ?BROKEN:init(Config),
    {State, Data, mute(Actions)}.

handle_event(Type, Content, State, Data, Meta) ->
    case ?BROKEN:handle_event(Type, Content, State, Data, Meta) of
        {next_state, Next, New, Actions} -> {next_state, Next, New, mute(Actions)};
        {keep_state, New, Actions} -> {keep_state, New, mute(Actions)};
        {keep_state_and_data, Actions} -> {keep_state_and_data, mute(Actions)};
        Result -> Result
    end.

mute(Actions) -> lists:append([muted(Action) || Action <- Actions]).

muted({trace, _}) -> [];
muted({until, Us, Actions, Mark}) -> [{until, Us, mute(Actions), Mark}];
muted(Action) -> [Action].

options() -> starl_planted:options().

scene(Context) ->
    {ok, #{blocks := [{mutex, ?BROKEN, Config} | Blocks]} = Scene} = starl_planted:scene(Context),
    {ok, Scene#{blocks := [{mutex, ?MODULE, Config} | Blocks]}}.

report(Scene, Outcome) -> starl_planted:report(Scene, Outcome).
