%% @doc The first part of `./starl hostile --insider': attacks each block in the simulator. The last robot of a team
%% sends the others the extremes of every message that the block's machines accept ({@link
%% starl_dev_insider_extremes}), while the team uses the block ({@link starl_hostile_insider}).
%% ```
%%     0 s      20 s              60 s            100 s             160 s              220 s
%%     | honest | attack          | quiet         | all robots      | all robots       |
%%     |        |                 |               | restart         | restart again    |
%%              memory            memory   judged            judged             judged
%% '''
%% A robot restarts with its store. In each of the three later parts the last turn is judged: it must
%% succeed at every robot, and all must agree.
-module(starl_dev_insider).

-export([run/2, blocks/0, plan/2, works/5, is_of_interest/1, header/0, format/1, is_borne/1]).
-export([runs/1, kinds/2, understood/1]).

-export_type([row/0, part/0]).

-type part() :: after_attack | after_restart | after_second.

%% One block: `kinds' and `sent' say what was sent, `unsolved' which clauses of `accepts/2' were not
%% understood. `bytes': of the machines of the honest robot that has most, before the attack and at most since.
-type row() :: #{
    block := atom(),
    kinds := non_neg_integer(),
    sent := non_neg_integer(),
    unsolved := [{module(), pos_integer()}],
    works := #{part() => true | {false, term()}},
    crashes := [{starl:robot_id(), atom()}],
    violations := [starl_monitor:violation()],
    bytes := {non_neg_integer(), non_neg_integer()},
    ended := ok | {too_much_memory, AtUs :: integer()}
}.

-type options() :: #{
    robots := pos_integer(),
    seed := integer(),
    %% the first so many; those of these kinds
    messages => pos_integer(),
    only => [{starl_packet:type(), term()}],
    atom() => term()
}.

-define(PERIOD_MS, 20000).
-define(WINDOW_MS, {20000, 55000}).
-define(RESTARTS_MS, [{again, 100000}, {anew, 160000}]).
-define(DOWN_MS, 1000).
-define(END_S, 225).
%% The judged turns, and the end of the time in which a painting robot must have set out for a line.
-define(PARTS, [{after_attack, 4}, {after_restart, 7}, {after_second, 10}]).
%% By so much may the machines of a robot grow, and the VM of the simulation.
-define(MOST_BYTES, 8_000_000).
-define(MOST_VM_BYTES, 3_000_000_000).
%% The time between two looks at the memory.
-define(SAMPLE_S, 5).
-define(EXAMPLES, 4).
-define(FEW, 100).

%% @doc The blocks that have something to be attacked: SAP, and those whose machines take messages.
-spec blocks() -> [atom()].
blocks() -> [sap | [Name || {Name, Block} <- starl_block_catalogue:known(), modules(Block) =/= []]].

%% @doc Attacks a block.
-spec run(atom(), options()) -> row().
run(Block, #{robots := Robots} = Options) ->
    {Kinds, Unsolved, Messages0} = plan(Block, Options),
    Messages = chosen(Messages0, Options),
    Seen = attacked(Block, Messages, Options),
    Honest = lists:seq(1, Robots - 1),
    #{events := Events, violations := Violations, bytes := Bytes, ended := Ended} = Seen,
    #{
        block => Block,
        kinds => Kinds,
        sent => length(Messages),
        unsolved => Unsolved,
        works => maps:from_list([
            {P, works(Block, T, Honest, Events, ?PERIOD_MS)}
         || {P, T} <- ?PARTS
        ]),
        crashes =>
            lists:usort([{R, Machine} || {T, R, Machine, crashed} <- Events, not is_restart(T)]) ++
            [Crash || {_, Why} = Crash <- maps:get(crashes, Seen), Why =/= killed],
        violations => [V || V <- Violations, is_judged(V, Honest)],
        bytes => Bytes,
        ended => Ended
    }.

chosen(Messages, #{messages := Most} = Options) ->
    chosen(lists:sublist(Messages, Most), maps:remove(messages, Options));
chosen(Messages, #{only := Kinds}) ->
    [M || M <- Messages, lists:member(kind(M), Kinds)];
chosen(Messages, _Options) ->
    Messages.

%% A restart ends all machines.
is_restart(Us) ->
    lists:any(
        fun({_, At}) -> Us >= 1000 * At andalso Us =< 1000 * (At + ?DOWN_MS) end, ?RESTARTS_MS
    ).

%% What the insider says of itself is believed, and counts.
is_judged(#{contract := counter, what := exceeds}, _Honest) ->
    false;
is_judged(#{at_us := At, robots := Robots}, Honest) ->
    is_late(At) andalso Robots -- Honest =/= Robots.

%% While lies are told, honest robots may believe them.
is_late(AtUs) -> AtUs > 1000 * (element(2, ?WINDOW_MS) + ?PERIOD_MS).

%% @doc Each block is attacked twice, since a later lie may cover up an earlier one: with few messages, and
%% with all.
-spec runs(options()) -> [options(), ...].
runs(Options) -> [Options#{messages => ?FEW}, Options].

%% @doc The kinds of the messages that a block is sent, for the option `only'.
-spec kinds(atom(), options()) -> [{starl_packet:type(), term()}].
kinds(Block, Options) ->
    {_, _, Messages} = plan(Block, Options),
    lists:usort([kind(Message) || Message <- Messages]).

%% @doc How many kinds of messages, the clauses that nothing was found for, and the messages.
-spec plan(atom(), options()) ->
    {non_neg_integer(), [{module(), pos_integer()}], [starl_hostile_insider:message()]}.
plan(sap, #{robots := Robots, seed := Seed}) ->
    Packets = packets(lists:seq(1, Robots - 1), Robots, rand:seed_s(exsss, Seed)),
    Bodies = [starl_dev_insider_extremes:fixed({app, Name}) || Name <- [word, nobody]],
    {7, [], mixed(Packets, lists:append(Bodies))};
plan(Name, #{robots := Robots, seed := Seed} = Options) ->
    {Kinds, Unsolved} = understood(Name),
    {ok, Block} = starl_block_catalogue:find(Name),
    Modules = modules(Block),
    Accepts = fun(Type, Body) ->
        lists:any(fun(M) -> M:accepts(Type, Body) end, Modules -- [M || {M, 1} <- Unsolved])
    end,
    Messages = starl_dev_insider_extremes:messages(Kinds, #{
        accepts => Accepts,
        insider => Robots,
        victim => 1,
        examples => examples(Name, [Type || {Type, _} <- Kinds], Options),
        seed => Seed
    }),
    {length(Kinds), Unsolved, Messages}.

%% @doc The kinds of messages of a block's machines, and the clauses for which none was found.
-spec understood(atom()) -> {[starl_dev_insider_kinds:kind()], [{module(), pos_integer()}]}.
understood(Name) ->
    {ok, Block} = starl_block_catalogue:find(Name),
    Found = [starl_dev_insider_kinds:of_machine(Module) || Module <- modules(Block)],
    {
        lists:usort(lists:append([Kinds || {Kinds, _} <- Found])),
        lists:append([Unsolved || {_, Unsolved} <- Found])
    }.

modules(Block) ->
    Machines = Block:machines(defaults(Block)),
    [Module || {_, Module, _} <- Machines, starl_dev_insider_kinds:is_listener(Module)].

%% Options that have no default are not asked for by `machines/1' of blocks but dpp.
defaults(Block) ->
    Given = maps:from_list([{Key, Value} || {Key, _, Value, _} <- Block:options()]),
    Given#{robots => [1], segments => [], world => {1, 1}, tube_radius => 1.0}.

%% Packets of SAP itself: each field as large as it can be, and drawn ones.
packets(Others, Insider, Random0) ->
    Most = starl_dev_insider_extremes:largest(fun(N) -> starl_shape:is(count, N) end, 1),
    Fixed = [
        {packet, To, Packet}
     || To <- Others,
        N <- [Most, Most - 1, 1 bsl 20, 1 bsl 40],
        Packet <- [
            starl_packet:hello(Insider, N),
            starl_packet:ack(Insider, N, N, N),
            starl_packet:ack(Insider, 1, 1, N),
            starl_packet:refusal(Insider, 1, N, N),
            starl_packet:ask(Insider, N, {0, N}),
            starl_packet:ask(Insider, N, {N, N}),
            starl_packet:told(Insider, N, N, {N, N}, {N, N}),
            starl_packet:data({Insider, N, 1, 1, #{}, {app, word}, N}),
            starl_packet:data({Insider, 1, N, N, #{To => N}, {app, word}, N})
        ]
    ],
    {Drawn, _} = lists:mapfoldl(
        fun(N, Random) ->
            To = lists:nth(1 + N rem length(Others), Others),
            {Packet, Next} = starl_dev_hostile_absurd:packet(Insider, To, Random),
            {{packet, To, Packet}, Next}
        end,
        Random0,
        lists:seq(1, 300)
    ),
    Fixed ++ Drawn.

mixed([A | As], [B | Bs]) -> [A, B | mixed(As, Bs)];
mixed(As, Bs) -> As ++ Bs.

%% -- the run --------------------------------------------------------------------------------

%% Messages of these types that a robot has got in the honest beginning, the latest of each kind.
examples(Block, Types, #{seed := Seed} = Options) ->
    Record = #{record => #{1 => {1, 1 bsl 40}}},
    {ok, Sim} = starl_sim:start((scenario(Block, [], Options))#{seed => Seed}, Record),
    _ = starl_sim:run(Sim, element(1, ?WINDOW_MS) div 1000),
    Messages = lists:append([message(Event) || Event <- starl_sim:events(Sim, 1)]),
    ok = starl_sim:close(Sim),
    Of = [Message || {Type, _} = Message <- lists:reverse(Messages), lists:member(Type, Types)],
    Kinds = lists:usort([kind(Message) || Message <- Of]),
    lists:append([
        lists:sublist([M || M <- Of, kind(M) =:= Kind], ?EXAMPLES)
     || Kind <- Kinds
    ]).

message(#{type := packet, content := {starl, _, data, {_, _, _, _, _, Type, Body}}}) ->
    [{Type, Body}];
message(#{type := packet, content := {starl, _, shout, _, Type, Body}}) ->
    [{Type, Body}];
message(_Event) ->
    [].

kind({packet, _, Packet}) -> {packet, element(3, Packet)};
kind({Type, Body}) when is_tuple(Body), is_atom(element(1, Body)) -> {Type, element(1, Body)};
kind({Type, _Body}) -> {Type, body}.

scenario(Block, Messages, #{robots := Robots, seed := Seed}) ->
    Picture = filename:join([code:priv_dir(starl_apps), "pictures", "hatch.svg"]),
    Common = #{
        app => starl_hostile_insider,
        blocks => [Block],
        messages => Messages,
        insider => Robots,
        window => ?WINDOW_MS,
        period => ?PERIOD_MS,
        robots => Robots,
        seed => Seed,
        time => ?END_S,
        mode => inline,
        clock_offset => 0,
        clock_drift => 0,
        faults => [
            {name(Id, R), At, At + ?DOWN_MS, reboot, R, #{}}
         || {Id, At} <- ?RESTARTS_MS, R <- lists:seq(1, Robots)
        ]
    },
    case Block of
        dpp -> Common#{picture => Picture};
        _ -> Common
    end.

%% Two for each robot of a small team.
name(Id, Robot) -> list_to_atom(atom_to_list(Id) ++ integer_to_list(Robot)).

attacked(Block, Messages, Options) ->
    Self = self(),
    Observe = fun
        ({judged, Events, Violations}) ->
            Self ! {judged, Events, Violations},
            ok;
        (_News) ->
            ok
    end,
    Scenario = scenario(Block, Messages, Options),
    {ok, {Full, Scene, #{monitors := Monitors} = Plan}} =
        starl_sim:plan(Scenario, #{observe => Observe}),
    {ok, Sim} = starl_sim:launch({Full, Scene, Plan#{monitors := []}}),
    Honest = lists:seq(1, maps:get(robots, Options) - 1),
    {From, To} = ?WINDOW_MS,
    _ = to(0, From div 1000, Sim),
    Before = bytes(Honest, Sim),
    {Ended1, Later} = filled(From div 1000, (To + ?PERIOD_MS) div 1000, Before, Honest, Sim),
    Ended = going_on(Ended1, (To + ?PERIOD_MS) div 1000, ?END_S, Sim),
    Crashes = closed(Sim),
    News = news(),
    Events = lists:append([Events || {Events, _} <- News]),
    #{
        events => [Event || Event <- Events, is_of_interest(Event)],
        violations => lists:append([Violations || {_, Violations} <- News]) ++
            judged(Events, starl_monitor:guarded(Monitors)),
        bytes => {Before, Later},
        crashes => Crashes,
        ended => Ended
    }.

%% The last crashes of each machine, and why.
closed(Sim) ->
    Robots = starl_sim:robots(Sim),
    ok = starl_sim:close(Sim),
    lists:usort([{M, why(Why)} || {_, #{crashes := Crashes}} <- Robots, {M, Why} <- Crashes]).

%% Without the places in the code.
why({crashed_after, _Us, Why}) -> why(Why);
why({Why, [{_, _, _, _} | _]}) -> Why;
why(Why) -> Why.

going_on(ok, From, To, Sim) -> to(From, To, Sim);
going_on(Ended, _From, _To, _Sim) -> Ended.

%% The most of the time: a machine that crashes is empty again.
filled(To, To, Most, _Honest, _Sim) ->
    {ok, Most};
filled(Now, To, Most, Honest, Sim) ->
    Next = min(To, Now + ?SAMPLE_S),
    case to(Now, Next, Sim) of
        ok -> filled(Next, To, max(Most, bytes(Honest, Sim)), Honest, Sim);
        Ended -> {Ended, max(Most, bytes(Honest, Sim))}
    end.

%% Second by second: nobody knows how much an attack fills.
to(To, To, _Sim) ->
    ok;
to(Now, To, Sim) ->
    _ = starl_sim:run(Sim, Now + 1),
    case erlang:memory(total) =< ?MOST_VM_BYTES of
        true -> to(Now + 1, To, Sim);
        false -> {too_much_memory, 1000000 * (Now + 1)}
    end.

news() ->
    receive
        {judged, Events, Violations} -> [{Events, Violations} | news()]
    after 0 -> []
    end.

%% The contracts judge afterwards, since a violation would end the run.
judged([], _Runner) ->
    [];
judged([Event | Events], Runner) ->
    case starl_monitor:step(Event, Runner) of
        {ok, Next} -> judged(Events, Next);
        {violation, Violation, Next} -> [Violation | judged(Events, Next)]
    end.

%% @doc Uses of blocks, lines to be painted, crashes.
-spec is_of_interest(starl_monitor:trace_event()) -> boolean().
is_of_interest({_, _, app, {used, _, _, _}}) -> true;
is_of_interest({_, _, app, {stroke, _}}) -> true;
is_of_interest({_, _, _, crashed}) -> true;
is_of_interest(_) -> false.

bytes(Robots, Sim) ->
    lists:max([
        8 *
            lists:sum([
                erts_debug:flat_size(Data)
             || #{data := Data} <- maps:values(machines(R, Sim))
            ])
     || R <- Robots
    ]).

machines(Robot, Sim) ->
    case starl_sim:inspect(Sim, Robot) of
        #{} = Machines -> Machines;
        _ -> #{}
    end.

%% -- judging --------------------------------------------------------------------------------

%% @doc Has a turn of a block succeeded at these robots, and do all agree? Painting robots have set out
%% for a line in the period of the turn, or the one before.
-spec works(atom(), Turn, [starl:robot_id()], [starl_monitor:trace_event()], PeriodMs) ->
    true | {false, term()}
when
    Turn :: pos_integer(), PeriodMs :: pos_integer().
works(dpp, Turn, _Honest, Events, Period) ->
    To = 1000 * Period * (Turn + 1),
    From = To - 2 * 1000 * Period,
    case [R || {T, R, app, {stroke, _}} <- Events, T >= From, T < To] of
        [] -> {false, nobody_paints};
        [_ | _] -> true
    end;
works(Block, Turn, Honest, Events, _Period) ->
    Used = turns(Block, Events),
    Outcomes = [{R, maps:get({R, Turn}, Used, missing)} || R <- Honest],
    Wrong = [Outcome || {_, Is} = Outcome <- Outcomes, Is =/= ok, not is_answer(Is)],
    case {Wrong, lists:usort([Is || {_, Is} <- Outcomes])} of
        {[], [_]} -> true;
        {[], Different} -> {false, {different, Different}};
        {_, _} -> {false, Wrong}
    end.

is_answer({ok, _}) -> true;
is_answer(_) -> false.

%% The outcome of each turn at each robot.
turns(Block, Events) ->
    maps:from_list([{{R, T}, Is} || {_, R, app, {used, B, T, Is}} <- Events, B =:= Block]).

%% @doc Did the team bear it?
-spec is_borne(row()) -> boolean().
is_borne(#{works := Works, bytes := {Before, Later}} = Row) ->
    #{unsolved := Unsolved, crashes := Crashes, violations := Violations, ended := Ended} = Row,
    Unsolved =:= [] andalso Crashes =:= [] andalso Violations =:= [] andalso Ended =:= ok andalso
        Later - Before =< ?MOST_BYTES andalso
        lists:all(fun(Is) -> Is =:= true end, maps:values(Works)).

%% @doc The heads of the columns.
-spec header() -> unicode:chardata().
header() ->
    "                              works after          MB of a robot\n"
    "block      kinds messages  attack    restart   another   before   at most\n".

%% @doc A row as text.
-spec format(row()) -> unicode:chardata().
format(
    #{block := Block, kinds := Kinds, sent := Sent, works := Works, bytes := {Before, Later}} = Row
) ->
    io_lib:format(
        "~-10ts ~5b ~7b  ~-9ts ~-9ts ~-9ts ~8.1f ~8.1f  ~ts~n",
        [
            Block, Kinds, Sent
        ] ++ [yes(maps:get(Part, Works)) || {Part, _} <- ?PARTS] ++
            [Before / 1.0e6, Later / 1.0e6, notes(Row)]
    ).

yes(true) -> "yes";
yes(_) -> "NO".

notes(#{works := Works, crashes := Crashes, violations := Violations} = Row) ->
    #{unsolved := Unsolved, ended := Ended} = Row,
    Terms =
        [{Part, Why} || {Part, {false, Why}} <- lists:sort(maps:to_list(Works))] ++
            [{crashed, Crashes} || Crashes =/= []] ++
            [{not_understood, Unsolved} || Unsolved =/= []] ++ [Ended || Ended =/= ok],
    lists:join(
        "; ",
        [io_lib:format("~0tP", [Term, 40]) || Term <- Terms] ++
            [starl_violation:format(V) || V <- lists:sublist(Violations, 3)]
    ).
