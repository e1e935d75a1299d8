%% @doc The exhaustive checker: explores every interleaving of deliveries, losses, duplicates,
%% time-outs and crashes of a small team that uses a building block. It runs the same machine code
%% as robots do and judges every run with the block's monitor.
%%
%% The checker reasons assume-guarantee, like the paper: SAP is checked over packets, the other
%% blocks over SAP's contract. doc/checking.md describes the coverage and its limits.
-module(starl_check).

-export([blocks/0, run/3, faults/0, terms/0, parse_faults/1, format_error/1, format_unlike/1]).

-export_type([options/0, outcome/0, reason/0]).

%% `depth': the largest number of choices in a row; `memory': bytes of the whole VM; the others as
%% in {@link starl_check_model:options()}.
-type options() :: #{
    robots => pos_integer(),
    faults => starl_check_model:budgets(),
    depth => pos_integer() | infinity,
    memory => pos_integer(),
    terms => pos_integer(),
    machine => {module(), Config :: map()} | {starl_machine:name(), module(), Config :: map()},
    symmetry => boolean(),
    workers => pos_integer()
}.

%% A violation comes with the chart of a shortest way to it and the number of its steps. A monitor that
%% has a mistake judges nothing; it was found before the search, or within it.
-type outcome() ::
    {holds, starl_check_search:ending(), starl_check_search:figures()}
    | {violated, #{
        violation := starl_monitor:violation(),
        steps := non_neg_integer(),
        chart := unicode:chardata(),
        figures := starl_check_search:figures()
    }}
    | {mistaken, before | within, Line :: unicode:chardata()}.

-type reason() :: {unknown_fault, string()} | {bad_count, string()} | {twice, atom()}.

-define(MEMORY, 4000000000).
%% A large heap is collected seldom; an even larger one would be mapped anew each time.
-define(HEAP_WORDS, 300000).
-define(MOST, 255).

%% @doc The blocks that can be checked, and the property checked of each.
-spec blocks() -> [{starl_check_model:block(), string()}].
blocks() -> starl_check_model:blocks().

%% @doc The possible faults and the meanings of their numbers.
-spec faults() -> [{atom(), string()}].
faults() ->
    [
        {loss, "messages that SAP reports lost; they may have been delivered, or be so later"},
        {crash, "machines that crash and start anew: the block's, the application"},
        {sap, "SAP machines that crash and start anew"},
        {reboot, "robots that go down, for some time, and start anew with what they stored"},
        {death, "robots that die for good"},
        {still, "robots that stand still within a step, while time passes, and go on with it"},
        {dup, "packets that arrive twice"},
        {late, "messages that are slower than time-outs"},
        {timeout, "calls that run out of patience"}
    ].

%% @doc The number of terms that a model with terms goes through, if no other is asked for.
-spec terms() -> pos_integer().
terms() -> starl_check_model:terms().

%% @doc Checks a block. `Control' decides from time to time whether to continue; it gets the present
%% figures and its own state, and is called in another process.
-spec run(starl_check_model:block() | starl_block:model_entry(), options(), {
    starl_check_search:control(State), State
}) ->
    outcome().
run(Block, Options, Control) ->
    Limits = #{
        depth => maps:get(depth, Options, infinity), memory => maps:get(memory, Options, ?MEMORY)
    },
    Asked = maps:without([depth, memory], Options),
    case starl_check_model:check(Block, Asked) of
        ok -> searched(starl_check_model:new(Block, Asked), Limits, Control);
        {error, Line} -> {mistaken, before, Line}
    end.

searched(Model, Limits, Control) ->
    %% The memory of a separate process is freed as a whole.
    Self = self(),
    {Pid, Ref} = spawn_opt(
        fun() ->
            Self ! {answer, self(), outcome(starl_check_search:run(Model, Limits, Control), Model)}
        end,
        [monitor, {min_heap_size, ?HEAP_WORDS}]
    ),
    receive
        {answer, Pid, Outcome} ->
            true = erlang:demonitor(Ref, [flush]),
            Outcome;
        {'DOWN', Ref, process, Pid, {mistake, Line}} ->
            {mistaken, within, Line};
        {'DOWN', Ref, process, Pid, Reason} ->
            error(Reason)
    end.

outcome({holds, Ending, Figures}, _Model) ->
    {holds, Ending, Figures};
outcome({violated, Violation, Way, Figures}, #{ids := Ids}) ->
    Steps = [starl_check_chart:described(Step) || Step <- Way],
    {violated, #{
        violation => starl_check_term:shown(Violation),
        steps => length(Way),
        chart => starl_check_chart:format(length(Ids), Steps),
        figures => Figures
    }}.

%% @doc Reads `loss:2,crash:1'.
-spec parse_faults(string()) -> {ok, starl_check_model:budgets()} | {error, reason()}.
parse_faults(Text) ->
    None = maps:from_list([{Fault, 0} || {Fault, _} <- faults()]),
    parse_faults(string:lexemes(Text, ","), [], None).

parse_faults([], _Known, Faults) ->
    {ok, Faults};
parse_faults([Word | Words], Known, Faults) ->
    {Name, Number} =
        case string:split(Word, ":") of
            [Only] -> {Only, "1"};
            [Before, After] -> {Before, After}
        end,
    case {lists:search(fun({F, _}) -> atom_to_list(F) =:= Name end, faults()), count(Number)} of
        {false, _} ->
            {error, {unknown_fault, Name}};
        {_, error} ->
            {error, {bad_count, Word}};
        {{value, {Fault, _}}, {ok, Count}} ->
            case lists:member(Fault, Known) of
                true -> {error, {twice, Fault}};
                false -> parse_faults(Words, [Fault | Known], Faults#{Fault := Count})
            end
    end.

count(Text) ->
    case string:to_integer(Text) of
        {Count, ""} when is_integer(Count), Count >= 0, Count =< ?MOST -> {ok, Count};
        _ -> error
    end.

%% @doc A short text on the difference between robots that were assumed to be alike.
-spec format_unlike(starl_check_search:unlike()) -> unicode:chardata().
format_unlike({number, Place}) ->
    io_lib:format("robot ~b does something else under its own number", [Place]);
format_unlike({Choice, Item, Permutation}) ->
    {Event, []} = starl_check_chart:described({Choice, Item, []}),
    Moves = [
        io_lib:format("~b as ~b", [From, To])
     || {From, To} <- lists:enumerate(tuple_to_list(Permutation)), From =/= To
    ],
    [
        "\"",
        starl_check_chart:text(Event),
        "\" comes to something else with robot ",
        lists:join(", ", Moves)
    ].

%% @doc One line that states the problem.
-spec format_error(reason()) -> unicode:chardata().
format_error({unknown_fault, Name}) ->
    Names = [atom_to_list(Fault) || {Fault, _} <- faults()],
    ["there is no fault \"", Name, "\"; there are ", lists:join(", ", Names)];
format_error({bad_count, Word}) ->
    ["\"", Word, "\": a fault and how often are expected, as in loss:2, at most 255"];
format_error({twice, Fault}) ->
    [atom_to_list(Fault), " is there twice"].
