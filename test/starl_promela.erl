%% Replays traces against models in Promela, by Spin (Debian: spin, and gcc): the trace is data, the model
%% takes one fact after the other or blocks. The models are in test/promela.
-module(starl_promela).

-export([find/0, build/2, replay/2]).
-export([lock/2, terms/1, tokens/1]).

%% A fact as five numbers: kind, two numbers, robot, time (ms).
-define(GRANTED, 1).
-define(LEASED, 2).
-define(ACQUIRED, 3).
-define(RELEASED, 4).
-define(LOST, 5).
-define(CRASHED, 6).

-define(CLAIMS, 1).
-define(LEADS, 2).
-define(ASSIGNS, 3).
-define(STEPS_DOWN, 4).
-define(ENDED, 5).

%% Are Spin and the compiler that it needs there?
find() ->
    case {os:find_executable("spin"), os:find_executable("gcc")} of
        {Spin, Gcc} when is_list(Spin), is_list(Gcc) -> ok;
        _ -> {missing, "no spin or no gcc (Debian: apt-get install spin gcc)"}
    end.

%% Makes the verifier of a model, in a directory; it reads its trace when it runs.
build(Model, Dir) ->
    ok = filelib:ensure_path(Dir),
    Source = filename:join(filename:dirname(?FILE), "promela"),
    [
        {ok, _} = file:copy(filename:join(Source, File), filename:join(Dir, File))
     || File <- ["trace.h", Model ++ ".pml"]
    ],
    Out = os:cmd(
        "cd " ++ Dir ++ " && spin -a " ++ Model ++
            ".pml && gcc -O1 -w -DSAFETY -DNOREDUCE -o pan pan.c && echo made"
    ),
    {match, _} = re:run(Out, "made\n$"),
    Dir.

%% Is the trace accepted? Else the number of its first fact, from 0, that no way through the model reaches
%% beyond.
replay(Facts, Dir) ->
    Lines = [io_lib:format("~b ~b ~b ~b ~b~n", tuple_to_list(Fact)) || Fact <- Facts],
    ok = file:write_file(filename:join(Dir, "trace.txt"), Lines),
    Out = os:cmd("cd " ++ Dir ++ " && ./pan -E -m200000"),
    Reached = [list_to_integer(N) || "reached " ++ N <- string:lexemes(Out, "\n")],
    %% without a word on states it did not run
    {match, _} = re:run(Out, "states, stored"),
    nomatch = re:run(Out, "max search depth too small"),
    case re:run(Out, "assertion violated") of
        {match, _} -> accepted;
        nomatch -> {refused, lists:max([0 | Reached])}
    end.

%% -- facts ----------------------------------------------------------------------------------

%% The tokens of which a trace tells.
tokens(Trace) ->
    lists:usort([Token || {_, _, mutex, {acquired, Token, _}} <- Trace]).

%% The facts on a token. Numbers of holds and hand-overs count in their order, from 1.
lock(Token, Trace) ->
    Own = [Fact || Fact <- Trace, is_on(Token, Fact)],
    Fences = lists:usort([fence(Event) || {_, _, mutex, Event} <- Own, Event =/= crashed]),
    Ranks = ranks(Fences),
    Hands = ranks(lists:usort([starl_mutex_home:hand_over(Fence) || Fence <- Fences])),
    [lock_fact(Fact, Ranks, Hands) || Fact <- Own].

is_on(_Token, {_, _, mutex, crashed}) ->
    true;
is_on(Token, {_, _, mutex, Event}) when is_tuple(Event), element(2, Event) =:= Token ->
    lists:member(element(1, Event), [granted, leased, acquired, released, lease_lost]);
is_on(_Token, _Fact) ->
    false.

fence(Event) -> element(3, Event).

ranks(Sorted) -> maps:from_list([{One, N} || {N, One} <- lists:enumerate(Sorted)]).

lock_fact({T, Robot, mutex, crashed}, _Ranks, _Hands) ->
    {?CRASHED, 0, 0, Robot, T div 1000};
lock_fact({T, Robot, mutex, Event}, Ranks, Hands) ->
    Fence = fence(Event),
    #{Fence := Hold} = Ranks,
    Hand = maps:get(starl_mutex_home:hand_over(Fence), Hands),
    At = T div 1000,
    case Event of
        {granted, _, _, To} -> {?GRANTED, Hold, Hand, To, At};
        %% clocks are at most one per cent fast
        {leased, _, _, Left} -> {?LEASED, Hold, Hand, Robot, (T + Left * 99 div 100) div 1000};
        {acquired, _, _} -> {?ACQUIRED, Hold, Hand, Robot, At};
        {released, _, _} -> {?RELEASED, Hold, Hand, Robot, At};
        {lease_lost, _, _} -> {?LOST, Hold, Hand, Robot, At}
    end.

%% The facts on the terms of path planning.
terms(Trace) ->
    Own = [{T, R, E} || {T, R, dpp_coordinator, E} <- Trace, is_of_term(E)],
    Terms = ranks(lists:usort([element(2, E) || {_, _, E} <- Own, has_term(E)])),
    [term_fact(Fact, Terms) || Fact <- Own].

is_of_term(crashed) -> true;
is_of_term({assigned, _, _, _}) -> true;
is_of_term(Event) -> has_term(Event).

has_term({Name, _Term}) -> lists:member(Name, [claims, leads, stepped_down, coordinator]);
has_term(_Event) -> false.

%% Which term an assignment is made in stands in none: it has to be the last one.
term_fact({T, Robot, Event}, Terms) ->
    case Event of
        crashed -> {?ENDED, 0, 0, Robot, T div 1000};
        {claims, Term} -> {?CLAIMS, maps:get(Term, Terms), 0, Robot, T div 1000};
        {leads, Term} -> {?LEADS, maps:get(Term, Terms), 0, Robot, T div 1000};
        {stepped_down, Term} -> {?STEPS_DOWN, maps:get(Term, Terms), 0, Robot, T div 1000};
        {coordinator, Term} -> {?ASSIGNS, maps:get(Term, Terms), 0, Robot, T div 1000};
        {assigned, _, _, _} -> {?ASSIGNS, 0, 0, Robot, T div 1000}
    end.
