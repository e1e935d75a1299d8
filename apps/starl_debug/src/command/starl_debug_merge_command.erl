%% @doc The command `./starl merge': merges the recordings of several robots of a run into one
%% recording.
-module(starl_debug_merge_command).
-behaviour(starl_cli_command).

-export([command/0]).

%% Rates of clocks are off by this at most; bounds that are wider say nothing.
-define(DRIFT_PPM, 100).
%% The VM corrects a clock that was set so fast ({@link starl_live_clock}).
-define(CORRECTED_PPM, 10000).
-define(UNKNOWN_US, 60000000).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "merge",
        synopsis => "make one recording of those of several robots",
        argument => {required, "FILES", {example, "robot-1.mcap"}},
        subject => fun subject/2,
        about => [
            "./starl merge FILES... --out FILE puts the recordings of the robots of one run together, "
            "by time; of a cluster, also the world's run.mcap, which has the true motions. The robots' "
            "clocks must agree. Where packets came before they were sent, that is said, and times are moved "
            "so far that each packet comes after it was sent.",
            "./starl merge out/painting-1/robots/*.mcap out/painting-1/run.mcap"
        ],
        flags => [
            {"Flags", [
                {out, file, none, "the file for the result (merged.mcap)"},
                starl_cli_out:overwrite_file()
            ]}
        ],
        run => fun run/1
    }.

-spec subject(string(), [string()]) -> {ok, [file:filename(), ...], [string()]}.
subject(File, Args) ->
    {Files, Others} = lists:splitwith(fun(Word) -> not lists:prefix("-", Word) end, Args),
    {ok, [File | Files], Others}.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := [_]}) ->
    {error, ["merge takes two recordings or more"]};
run(#{subject := Files, values := #{out := Given, overwrite := Overwrite}}) ->
    {Taken, Out} = starl_cli_out:file(Given, "merged.mcap", Overwrite),
    Own = [[Out, ": this is one of the files to merge"] || lists:member(Out, Files)],
    case Taken ++ Own of
        [] -> told(starl_trace_merge:files(Files, Out), Files, Out);
        Problems -> {error, Problems}
    end.

told({ok, #{messages := Messages, cut_off := CutOff} = Merged}, Files, Out) ->
    #{begun_us := Begun, until_us := Until, missing := Missing, clocks := Clocks} = Merged,
    #{lacking := Lacking} = Merged,
    case starl_mcap_recover:pack(Out, starl_trace_writer:patch()) of
        ok -> ok;
        {error, Why} -> starl_cli_terminal:warn([Out, ": not packed: ", Why])
    end,
    starl_cli_terminal:out([
        io_lib:format("~ts: ~b messages, ~.1f s\n", [Out, Messages, (Until - Begun) / 1.0e6]),
        [[File, ": is cut off; its end is missing\n"] || File <- CutOff],
        missing([integer_to_list(Robot) || Robot <- Missing]),
        [lacking(Which) || Which <- Lacking],
        [
            io_lib:format(
                "clocks: packets from robot ~b to robot ~b came ~.1f ms before they were sent\n",
                [From, To, Us / 1000]
            )
         || {{From, To}, Us} <- Clocks
        ],
        [
            io_lib:format(
                "clocks: times of robot ~b are moved by ~.1f ms at most, behind the packets that came to it\n",
                [Robot, Us / 1000]
            )
         || {Robot, Us} <- maps:get(moved, Merged)
        ],
        clocks(starl_debug_recording:read(Files, #{}), Out)
    ]),
    0;
told({error, Reason}, _Files, _Out) ->
    {error, [starl_trace_merge:format_error(Reason)]}.

%% How far the clocks can differ, by the stamps of both ends of each packet.
clocks({ok, #{robots := [_, _ | _], packets := [_ | _]} = Recording}, Out) ->
    clocks_within(within(Recording, ?DRIFT_PPM), within(Recording, ?CORRECTED_PPM), Out);
clocks(_NoneOrOne, _Out) ->
    "".

within(Recording, Ppm) ->
    fun() ->
        case starl_debug_envelope:from_packets(Recording, Ppm) of
            {ok, Bounds} -> {ok, starl_debug_clocks:widest(Bounds)};
            {error, _} = Error -> Error
        end
    end.

%% Clocks that no drift explains may have been set meanwhile.
clocks_within(Even, Corrected, Out) ->
    case Even() of
        {ok, Us} ->
            advice(Us, "", Out);
        {error, Line} ->
            case Corrected() of
                {ok, Us} -> advice(Us, io_lib:format(" --drift ~b", [?CORRECTED_PPM]), Out);
                {error, _} -> ["clocks: ", Line, "\n"]
            end
    end.

advice(Us, _Drift, _Out) when Us >= ?UNKNOWN_US ->
    "";
advice(Us, Drift, Out) ->
    io_lib:format(
        "clocks: by the packets any two differ by ~.1f ms at most; ./starl judge ~ts --sigma ~bms~ts\n",
        [Us / 1000, Out, Us div 1000 + 1, Drift]
    ).

lacking(Robot) when is_integer(Robot) ->
    io_lib:format("an earlier recording of robot ~b is missing\n", [Robot]);
lacking(Name) ->
    [Name, " is missing\n"].

missing([]) -> "";
missing([Robot]) -> ["the recording of robot ", Robot, " is missing\n"];
missing(Robots) -> ["the recordings of robots ", lists:join(", ", Robots), " are missing\n"].
