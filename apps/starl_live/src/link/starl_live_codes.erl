%% @doc Manages the code of a live robot's machines and its reloads. It decides which reload
%% commands the machines get, and reports how they apply them.
-module(starl_live_codes).

-export([
    new/1,
    histories/1,
    code/2,
    reload/3,
    take_back/3,
    started/3,
    fallen/4,
    others/2,
    heeded/4,
    report/2
]).

-export_type([t/0, config/0, words/0, report/0]).

%% The modules of the robot's machines; the modules of new code; the process that gets reports on
%% reloads; do the machines run inline?
-type config() :: #{
    parts := #{starl_machine:name() => module()},
    codes => starl_reload:codes(),
    reporter => pid(),
    inline => boolean(),
    atom() => term()
}.

-type words() :: [{starl_machine:name(), starl_reload:word()}].

%% How a machine applies a reload.
-type report() :: {starl_reloaded, starl:robot_id(), starl_machine:name(), starl_reload:told()}.

-record(codes, {
    %% the modules of the robot's machines, those of new code, and who is told about reloads
    parts :: #{starl_machine:name() => module()},
    codes :: starl_reload:codes(),
    reporter :: pid() | none
}).

-opaque t() :: #codes{}.

%% @doc The code of a robot that starts.
-spec new(config()) -> t().
new(#{parts := Parts} = Config) ->
    #codes{
        parts = Parts,
        codes = maps:get(codes, Config, #{}),
        reporter = maps:get(reporter, Config, none)
    }.

%% @doc The machines of whose calls histories are kept: of real robots, those whose calls a model explains.
-spec histories(config()) -> [starl_machine:name()].
histories(#{inline := true}) ->
    [];
histories(#{parts := Parts}) ->
    [Name || {Name, Module} <- lists:sort(maps:to_list(Parts)), has_history(Module)].

has_history(Module) ->
    {module, Module} = code:ensure_loaded(Module),
    erlang:function_exported(Module, has_history, 0) andalso Module:has_history().

%% @doc The code that a machine starts with ({@link starl_reload:code/2}).
-spec code(starl_machine:name(), t()) -> map().
code(Name, #codes{codes = Codes}) -> starl_reload:code(Name, Codes).

%% @doc A reload begins. Returns the commands for the robot's machines, which start with this code
%% from now on. This process gets a report on how each machine applies its command.
-spec reload(starl_reload:order(), pid(), t()) -> {words(), t()}.
reload(Order, Reporter, #codes{parts = Parts, codes = Before} = Codes) ->
    {Words, Next} = starl_reload:take(Order, Parts, Before),
    {Words, Codes#codes{codes = Next, reporter = Reporter}}.

%% @doc A reload has failed elsewhere. Returns the commands for the machines that have to go back.
-spec take_back(starl_reload:count(), Failed :: starl:robot_id(), t()) -> {words(), t()}.
take_back(N, Failed, #codes{codes = Before} = Codes) ->
    {Words, Next} = starl_reload:back(N, Failed, Before),
    {Words, Codes#codes{codes = Next}}.

%% @doc A machine starts. Returns what is to be reported of its code.
-spec started(starl_machine:name(), NowUs :: integer(), t()) -> {[starl_reload:told()], t()}.
started(Name, Now, #codes{codes = Codes} = Before) ->
    {Told, Begun} = starl_reload:started(Name, Now, Codes),
    {Told, Before#codes{codes = Begun}}.

%% @doc A machine has ended by itself: new code on trial is given up.
-spec fallen(starl_machine:name(), starl_crash:cause() | none, NowUs :: integer(), t()) ->
    [starl_reload:told()].
fallen(_Name, none, _Now, _Codes) -> [];
fallen(Name, Cause, Now, #codes{codes = Codes}) -> starl_reload:fallen(Name, Cause, Now, Codes).

%% @doc All other machines of the robot.
-spec others(starl_machine:name(), t()) -> [starl_machine:name()].
others(Name, #codes{parts = Parts}) -> lists:delete(Name, lists:sort(maps:keys(Parts))).

%% @doc A machine has reported how it applies a reload. The report is logged, and returned for
%% {@link report/2}.
-spec heeded(starl_reload:told(), starl_machine:name(), starl:robot_id(), t()) -> {report(), t()}.
heeded(#{outcome := Outcome, module := Module} = Told, Name, Id, #codes{codes = Codes} = Before) ->
    Line = unicode:characters_to_binary(starl_reload:format(Id, Name, Module, Outcome)),
    logger:notice(#{what => reload, outcome => Line}),
    Heard = starl_reload:heard(Name, Told, Codes),
    {{starl_reloaded, Id, Name, Told}, Before#codes{codes = Heard}}.

%% @doc Sends the report to the process that gets reports on reloads.
-spec report(report(), t()) -> ok.
report(_Report, #codes{reporter = none}) ->
    ok;
report(Report, #codes{reporter = Reporter}) ->
    Reporter ! Report,
    ok.
