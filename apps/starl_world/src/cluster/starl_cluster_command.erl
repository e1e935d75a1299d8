%% @doc The commands of other terminals to a running cluster: parses them and makes the texts of the
%% answers. A pure module.
-module(starl_cluster_command).

-export([words/1, parse/1, described/2, unheard/1]).

-export_type([t/0]).

-type t() ::
    status
    | stop
    | {heal, starl_run_hand:heal()}
    | {reload, starl_version:source()}
    | {act, [starl_run_hand:t()]}.

%% Each command, and the number of words after the first one.
-define(COMMANDS, [
    {"status", 0},
    {"kill", 1},
    {"pause", 2},
    {"lose-store", 1},
    {"set-back", 1},
    {"cut", 2},
    {"freeze", 1},
    {"fill", 1},
    {"unplug", 1},
    {"sense", 3},
    {"heal", 0},
    {"stop", 0},
    {"reload", 1}
]).

%% @doc The number of words after the first one of a command; `none': it is no command.
-spec words(string()) -> non_neg_integer() | none.
words(Word) -> proplists:get_value(Word, ?COMMANDS, none).

%% @doc The command that these words are.
-spec parse([string()]) -> {ok, t()} | {error, unicode:chardata()}.
parse(["status"]) -> {ok, status};
parse(["stop"]) -> {ok, stop};
parse(["heal"]) -> {ok, {heal, all}};
parse(["reload", What]) -> {ok, {reload, source(What)}};
parse(["pause" | Words]) -> pause(Words);
parse(["sense" | Words]) -> sense(Words);
parse([Word | Robots]) -> act(Word, [string:to_integer(Robot) || Robot <- Robots]);
parse([]) -> {error, "a command expected, as cluster status"}.

pause([Robot, Seconds]) ->
    case {string:to_integer(Robot), number(Seconds)} of
        {{Id, []}, S} when is_integer(Id), is_number(S) ->
            {ok, {act, [{pause, Id, #{}, round(1000 * S)}]}};
        _ ->
            pause([])
    end;
pause(_) ->
    {error, "pause: a robot by its number and seconds, as in pause 3 1.5"}.

sense([Robot, Sense, How]) ->
    Senses = [{atom_to_list(Kind), Kind} || Kind <- [all | [K || {K, _} <- starl_sense:kinds()]]],
    Faults = [{"well", well, #{}} | starl_live_sense_fault:known()],
    case
        {string:to_integer(Robot), lists:keyfind(Sense, 1, Senses), lists:keyfind(How, 1, Faults)}
    of
        {{Id, []}, {_, Of}, {_, well, _}} when is_integer(Id) ->
            {ok, {heal, {sense, Id, Of}}};
        {{Id, []}, {_, Of}, {_, Kind, Params}} when is_integer(Id) ->
            {ok, {act, [{Kind, Id, Params#{sense => Of}, lasting}]}};
        {{Id, []}, false, _} when is_integer(Id) ->
            wrong_sense(["there is no sense ", Sense, "; there are ", words_of(Senses)]);
        {{Id, []}, _, false} when is_integer(Id) ->
            wrong_sense(["a sense can be ", words_of(Faults), ", not ", How]);
        _ ->
            sense([])
    end;
sense(_) ->
    wrong_sense("a robot by its number, a sense, and what it is, as in sense 2 camera frozen").

wrong_sense(Why) -> {error, ["sense: ", Why]}.

words_of(Known) -> lists:join(", ", [element(1, Each) || Each <- Known]).

number(Text) ->
    case {string:to_float(Text), string:to_integer(Text)} of
        {{Float, []}, _} -> Float;
        {_, {Integer, []}} -> Integer;
        _ -> none
    end.

act("kill", [{Robot, []}]) -> {ok, {act, [{reboot, Robot, #{}, 0}]}};
act("lose-store", [{Robot, []}]) -> {ok, {act, [{store_lost, Robot, #{}, 0}]}};
act("set-back", [{Robot, []}]) -> {ok, {act, [{store_set_back, Robot, #{}, 0}]}};
act("freeze", [{Robot, []}]) -> {ok, {act, [{location_frozen, Robot, #{}, lasting}]}};
act("fill", [{Robot, []}]) -> {ok, {act, [{store_full, Robot, #{}, lasting}]}};
act("unplug", [{Robot, []}]) -> {ok, {act, [{serial_gone, Robot, #{}, lasting}]}};
act("cut", [{A, []}, {B, []}]) when A =/= B -> {ok, {act, starl_run_hand:cut(A, B, lasting)}};
act(Word, _) -> {error, [Word, ": robots by their numbers, as in cut 1 2 or kill 3"]}.

%% A file, an application as users name it, or a module.
source(What) ->
    case filename:extension(What) of
        ".erl" -> What;
        _ -> module(["starl_" ++ What, What])
    end.

%% The first of these that there is, else the last. A user's own words: few atoms.
module([Name | Names]) ->
    Module = list_to_atom(Name),
    case Names =:= [] orelse code:which(Module) =/= non_existing of
        true -> Module;
        false -> module(Names)
    end.

%% @doc The answer to `status', with what each node that has answered knows of the other robots.
-spec described(starl_cluster:status(), #{starl:robot_id() => [starl_live_peers:peer()]}) ->
    unicode:chardata().
described(
    #{now_us := Now, running := Running, up := Up, restarts := Restarts, os_pids := Pids}, Peers
) ->
    [
        io_lib:format("~.1f s, ~b at work~n", [Now / 1.0e6, Running])
        | [
            io_lib:format("robot ~b  ~-5s process ~s, started ~b times~ts~n", [
                Id,
                up(lists:member(Id, Up)),
                maps:get(Id, Pids, "-"),
                N + 1,
                hears(maps:get(Id, Peers, []))
            ])
         || {Id, N} <- lists:sort(maps:to_list(Restarts))
        ]
    ].

up(true) -> "up";
up(false) -> "down".

%% Whom it hears, and whom not, and why.
hears([]) ->
    "";
hears(Peers) ->
    Complaints = [
        [", ", Line]
     || Peer <- Peers, Line <- [starl_live_hearing:complaint(Peer)], Line =/= none
    ],
    Heard = length([x || #{is_silent := false, heard_ms := Ms} <- Peers, Ms =/= never]),
    [io_lib:format(", hears ~b of ~b others", [Heard, length(Peers)]) | Complaints].

%% @doc The end of an answer: the nodes that have not answered.
-spec unheard([starl:robot_id()]) -> unicode:chardata().
unheard([]) ->
    "";
unheard(Robots) ->
    Ids = lists:join(", ", [integer_to_list(Id) || Id <- lists:sort(Robots)]),
    Of =
        case Robots of
            [_] -> "the node of robot ";
            _ -> "the nodes of robots "
        end,
    ["; no answer yet from ", Of, Ids].
