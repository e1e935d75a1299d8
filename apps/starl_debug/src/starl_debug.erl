%% @doc The trace debugger: what can have happened in a recorded run when the robots' clocks
%% disagree.
%% ```
%%   {ok, Recording} = starl_debug_recording:read(["out/painting-1/run.mcap"], #{}),
%%   {ok, Predicate} = starl_debug:predicate("dist(r1.pos, r2.pos) < 400 mm"),
%%   {ok, Formula} = starl_debug:formula(Predicate, Recording),
%%   Answer = starl_debug_check:run(Formula, Recording, #{sigma => 50000}, fun(_) -> continue end)
%% '''
-module(starl_debug).

-export([predicate/1, formula/2]).

%% @doc Reads and checks a predicate: a text, or an expression of {@link starl_debug_parser}.
-spec predicate(unicode:chardata() | starl_debug_parser:expr()) ->
    {ok, starl_debug_type:formula()} | {error, starl_debug_parser:reason()}.
predicate(Expr) when is_tuple(Expr) ->
    starl_debug_type:check(Expr);
predicate(Text) ->
    case starl_debug_parser:parse(Text) of
        {ok, Expr} -> starl_debug_type:check(Expr);
        {error, _} = Error -> Error
    end.

%% @doc The predicate for the robots of a recording. If the predicate names robots that are not
%% there, returns these robots.
-spec formula(starl_debug_type:formula(), starl_debug_recording:t()) ->
    {ok, starl_debug_ground:t()} | {error, {no_robots, [starl:robot_id(), ...]}}.
formula(Predicate, #{robots := Robots} = Recording) ->
    Known = maps:with([robots, tokens, elections, geocasts], Recording),
    Formula = starl_debug_ground:formula(Predicate, Known),
    case starl_debug_ground:robots(Formula) -- Robots of
        [] -> {ok, Formula};
        Missing -> {error, {no_robots, Missing}}
    end.
