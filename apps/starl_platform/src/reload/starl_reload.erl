%% @doc New code for running robots: what a robot's driver tells its machines and its sequential
%% application, and what they answer.
%%
%% A reload has a number and new versions of modules ({@link starl_version}). The driver hands each
%% machine that runs one of these modules the event `code' with {@link word()}; the application heeds
%% it at its next step. The state is carried over: by `code_change/2' of a {@link starl_app}, by
%% `code_change/3' of a {@link starl_machine}. The action `{reloaded, ...}' tells the driver how it
%% went. During the trial time a crash ends nothing: the former code is back at once, and the driver
%% has all other robots of the reload go back, too.
%%
%% The state then: if the new code did not convert it, it stays as it is. A machine's converted state
%% is converted back by the new code; an application's is the state before the switch.
-module(starl_reload).

-export([take/4, back/2, settled/4, begun/2, present/3, on_trial/3, is_failure/1, format/4]).

-export_type([count/0, switch/0, word/0, outcome/0, told/0, order/0, codes/0]).

%% Reloads are counted from 1.
-type count() :: pos_integer().

%% The new module, the trial time, and the robot's machines that learn of a crash.
-type switch() :: #{
    number := count(),
    module := module(),
    trial_us := non_neg_integer(),
    others := [starl_machine:name()]
}.

%% The content of the event `code': take the new code; or go back, since that robot failed.
-type word() :: {take, switch()} | {back, count(), Failed :: starl:robot_id()}.

%% It runs the new code; the state could not be carried over; it crashed within the trial time and
%% is back; it is back for another robot's sake; the application is done, and takes no code.
-type outcome() ::
    taken
    | done
    | {migration_failed, starl_crash:cause()}
    | {crashed, starl_crash:cause()}
    | {back, Failed :: starl:robot_id()}.

%% The action of a machine: the outcome, and the module that it runs now.
-type told() :: #{
    number := count(),
    outcome := outcome(),
    module := module(),
    tell := [starl_machine:name()]
}.

%% A reload.
-type order() :: #{
    number := count(),
    versions := #{module() => module()},
    trial_us := non_neg_integer()
}.

%% The code of a robot's machines that is not their first: the code now, the code before, and until
%% when a machine that cannot even start with it goes back.
-type codes() :: #{
    starl_machine:name() => {count(), Now :: module(), Before :: module(), until()}
}.

-type until() :: (Us :: integer()) | {from_start, Us :: non_neg_integer()}.

%% @doc The machines of a robot that take part, with their words, and the code that starts from now
%% on. `Parts' has the first module of each machine.
-spec take(order(), NowUs :: integer(), Parts :: #{starl_machine:name() => module()}, codes()) ->
    {[{starl_machine:name(), word()}], codes()}.
take(#{number := N, versions := Versions, trial_us := Us}, NowUs, Parts, Codes) ->
    Mine = [{Name, M} || {Name, M} <- lists:sort(maps:to_list(Parts)), is_map_key(M, Versions)],
    New = maps:from_list([
        {Name, {N, maps:get(M, Versions), present(Name, M, Codes), NowUs + Us}}
     || {Name, M} <- Mine
    ]),
    Others = lists:sort(maps:keys(Parts)),
    Words = [
        {Name,
            {take, #{
                number => N,
                module => maps:get(M, Versions),
                trial_us => Us,
                others => lists:delete(Name, Others)
            }}}
     || {Name, M} <- Mine
    ],
    {Words, maps:merge(Codes, New)}.

%% @doc The machines that this reload has changed, and the code before it.
-spec back(count(), codes()) -> {[starl_machine:name()], codes()}.
back(N, Codes) ->
    Names = lists:sort([Name || {Name, {M, _, _, _}} <- maps:to_list(Codes), M =:= N]),
    {Names, lists:foldl(fun undone/2, Codes, Names)}.

undone(Name, Codes) ->
    #{Name := {N, _, Before, Until}} = Codes,
    Codes#{Name := {N, Before, Before, Until}}.

%% @doc A machine has told the module that it runs now.
-spec settled(starl_machine:name(), count(), module(), codes()) -> codes().
settled(Name, N, Module, Codes) ->
    case Codes of
        #{Name := {N, _, Before, Until}} -> Codes#{Name := {N, Module, Before, Until}};
        #{} -> Codes
    end.

%% @doc The robot starts now: so does its trial.
-spec begun(NowUs :: integer(), codes()) -> codes().
begun(NowUs, Codes) ->
    maps:map(
        fun
            (_, {N, Now, Before, {from_start, Us}}) -> {N, Now, Before, NowUs + Us};
            (_, Code) -> Code
        end,
        Codes
    ).

%% @doc The module that a machine starts with.
-spec present(starl_machine:name(), First, codes()) -> First | module() when First :: term().
present(Name, First, Codes) ->
    case Codes of
        #{Name := {_, Now, _, _}} -> Now;
        #{} -> First
    end.

%% @doc A machine has ended by itself: the reload that is on trial then, and the code before it.
-spec on_trial(starl_machine:name(), NowUs :: integer(), codes()) -> {count(), module()} | none.
on_trial(Name, NowUs, Codes) ->
    case Codes of
        #{Name := {N, Now, Before, Until}} when NowUs < Until, Now =/= Before -> {N, Before};
        #{} -> none
    end.

%% @doc Must all robots go back for it?
-spec is_failure(outcome()) -> boolean().
is_failure({migration_failed, _}) -> true;
is_failure({crashed, _}) -> true;
is_failure(_) -> false.

%% @doc One line for the user on the outcome of a reload on a robot.
-spec format(starl:robot_id(), starl_machine:name(), module(), outcome()) -> unicode:chardata().
format(Robot, Name, Module, Outcome) ->
    Code = starl_version:original(Module),
    [io_lib:format("robot ~b, ~ts (~ts): ", [Robot, Name, Code]) | why(Outcome)].

why(taken) ->
    "runs the new code";
why(done) ->
    "is done, and takes no new code";
why({migration_failed, Cause}) ->
    ["rolled back: the state could not be carried over: ", starl_crash:format(Cause)];
why({crashed, Cause}) ->
    ["rolled back: the new code crashed: ", starl_crash:format(Cause)];
why({back, Failed}) ->
    io_lib:format("rolled back, since the reload failed on robot ~b", [Failed]).
