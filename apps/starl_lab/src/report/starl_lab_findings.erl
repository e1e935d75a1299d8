%% @doc Collects what is noteworthy about a run without being a violation, and the robots' results.
%% It covers reloads, messages that nobody receives, the least distance of two robots, and robots
%% that left the floor. It gives them as figures of the report, and as text.
-module(starl_lab_findings).

-export([watch/1, watch_live/1, make/3, figures/1, lines/1, results/1, rolled_back/1]).

-export_type([t/0]).

-record(notes, {
    reloads :: [starl_reload_monitor:reload()],
    strangers :: [starl_run_mail_monitor:stranger()],
    unheard :: [starl_run_mail_monitor:unheard()],
    overloads :: [starl_run_mail_monitor:overload()],
    refused :: [starl_run_mail_monitor:refused()],
    kept :: [starl_mutex_waits:kept()],
    circles :: [starl_mutex_waits:circle()],
    missed :: [map()],
    %% what path planning has given up
    left :: starl_dpp_monitor:left() | none,
    %% the application's own modules, for the lines that send
    beams :: [beam()],
    %% without a contract of distances
    ways :: {starl_lab_ways:least(), [starl_lab_ways:off()]} | none,
    cut :: none | integer(),
    results :: [{starl:robot_id(), term()}]
}).

-opaque t() :: #notes{}.

-type beam() :: binary() | file:filename().

%% The distance of the centres of two touching Creates, mm.
-define(CONTACT_MM, 330).
%% The number of robots that a line names.
-define(NAMED, 5).
%% The length of a result in the report; the whole is in results.term.
-define(DEPTH, 30).

%% @doc The monitors that look on.
-spec watch(starl_run_scenario:t()) -> [{module(), map()}].
watch(#{robots := Team, reloads := Reloads}) ->
    [
        starl_lab_ways:watch(),
        starl_lab_measures:watch(),
        {starl_run_drawings_monitor, #{}},
        {starl_run_mail_monitor, #{robots => Team}},
        {starl_mutex_waits, #{}}
    ] ++
        [{starl_reload_monitor, #{}} || Reloads =/= []].

%% @doc The same for a live run, whose code may be reloaded at any time.
-spec watch_live(starl_run_scenario:t()) -> [{module(), map()}].
watch_live(Scenario) -> watch(Scenario) ++ [{starl_reload_monitor, #{}}].

%% @doc The notes on a run of an application with these modules. Path planning has its own contract
%% of distances, and its report shows them.
-spec make(starl_sim_run:outcome(), starl_lab_ways:t(), [beam()]) -> t().
make(#{monitors := Monitors, robots := Robots}, Ways, Beams) ->
    #{starl_run_mail_monitor := #{strangers := Strangers, unheard := Unheard} = Mail} = Monitors,
    Gone = [Id || {Id, #{result := Result}} <- Robots, Result =:= died orelse Result =:= given_up],
    #{kept := Kept, circles := Circles} =
        maps:get(starl_mutex_waits, Monitors, #{kept => [], circles => []}),
    #{reloads := Reloads} = maps:get(starl_reload_monitor, Monitors, #{reloads => []}),
    #notes{
        reloads = Reloads,
        strangers = Strangers,
        unheard = [One || #{robot := Id} = One <- Unheard, not lists:member(Id, Gone)],
        overloads = maps:get(overloads, Mail),
        refused = maps:get(refused, Mail),
        kept = Kept,
        circles = Circles,
        missed = maps:get(missed, maps:get(starl_barrier_monitor, Monitors, #{}), []),
        left = maps:get(left, maps:get(starl_dpp_monitor, Monitors, #{}), none),
        beams = Beams,
        ways = ways(is_map_key(starl_dpp_monitor, Monitors), Ways),
        cut = cut(starl_lab_ways:is_whole(Ways), Ways),
        results = [{Id, Result} || {Id, #{result := Result}} <- Robots]
    }.

ways(true, _Ways) -> none;
ways(false, Ways) -> {starl_lab_ways:least(Ways), starl_lab_ways:off_floor(Ways)}.

cut(true, _Ways) -> none;
cut(false, Ways) -> starl_lab_ways:until_us(Ways).

%% -- figures --------------------------------------------------------------------------------

%% @doc The notes as figures of the report.
-spec figures(t()) -> [{atom(), starl_json:value()}].
figures(#notes{results = Results, reloads = Reloads} = Notes) ->
    [{reloads, [reload(Reload) || Reload <- Reloads]} || Reloads =/= []] ++
        far(Notes) ++
        tokens(Notes) ++
        left(Notes) ++
        [
            {messages_to_nobody, [stranger(S) || S <- Notes#notes.strangers]},
            {messages_unheard, [unheard(U) || U <- Notes#notes.unheard]},
            {messages_not_sent, [not_sent(O) || O <- Notes#notes.overloads]},
            {messages_refused, [unheard(R) || R <- Notes#notes.refused]},
            {results, [[{robot, Id} | result(Result)] || {Id, Result} <- Results]}
        ].

reload(#{number := N, machines := Machines, taken := Taken, back := Back} = Reload) ->
    [
        {number, N},
        {machines, [atom_to_binary(Name) || Name <- Machines]},
        {taken, Taken},
        {back, Back},
        {text, unicode:characters_to_binary(starl_reload_monitor:format(Reload))}
    ].

far(#notes{ways = none}) ->
    [];
far(#notes{ways = {Least, Off}}) ->
    least(Least) ++
        [{off_floor, [[{robot, Id}, {at_s, At / 1.0e6}, {mm, tenth(Mm)}] || {Id, At, Mm} <- Off]}].

least(none) -> [{least_distance_mm, null}];
least({Mm, _, _}) -> [{least_distance_mm, tenth(Mm)}].

%% Only of applications that have come to this.
tokens(#notes{kept = Kept, circles = Circles}) ->
    [{tokens_kept, [kept(One) || One <- Kept]} || Kept =/= []] ++
        [{tokens_in_circle, [circle(One) || One <- Circles]} || Circles =/= []].

left(#notes{left = none}) ->
    [];
left(#notes{left = #{edges := Edges, in_the_way := Robots, cut_off := CutOff}}) ->
    [
        {edges_given_up, Edges},
        {edges_cut_off, CutOff},
        {in_the_way, [
            [{robot, Robot}, {silent_s, Since / 1.0e6}, {edges, N}]
         || {Robot, Since, N} <- Robots
        ]}
    ].

kept(#{robot := Robot, token := Token, asked := Asked}) ->
    [{robot, Robot}, {token, binary(Token)}, {asked, Asked}].

circle(#{at_us := At, waits := Waits}) ->
    [
        {at_s, At / 1.0e6},
        {waits, [[{robot, Robot}, {holds, binary(Token)}] || {Robot, Token} <- Waits]}
    ].

binary(Token) -> unicode:characters_to_binary(token(Token)).

token(Token) -> io_lib:format("~0tP", [Token, ?DEPTH]).

%% A distance must not look greater than it is.
tenth(Mm) -> floor(Mm * 10) / 10.

stranger(#{from := From, to := To} = One) -> [{from, From}, {to, To} | mail(One)].

unheard(#{robot := Robot, from := From} = One) -> [{robot, Robot}, {from, From} | mail(One)].

not_sent(#{robot := Robot} = One) -> [{robot, Robot} | mail(One)].

mail(#{type := Type, at_us := At, count := Count}) ->
    [{type, atom_to_binary(Type)}, {at_s, At / 1.0e6}, {count, Count}].

result({done, Result}) ->
    Text = io_lib:format("~0tP", [Result, ?DEPTH]),
    [{ended, <<"done">>}, {result, unicode:characters_to_binary(Text)}];
result(Other) ->
    [{ended, atom_to_binary(Other)}].

%% @doc The file of results: a term per robot, `{Robot, {done, Result}}'.
-spec results(t()) -> unicode:chardata().
results(#notes{results = Results} = Notes) ->
    ["%% The result of each robot: {Robot, {done, Result} | running | died | given_up}.\n"] ++
        [["%% ", Line, "\n"] || Line <- reloads(Notes)] ++
        [io_lib:format("~tp.\n", [Result]) || Result <- Results].

%% @doc The numbers of the reloads that were rolled back.
-spec rolled_back(t()) -> [starl_reload:count()].
rolled_back(#notes{reloads = Reloads}) ->
    [N || #{number := N} = Reload <- Reloads, starl_reload_monitor:is_back(Reload)].

%% -- in words -------------------------------------------------------------------------------

%% @doc The notes in words, a line each; the first ones concern reloads and distances.
-spec lines(t()) -> [unicode:chardata()].
lines(#notes{strangers = Strangers, unheard = Unheard} = Notes) ->
    reloads(Notes) ++ distance(Notes) ++ floor_of(Notes) ++ to_nobody(Strangers) ++ by_type(Unheard) ++
        overload(Notes) ++ refused(Notes) ++ ended_with(Notes) ++ in_circles(Notes) ++
        not_come(Notes) ++ given_up(Notes) ++ cut(Notes).

reloads(#notes{reloads = Reloads}) -> [starl_reload_monitor:format(R) || R <- Reloads].

distance(#notes{ways = {{Mm, At, {A, B}}, _}}) when Mm < ?CONTACT_MM ->
    Shown = [A, B, tenth(Mm), ?CONTACT_MM, At / 1.0e6],
    [
        io_lib:format(
            "robots ~b and ~b came within ~.1f mm (centres; Creates touch at ~b), at ~.3f s", Shown
        )
    ];
distance(#notes{ways = {{Mm, At, {A, B}}, _}}) ->
    Shown = [tenth(Mm), A, B, At / 1.0e6],
    [io_lib:format("the closest two robots: ~.1f mm (robots ~b and ~b, at ~.3f s)", Shown)];
distance(_) ->
    [].

floor_of(#notes{ways = {_, [_ | _] = Off}}) ->
    [{Id, At, _} | Later] = Off,
    {Mm, Far} = lists:max([{Most, Robot} || {Robot, _, Most} <- Off]),
    First = io_lib:format("robot ~b left the floor at ~.3f s", [Id, At / 1.0e6]),
    Others = [[", later ", robots([Robot || {Robot, _, _} <- Later])] || Later =/= []],
    [[First, Others, io_lib:format("; robot ~b by ~.1f mm", [Far, Mm])]];
floor_of(_) ->
    [].

%% A message to a robot that is not there is one line, whoever sends it.
to_nobody(Strangers) ->
    Keys = lists:usort([{To, Type} || #{to := To, type := Type} <- Strangers]),
    [
        nowhere(Key, [One || #{to := To, type := Type} = One <- Strangers, {To, Type} =:= Key])
     || Key <- Keys
    ].

nowhere({To, Type}, All) ->
    {At, From} = first(All),
    io_lib:format("there is no robot ~b: ~ts of type ~tp, first by robot ~b at ~.3f s", [
        To, messages(All), Type, From, At / 1.0e6
    ]).

%% A broadcast that nobody listens to is one line, too.
by_type(Unheard) ->
    Types = lists:usort([Type || #{type := Type} <- Unheard]),
    [nobody(Type, [One || #{type := Of} = One <- Unheard, Of =:= Type]) || Type <- Types].

nobody(Type, All) ->
    {At, From} = first(All),
    io_lib:format("~ts ~ts not listen to ~tp: ~ts, first by robot ~b at ~.3f s", [
        robots([Id || #{robot := Id} <- All]), do(All), Type, messages(All), From, At / 1.0e6
    ]).

%% Posts that were dropped tell nobody else.
overload(#notes{overloads = Overloads, beams = Beams}) ->
    [
        not_sent(Type, [One || #{type := Of} = One <- Overloads, Of =:= Type], Beams)
     || Type <- lists:usort([Type || #{type := Type} <- Overloads])
    ].

not_sent(Type, All, Beams) ->
    At = lists:min([At || #{at_us := At} <- All]),
    io_lib:format(
        "~ts did not send ~ts of type ~tp, too many were under way, first at ~.3f s~ts", [
            robots([Id || #{robot := Id} <- All]),
            messages(All),
            Type,
            At / 1.0e6,
            sent_at(Type, Beams)
        ]
    ).

refused(#notes{refused = Refused, beams = Beams}) ->
    [
        full(Type, [One || #{type := Of} = One <- Refused, Of =:= Type], Beams)
     || Type <- lists:usort([Type || #{type := Type} <- Refused])
    ].

full(Type, All, Beams) ->
    {At, From} = first(All),
    io_lib:format(
        "~ts had ended, with a full inbox: messages of type ~tp are lost after their last try, first "
        "by robot ~b at ~.3f s~ts",
        [robots([Id || #{robot := Id} <- All]), Type, From, At / 1.0e6, sent_at(Type, Beams)]
    ).

ended_with(#notes{kept = Kept}) ->
    [
        [
            keeps(One),
            [[": ", robots(Asked), " asked for it in vain"] || Asked =/= []]
        ]
     || #{asked := Asked} = One <- lists:sublist(Kept, ?NAMED)
    ].

keeps(#{robot := Robot, token := Token, since_us := Since}) ->
    io_lib:format("robot ~b has held token ~ts since ~.3f s", [Robot, token(Token), Since / 1.0e6]);
keeps(#{robot := Robot, token := Token}) ->
    io_lib:format("robot ~b ended with token ~ts, and keeps it", [Robot, token(Token)]).

%% Rounds of a barrier that some have waited for in vain.
not_come(#notes{missed = Missed}) ->
    [
        io_lib:format("~ts has not come to round ~b of barrier ~ts: ~ts waited for it in vain", [
            robots(Absent), Round, token(Name), robots(Waited)
        ])
     || #{name := Name, round := Round, absent := Absent, waited := Waited} <- lists:sublist(
            Missed, ?NAMED
        )
    ].

%% Lines that nobody can paint, with those who stand in the way.
given_up(#notes{left = none}) ->
    [];
given_up(#notes{left = #{edges := Edges, in_the_way := Robots, cut_off := CutOff}}) ->
    {Named, More} = lists:split(min(?NAMED, length(Robots)), Robots),
    Parts =
        [in_the_way(Robot) || Robot <- Named] ++
            [io_lib:format("~b more robots stand in the way", [length(More)]) || More =/= []] ++
            [io_lib:format("all ways to ~ts are closed", [edges(CutOff)]) || CutOff > 0],
    [["gave up ", edges(Edges), ": ", lists:join("; ", Parts)]].

in_the_way({Robot, Since, N}) ->
    io_lib:format("robot ~b, silent since ~.3f s, stands in the way of ~b", [
        Robot, Since / 1.0e6, N
    ]).

edges(1) -> "1 edge";
edges(N) -> io_lib:format("~b edges", [N]).

in_circles(#notes{circles = Circles}) ->
    [in_circle(Circle) || Circle <- lists:sublist(Circles, ?NAMED)].

in_circle(#{at_us := At, waits := [{Robot, Token}]}) ->
    io_lib:format("robot ~b asked for token ~ts, which it holds itself, at ~.3f s", [
        Robot, token(Token), At / 1.0e6
    ]);
in_circle(#{at_us := At, waits := [{_, First} | _] = Waits}) ->
    Asked = [Token || {_, Token} <- tl(Waits)] ++ [First],
    [
        io_lib:format("~ts waited for each other's tokens, at ~.3f s: ", [
            robots([Robot || {Robot, _} <- Waits]), At / 1.0e6
        ]),
        lists:join(", ", [
            io_lib:format("robot ~b held ~ts and asked for ~ts", [Robot, token(Held), token(Asks)])
         || {{Robot, Held}, Asks} <- lists:zip(Waits, Asked)
        ]),
        "; acquire them as one list"
    ].

%% The lines that send this type.
sent_at(Type, Beams) ->
    Calls = lists:append([starl_cli_lint:sends(Type, Beam) || Beam <- Beams]),
    [
        io_lib:format("; ~ts:~b", [filename:basename(File), Line])
     || {File, Line, _} <- lists:sublist(Calls, ?NAMED)
    ].

first(All) -> lists:min([{At, From} || #{at_us := At, from := From} <- All]).

messages(All) ->
    case lists:sum([Count || #{count := Count} <- All]) of
        1 -> "1 message";
        Count -> io_lib:format("~b messages", [Count])
    end.

do([_]) -> "does";
do(_) -> "do".

robots([Id]) ->
    io_lib:format("robot ~b", [Id]);
robots(Ids) when length(Ids) > ?NAMED ->
    {Named, Others} = lists:split(?NAMED, lists:sort(Ids)),
    [listed(Named), io_lib:format(" and ~b more", [length(Others)])];
robots(Ids) ->
    listed(lists:sort(Ids)).

listed(Ids) -> ["robots ", lists:join(", ", [integer_to_list(Id) || Id <- Ids])].

cut(#notes{cut = none}) ->
    [];
cut(#notes{cut = Until}) ->
    [
        io_lib:format("the ways of the robots are known until ~.3f s only: they are too many", [
            Until / 1.0e6
        ])
    ].
