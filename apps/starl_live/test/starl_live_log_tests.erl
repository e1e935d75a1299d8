-module(starl_live_log_tests).
-include_lib("eunit/include/eunit.hrl").

%% What a supervisor says of the end of a child, or of its own, becomes this.
again_test_() ->
    Unwritable = <<"robot-2: no space left on device">>,
    [
        ?_assertEqual({Told, Expected}, {Told, said(starl_live_log:again(event(Told), []))})
     || {Told, Expected} <- [
            {
                {{pid, starl_live_robot}, child_terminated, {shutdown, {store, Unwritable}}},
                #{what => store_unwritable, why => Unwritable}
            },
            {
                {{pid, starl_live_robot}, child_terminated, {shutdown, outlived}},
                #{what => robot_starts_anew, why => outlived}
            },
            {
                {{pid, starl_live_robot}, start_error, {shutdown, {transport, <<"in use">>}}},
                #{what => robot_starts_anew, why => {transport, <<"in use">>}}
            },
            {
                {{pid, starl_robot_sup}, child_terminated, killed},
                #{what => machine_ended, machine => dpp, why => killed}
            },
            {
                {{pid, starl_live_robot}, shutdown, reached_max_restart_intensity},
                #{what => node_ends, why => reached_max_restart_intensity}
            },
            {{{local, starl_live_sup}, child_terminated, shutdown}, stop},
            {{{local, starl_live_sup}, shutdown, reached_max_restart_intensity}, stop},
            %% a crash is another matter
            {{{pid, starl_live_robot}, child_terminated, {badmatch, 1}}, ignore},
            {{{local, starl_live_sup}, child_terminated, {badmatch, 1}}, ignore},
            {{{local, another}, child_terminated, shutdown}, ignore}
        ]
    ].

event({Supervisor, What, Reason}) ->
    Report = [
        {supervisor, Supervisor},
        {errorContext, What},
        {reason, Reason},
        {offender, [{pid, pid}, {id, dpp}]}
    ],
    #{
        level => error,
        meta => #{report_cb => fun supervisor:format_log/2},
        msg => {report, #{label => {supervisor, What}, report => Report}}
    }.

said(#{msg := {report, #{what := _} = Report}}) -> Report;
said(Other) -> Other.

%% ... which is a line for people, however it ended.
words_test_() ->
    Ends = [
        {store, <<"robot-2: no space left on device">>},
        outlived,
        gave_up,
        {transport, <<"in use">>},
        {anything, 'else'}
    ],
    Events =
        [event({{pid, starl_live_robot}, child_terminated, {shutdown, End}}) || End <- Ends] ++
            [
                event({{pid, starl_robot_sup}, child_terminated, killed}),
                event({{pid, starl_live_robot}, shutdown, reached_max_restart_intensity})
            ],
    Lines = [line(starl_live_log:again(Event, [])) || Event <- Events],
    [
        ?_assertEqual([], [Line || Line <- Lines, string:find(Line, "what:") =/= nomatch]),
        ?_assertEqual(
            "its store cannot be written: robot-2: no space left on device; it starts anew",
            hd(Lines)
        )
    ].

line(Event) ->
    lists:flatten(logger_formatter:format(Event, #{single_line => true, template => [msg]})).
