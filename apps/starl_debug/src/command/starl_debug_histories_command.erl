%% @doc The command `./starl histories': checks whether the promises of the blocks can explain the
%% answers to the calls of a recorded run.
-module(starl_debug_histories_command).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "histories",
        synopsis => "judge the calls of a recorded run by what their callers saw",
        argument => {required, "RECORDING", {example, "out/painting-1"}},
        subject => fun subject/2,
        about => about(),
        flags => [
            {"Flags", [
                starl_debug_bounds:flag(""),
                starl_debug_bounds:drift(),
                {states, {integer, 1, 100000000}, 200000,
                    "the most states that are tried for an object"}
            ]}
        ],
        statuses => [
            {0, "all answers can be explained"},
            {3, "some cannot"},
            {5, "not all is decided, or known, and the rest can be explained"},
            {6, "some can only be explained if clocks disagree within sigma"}
        ],
        run => fun run/1
    }.

about() ->
    [
        "RECORDING is a recording, or the directory of a run that holds one. ./starl judge reads what the "
        "machines of a run tell of themselves; this command reads what the applications saw: their calls "
        "to blocks, and the answers. Is there an order of the calls, each in effect at some moment between "
        "its beginning and its answer, that explains all answers? A call without an answer may have taken "
        "effect at any time after it, or never. There is a line for each object, and for one that cannot be "
        "explained the calls at the end of the shortest part of the run that cannot.",
        {list, "What is asked", [
            {"mutex", "each token is a lock, linearizable, with growing fencing numbers"},
            {"registers", "each register is sequentially consistent"},
            {"election", "all elect the same robot; bully: a robot elects one in each life"},
            {"counter", "a value is within its bounds, and never goes back"}
        ]},
        "Holds that a fault of a clock may have ended, or not ended, are left out. With --sigma what cannot be "
        "explained by the times of the recording is tried with each call longer by sigma."
    ].

-spec subject(string(), [string()]) ->
    {ok, file:filename(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    starl_cli_out:recording(Word, "./starl run TARGET --record makes one", Args).

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := File, values := #{sigma := Text} = Values}) ->
    case starl_debug_bounds:read(Text) of
        {ok, _} when Text =:= none -> judged(File, 0, Values);
        {ok, Sigma} -> by_clocks(Sigma, File, Values);
        {error, Line} -> {error, [Line]}
    end.

by_clocks(Sigma, File, #{drift := Drift} = Values) ->
    case starl_debug_recording:read([File], #{}) of
        {ok, Recording} ->
            case starl_debug_bounds:bounds(Sigma, Recording, Drift) of
                {ok, Us} when is_integer(Us) -> judged(File, Us, Values);
                {ok, Bounds} -> judged(File, starl_debug_clocks:widest(Bounds), Values);
                {error, Line} -> {error, [Line]}
            end;
        {error, Reason} ->
            {error, [starl_debug_recording:format_error(Reason)]}
    end.

judged(File, Sigma, Values) ->
    case starl_cli_inputs:sources_beside(File) of
        {ok, Sources} -> with_own(own(Sources, []), File, Sigma, Values);
        {error, Line} -> {error, [Line]}
    end.

with_own({ok, Own}, File, Sigma, Values) ->
    judged(File, Sigma, Values, starl_block_catalogue:histories(Own));
with_own({error, _} = Error, _File, _Sigma, _Values) ->
    Error.

%% Blocks of the user's own, as the run has kept their sources.
own([], Modules) ->
    {ok, Modules};
own([Source | Sources], Modules) ->
    case starl_cli_source:modules(Source) of
        {ok, _, Codes} -> own(Sources, [M || {M, _, _} <- Codes] ++ Modules);
        {error, _} = Error -> Error
    end.

judged(File, Sigma, #{states := States}, Models) ->
    case starl_trace_history:file(File, Models) of
        {ok, #{facts := Facts} = Read} ->
            case missing(Facts) of
                [] -> told(File, Read, verdicts(Read, Sigma, States));
                [Robot | _] -> {error, [incomplete(File, Robot)]}
            end;
        {error, Reason} ->
            {error, [starl_trace_judge:format_error(Reason)]}
    end.

missing(#{told_by := By, robots := Robots}) -> [Id || {Id, _} <- Robots] -- By;
missing(_Facts) -> [].

incomplete(File, Robot) ->
    io_lib:format(
        "~ts: it does not tell of robot ~b, whose calls may explain others; ./starl merge joins the "
        "recordings of the robots",
        [File, Robot]
    ).

verdicts(#{facts := Facts, history := History, models := Models}, Sigma, States) ->
    Options = (broken(Facts))#{states => States},
    Plain = starl_history:verdicts(Models, History, Options),
    case Sigma > 0 andalso [x || #{outcome := {broken, _, _, _}} <- Plain] =/= [] of
        true ->
            Wide = starl_history:verdicts(Models, History, Options#{sigma_us => Sigma}),
            lists:zipwith(fun with_clocks/2, Plain, Wide);
        false ->
            Plain
    end.

%% Longer calls have more orders.
with_clocks(#{outcome := {broken, What, _, _}} = Verdict, #{outcome := {kept, _}}) ->
    Verdict#{outcome := {depends, What}};
with_clocks(#{outcome := {broken, _, _, _}}, Wide) ->
    Wide;
with_clocks(Verdict, _Wide) ->
    Verdict.

%% When faults made clocks go wrong, or applications stand still within a step, as the run has told its
%% contracts.
broken(#{kind := simulation, monitors := Monitors}) ->
    Windows = lists:usort([W || {_, #{broken := Told}} <- Monitors, W <- Told]),
    #{
        clocks => [{From, To} || {_, From, To, {clock, _}} <- Windows],
        stills => [{Robot, From, To} || {Robot, From, To, caller} <- Windows]
    };
broken(_Facts) ->
    #{}.

told(File, #{facts := #{app := App}} = Read, Verdicts) ->
    #{until_us := Until, ends := Ends, history := History} = Read,
    Count = length(starl_history:calls(History)),
    starl_cli_terminal:out([
        io_lib:format("~ts: ~ts, to ~.1f s, ~b calls\n", [File, App, Until / 1.0e6, Count]),
        [line(Verdict) || Verdict <- Verdicts],
        [
            "THE RECORDING HAS A HOLE THERE, or was cut off; what came then is not judged\n"
         || Ends =:= hole
        ],
        [nothing(Read) || Count =:= 0]
    ]),
    status([outcome(Verdict) || Verdict <- Verdicts], Ends).

line(#{outcome := {depends, What}} = Verdict) ->
    [
        starl_history:format_object(Verdict),
        "depends on the clocks: by the times of the recording it is not ",
        What,
        "\n"
    ];
line(Verdict) ->
    starl_history:format(Verdict).

nothing(#{models := []}) ->
    "the run has no block that promises its callers anything of this kind\n";
nothing(_Read) ->
    "nobody has called a block, or the recording does not keep the calls\n".

outcome(#{outcome := undecided}) -> undecided;
outcome(#{outcome := Outcome}) -> element(1, Outcome).

status(Outcomes, Ends) ->
    Found =
        [
            3
         || lists:member(broken, Outcomes)
        ] ++
            [5 || Ends =:= hole orelse lists:member(undecided, Outcomes)] ++
            [6 || lists:member(depends, Outcomes)],
    hd(Found ++ [0]).
