%% @doc The promise that a call makes for the time when all faults are over: its outcome, and its
%% latest end. The exercise of a block makes promises ({@link starl_block_exercise}).
-module(starl_promise).

-export([due_us/2, soon/3, when_all/4, has_died/2, is_ok/1, is_some/1, is_answer/1]).

-export_type([t/0, due/0, call/0, team/0]).

%% No promise; or, by this time, an outcome for which the function holds.
-type t() :: none | due().
-type due() :: {DueUs :: us() | never, fun((Outcome :: term()) -> boolean())}.

%% A call of the exercise.
-type call() :: #{
    what := term(),
    robot := starl:robot_id(),
    since_us := us(),
    patience_ms := pos_integer() | none
}.

%% The robots, those that have died, the end of all faults (`never': there are always some), and the
%% time within which a promise comes true; the time in which a message reaches a robot (by default
%% at once), and the values of the exercise. `rest': robots for which faults never end; they count among
%% those that have died, but may still say something.
-type team() :: #{
    robots := [starl:robot_id()],
    died := [starl:robot_id()],
    healed_us := us() | never,
    within_us := us(),
    reach_us => us(),
    rest => [starl:robot_id(), ...],
    use => starl_block_exercise:use()
}.

-type us() :: integer().

%% @doc The latest end of a call as promised: this time after the call and after the heal.
-spec due_us(call(), team()) -> us() | never.
due_us(#{since_us := Since}, #{healed_us := Healed, within_us := Within}) ->
    %% an atom is larger than any number
    case max(Since, Healed) of
        never -> never;
        From when is_integer(From), is_integer(Within) -> From + Within
    end.

%% @doc Promises an outcome for which the function holds, by the usual time.
-spec soon(call(), fun((term()) -> boolean()), team()) -> due().
soon(Call, Is, Team) -> {due_us(Call, Team), Is}.

%% @doc The same if all robots take part, at these times, and none has died; else no promise.
-spec when_all([us()], call(), fun((term()) -> boolean()), team()) -> t().
when_all(Times, Call, Is, #{robots := Robots, died := [], within_us := Within} = Team) when
    length(Times) =:= length(Robots)
->
    {max(lists:max(Times) + Within, due_us(Call, Team)), Is};
when_all(_Times, _Call, _Is, _Team) ->
    none.

%% @doc Has any of these robots died?
-spec has_died([starl:robot_id()], team()) -> boolean().
has_died(Robots, #{died := Died}) -> lists:any(fun(R) -> lists:member(R, Died) end, Robots).

%% @doc Has the call succeeded with `ok'?
-spec is_ok(Outcome :: term()) -> boolean().
is_ok(Outcome) -> Outcome =:= ok.

%% @doc Has the call succeeded with `{ok, _}'?
-spec is_some(Outcome :: term()) -> boolean().
is_some({ok, _}) -> true;
is_some(_Outcome) -> false.

%% @doc Has the block answered, with any answer?
-spec is_answer(Outcome :: term()) -> boolean().
is_answer(Outcome) -> Outcome =/= {error, restarted} andalso Outcome =/= {error, timeout}.
