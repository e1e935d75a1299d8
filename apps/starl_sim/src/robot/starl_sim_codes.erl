%% @doc The code versions of a simulated robot's machines, and its reloads. The versions are kept in
%% the robot's store. The module returns the reload commands for the machines, and handles the
%% results that the machines report.
-module(starl_sim_codes).

-export([reload/3, started/3, fallen/4, to_tell/3, heeded/4, news/4]).

-export_type([words/0, order/0, news/0]).

-type words() :: [{starl_machine:name(), starl_reload:word()}].

%% A reload by its number, or as data; one that has failed on that robot.
-type order() ::
    {reload, starl_reload:count() | starl_run_reloads:t()}
    | {reload_failed, starl_reload:count(), Failed :: starl:robot_id()}.

%% What a robot learns at this time.
-type news() :: {starl:robot_id(), DueUs :: starl_sim_queue:time(), order()}.

%% @doc Begins a reload of the scenario by its number, or another reload, or handles a failure on
%% another robot. Returns the commands for the robot's machines, which start with this code, or the
%% former code, from now on.
-spec reload(order(), starl_sim_world:t(), Store) -> {words(), starl_sim_world:t(), Store} when
    Store :: starl_sim_store:t().
reload({reload, #{order := #{number := N}} = Reload}, World, Store) ->
    Reloads = maps:get(reloads, World, #{}),
    reload({reload, N}, World#{reloads => Reloads#{N => Reload}}, Store);
reload({reload, N}, #{reloads := Reloads, parts := Parts} = World, Store) ->
    #{N := #{order := Order}} = Reloads,
    {Words, Codes} = starl_reload:take(Order, Parts, starl_sim_store:codes(Store)),
    {Words, World, starl_sim_store:codes(Codes, Store)};
reload({reload_failed, N, Failed}, World, Store) ->
    {Words, Codes} = starl_reload:back(N, Failed, starl_sim_store:codes(Store)),
    {Words, World, starl_sim_store:codes(Codes, Store)}.

%% @doc Handles the start of a machine at this time of the robot's clock: returns the reports on its
%% code.
-spec started(starl_machine:name(), LocalUs :: integer(), Store) ->
    {[starl_reload:told()], Store}
when
    Store :: starl_sim_store:t().
started(Name, Local, Store) ->
    {Told, Codes} = starl_reload:started(Name, Local, starl_sim_store:codes(Store)),
    {Told, starl_sim_store:codes(Codes, Store)}.

%% @doc Handles the end of a machine by itself. New code on trial is given up: the machine could not
%% even start with it, or could not go back cleanly.
-spec fallen(starl_machine:name(), starl_crash:cause() | none, LocalUs, starl_sim_store:t()) ->
    [starl_reload:told()]
when
    LocalUs :: integer().
fallen(_Name, none, _Local, _Store) ->
    [];
fallen(Name, Cause, Local, Store) ->
    starl_reload:fallen(Name, Cause, Local, starl_sim_store:codes(Store)).

%% @doc The machines to notify that this machine has started with new code.
-spec to_tell(nobody | others, starl_machine:name(), starl_sim_world:t()) -> [starl_machine:name()].
to_tell(nobody, _Name, _World) ->
    [];
to_tell(others, Name, #{parts := Parts}) ->
    lists:delete(Name, lists:sort(maps:keys(Parts))).

%% @doc Handles the report of a machine on a reload. The report is logged; a failure is also sent to
%% the other robots.
-spec heeded(starl_reload:told(), starl_machine:name(), Where, Store) -> {[news()], Store} when
    Where :: {starl:robot_id(), Now :: starl_sim_queue:time(), starl_sim_world:t()},
    Store :: starl_sim_store:t().
heeded(#{number := N, outcome := Outcome, module := Module} = Told, Name, {Id, Now, World}, Store) ->
    Line = unicode:characters_to_binary(starl_reload:format(Id, Name, Module, Outcome)),
    logger:notice(#{what => reload, number => N, outcome => Line}, #{domain => [starl, sim]}),
    Codes = starl_reload:heard(Name, Told, starl_sim_store:codes(Store)),
    News =
        case starl_reload:is_failure(Outcome) of
            true -> news(N, Id, Now, World);
            false -> []
        end,
    {News, starl_sim_store:codes(Codes, Store)}.

%% @doc The news that a reload has failed on a robot, for all robots of the reload.
-spec news(starl_reload:count(), starl:robot_id(), Now, starl_sim_world:t()) -> [news()] when
    Now :: starl_sim_queue:time().
news(N, Id, Now, #{reloads := Reloads, delay_us := {Window, _}}) ->
    #{N := #{robots := Robots}} = Reloads,
    Due = Now + starl_run_reloads:news_us(Window),
    [{Robot, Due, {reload_failed, N, Id}} || Robot <- Robots].
