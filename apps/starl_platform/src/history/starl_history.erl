%% @doc Histories of calls: the calls of applications to building blocks and their answers, as the
%% callers see them. {@link verdicts/3} decides whether a block's promise can explain the answers.
%%
%% A history uses no internal events of a machine. The application's process reports when it calls a
%% machine and when it has the answer ({@link event()}). Of the machine, a history knows only when
%% it was lost. So it finds a machine that is wrong and traces as if it were right, and also a
%% monitor that looks away.
%% ```
%%   History = lists:foldl(fun starl_history:event/2, starl_history:new([mutex]), Trace),
%%   starl_history:verdicts([{starl_mutex_history, Config}], History, #{})
%% '''
%% The promise of a block to its callers is a model ({@link starl_history_model}). A call without an
%% answer (the robot or the machine has crashed, or nobody waited for it) may have taken effect at
%% any later time, or never.
-module(starl_history).

-export([new/1, event/2, calls/1]).
-export([models/2, verdicts/3, format/1, format_object/1]).

-export_type([t/0, event/0, call/0, tag/0, mark/0, options/0, verdict/0, outcome/0]).

%% What an application's process traces of a call, and of its answer.
-type event() ::
    {history, {invoked, tag(), starl_machine:name(), Request :: term()}}
    | {history, {returned, tag(), Answer :: term()}}.

%% The number of a call: the incarnation of the application, and its calls.
-type tag() :: {pos_integer(), non_neg_integer()}.

%% A call: of which life of its machine, when it was invoked and when it returned (µs), and its answer;
%% `infinity' and `unknown' if nobody knows what became of it. `n': its place among all, in the order
%% of their invocations.
-type call() :: #{
    n := pos_integer(),
    robot := starl:robot_id(),
    machine := starl_machine:name(),
    life := non_neg_integer(),
    request := term(),
    invoked_us := integer(),
    returned_us := integer() | infinity,
    answer := {ok, Answer :: term()} | unknown
}.

%% A store was damaged, lost, or set back.
-type mark() :: {AtUs :: integer(), starl:robot_id(), store}.

-record(history, {
    machines :: #{starl_machine:name() => []},
    %% latest first
    calls = [] :: [call()],
    open = #{} :: #{{starl:robot_id(), tag()} => call()},
    lives = #{} :: #{{starl:robot_id(), starl_machine:name()} => pos_integer()},
    marks = [] :: [mark()],
    count = 0 :: non_neg_integer()
}).

-opaque t() :: #history{}.

%% `states': the most states of a search; `clocks': the windows in which clocks were set, or went wrong
%% by more than they may; `stills': when a robot's application stood still within a step.
%% `sigma_us': how far two clocks differ at most.
-type options() :: #{
    states => pos_integer(),
    clocks => [{FromUs :: integer(), ToUs :: integer()}],
    stills => [{starl:robot_id(), FromUs :: integer(), ToUs :: integer()}],
    sigma_us => non_neg_integer()
}.

%% What is said of an object, such as a token: how many calls there were, and the outcome.
-type verdict() :: #{
    machine := starl_machine:name(),
    object := term(),
    calls := non_neg_integer(),
    outcome := outcome()
}.

%% `{kept, What}': there is an explanation. `{broken, ...}': there is none; the shortest prefix that cannot
%% be explained ends at this time, with the calls that are in it, the last ones first. `undecided': it was
%% not found within so many states.
-type outcome() ::
    {kept, What :: unicode:chardata()}
    | {broken, What :: unicode:chardata(), AtUs :: integer(), [call(), ...]}
    | undecided.

-define(STATES, 200000).
%% The number of calls that are shown of a prefix.
-define(SHOWN, 6).

%% @doc An empty history of the calls to these machines.
-spec new([starl_machine:name()]) -> t().
new(Machines) -> #history{machines = maps:from_keys(Machines, [])}.

%% @doc Adds a trace event to the history.
-spec event(starl_monitor:trace_event(), t()) -> t().
event({At, Robot, app, {history, {invoked, Tag, Machine, Request}}}, History) ->
    invoked(At, Robot, Tag, Machine, Request, History);
event({At, Robot, app, {history, {returned, Tag, Answer}}}, #history{open = Open} = History) ->
    case maps:take({Robot, Tag}, Open) of
        {Call, Left} -> returned(At, Answer, Call, History#history{open = Left});
        error -> History
    end;
event({_, Robot, Machine, crashed}, #history{machines = Machines, lives = Lives} = History) when
    is_map_key(Machine, Machines)
->
    Key = {Robot, Machine},
    History#history{lives = Lives#{Key => maps:get(Key, Lives, 0) + 1}};
event({At, Robot, robot, store_set_back}, #history{marks = Marks} = History) ->
    History#history{marks = [{At, Robot, store} | Marks]};
event({At, Robot, Machine, store_damaged}, #history{machines = Machines} = History) when
    is_map_key(Machine, Machines)
->
    History#history{marks = [{At, Robot, store} | History#history.marks]};
event(_Event, History) ->
    History.

invoked(At, Robot, Tag, Machine, Request, #history{machines = Machines} = History) when
    is_map_key(Machine, Machines)
->
    #history{open = Open, count = Count, lives = Lives} = History,
    Call = #{
        n => Count + 1,
        robot => Robot,
        machine => Machine,
        life => maps:get({Robot, Machine}, Lives, 0),
        request => Request,
        invoked_us => At,
        returned_us => infinity,
        answer => unknown
    },
    History#history{open = Open#{{Robot, Tag} => Call}, count = Count + 1};
invoked(_At, _Robot, _Tag, _Machine, _Request, History) ->
    History.

%% Without an answer nobody knows.
returned(At, {ok, _} = Answer, Call, #history{calls = Calls} = History) ->
    History#history{calls = [Call#{returned_us := At, answer := Answer} | Calls]};
returned(_At, _Error, Call, #history{calls = Calls} = History) ->
    History#history{calls = [Call | Calls]}.

%% @doc All calls, in the order of their invocations.
-spec calls(t()) -> [call()].
calls(#history{calls = Calls, open = Open}) ->
    lists:sort(fun(#{n := A}, #{n := B}) -> A =< B end, maps:values(Open) ++ Calls).

%% The calls as they are known at a time (µs), that time included.
-spec until(integer(), [call()]) -> [call()].
until(Us, Calls) ->
    [
        case Call of
            #{returned_us := Returned} when is_integer(Returned), Returned =< Us -> Call;
            #{} -> Call#{returned_us := infinity, answer := unknown}
        end
     || #{invoked_us := Invoked} = Call <- Calls, Invoked =< Us
    ].

%% The calls for clocks that differ pairwise by at most this time (µs): each call begins up to
%% half of it earlier, and ends up to half of it later.
-spec widened(non_neg_integer(), [call()]) -> [call()].
widened(Sigma, Calls) ->
    Half = (Sigma + 1) div 2,
    [
        Call#{invoked_us := Invoked - Half, returned_us := later(Returned, Half)}
     || #{invoked_us := Invoked, returned_us := Returned} = Call <- Calls
    ].

later(infinity, _Us) -> infinity;
later(At, Us) -> At + Us.

%% @doc Those of the models whose contract is among these, with the contract's configuration.
-spec models([module()], Monitors :: [{module(), map()}]) -> [{module(), map()}].
models(Models, Monitors) ->
    [
        {Model, Config}
     || Model <- Models, {Monitor, Config} <- Monitors, Model:contract() =:= Monitor
    ].

%% @doc The verdicts of the models on the calls, object by object.
-spec verdicts([{module(), Config :: map()}], t(), options()) -> [verdict()].
verdicts(Models, #history{marks = Marks} = History, Options) ->
    Calls = calls(History),
    Sigma = maps:get(sigma_us, Options, 0),
    Judge = Options#{states => maps:get(states, Options, ?STATES), marks => lists:reverse(Marks)},
    [
        (verdict(Model, Config, Own, Judge))#{machine => Model:machine(), object => Object}
     || {Model, Config} <- Models,
        {Object, Own} <- Model:objects(widened(Sigma, of_machine(Model:machine(), Calls)), Config)
    ].

of_machine(Machine, Calls) -> [Call || #{machine := M} = Call <- Calls, M =:= Machine].

verdict(Model, Config, Calls, Judge) ->
    Outcome =
        case Model:judge(Calls, Config, Judge) of
            {explained, What} -> {kept, What};
            {unexplained, What} -> shortest(Model, Config, Calls, Judge, What);
            undecided -> undecided
        end,
    #{calls => length(Calls), outcome => Outcome}.

%% A prefix of what can be explained can be explained, so the shortest that cannot be is found by halving.
shortest(Model, Config, Calls, Judge, What) ->
    Times = list_to_tuple(
        lists:usort(
            lists:append([
                [Invoked | [Returned || is_integer(Returned)]]
             || #{invoked_us := Invoked, returned_us := Returned} <- Calls
            ])
        )
    ),
    IsBroken = fun(N) ->
        Judged = Model:judge(until(element(N, Times), Calls), Config, Judge),
        is_tuple(Judged) andalso element(1, Judged) =:= unexplained
    end,
    At = element(halved(0, tuple_size(Times), IsBroken), Times),
    {broken, What, At, lists:sublist(last_first(until(At, Calls)), ?SHOWN)}.

%% The prefix of the greater number is known to be broken, that of the smaller one not to be.
halved(Sound, Broken, _IsBroken) when Broken - Sound =< 1 -> Broken;
halved(Sound, Broken, IsBroken) ->
    Middle = (Sound + Broken) div 2,
    case IsBroken(Middle) of
        true -> halved(Sound, Middle, IsBroken);
        false -> halved(Middle, Broken, IsBroken)
    end.

last_first(Calls) ->
    lists:sort(fun(A, B) -> latest(A) >= latest(B) end, Calls).

latest(#{returned_us := Returned}) when is_integer(Returned) -> {Returned, 1};
latest(#{invoked_us := Invoked}) -> {Invoked, 0}.

%% @doc The lines of a verdict: the object, and, if it is broken, the calls at the end of the shortest
%% prefix, the last one first.
-spec format(verdict()) -> unicode:chardata().
format(#{outcome := Outcome} = Verdict) -> [format_object(Verdict), outcome(Outcome)].

%% @doc The beginning of that line.
-spec format_object(#{machine := atom(), object := term(), calls := integer(), _ => _}) ->
    unicode:chardata().
format_object(#{machine := Machine, object := Object, calls := Count}) ->
    io_lib:format("~ts ~0tp: ~b call~ts, ", [Machine, Object, Count, ["s" || Count =/= 1]]).

outcome({kept, What}) ->
    [What, "\n"];
outcome(undecided) ->
    "undecided: too many orders are possible; look at a part of the run\n";
outcome({broken, What, At, Calls}) ->
    [
        io_lib:format("not ~ts; ~.6f s is the first moment that cannot be explained:\n", [
            What, At / 1.0e6
        ]),
        [["    ", format_call(Call), "\n"] || Call <- Calls]
    ].

%% A call in a line.
-spec format_call(call()) -> unicode:chardata().
format_call(#{robot := Robot, request := Request, invoked_us := Invoked} = Call) ->
    #{returned_us := Returned, answer := Answer} = Call,
    io_lib:format("~12.6f s..~ts robot ~b: ~0tP -> ~ts", [
        Invoked / 1.0e6, ended(Returned), Robot, Request, 30, answered(Answer)
    ]).

ended(infinity) -> lists:duplicate(14, $\s);
ended(At) -> io_lib:format("~12.6f s", [At / 1.0e6]).

answered(unknown) -> "not known";
answered({ok, Answer}) -> io_lib:format("~0tP", [Answer, 30]).
