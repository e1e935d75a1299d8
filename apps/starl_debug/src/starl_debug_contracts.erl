%% @doc The contracts that speak of several robots at one moment, judged without trust in the
%% clocks.
%%
%% The monitors of a run take the times of a recording as they are. What they find is broken only if
%% it is so for all clocks that are possible; what they do not find may have happened for others.
%% What is certain and was not found by them is explained by a fault, since they excuse only that.
-module(starl_debug_contracts).

-export([judge/3]).

-export_type([judgement/0, word/0]).

-type word() :: kept | broken | depends.

%% The contract, what of it, the word, and the violations that the monitors had found.
-type judgement() :: #{
    contract := atom(),
    what := atom(),
    word := word(),
    violations := [starl_monitor:violation()],
    answer := starl_debug_check:answer()
}.

%% @doc Judges what the monitors of a recording cannot know; `Violations' are theirs.
-spec judge(starl_debug_recording:t(), [starl_monitor:violation()], starl_debug_check:options()) ->
    [judgement()].
judge(#{monitors := Monitors} = Recording, Violations, Options) ->
    [
        judged(Contract, What, Text, Recording, Violations, Options)
     || {Module, Config} <- Monitors, {Contract, What, Text} <- of_one_moment(Module, Config)
    ].

%% Which predicate breaks a contract, and how its monitor calls that. By their names: the debugger
%% does not rest on the blocks.
of_one_moment(starl_mutex_monitor, _Config) ->
    [{mutex, two_holders, "two_owners"}];
of_one_moment(starl_dpp_monitor, #{r_s := Mm}) ->
    [
        {dpp, two_coordinators, "two_coordinators"},
        {dpp, too_close, io_lib:format("too_near(~.3f mm)", [Mm * 1.0])}
    ];
of_one_moment(_Module, _Config) ->
    [].

judged(Contract, What, Text, Recording, Violations, Options) ->
    {ok, Predicate} = starl_debug:predicate(Text),
    {ok, Formula} = starl_debug:formula(Predicate, Recording),
    #{verdict := Verdict} =
        Answer = starl_debug_check:run(Formula, Recording, Options, fun(_Done) -> continue end),
    Found = [V || #{contract := C, what := W} = V <- Violations, C =:= Contract, W =:= What],
    #{
        contract => Contract,
        what => What,
        word => word(Verdict, Found),
        violations => Found,
        answer => Answer
    }.

word(never, []) -> kept;
word(possibly, _) -> depends;
word(certainly, []) -> kept;
word(_Verdict, [_ | _]) -> broken.
