%% @doc `./starl check BLOCK': runs the exhaustive checker on a building block.
-module(starl_lab_check).

-behaviour(starl_cli_command).

-export([command/0]).
-export([search/3]).

-define(DEPTH, {optional, {integer, 1, 1000000}}).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "check",
        synopsis => "check every order of events in a small team",
        argument => fun argument/0,
        subject => fun subject/2,
        about => fun about/1,
        flags => fun flags/1,
        words => fun words/1,
        statuses => [
            {0, "the contract holds"},
            {3, "it is violated; the shortest way there is printed"},
            {4, "out of memory before all was covered, or a search without end"},
            {5, "the block's monitor has a mistake, so nothing was judged"},
            {130, "interrupted, with what was covered"}
        ],
        run => fun run/1
    }.

argument() -> {required, "BLOCK", starl_check:blocks() ++ [{all, "one after the other"}]}.

about(_Subject) ->
    {required, _, Blocks} = argument(),
    [
        "Goes through all that can happen to a small team that uses a block, with the code that "
        "robots run, and holds it to the block's contract.",
        {list, "Blocks", named(Blocks) ++ [{"FILE.erl", "a block of your own"}]},
        {list, "Faults", named(starl_check:faults())}
    ].

named(Known) -> [{atom_to_list(Name), Doc} || {Name, Doc} <- Known].

flags(_Subject) ->
    [
        {"Flags", [
            {robots, {integer, 1, 8}, 3, "robots in the team"},
            {faults, string, "loss:1,crash:1",
                "faults, each with the number of times that it may happen, as in "
                "loss:2,crash:1; or none"},
            {terms, {integer, 1, 1000}, starl_check:terms(),
                "the number of terms that the model terms goes through"},
            {depth, ?DEPTH, none, "the largest number of steps in a row"},
            {memory, {integer, 100, 1000000}, 4000, "the most memory to use, MB"},
            {'no-symmetry', switch, false,
                "treats robots that are alike as different ones, which takes longer"},
            {quiet, switch, false, "no progress line"}
        ]}
    ].

words(faults) -> [[atom_to_list(Fault), ":1"] || {Fault, _} <- starl_check:faults()];
words(_Flag) -> [].

%% @doc A block of the user's own.
-spec subject(string(), [string()]) ->
    {ok, {own, module()}, [string()]} | {error, [unicode:chardata(), ...]}.
subject(File, Args) ->
    case starl_cli_source:block(File, check) of
        {ok, Block, _} -> {ok, {own, Block}, Args};
        {error, _} = Error -> Error
    end.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Wanted, values := #{faults := Text} = Values}) ->
    case faults(Text) of
        {ok, Faults} -> each(models(Wanted), Values#{faults := Faults}, 0);
        {error, Reason} -> {error, [["--faults: ", starl_check:format_error(Reason)]]}
    end.

%% @doc Goes through what can happen until so many states are known.
-spec search(Model, starl_check:options(), MostStates :: pos_integer()) ->
    starl_check:outcome()
when
    Model :: atom() | starl_block:model_entry().
search(Model, Options, MostStates) ->
    Enough = fun(#{states := States}, none) ->
        case States > MostStates of
            true -> {stop, none};
            false -> {continue, none}
        end
    end,
    starl_check:run(Model, Options, {Enough, none}).

models(all) -> starl_block_catalogue:models();
models({own, Block}) -> Block:models();
models(Name) -> [lists:keyfind(Name, 1, starl_block_catalogue:models())].

faults("none") -> starl_check:parse_faults("");
faults(Text) -> starl_check:parse_faults(Text).

%% Checks the blocks in turn and gives the gravest status; an interruption ends the list.
each([], _Values, Status) ->
    Status;
each([Block | Blocks], Values, Status) ->
    case checked(Block, Values) of
        130 -> 130;
        Next -> each(Blocks, Values, graver(Status, Next))
    end.

graver(3, _) -> 3;
graver(_, 3) -> 3;
graver(One, Other) -> max(One, Other).

checked({Block, _, _} = Model, #{robots := Robots, faults := Faults, memory := Megabytes} = Values) ->
    Options = #{
        terms => maps:get(terms, Values),
        robots => Robots,
        faults => Faults,
        memory => Megabytes * 1000000,
        depth => depth(maps:get(depth, Values)),
        symmetry => not maps:get('no-symmetry', Values)
    },
    Stop = atomics:new(1, []),
    starl_cli_signal:on_interrupt(fun() -> atomics:put(Stop, 1, 1) end),
    Begin = now_ms(),
    Outcome = starl_check:run(Model, Options, control(Stop, Values)),
    starl_cli_signal:on_interrupt(quit),
    starl_cli_progress:erase(),
    tell(Outcome, Block, Values, (now_ms() - Begin) / 1000).

depth(none) -> infinity;
depth(Depth) -> Depth.

control(Stop, #{quiet := Quiet}) ->
    How =
        case Quiet of
            true -> quiet;
            false -> auto
        end,
    Look = fun(Figures, Progress) ->
        Next = starl_cli_progress:show(Progress, unknown, fun() -> figures(Figures) end),
        case atomics:get(Stop, 1) of
            0 -> {continue, Next};
            1 -> {stop, Next}
        end
    end,
    {Look, starl_cli_progress:new(How)}.

figures(#{states := States, waiting := Waiting, depth := Depth}) ->
    [
        io_lib:format("~ts states", [grouped(States)]),
        io_lib:format("~ts waiting", [grouped(Waiting)]),
        io_lib:format("depth ~b", [Depth]),
        io_lib:format("~b MB", [erlang:memory(total) div 1000000])
    ].

%% -- what came out --------------------------------------------------------------------------

tell({violated, Found}, Block, Values, Seconds) ->
    #{violation := Violation, steps := Steps, chart := Chart, figures := Figures} = Found,
    starl_cli_terminal:out([
        unlike(Figures),
        ["VIOLATED: ", starl_violation:format(Violation), "\n"],
        io_lib:format("A shortest way there, ~b steps:~n~n", [Steps]),
        [Chart, "\n", covered(Figures, Block, Values, Seconds), "\n"]
    ]),
    3;
tell({holds, Ending, Figures}, Block, Values, Seconds) ->
    starl_cli_terminal:out([
        unlike(Figures),
        [verdict(Ending, Block), "\n", covered(Figures, Block, Values, Seconds), "\n"],
        [[What, "\n"] || What <- left(Ending, Figures, Values)]
    ]),
    status(Ending);
%% A mistake of the block's monitor.
tell({mistaken, When, Line}, _Block, _Values, _Seconds) ->
    starl_cli_terminal:complain(["check: ", Line]),
    case When of
        before -> 2;
        within -> 5
    end.

status(complete) -> 0;
status(depth) -> 0;
status(endless) -> 4;
status(memory) -> 4;
status(interrupted) -> 130.

verdict(complete, Block) ->
    ["The contract of ", atom_to_list(Block), " holds in every state."];
verdict(_, Block) ->
    ["NOT COMPLETE: the contract of ", atom_to_list(Block), " holds in every state met so far."].

covered(#{states := States, runs := Runs, depth := Depth} = Figures, Block, Values, Seconds) ->
    #{robots := Robots, faults := Faults} = Values,
    io_lib:format("~ts, ~b robots, ~ts~ts: ~ts states, ~ts runs, depth ~b, ~.1f s", [
        Block,
        Robots,
        fault_text(Faults),
        bounds(Figures),
        grouped(States),
        grouped(Runs),
        Depth,
        Seconds
    ]).

bounds(#{bounds := ""}) -> "";
bounds(#{bounds := Words}) -> [", ", Words].

fault_text(Faults) ->
    Given = [
        io_lib:format("~ts:~b", [Fault, Count])
     || {Fault, _} <- starl_check:faults(), Count <- [maps:get(Fault, Faults)], Count > 0
    ],
    case Given of
        [] -> "no faults";
        _ -> lists:join(",", Given)
    end.

left(complete, _, _) ->
    [];
left(Why, #{depth := Depth, waiting := Waiting}, #{memory := Megabytes}) ->
    Reason =
        case Why of
            depth ->
                "stopped at the depth asked for";
            endless ->
                "the search does not end: more than 4,095 steps in a row lead to new states, as "
                "where a number in a machine grows for ever";
            memory ->
                io_lib:format("~b MB of memory are used up (--memory gives more)", [Megabytes]);
            interrupted ->
                "interrupted"
        end,
    [
        io_lib:format("~ts: everything up to depth ~b is covered, ~ts states are not gone into", [
            Reason, Depth, grouped(Waiting)
        ])
    ].

unlike(#{unlike := none}) ->
    [];
unlike(#{unlike := Unlike}) ->
    ["Robots are not alike, so all were told apart: ", starl_check:format_unlike(Unlike), "\n"].

%% 1234567 as 1,234,567.
grouped(N) when N < 1000 -> integer_to_list(N);
grouped(N) -> grouped(N div 1000) ++ io_lib:format(",~3..0b", [N rem 1000]).

now_ms() -> erlang:monotonic_time(millisecond).
