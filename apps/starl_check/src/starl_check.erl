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

%% An event, and the events that the robots traced in it.
-type step() :: {event(), [starl_monitor:trace_event()]}.

-type event() ::
    {arrow, From :: starl_check_term:place(), To :: starl_check_term:place(), solid | dotted,
        iodata()}
    | {mark, starl_check_term:place(), happens | crash, iodata()}
    | {note, iodata()}.

-define(COLUMN, 12).
-define(MARGIN, 8).

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

%% @doc The default number of terms in a model with terms.
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
    Steps = [described(Step) || Step <- Way],
    {violated, #{
        violation => starl_check_term:shown(Violation),
        steps => length(Way),
        chart => chart(length(Ids), Steps),
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
    {Event, []} = described({Choice, Item, []}),
    Moves = [
        io_lib:format("~b as ~b", [From, To])
     || {From, To} <- lists:enumerate(tuple_to_list(Permutation)), From =/= To
    ],
    [
        "\"",
        text(Event),
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

%% -- the chart --------------------------------------------------------------------------------

%% A way through the states as a message sequence chart in plain text.
%% ```
%%          robot 1     robot 2
%%     1    o           |            calls
%%     2    |---------->o            ballot {first, {7, 1}}
%%     3    |           x            election crashes
%% '''
%% Each robot has a column. `o' marks the robot at which an event happens; an arrow is an arriving
%% message, a dotted arrow the report of an outcome. The events that the robots traced in a step
%% stand below it.

%% The chart of these steps for this number of robots.
-spec chart(pos_integer(), [step()]) -> [iodata(), ...].
chart(Robots, Steps) ->
    Numbered = lists:zip(lists:seq(1, length(Steps)), Steps),
    [head(Robots) | [step(N, Step, Robots) || {N, Step} <- Numbered]].

head(Robots) ->
    Titles = [string:pad("robot " ++ integer_to_list(N), ?COLUMN) || N <- lists:seq(1, Robots)],
    [lists:duplicate(?MARGIN - 1, $\s), Titles, "\n"].

step(N, {Event, Traces}, Robots) ->
    [
        row(io_lib:format("~5b", [N]), lanes(Event, Robots), text(Event)),
        [row("     ", bare(Robots), traced(Trace)) || Trace <- Traces]
    ].

row(Number, Lanes, Text) ->
    Line = [Number, lists:duplicate(?MARGIN - 5, $\s), Lanes, Text],
    [string:trim(lists:flatten(Line), trailing), "\n"].

%% The text of an event.
-spec text(event()) -> iodata().
text({arrow, _, _, _, Text}) -> Text;
text({mark, _, _, Text}) -> Text;
text({note, Text}) -> Text.

traced({_, Id, Name, Event}) ->
    io_lib:format("  ~b ~ts: ~0tp", [
        starl_check_term:number(Id), Name, starl_check_term:shown(Event)
    ]).

bare(Robots) -> lists:append([lane($|, $\s) || _ <- lists:seq(1, Robots)]).

lane(Mark, Fill) -> [Mark | lists:duplicate(?COLUMN - 1, Fill)].

lanes({note, _}, Robots) ->
    bare(Robots);
lanes({mark, Place, Kind, _}, Robots) ->
    Mark =
        case Kind of
            happens -> $o;
            crash -> $x
        end,
    lists:append([
        case N of
            Place -> lane(Mark, $\s);
            _ -> lane($|, $\s)
        end
     || N <- lists:seq(1, Robots)
    ]);
lanes({arrow, From, To, Kind, _}, Robots) ->
    Low = ?COLUMN * (min(From, To) - 1),
    High = ?COLUMN * (max(From, To) - 1),
    Bare = bare(Robots),
    Before = lists:sublist(Bare, Low),
    After = lists:nthtail(High + 1, Bare),
    Before ++ shaft(From < To, High - Low - 2, Kind) ++ After.

shaft(true, Length, Kind) -> "|" ++ stroke(Length, Kind) ++ ">o";
shaft(false, Length, Kind) -> "o<" ++ stroke(Length, Kind) ++ "|".

stroke(Length, solid) -> lists:duplicate(Length, $-);
stroke(Length, dotted) -> lists:duplicate(Length, $.).

%% -- the steps -----------------------------------------------------------------------------

%% A step of the search in words, as a line of a chart.
-spec described(
    {starl_check_choice:t(), starl_check_part:item() | none, [starl_monitor:trace_event()]}
) ->
    step().
described({{still, Choice, {Step, Actions}}, Item, Traces}) ->
    {Happens, _} = described({Choice, Item, []}),
    {
        cut(Happens, io_lib:format("  (stands still: step ~b, action ~b)", [Step, Actions + 1])),
        Traces
    };
described({{go_on, Place}, none, Traces}) ->
    {{mark, Place, happens, "goes on with its step"}, Traces};
described({{fire, Place, {app, _}}, none, Traces}) ->
    {{mark, Place, happens, "the application goes on"}, Traces};
described({{fire, Place, {Name, Timer}}, none, Traces}) ->
    Text = io_lib:format("~ts: time-out ~0tp", [Name, starl_check_term:shown(Timer)]),
    {{mark, Place, happens, Text}, Traces};
described({{crash, Place, Name}, none, Traces}) ->
    {{mark, Place, crash, [atom_to_list(Name), " crashes"]}, Traces};
described({{down, Place}, none, Traces}) ->
    {{mark, Place, crash, "goes down"}, Traces};
described({{die, Place}, none, Traces}) ->
    {{mark, Place, crash, "dies"}, Traces};
described({{up, Place}, none, Traces}) ->
    {{mark, Place, happens, "starts anew"}, Traces};
described({{outcome, Place, _, Lost}, none, Traces}) ->
    {{mark, Place, happens, ["hears from SAP: ", heard(Lost)]}, Traces};
described({tick, none, Traces}) ->
    {{note, "time passes"}, Traces};
described({{Kind, _}, Item, Traces}) ->
    {arrow(Kind, Item), Traces}.

cut({mark, Place, Kind, Text}, More) -> {mark, Place, Kind, [Text, More]};
cut({arrow, From, To, Line, Text}, More) -> {arrow, From, To, Line, [Text, More]}.

arrow(Kind, {packet, From, To, Packet}) ->
    {arrow, From, To, solid, [shown(Packet), again(Kind)]};
arrow(deliver, {message, From, To, Type, Body, _, Age}) ->
    {arrow, From, To, solid, [atom_to_list(Type), " ", shown(Body), slow(Age)]};
arrow(refuse, {message, From, To, Type, Body, _, _}) ->
    {arrow, From, To, dotted, [atom_to_list(Type), " ", shown(Body), "  (refused)"]}.

heard([]) ->
    "nothing is lost";
heard(Lost) ->
    ["lost at ", lists:join(", ", [integer_to_list(starl_check_term:number(R)) || R <- Lost])].

again(again) -> "  (and once more later)";
again(deliver) -> "".

slow(fresh) -> "";
slow(late) -> "  (slow)";
slow(ghost) -> "  (thought lost)";
slow({queued, _}) -> "".

shown(Term) -> io_lib:format("~0tp", [starl_check_term:shown(Term)]).
