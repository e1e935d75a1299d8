%% Painting with an insider, for tests: one robot with the key of the fleet says things in its own name, once, and
%% paints on. The option `attack' is who does it, when (ms after its start), and what it sends: a function from its
%% number and the team to lists of `{To, Type, Body}', one list after the other, each sent as a message of SAP.
-module(starl_dpp_insider).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([init/2, step/2]).
-export([options/0, scene/1, report/2]).
-export([largest/2, random/3, most/0]).

-define(PAINTING, starl_painting).
%% From one list of messages to the next.
-define(APART_MS, 50).
%% The largest numbers that the shapes of messages have room for.
-define(MOST, (1 bsl 58 - 1)).
-define(MOST_SERIAL, (1 bsl 128 - 1)).

init(Robot, {Program, Argument, {Insider, AtMs, Packets}}) ->
    Attack =
        case {starl:id(Robot), starl:stored(Robot)} of
            {Insider, none} -> {starl:now(Robot) + AtMs, Packets};
            _ -> none
        end,
    {Program, Program:init(Robot, Argument), Attack}.

step(Robot, {Program, Painting, {At, Packets} = Attack}) ->
    case starl:now(Robot) >= At of
        true ->
            ok = starl:store(Robot, has_attacked),
            Waves = Packets(starl:id(Robot), starl:participants(Robot)),
            lists:foreach(fun(Wave) -> say(Robot, Wave) end, Waves),
            {continue, {Program, Painting, none}};
        false ->
            painted(Program, Program:step(Robot, Painting), Attack)
    end;
step(Robot, {Program, Painting, none}) ->
    painted(Program, Program:step(Robot, Painting), none).

say(Robot, Wave) ->
    starl_app_proc:perform([{cast, sap, {send, To, Type, Body}} || {To, Type, Body} <- Wave]),
    starl:sleep(Robot, ?APART_MS).

painted(Program, {continue, Painting}, Attack) -> {continue, {Program, Painting, Attack}};
painted(_Program, {done, Result}, _Attack) -> {done, Result}.

options() ->
    [
        {attack, {term, "{Robot, Ms, Fun}", fun is_tuple/1}, {0, 0, fun(_, _) -> [] end}, ""},
        {stored, {term, "the term in a robot's store at first", fun is_function/1},
            fun(_) -> none end, ""}
        | starl_app:options(?PAINTING)
    ].

scene(#{options := #{attack := Attack, stored := Stored} = Options} = Context) ->
    Given = Context#{options := maps:without([attack, stored], Options)},
    {ok, #{app := {sequential, Program, Argument}, blocks := Blocks} = Scene} =
        starl_scene:make(?PAINTING, Given),
    {ok, Scene#{
        app := {sequential, ?MODULE, {Program, Argument, Attack}},
        blocks := [with_store(Stored, Block) || Block <- Blocks]
    }}.

with_store(Stored, {dpp, starl_dpp_participant, Config}) ->
    {dpp, starl_dpp_attacked, Config#{first => Stored}};
with_store(_Stored, Machine) ->
    Machine.

report(Scene, Outcome) -> starl_scene:report(?PAINTING, Scene, Outcome).

most() -> ?MOST_SERIAL.

%% Messages with the largest numbers that are taken for messages, by their types; the term is the sender's own, or one
%% in the name of another robot.
largest(Sender, Team) ->
    Terms = [{?MOST_SERIAL, Of, ?MOST} || Of <- [Sender, hd(Team -- [Sender]), ?MOST]],
    All = lists:append([bodies(Term, Id, Team) || Term <- Terms, Id <- ids()]),
    lists:usort([{Type, Body} || {Type, Body} <- All, starl_dpp_message:accepts(Type, Body)]).

ids() -> [{?MOST, ?MOST}, {?MOST, ?MOST_SERIAL}].

bodies(Term, Id, Team) ->
    At = {1000.0, 1000.0},
    Way = [{At, up}],
    Ballots = [{Seq, Seq, true} || Seq <- [?MOST, -?MOST]],
    [{dpp_beat, {Term, Seq, [{R, ?MOST} || R <- Team]}} || Seq <- [?MOST, -?MOST]] ++
        [{dpp_recover, {Term, Seq, Leads}} || Seq <- [?MOST, -?MOST], Leads <- [true, false]] ++
        [{dpp_here, {Term, Ballot}} || Ballot <- Ballots] ++
        [
            {dpp_state, {Term, Id, Place, [], Ballot}}
         || Place <- [{standing, At}, {moving, ?MOST, At, Way}], Ballot <- Ballots
        ] ++
        [{dpp_request, {Term, Id, At, [], Stamp}} || Stamp <- [?MOST, -?MOST]] ++
        [{dpp_answer, {Term, Id, A, []}} || A <- [{above, Id}, {assign, At, Way}, again]] ++
        [
            {dpp_passed, {Term, Id, ?MOST}},
            {dpp_refused, Term},
            {dpp_prevoted, Term},
            {dpp_prevote, ?MOST_SERIAL}
        ].

%% A message to a robot with small, guessed, believed, far and largest numbers; the draws are those of `rand'.
random(To, Sender, Team) ->
    Term = {number(), pick([Sender, Sender, Sender, pick(Team), ?MOST]), pick([1, ?MOST])},
    Id = {pick([1, 2, ?MOST]), pick([1, 5, number()])},
    {Type, Body} = pick([
        {dpp_beat, {Term, pick([1, 1000000, ?MOST]), [{R, pick([1, ?MOST])} || R <- Team]}},
        {dpp_recover, {Term, 1, pick([true, false])}},
        {dpp_refused, pick([Term, {doubted, Term}])},
        {dpp_prevoted, Term},
        {dpp_prevote, number()},
        {dpp_here, {Term, {1, 1, true}}},
        {dpp_passed, {Term, Id, pick([1, ?MOST])}},
        {dpp_answer, {Term, Id, pick([again, {above, Id}]), []}}
    ]),
    {To, Type, Body}.

number() ->
    Guesses = 1 bsl 90,
    Stepped = Guesses + (rand:uniform(40) bsl 32),
    pick([0, 1, 2, 7, 1 bsl 62, Guesses - 1, Guesses, Stepped, 1 bsl 91, 1 bsl 127, ?MOST_SERIAL]).

pick(List) -> lists:nth(rand:uniform(length(List)), List).
