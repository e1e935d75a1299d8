%% @doc Finds calls in a user's modules that return values from outside the robot: random numbers,
%% clocks, identifiers, shared tables and this computer's environment. With them, equal scenarios
%% and seeds give unequal runs. It also finds the calls that send messages of a type, for a note on
%% such messages, and the calls that name a token by a text.
-module(starl_cli_lint).

-export([calls/1, sends/2, named_by_text/1, text/1]).

-export_type([call/0]).

-type call() :: {file:filename(), Line :: pos_integer(), mfa()}.

%% Functions of rand that keep a state of their own, or make one of nothing.
-define(STATELESS, [
    {uniform, 0},
    {uniform, 1},
    {uniform_real, 0},
    {normal, 0},
    {normal, 2},
    {bytes, 1},
    {seed, 1},
    {seed_s, 1}
]).
-define(CLOCKS, [
    now, system_time, monotonic_time, timestamp, date, time, localtime, universaltime
]).

%% @doc These calls, in the order of the source. A module without its source in the beam has none.
-spec calls(Beam :: binary() | file:filename()) -> [call()].
calls(Beam) ->
    {File, Forms} = source(Beam),
    All = [{File, at(Anno), Call} || {Anno, Call, _} <- found(Forms), kind(Call) =/= own],
    lists:usort(All).

%% @doc The calls that send messages of this type, as far as it is an atom in the source; in its
%% order.
-spec sends(Type :: atom(), Beam :: binary() | file:filename()) -> [call()].
sends(Type, Beam) ->
    {File, Forms} = source(Beam),
    All = [{File, at(Anno), Call} || {Anno, Call, Args} <- found(Forms), is_sent(Type, Call, Args)],
    lists:usort(All).

%% @doc One line for each call that gives a text as a token: it would be a list of tokens, one for each
%% character, each of which other texts have, too.
-spec named_by_text(Beam :: binary() | file:filename()) -> [unicode:chardata()].
named_by_text(Beam) ->
    {File, Forms} = source(Beam),
    [
        io_lib:format(
            "~ts:~b: ~tp:~tp/~b: ~tp names a token for each of its characters; use an atom, or <<~tp>>",
            [File, at(Anno), M, F, A, Text, Text]
        )
     || {Anno, {M, F, A}, [_, {string, _, Text} | _]} <- found(Forms),
        M =:= starl_mutex,
        lists:member(F, [acquire, release, with_token])
    ].

is_sent(Type, {starl, F, 4}, [_, _, {atom, _, Type}, _]) -> F =:= post orelse F =:= send;
is_sent(Type, {starl, broadcast, 3}, [_, {atom, _, Type}, _]) -> true;
is_sent(_Type, _Call, _Args) -> false.

source(Beam) ->
    case beam_lib:chunks(Beam, [abstract_code]) of
        {ok, {Module, [{abstract_code, {raw_abstract_v1, Forms}}]}} ->
            [{File, Line} | _] = [F || {attribute, _, file, F} <- Forms] ++ [{file(Module), 1}],
            true = is_integer(Line),
            {File, Forms};
        _ ->
            {"", []}
    end.

file(Module) -> atom_to_list(Module) ++ ".erl".

at(Anno) -> erl_anno:line(Anno).

found({call, Anno, {remote, _, {atom, _, M}, {atom, _, F}}, Args}) ->
    [{Anno, {M, F, length(Args)}, Args} | found(Args)];
found({call, Anno, {atom, _, F}, Args}) ->
    [{Anno, {erlang, F, length(Args)}, Args} || erl_internal:bif(F, length(Args))] ++ found(Args);
found({'fun', Anno, {function, {atom, _, M}, {atom, _, F}, {integer, _, A}}}) ->
    [{Anno, {M, F, A}, []}];
found(Form) when is_tuple(Form) -> found(tuple_to_list(Form));
found([Form | Forms]) ->
    found(Form) ++ found(Forms);
found(_Other) ->
    [].

%% @doc One line on a call, with its place and the remedy.
-spec text(call()) -> unicode:chardata().
text({File, Line, {M, F, A} = Call}) ->
    io_lib:format("~ts:~b: ~tp:~tp/~b ~ts", [File, Line, M, F, A, words(kind(Call))]).

words(random) ->
    "is not the robot's random number; use starl:random(Robot)";
words(clock) ->
    "reads this computer's clock; use starl:now(Robot)";
words(unique) ->
    "differs from run to run; use starl:id(Robot) and a counter";
words(process) ->
    "is another process in each run; use starl:id(Robot)";
words(shared) ->
    "is shared by the robots of one computer; use the state of step/2, or starl:store(Robot, Term)";
words(environment) ->
    "reads what is around this computer's VM; use an option of options/0".

%% Functions that take a state, such as rand:uniform_s/1, are as good as the state that they take.
kind({rand, F, A}) ->
    case lists:member({F, A}, ?STATELESS) of
        true -> random;
        false -> own
    end;
kind({random, _, _}) ->
    random;
kind({crypto, F, _}) when F =:= strong_rand_bytes; F =:= rand_uniform -> random;
kind({os, F, _}) when F =:= system_time; F =:= timestamp; F =:= perf_counter -> clock;
kind({calendar, F, 0}) when F =:= local_time; F =:= universal_time -> clock;
kind({erlang, self, 0}) ->
    process;
kind({Tables, _, _}) when Tables =:= ets; Tables =:= persistent_term ->
    shared;
kind({application, F, _}) when F =:= get_env; F =:= get_all_env; F =:= set_env; F =:= unset_env ->
    environment;
kind({os, F, _}) when F =:= getenv; F =:= putenv; F =:= unsetenv; F =:= env -> environment;
kind({erlang, F, _}) when F =:= unique_integer; F =:= make_ref -> unique;
kind({erlang, F, A}) when A =< 1 ->
    case lists:member(F, ?CLOCKS) of
        true -> clock;
        false -> own
    end;
kind(_) ->
    own.
