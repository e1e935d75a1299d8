%% @doc The behaviour of an application: the program that each robot of a team runs.
%% ```
%%   -module(shuttle).
%%   -behaviour(starl_app).
%%   -export([init/2, step/2]).
%%
%%   init(_Robot, _Options) -> 3.                    % three rounds are left
%%
%%   step(_Robot, 0) -> {done, home};
%%   step(Robot, Rounds) ->
%%       Y = 1000.0 * starl:id(Robot),
%%       ok = starl:go_to(Robot, {1000.0, Y}),
%%       ok = starl:go_to(Robot, {4000.0, Y}),
%%       {continue, Rounds - 1}.
%% '''
%% `./starl run shuttle.erl --robots 3' runs it in the simulator.
%%
%% `step/2' is the body of "repeat … until done". It may block in `starl:send', `starl:await',
%% `starl:go_to', `starl:sleep' and in the calls of the building blocks. New code takes effect
%% between two steps; an optional `code_change/2' (old state, old module version) converts the
%% state. A reload ({@link starl_reload}) is on trial: if the state cannot be converted, or the new
%% code crashes soon, the application goes on with its former code. Code that replaces the former
%% code directly ({@link starl_code:load/3}) cannot be taken back. If it cannot convert the state,
%% the application waits before the next step until other code is loaded that can; the old code can,
%% too. The rest of the robot goes on. Earlier effects of the application, and messages that arrive
%% meanwhile, are kept.
%%
%% An application may also list its building blocks and its options; with its blocks it gets their
%% contracts. It may have contracts of its own ({@link starl_monitor}), and figures for the report:
%% `report/2' of the behaviour {@link starl_scene}. An application with a scene of its own also has
%% that behaviour.
-module(starl_app).

-export([options/1, measures/1, check/2, declared/3, place/3]).

%% `Args' are the values of the application's options, unless its scene says otherwise.
-callback init(starl:robot(), Args :: term()) -> State :: term().
-callback step(starl:robot(), State :: term()) -> {continue, State :: term()} | {done, term()}.
-callback code_change(State :: term(), OldVsn :: term()) -> State :: term().
%% The building blocks of the application, as in `[starl_election, {starl_mutex, #{lease_ms =>
%% 2000}}]'; not needed with a scene of its own.
-callback blocks() -> [starl_block:entry()].
-callback options() -> [starl_options:option()].
%% The application's own contracts, with the configuration of each.
-callback monitors(starl_scene:context()) -> [{module(), Config :: map()}].
%% What it assumes, of its blocks among others, and guarantees, for `./starl blocks --compose'.
-callback guarantees() -> [starl_guarantee:t()].
%% What it measures by `starl:measure/3', with a text that has the unit. Reports and sweeps have the
%% median and the range of these, also of a run without any value.
-callback measures() -> [{Key :: atom(), Text :: string()}].

%% Does it find its way among walls? Without this callback it does, or it is its own matter; `false': a floor
%% plan with walls inside is refused before the run.
-callback knows_walls() -> boolean().

-optional_callbacks([
    code_change/2, blocks/0, options/0, monitors/1, guarantees/0, measures/0, knows_walls/0
]).

-define(CALLBACKS, [{init, 2}, {step, 2}]).

%% @doc The application's own options.
-spec options(module()) -> [starl_options:option()].
options(App) -> starl_callback:call(App, options, [], []).

%% @doc The measures that an application declares. One whose declaration fails has none.
-spec measures(module()) -> [{atom(), string()}].
measures(App) ->
    case starl_callback:exported(App, measures, 0) andalso declared(App, measures, []) of
        {ok, Measures} when is_list(Measures) ->
            [{Key, Text} || {Key, Text} <- Measures, is_atom(Key), io_lib:printable_list(Text)];
        _ ->
            []
    end.

%% @doc Checks an application before it runs: are its callbacks there, and is its table of options
%% sound, without the keys that belong to others? Otherwise one line with the place.
-spec check(module(), Taken :: [atom()]) -> ok | {error, unicode:chardata()}.
check(App, Taken) ->
    case starl_callback:exported(App, scene, 1) orelse missing(App) of
        true -> check_options(App, Taken);
        [] -> check_options(App, Taken);
        [Callback | _] -> {error, not_there(App, Callback)}
    end.

missing(App) -> [{F, A} || {F, A} <- ?CALLBACKS, not starl_callback:exported(App, F, A)].

not_there(App, {Function, Arity}) ->
    case starl_code:line(App, Function, Arity) of
        {ok, _, _} ->
            io_lib:format("~ts: ~ts/~b is not exported; write -export([init/2, step/2])", [
                place(App, Function, Arity), Function, Arity
            ]);
        none ->
            io_lib:format("~ts: ~ts/~b is missing; an application exports init/2 and step/2", [
                place(App, none, 0), Function, Arity
            ])
    end.

check_options(App, Taken) ->
    case starl_callback:exported(App, options, 0) andalso declared(App, options, []) of
        false -> ok;
        {ok, Options} -> checked_options(starl_options:check_table(Options, Taken), App);
        {error, _} = Error -> Error
    end.

checked_options(ok, _App) -> ok;
checked_options({error, Why}, App) -> {error, [place(App, options, 0), ": options/0: ", Why]}.

%% @doc Calls a function by which an application declares something. If it crashes: one line with
%% the place.
-spec declared(module(), Function :: atom(), Args :: [term()]) ->
    {ok, term()} | {error, unicode:chardata()}.
declared(App, Function, Args) ->
    try
        {ok, apply(App, Function, Args)}
    catch
        Class:Reason:Stack ->
            {Text, Frames} = starl_crash:cause(starl_crash:reason(Class, Reason, Stack)),
            {error, [
                crashed_at(starl_crash:place(Frames), App), ": ", called(Function, Args), Text
            ]}
    end.

crashed_at({_, _, _, File, Line}, _App) -> io_lib:format("~ts:~b", [File, Line]);
crashed_at(none, App) -> atom_to_list(App).

called(Function, Args) -> io_lib:format("~ts/~b: ", [Function, length(Args)]).

%% @doc The place of a function in the source, or of the module itself: file and line, where they
%% are known.
-spec place(module(), Function :: atom(), arity()) -> unicode:chardata().
place(App, Function, Arity) ->
    case starl_code:line(App, Function, Arity) of
        {ok, File, Line} -> io_lib:format("~ts:~b", [filename:basename(File), Line]);
        none -> atom_to_list(App)
    end.
