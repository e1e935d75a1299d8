%% @doc `./starl view': shows a recording in a browser.
-module(starl_lab_view).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "view",
        synopsis => "show a recording in a browser",
        argument => {required, "RUN", {example, "out/painting-1"}},
        subject => fun subject/2,
        about => [
            "RUN is a recording or the directory of a run that holds one: live runs do, others with "
            "--record. Every run of the simulator can be shown while it is done again, by ./starl "
            "replay RUN --view. Ctrl-C ends the window."
        ],
        flags => fun flags/1,
        run => fun run/1
    }.

flags(_Subject) ->
    [
        {"Flags", [
            Flag
         || Flag <- starl_lab_window:flags(), not lists:member(element(1, Flag), [view, no_wait])
        ]}
    ].

-spec subject(string(), [string()]) ->
    {ok, file:filename(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    Again = [
        "./starl replay ",
        starl_cli_terminal:quoted(Word),
        " --view does the run again, and shows it"
    ],
    starl_cli_out:recording(Word, Again, Args).

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := File, values := Values}) ->
    case starl_trace_reader:start(File) of
        {ok, Cursor} ->
            ok = starl_trace_reader:stop(Cursor),
            show(File, Values);
        {error, Reason} ->
            {error, [starl_trace_reader:format_error(Reason)]}
    end.

show(File, Values) ->
    case starl_lab_window:open(Values) of
        {ok, View} -> shown(starl_view_recording:load(File, starl_view:hub(View)), File);
        {error, _} = Error -> Error
    end.

shown({ok, Ended}, File) ->
    _ =
        Ended =:= closed orelse
            starl_cli_terminal:complain([File, " is not whole; what could be read is shown"]),
    Self = self(),
    starl_cli_signal:on_interrupt(fun() -> Self ! interrupted end),
    receive
        interrupted -> 0
    end;
shown({error, Reason}, _File) ->
    {error, [starl_trace_reader:format_error(Reason)]}.
