%% @doc The report of a run: its figures in order, as JSON, as a text and as a short summary. The
%% application itself supplies its own figures and decides when its work is complete.
-module(starl_lab_report).

-export([make/1, text/1, json/1, summary/1, figures/1, figure/2, formats/1]).
-export([complete/1, judged/1, ending/1]).

-export_type([t/0, input/0]).

%% `ending' is `time' if the scenario's time limit was reached; `wall_s' excludes the start; `code' is
%% that which has run, where the report is of one run alone.
-type input() :: #{
    name := string(),
    scenario := starl_run_scenario:t(),
    ending := starl_sim_run:ending(),
    wall_s := float(),
    outcome := starl_sim_run:outcome(),
    app := starl_scene:report(),
    code => starl_build:code(),
    notes => starl_lab_findings:t()
}.

-record(report, {
    fields :: [{atom(), starl_json:value()}],
    ending :: starl_sim_run:ending(),
    app :: starl_scene:report(),
    running :: [starl:robot_id()],
    died :: [starl:robot_id()],
    %% the robots whose application was given up; the number of application crashes, and of causes
    given_up :: [starl:robot_id()],
    crashes :: {non_neg_integer(), Causes :: non_neg_integer()},
    notes :: [unicode:chardata()],
    rolled_back :: [starl_reload:count()],
    %% the robots that wait, by call and place
    waiting :: [unicode:chardata()]
}).

-opaque t() :: #report{}.

%% Monitors that judge nothing.
-define(LOOKING_ON, [
    starl_run_paths_monitor,
    starl_run_mail_monitor,
    starl_run_measures_monitor,
    starl_run_drawings_monitor,
    starl_lab_first_crash,
    starl_reload_monitor,
    starl_mutex_waits
]).
%% The figures that have lines of their own in the text; the number of notes in the summary.
-define(LISTS, [
    violations,
    not_judged,
    clauses_not_judged,
    results,
    reloads,
    off_floor,
    messages_to_nobody,
    messages_unheard,
    messages_not_sent,
    messages_refused,
    tokens_kept,
    tokens_in_circle,
    in_the_way
]).
-define(NOTES, 6).
%% The places of waiting applications that are shown in the summary.
-define(MOST_WAITS, 5).

%% @doc Makes the report of a run.
-spec make(input()) -> t().
make(#{outcome := Outcome, ending := Ending, app := App} = Input) ->
    #{robots := Robots, monitors := Monitors} = Outcome,
    Seen = maps:get(starl_crash_monitor, Monitors, #{}),
    #report{
        fields = fields(Input),
        ending = Ending,
        %% A function cannot be sent to another VM.
        app = with_measures(Input, maps:remove(write, App)),
        running = [Id || {Id, #{result := running}} <- Robots],
        died = [Id || {Id, #{result := died}} <- Robots],
        given_up = [Id || {Id, #{result := given_up}} <- Robots],
        crashes = {maps:get(crashes, Seen, 0), maps:get(causes, Seen, 0)},
        notes = [Line || #{notes := Notes} <- [Input], Line <- starl_lab_findings:lines(Notes)],
        rolled_back = [
            N
         || #{notes := Notes} <- [Input], N <- starl_lab_findings:rolled_back(Notes)
        ],
        waiting = waiting(Outcome)
    }.

with_measures(#{scenario := Scenario}, App) ->
    Measures = starl_lab_measures:formats(maps:get(app, Scenario, none)),
    App#{formats => maps:merge(Measures, maps:get(formats, App, #{}))}.

%% Where the applications wait that still run at the end.
waiting(#{robots := Robots} = Outcome) ->
    AtWork = [Id || #{hung := {_, Works}} <- [Outcome], {Id, _, _} <- Works],
    Waits = [
        {place_of(starl_lab_phrase:waits(W)), Id}
     || {Id, #{waits := W}} <- Robots, not lists:member(Id, AtWork)
    ],
    Places = lists:usort([Place || {Place, _} <- Waits, Place =/= none]),
    Groups = lists:sort([{[Id || {P, Id} <- Waits, P =:= Place], Place} || Place <- Places]),
    [[starl_lab_phrase:robots(Ids), ": ", Place] || {Ids, Place} <- Groups].

place_of(none) -> none;
place_of(Text) -> unicode:characters_to_binary(Text).

%% The application's figures, and what it has measured beside them.
own(Figures, Measures, Formats) ->
    [
        {Key, rounded(maps:get(Key, Formats, #{}), Value)}
     || {Key, Value} <-
            Figures ++ [M || {K, _} = M <- Measures, not is_map_key(K, maps:from_list(Figures))]
    ].

fields(#{name := Name, scenario := Scenario, app := #{figures := Figures} = App} = Input) ->
    #{outcome := Outcome, wall_s := Wall, ending := Ending} = Input,
    #{end_us := EndUs, monitors := Monitors} = Outcome,
    Measures = starl_lab_measures:figures(maps:get(app, Scenario, none), Monitors),
    Own = own(Figures, Measures, maps:get(formats, App, #{})),
    [
        {app, unicode:characters_to_binary(Name)},
        {seed, maps:get(seed, Scenario)},
        {robots, maps:get(robots, Scenario)},
        {virtual_s, rounded(#{decimals => 6}, EndUs / 1.0e6)},
        {wall_s, rounded(#{}, Wall)}
    ] ++ [{code, list_to_binary(Code)} || #{code := Code} <- [Input]] ++ Own ++
        happened(Outcome) ++ not_judged(Outcome) ++ clauses(Outcome) ++ late_computers(Outcome) ++
        [
            {ending, atom_to_binary(Ending)}
        ] ++ hung(Outcome) ++ crashes(maps:get(starl_crash_monitor, Monitors, #{})) ++
        [Figure || #{notes := Notes} <- [Input], Figure <- starl_lab_findings:figures(Notes)] ++
        [
            {waiting, [unicode:characters_to_binary(W) || W <- Waiting]}
         || Waiting <- [waiting(Outcome)], Waiting =/= []
        ].

happened(#{monitors := Monitors, violations := Violations} = Outcome) ->
    [
        {messages, maps:get(sent, maps:get(starl_sap_monitor, Monitors))},
        {packets, maps:get(packets, Outcome)},
        {events, maps:get(events, Outcome)},
        {digest, hex(maps:get(digest, Outcome))},
        {contracts, contracts(Monitors)},
        {violations, [violation(V) || V <- Violations]}
    ].

%% The contracts by which the run was judged.
contracts(Monitors) ->
    Judging = maps:keys(maps:without(?LOOKING_ON, Monitors)),
    [unicode:characters_to_binary(starl_monitor:name(M)) || M <- lists:sort(Judging)].

%% Only for runs that ended because a robot did not end its step.
hung(#{hung := {Ms, AtWork}}) ->
    [{hung, unicode:characters_to_binary(starl_lab_stall:line(Ms, loop, AtWork))}];
hung(#{}) ->
    [].

%% Only for runs in which applications crashed.
crashes(#{crashes := Count, causes := Causes, first_crash := {_, _, _, _} = Crash}) ->
    First = unicode:characters_to_binary(starl_lab_phrase:crash(Crash)),
    [{application_crashes, Count}, {crash_causes, Causes}, {first_crash, First}];
crashes(#{}) ->
    [].

%% Only for runs of which a part is not judged.
not_judged(#{unjudged := []}) ->
    [];
not_judged(#{unjudged := Parts}) ->
    [{not_judged, [unicode:characters_to_binary(starl_unjudged:format(P)) || P <- Parts]}].

%% Only for runs in which a monitor could not judge one of its clauses.
clauses(#{monitors := Monitors}) ->
    case starl_monitor:clauses_not_judged(Monitors) of
        [] -> [];
        Lines -> [{clauses_not_judged, [unicode:characters_to_binary(Line) || Line <- Lines]}]
    end.

%% Only for runs in real time in which computers were late.
late_computers(#{late_computers := [_ | _] = Late}) ->
    Line = "robot ~b: ~ts, by ~.1f s at most",
    Texts = [io_lib:format(Line, [Id, times(N), Us / 1.0e6]) || {Id, N, Us} <- Late],
    [{late_computers, [unicode:characters_to_binary(Text) || Text <- Texts]}];
late_computers(#{}) ->
    [].

times(1) -> "once";
times(N) -> io_lib:format("~b times", [N]).

violation(#{contract := Contract, what := What, at_us := At, robots := Robots} = Violation) ->
    [
        {contract, atom_to_binary(Contract)},
        {what, atom_to_binary(What)},
        {at_s, At / 1.0e6},
        {robots, Robots},
        {text, unicode:characters_to_binary(starl_violation:format(Violation))}
    ].

rounded(_Format, Value) when not is_float(Value) ->
    whole(Value);
rounded(Format, Value) ->
    Digits = maps:get(decimals, Format, 3),
    case maps:get(rounded, Format, near) of
        near ->
            list_to_float(float_to_list(Value, [{decimals, max(1, Digits)}]));
        down ->
            Scale = math:pow(10, Digits),
            floor(Value * Scale) / Scale
    end.

whole(infinity) -> null;
whole(Value) -> Value.

%% @doc All figures, in their order.
-spec figures(t()) -> [{atom(), starl_json:value()}].
figures(#report{fields = Fields}) -> Fields.

%% @doc One figure of the report.
-spec figure(atom(), t()) -> starl_json:value().
figure(Key, #report{fields = Fields}) -> proplists:get_value(Key, Fields, null).

%% @doc Why the run ended.
-spec ending(t()) -> starl_sim_run:ending().
ending(#report{ending = Ending}) -> Ending.

%% @doc The formats of the application's figures.
-spec formats(t()) -> #{atom() => starl_scene:format()}.
formats(#report{app = App}) -> maps:get(formats, App, #{}).

%% @doc Whether the work is complete: all applications of robots that live have ended, and the application's
%% figures say so. If it has no word in this, none died or was given up either.
-spec complete(t()) -> boolean().
complete(#report{ending = Ending}) when Ending =:= lost; Ending =:= hung ->
    false;
complete(#report{app = #{complete := Complete}, running = Running}) ->
    Complete andalso Running =:= [];
complete(#report{ending = Ending, died = Died, given_up = GivenUp}) ->
    Ending =:= done andalso Died ++ GivenUp =:= [].

%% @doc Whether the whole run is judged by all contracts.
-spec judged(t()) -> boolean().
judged(Report) -> figure(not_judged, Report) =:= null.

%% @doc The report as JSON.
-spec json(t()) -> iolist().
json(#report{fields = Fields}) -> starl_json:pretty(Fields).

%% @doc The report as a text, one line per figure.
-spec text(t()) -> unicode:chardata().
text(#report{fields = Fields, notes = Notes}) ->
    Shown = [
        {Key, Value}
     || {Key, Value} <- Fields, Value =/= null, not lists:member(Key, ?LISTS)
    ],
    Violations = proplists:get_value(violations, Fields),
    [
        [io_lib:format("~-22ts ~ts\n", [Key, plain(Value)]) || {Key, Value} <- Shown],
        io_lib:format("~-22ts ~b\n", [violations, length(Violations)]),
        [["  ", proplists:get_value(text, V), "\n"] || V <- Violations],
        [
            [Part, "\n"]
         || Key <- [not_judged, clauses_not_judged], Part <- proplists:get_value(Key, Fields, [])
        ],
        [["note: ", Note, "\n"] || Note <- Notes]
    ].

plain(Text) when is_binary(Text) -> Text;
plain([Text | _] = Texts) when is_binary(Text) -> lists:join(", ", Texts);
plain(Value) when is_float(Value) -> float_to_list(Value, [{decimals, 9}, compact]);
plain(Value) -> io_lib:format("~0tp", [Value]).

hex(<<>>) -> null;
hex(Bytes) -> string:lowercase(binary:encode_hex(Bytes)).

%% -- summary --------------------------------------------------------------------------------

%% @doc A summary of a few lines; the first line alone says how the run ended.
-spec summary(t()) -> [unicode:chardata(), ...].
summary(Report) ->
    [headline(Report) | [Line || Line <- details(Report), Line =/= none]].

headline(Report) ->
    Robots = figure(robots, Report),
    io_lib:format("~ts: ~ts, ~b robot~ts, ~ts s", [
        figure(app, Report),
        verdict(Report),
        Robots,
        plural(Robots),
        decimals(1, figure(virtual_s, Report))
    ]).

verdict(Report) ->
    case {figure(violations, Report), ending(Report), complete(Report)} of
        {[_ | _], _, _} -> ["A CONTRACT IS VIOLATED", share(", ", Report)];
        {[], stopped, _} -> ["interrupted", share(", ", Report)];
        {[], Ending, IsComplete} -> [ended(Ending, IsComplete, Report), to_the_end(Report)]
    end.

ended(_Ending, true, Report) ->
    ["complete", share(", ", Report), rolled_back(Report)];
ended(Ending, false, #report{app = App} = Report) ->
    case judged(Report) orelse is_short(Ending, Report) of
        true -> [unfinished(Ending, App), share(", ", Report), " (", why(Ending, Report), ")"];
        false -> ["ended", share(", ", Report), " as far as it is judged"]
    end.

%% Robots may still wait when all is done that there was to do.
unfinished(Ending, #{complete := true}) when Ending =:= time; Ending =:= quiet -> "NOT ENDED";
unfinished(_Ending, _App) -> "NOT COMPLETE".

%% All robots have ended their work: what they have done since it was judged last is not known.
is_short(done, #report{died = [], given_up = [], running = []}) -> false;
is_short(_Ending, _Report) -> true.

to_the_end(Report) ->
    case judged(Report) of
        true -> "";
        false -> ", NOT JUDGED TO THE END"
    end.

%% The work was done all the same: by the former code.
rolled_back(#report{rolled_back = []}) ->
    "";
rolled_back(#report{rolled_back = [N]}) ->
    io_lib:format(", RELOAD ~b ROLLED BACK", [N]);
rolled_back(#report{rolled_back = Numbers}) ->
    [", RELOADS ", lists:join(", ", [integer_to_list(N) || N <- Numbers]), " ROLLED BACK"].

share(Before, #report{app = #{done := Done}}) -> [Before, Done];
share(_Before, _Report) -> "".

why(time, Report) ->
    ["the time was up", still("; ", Report)];
why(lost, _Report) ->
    "a node was lost";
why(hung, _Report) ->
    "a step did not end";
why(_, #report{died = [], given_up = [_ | _] = GivenUp} = Report) ->
    [
        "the application crashed for ever on ",
        starl_lab_phrase:robots(GivenUp),
        still("; ", Report)
    ];
why(_, #report{died = [], running = []}) ->
    "no robot could do more";
why(_, #report{died = [], running = _} = Report) ->
    ["nothing happens any more", still("; ", Report)];
why(_, #report{died = Died} = Report) ->
    [starl_lab_phrase:robots(Died), " died", still("; ", Report)].

still(_, #report{running = []}) -> "";
still(Before, #report{running = Ids}) -> [Before, starl_lab_phrase:robots(Ids), " still at work"].

details(#report{app = App} = Report) ->
    Own = [["  ", Line] || Line <- maps:get(summary, App, [])],
    [crashed(Report), stands(Report)] ++ waits(Report) ++ Own ++ noted(Report) ++
        [radio(Report), cost(Report)].

noted(#report{notes = Notes}) when length(Notes) > ?NOTES ->
    {Shown, More} = lists:split(?NOTES, Notes),
    [["  ", Note] || Note <- Shown] ++
        [io_lib:format("  and ~b more notes, in report.txt", [length(More)])];
noted(#report{notes = Notes}) ->
    [["  ", Note] || Note <- Notes].

%% The work of an interrupted run is not waited for.
waits(#report{ending = stopped}) ->
    [];
waits(#report{waiting = Waiting}) ->
    {Shown, More} = lists:split(min(?MOST_WAITS, length(Waiting)), Waiting),
    [["  waits: ", Line] || Line <- Shown] ++
        [io_lib:format("  and ~b other places (report.txt)", [length(More)]) || More =/= []].

%% The first crash was told when it happened.
crashed(#report{crashes = {0, _}}) ->
    none;
crashed(#report{crashes = {1, _}}) ->
    "  the application crashed once, as told above";
crashed(#report{crashes = {Count, 1}}) ->
    io_lib:format("  the application crashed ~b times, each time as told above", [Count]);
crashed(#report{crashes = {Count, Causes}}) ->
    io_lib:format("  the application crashed ~b times, from ~b causes; the first is told above", [
        Count, Causes
    ]).

stands(Report) ->
    case figure(hung, Report) of
        null -> none;
        Line -> ["  ", Line]
    end.

radio(Report) ->
    {Messages, Packets} = {figure(messages, Report), figure(packets, Report)},
    io_lib:format("  ~b messages in ~b packets", [Messages, Packets]).

cost(Report) ->
    {Virtual, Wall} = {figure(virtual_s, Report), figure(wall_s, Report)},
    io_lib:format("  ~b events in ~ts s, ~ts x real time; seed ~b~ts", [
        figure(events, Report),
        decimals(1, Wall),
        decimals(0, Virtual / max(0.001, Wall)),
        figure(seed, Report),
        digest(figure(digest, Report))
    ]).

digest(null) -> "";
digest(Hex) -> [", digest ", Hex].

plural(1) -> "";
plural(_) -> "s".

decimals(N, X) -> float_to_list(float(X), [{decimals, N}]).
