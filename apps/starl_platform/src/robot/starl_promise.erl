%% @doc What is promised of a call when nothing goes wrong any more, and by when: the words in which
%% the exercise of a block says it ({@link starl_block_exercise}).
-module(starl_promise).

-export([due_us/2, soon/3, when_all/4, has_died/2, is_ok/1, is_some/1, is_answer/1]).

-export_type([t/0, due/0, call/0, team/0]).

%% Nothing; or by this time an outcome of which this holds.
-type t() :: none | due().
-type due() :: {DueUs :: us() | never, fun((Outcome :: term()) -> boolean())}.

%% A call of the exercise.
-type call() :: #{
    what := term(),
    robot := starl_monitor:robot_id(),
    since_us := us(),
    patience_ms := pos_integer() | none
}.

%% The robots, those that have died, when the faults are over (`never': always some), and within
%% which time a promise comes true.
-type team() :: #{
    robots := [starl_monitor:robot_id()],
    died := [starl_monitor:robot_id()],
    healed_us := us() | never,
    within_us := us()
}.

-type us() :: integer().

%% @doc When a call must have ended as promised: so long after it was made and after the heal.
-spec due_us(call(), team()) -> us() | never.
due_us(#{since_us := Since}, #{healed_us := Healed, within_us := Within}) ->
    %% an atom is more than every number
    case max(Since, Healed) of
        never -> never;
        From when is_integer(From), is_integer(Within) -> From + Within
    end.

%% @doc An outcome of which this holds, by then.
-spec soon(call(), fun((term()) -> boolean()), team()) -> due().
soon(Call, Is, Team) -> {due_us(Call, Team), Is}.

%% @doc The same when all robots take part, at these times, and none has died.
-spec when_all([us()], call(), fun((term()) -> boolean()), team()) -> t().
when_all(Times, Call, Is, #{robots := Robots, died := [], within_us := Within} = Team) when
    length(Times) =:= length(Robots)
->
    {max(lists:max(Times) + Within, due_us(Call, Team)), Is};
when_all(_Times, _Call, _Is, _Team) ->
    none.

%% @doc Has any of these robots died?
-spec has_died([starl_monitor:robot_id()], team()) -> boolean().
has_died(Robots, #{died := Died}) -> lists:any(fun(R) -> lists:member(R, Died) end, Robots).

%% @doc The call has succeeded: `ok'.
-spec is_ok(Outcome :: term()) -> boolean().
is_ok(Outcome) -> Outcome =:= ok.

%% @doc The call has succeeded: `{ok, _}'.
-spec is_some(Outcome :: term()) -> boolean().
is_some({ok, _}) -> true;
is_some(_Outcome) -> false.

%% @doc The block has answered, whatever.
-spec is_answer(Outcome :: term()) -> boolean().
is_answer(Outcome) -> Outcome =/= {error, restarted} andalso Outcome =/= {error, timeout}.
