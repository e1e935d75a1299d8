%% @doc Installs new code on running robots. It defines the commands of a robot's driver to its
%% machines and its sequential application, and their answers.
%%
%% The same procedure applies in every world: in a simulation, a cluster, a notebook, a fleet of
%% real robots. An operator makes an {@link order/4} and has its code loaded. The robots' drivers
%% get the order, and notify the machines.
%% ```
%%     sources -- order/4 --> new versions, loaded beside the former ones
%%        order -- take/3 --> a word for each machine -- at its next step --> taken, on trial
%%                                       crashed, or failed elsewhere -- back/3 --> back
%% '''
%%
%% A reload has a number and new versions of modules ({@link starl_version}). The driver gives each
%% machine that runs one of these modules the event `code' with {@link word()}; the application
%% applies it at its next step. The state is carried over: by `code_change/2' of a
%% {@link starl_app}, by `code_change/3' of a {@link starl_machine}. The action `{reloaded, ...}'
%% reports the result to the driver. During the trial time a crash ends nothing: the last code whose
%% trial ended well is back at once ({@link starl_lineage}), and the driver makes all other robots
%% of the reload go back, too. If a machine's new code does not know an event that the former code
%% knows, this counts as such a crash.
%%
%% The state then: if the new code did not convert it, it stays as it is. A machine's converted
%% state is converted back, version by version; an application gets back its state from before the
%% switch.
-module(starl_reload).

-export([order/4, trial_ms/0, format_error/1]).
-export([take/3, back/3, heard/3, started/3, fallen/4, code/2, passed/2, without/2]).
-export([told/4, left/3, is_failure/1, format/4, reason/1]).

-export_type([count/0, switch/0, word/0, outcome/0, told/0, order/0, codes/0, reason/0]).

%% Reloads are counted from 1.
-type count() :: pos_integer().

%% The new module and the trial time.
-type switch() :: #{number := count(), module := module(), trial_us := non_neg_integer()}.

%% The content of the event `code': take the new code; or go back, since that robot failed.
-type word() :: {take, switch()} | {back, count(), Failed :: starl:robot_id()}.

%% It runs the new code; the state could not be carried over; it crashed within the trial time, or
%% did not know an event, and is back; it is back for another robot's sake; it is back together with
%% a later version, which replaced it within its trial time; it is back for good, but with the state
%% before the switch, since the former code crashed with the state that the new code had left; the
%% application is done, and takes no code.
-type outcome() ::
    taken
    | done
    | {migration_failed, starl_crash:cause()}
    | {crashed, starl_crash:cause()}
    | {back, Failed :: starl:robot_id()}
    | {unproven, Later :: count()}
    | {restored, starl_crash:cause()}.

%% The action of a machine: the outcome, the module that it runs now, and its versions. `tell': all
%% other machines of the robot learn of a crash.
-type told() :: #{
    number := count(),
    outcome := outcome(),
    module := module(),
    lineage => starl_lineage:t(),
    tell := others | nobody
}.

%% A reload.
-type order() :: #{
    number := count(),
    versions := #{module() => module()},
    trial_us := non_neg_integer()
}.

%% No machine of the robots, nor their application, is among these modules; what is wrong with the code.
-type reason() :: {no_part, [module()]} | {code, [unicode:chardata(), ...]}.

%% The code of a robot's machines that is not their first: the versions that they have come through,
%% and the words that they have not heeded yet, the oldest first.
-type codes() :: #{starl_machine:name() => {starl_lineage:t(), Awaited :: [word()]}}.

-define(TRIAL_MS, 5000).

%% -- for an operator ------------------------------------------------------------------------

%% @doc Makes a reload of robots with these machines: the order to their drivers, and the code of
%% the new versions. The code must be loaded wherever they run ({@link starl_version:load/1}).
-spec order(
    count(),
    [starl_version:source()],
    Parts :: #{starl_machine:name() => module()},
    TrialMs :: non_neg_integer()
) ->
    {ok, order(), [starl_version:code()]} | {error, reason()}.
order(N, Sources, Parts, TrialMs) ->
    case starl_version:make(Sources) of
        {ok, #{versions := Versions, code := Code}} ->
            case [M || M <- maps:values(Parts), is_map_key(M, Versions)] of
                [_ | _] ->
                    Order = #{number => N, versions => Versions, trial_us => 1000 * TrialMs},
                    {ok, Order, Code};
                [] ->
                    {error, {no_part, lists:sort(maps:keys(Versions))}}
            end;
        {error, Lines} ->
            {error, {code, Lines}}
    end.

%% @doc Why there is no order, in lines.
-spec format_error(reason()) -> [unicode:chardata(), ...].
format_error({no_part, Modules}) ->
    Names = lists:join(", ", [atom_to_list(M) || M <- Modules]),
    [[Names, ": neither the application nor a machine of the robots; reload it together with one"]];
format_error({code, Lines}) ->
    Lines.

%% @doc The trial time, unless another one is given.
-spec trial_ms() -> pos_integer().
trial_ms() -> ?TRIAL_MS.

%% -- for a driver ---------------------------------------------------------------------------

%% @doc The machines of a robot that take part, with their commands. `Parts' has the first module of
%% each machine.
-spec take(order(), Parts :: #{starl_machine:name() => module()}, codes()) ->
    {[{starl_machine:name(), word()}], codes()}.
take(#{number := N, versions := Versions, trial_us := Us}, Parts, Codes) ->
    Words = [
        {Name, {take, #{number => N, module => maps:get(M, Versions), trial_us => Us}}}
     || {Name, M} <- lists:sort(maps:to_list(Parts)), is_map_key(M, Versions)
    ],
    Known = maps:map(fun(_, First) -> {starl_lineage:new(First), []} end, Parts),
    {Words, awaited(Words, maps:merge(maps:with([Name || {Name, _} <- Words], Known), Codes))}.

awaited(Words, Codes) -> lists:foldl(fun await/2, Codes, Words).

await({Name, Word}, Codes) ->
    #{Name := {Lineage, Awaited}} = Codes,
    Codes#{Name := {Lineage, Awaited ++ [Word]}}.

%% @doc Handles the failure of a reload on another robot: returns the commands for the machines that
%% it has changed, or would change.
-spec back(count(), Failed :: starl:robot_id(), codes()) ->
    {[{starl_machine:name(), word()}], codes()}.
back(N, Failed, Codes) ->
    Names = [Name || {Name, Code} <- lists:sort(maps:to_list(Codes)), concerns(N, Code)],
    Words = [{Name, {back, N, Failed}} || Name <- Names],
    {Words, awaited(Words, Codes)}.

concerns(N, {Lineage, Awaited}) ->
    starl_lineage:leave(N, Lineage) =/= unknown orelse is_to_take(N, Awaited).

is_to_take(N, Words) -> lists:any(fun(Word) -> is_take(N, Word) end, Words).

is_take(N, {take, #{number := M}}) -> N =:= M;
is_take(_N, {back, _, _}) -> false.

is_of(N, {back, M, _}) -> N =:= M;
is_of(N, Take) -> is_take(N, Take).

%% @doc Records the result that a machine reports of a command.
-spec heard(starl_machine:name(), told(), codes()) -> codes().
heard(Name, #{number := N, outcome := Outcome, lineage := Lineage}, Codes) ->
    #{Name := {_, Awaited}} = Codes,
    Heeded =
        case Outcome of
            taken -> fun is_take/2;
            _ -> fun is_of/2
        end,
    Codes#{Name := {Lineage, [Word || Word <- Awaited, not Heeded(N, Word)]}};
heard(_Name, #{}, Codes) ->
    Codes.

%% @doc Handles the start of a machine. It applies all commands that its predecessor has not
%% applied, and code that it takes is on trial from now on.
-spec started(starl_machine:name(), NowUs :: integer(), codes()) -> {[told()], codes()}.
started(Name, Now, Codes) ->
    case Codes of
        #{Name := {Lineage, [_ | _] = Awaited}} ->
            {Told, Begun} = heeded(Awaited, Now, Lineage, []),
            {Told, Codes#{Name := {Begun, []}}};
        #{} ->
            {[], Codes}
    end.

heeded([], _Now, Lineage, Told) ->
    {Told, Lineage};
heeded([{take, #{number := N} = Switch} | Words], Now, Lineage, Told) ->
    case [Robot || {back, M, Robot} <- Words, M =:= N] of
        [] ->
            Taken = taken(Switch, Now, Lineage),
            heeded(Words, Now, Taken, Told ++ [told(N, taken, nobody, Taken)]);
        [Robot | _] ->
            heeded(Words, Now, Lineage, Told ++ [told(N, {back, Robot}, nobody, Lineage)])
    end;
heeded([{back, N, Robot} | Words], Now, Lineage, Told) ->
    case starl_lineage:leave(N, Lineage) of
        {left, Left, Earlier} ->
            heeded(Words, Now, Earlier, Told ++ left({back, Robot}, nobody, {Left, Earlier}));
        {skipped, Skipped} ->
            heeded(Words, Now, Skipped, Told ++ [told(N, {back, Robot}, nobody, Skipped)]);
        unknown ->
            heeded(Words, Now, Lineage, Told)
    end.

taken(Switch, Now, Lineage) -> starl_lineage:take(Switch#{kept => none}, Now, Lineage).

%% @doc Handles the end of a machine by itself: returns the reports on the reload that was on trial.
-spec fallen(starl_machine:name(), starl_crash:cause(), NowUs :: integer(), codes()) -> [told()].
fallen(Name, Cause, Now, Codes) ->
    case Codes of
        #{Name := {Lineage, _}} ->
            case starl_lineage:is_on_trial(Now, Lineage) of
                true -> left({crashed, Cause}, nobody, starl_lineage:back(Lineage));
                false -> []
            end;
        #{} ->
            []
    end.

%% @doc The versions with which a machine starts now; none if it starts with its first code.
-spec code(starl_machine:name(), codes()) -> #{code => starl_lineage:t()}.
code(Name, Codes) ->
    case Codes of
        #{Name := {Lineage, _}} -> #{code => Lineage};
        #{} -> #{}
    end.

%% -- for those who start robots -------------------------------------------------------------

%% @doc Records that the trial of the reload has ended well on all robots.
-spec passed(count(), codes()) -> codes().
passed(N, Codes) -> maps:map(fun(_Name, Code) -> passed_by(N, Code) end, Codes).

passed_by(N, {Lineage, Awaited} = Code) ->
    case is_to_take(N, Awaited) of
        true -> promoted(N, Lineage, Awaited);
        false -> Code
    end.

promoted(N, Lineage, Awaited) ->
    {Passed, Later} = lists:partition(fun({take, #{number := M}}) -> M =< N end, Awaited),
    Switches = [proven(N, Switch) || {take, Switch} <- Passed],
    {lists:foldl(fun(Switch, L) -> taken(Switch, 0, L) end, Lineage, Switches), Later}.

%% An earlier one that the passed one has replaced within its trial has proven nothing.
proven(N, #{number := N} = Switch) -> Switch#{trial_us := 0};
proven(_N, Switch) -> Switch.

%% @doc Records that the reload has failed on a robot: no robot starts with it.
-spec without(count(), codes()) -> codes().
without(N, Codes) -> maps:map(fun(_Name, Code) -> left_by(N, Code) end, Codes).

left_by(N, {Lineage, Awaited}) ->
    Left = [Word || Word <- Awaited, not is_of(N, Word)],
    case starl_lineage:leave(N, Lineage) of
        {left, _, Earlier} -> {Earlier, Left};
        {skipped, Skipped} -> {Skipped, Left};
        unknown -> {Lineage, Left}
    end.

%% -- for a machine's runner -----------------------------------------------------------------

%% @doc The report of a machine on a reload.
-spec told(count(), outcome(), others | nobody, starl_lineage:t()) -> told().
told(N, Outcome, Tell, Lineage) ->
    #{
        number => N,
        outcome => Outcome,
        module => starl_lineage:code(Lineage),
        lineage => starl_lineage:bare(Lineage),
        tell => Tell
    }.

%% @doc The report of a machine that has left these versions. A failure is reported only once.
-spec left(outcome(), others | nobody, {[starl_lineage:version(), ...], starl_lineage:t()}) ->
    [told(), ...].
left(Outcome, Tell, {[#{number := N} | Older], Lineage}) ->
    [
        told(N, Outcome, Tell, Lineage)
        | [
            told(M, {unproven, N}, nobody, Lineage)
         || #{number := M, standing := Standing} <- Older, Standing =/= failed
        ]
    ].

%% @doc Checks whether all robots must go back because of this outcome.
-spec is_failure(outcome()) -> boolean().
is_failure({migration_failed, _}) -> true;
is_failure({crashed, _}) -> true;
is_failure({unproven, _}) -> true;
is_failure(_) -> false.

%% @doc One line for the user on the outcome of a reload on a robot.
-spec format(starl:robot_id(), starl_machine:name(), module(), outcome()) -> unicode:chardata().
format(Robot, Name, Module, Outcome) ->
    Code = starl_version:original(Module),
    [
        io_lib:format("robot ~b, ~ts (~ts): ", [Robot, Name, Code]),
        verdict(Outcome),
        reason(Outcome)
    ].

verdict(taken) -> "";
verdict(done) -> "";
verdict({restored, _}) -> "";
verdict({back, _}) -> "rolled back, since ";
verdict({unproven, _}) -> "rolled back ";
verdict(_) -> "rolled back: ".

%% @doc An outcome in words.
-spec reason(outcome()) -> unicode:chardata().
reason(taken) ->
    "runs the new code";
reason(done) ->
    "is done, and takes no new code";
reason({migration_failed, Cause}) ->
    ["the state could not be carried over: ", starl_crash:format(Cause)];
reason({crashed, Cause}) ->
    ["the new code crashed: ", starl_crash:format(Cause)];
reason({back, Failed}) ->
    io_lib:format("the reload failed on robot ~b", [Failed]);
reason({unproven, Later}) ->
    io_lib:format("together with reload ~b, which came within its trial time", [Later]);
reason({restored, Cause}) ->
    [
        "the former code crashed with the state that the new code had left, and goes on with the "
        "state before the switch: ",
        starl_crash:format(Cause)
    ].
