%% @doc Parses the requests of a page to a simulation that is played. Nothing is trusted: an invalid
%% request becomes an error line for the page. Faults are read where the run is known
%% ({@link starl_lab_window_fault}).
-module(starl_lab_player_request).

-export([read/1]).

-export_type([t/0]).

%% `until', `step' and `step_to' go as fast as they can, then the run rests, or goes on. `step' goes to the next
%% event of a robot, or, without one, by a window; `step_to' to the event of this number.
-type t() ::
    stop
    | pause
    | go
    | {go, starl_lab_player_pace:speed()}
    | {speed, starl_lab_player_pace:speed()}
    | {until, Us :: non_neg_integer(), GoesOn :: boolean()}
    | {step, starl:robot_id() | none}
    | {step_to, starl:robot_id(), Event :: pos_integer()}
    | {fault, Command :: #{binary() => term()}}
    | {heal, Id :: term()}
    | {save, Name :: binary()}
    | {look, starl:robot_id()}.

-define(MOST_SPEED, 1000).
-define(MOST_S, 1.0e9).

%% @doc The order of a command, which is an object of JSON.
-spec read(#{binary() => term()}) -> {ok, t()} | {error, unicode:chardata()}.
read(#{<<"do">> := Do} = Command) -> order(Do, Command);
read(_Command) -> unknown().

order(<<"stop">>, _) ->
    {ok, stop};
order(<<"pause">>, _) ->
    {ok, pause};
order(<<"go">>, #{<<"speed">> := Speed}) ->
    speed(go, Speed);
order(<<"go">>, _) ->
    {ok, go};
order(<<"speed">>, #{<<"speed">> := Speed}) ->
    speed(speed, Speed);
order(<<"until">>, #{<<"at">> := At} = Command) when is_number(At), At >= 0, At < ?MOST_S ->
    {ok, {until, round(At * 1.0e6), maps:get(<<"go">>, Command, false) =:= true}};
order(<<"step">>, Command) ->
    step(maps:get(<<"robot">>, Command, none), maps:get(<<"to">>, Command, next));
order(<<"fault">>, Command) ->
    {ok, {fault, Command}};
order(<<"heal">>, #{<<"id">> := Id}) ->
    {ok, {heal, Id}};
order(<<"save">>, #{<<"name">> := Name}) when is_binary(Name) -> {ok, {save, Name}};
order(<<"look">>, #{<<"robot">> := Robot}) when is_integer(Robot) -> {ok, {look, Robot}};
order(_, _) ->
    unknown().

speed(Do, Speed) when is_number(Speed), Speed > 0, Speed =< ?MOST_SPEED -> {ok, {Do, Speed}};
speed(Do, Max) when Max =:= max; Max =:= <<"max">> -> {ok, {Do, max}};
speed(_Do, _) -> {error, "a speed is a number from 0 to 1000, or max"}.

step(none, _) -> {ok, {step, none}};
step(Robot, N) when is_integer(Robot), is_integer(N), N > 0 -> {ok, {step_to, Robot, N}};
step(Robot, _) when is_integer(Robot) -> {ok, {step, Robot}};
step(_, _) -> {error, "there is no such robot"}.

unknown() -> {error, "this cannot be done here"}.
