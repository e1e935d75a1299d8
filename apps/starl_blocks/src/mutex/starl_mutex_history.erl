%% @doc The consistency that mutual exclusion promises its callers: each token is a lock with
%% fencing numbers, and is linearizable.
%%
%% A hold begins between `acquire' and its answer, and exists when the answer comes. If `release' is
%% answered `ok', it has ended between that call and that answer. Else (the lease has run out, or
%% the machine or the application has crashed) it has ended at some time after the answer to
%% `acquire'. No two holds of a token overlap, and fencing numbers grow from hold to hold. An
%% `acquire' without an answer that contains its tokens is no known hold.
%%
%% The promise rests on clocks: a hold during which any robot's clock was set or wrong is left out.
%% If a store was lost or set back, too, the numbers of a token may begin anew. Then only holds from
%% then on are compared.
-module(starl_mutex_history).
-behaviour(starl_history_model).

-export([machine/0, contract/0, objects/2, judge/3]).

%% `ends': not with a release that is known to have released it.
-type hold() :: #{
    robot := starl:robot_id(),
    fence := pos_integer(),
    acquired := {InvokedUs :: integer(), ReturnedUs :: integer()},
    released := {InvokedUs :: integer(), ReturnedUs :: integer()} | ends
}.

-spec machine() -> starl_machine:name().
machine() -> mutex.

-spec contract() -> module().
contract() -> starl_mutex_monitor.

%% @doc The calls of each token; of a call for a set, its part.
-spec objects([starl_history:call()], map()) -> [{term(), [starl_history:call()]}].
objects(Calls, _Config) ->
    Parts = lists:append([parts(Call) || Call <- Calls]),
    Of = maps:groups_from_list(fun({Token, _}) -> Token end, fun({_, Call}) -> Call end, Parts),
    lists:sort(maps:to_list(Of)).

parts(#{request := {acquire, Tokens, Us}, answer := Answer} = Call) when is_list(Tokens) ->
    [
        {T, Call#{request := {acquire, T, Us}, answer := granted(T, Answer)}}
     || T <- alike(Tokens)
    ];
parts(#{request := {release, Tokens}} = Call) when is_list(Tokens) ->
    [{T, Call#{request := {release, T}}} || T <- alike(Tokens)];
parts(#{request := {acquire, Token, _}} = Call) ->
    [{hd(alike([Token])), Call}];
parts(#{request := {release, Token}} = Call) ->
    [{hd(alike([Token])), Call}];
parts(_Call) ->
    [].

%% Tokens are compared by `=='.
alike(Tokens) -> lists:usort([plain(Token) || Token <- Tokens]).

plain(Token) when is_float(Token), trunc(Token) == Token -> trunc(Token);
plain(Token) -> Token.

granted(Token, {ok, {ok, Granted}}) ->
    {ok, {ok, hd([Fence || {T, Fence} <- Granted, T == Token])}};
granted(_Token, Answer) ->
    Answer.

-spec judge([starl_history:call()], map(), starl_history_model:judge()) ->
    starl_history_model:judgement().
judge(Calls, Config, #{states := Most} = Judge) ->
    Holds = [Hold || Hold <- holds(Calls), is_judged(Hold, Config, Judge)],
    Fences = lists:sort([Fence || #{fence := Fence} <- Holds]),
    Ranks = maps:from_list([{Fence, N} || {N, Fence} <- lists:enumerate(Fences)]),
    Timed = lists:append([timed(Hold, Ranks, Judge) || Hold <- Holds]),
    case length(Fences) =:= map_size(Ranks) of
        false -> {unexplained, "linearizable: a fencing number comes twice"};
        true -> said(starl_history_search:linearizable(Timed, {0, free}, fun step/2, Most))
    end.

said(explained) -> {explained, "linearizable"};
said(unexplained) -> {unexplained, "linearizable"};
said(undecided) -> undecided.

%% -- holds ----------------------------------------------------------------------------------

%% A robot calls one after the other.
-spec holds([starl_history:call()]) -> [hold()].
holds(Calls) ->
    {Held, Over} = lists:foldl(fun call/2, {#{}, []}, Calls),
    maps:values(Held) ++ Over.

call(#{request := {acquire, _, _}, answer := {ok, {ok, Fence}}} = Call, {Held, Over}) ->
    #{robot := Robot, invoked_us := Invoked, returned_us := Returned} = Call,
    New = #{robot => Robot, fence => Fence, acquired => {Invoked, Returned}, released => ends},
    {Held#{Robot => New}, [maps:get(Robot, Held) || is_map_key(Robot, Held)] ++ Over};
call(#{request := {release, _}, robot := Robot, answer := Answer} = Call, {Held, Over}) when
    is_map_key(Robot, Held)
->
    #{invoked_us := Invoked, returned_us := Returned} = Call,
    {Hold, Others} = maps:take(Robot, Held),
    case Answer of
        {ok, ok} -> {Others, [Hold#{released := {Invoked, Returned}} | Over]};
        _ -> {Others, [Hold | Over]}
    end;
call(_Call, Holds) ->
    Holds.

%% A hold may rest on a lease that was confirmed before the call.
is_judged(#{acquired := {Invoked, Returned}} = Hold, Config, Judge) ->
    #{marks := Marks} = Judge,
    Clocks = maps:get(clocks, Judge, []),
    From = Invoked - 2 * maps:get(lease_us, Config, 0),
    Until = last(Hold, Returned),
    not lists:any(fun({Begin, End}) -> Begin =< Until andalso From =< End end, Clocks) andalso
        (Clocks =:= [] orelse Marks =:= [] orelse Invoked > element(1, lists:last(Marks))).

last(#{released := {_, Returned}}, _Acquired) -> Returned;
last(#{released := ends}, Acquired) -> Acquired.

%% When the answer comes, the hold is there. An application that stands still in the step that the answer begins
%% tells of it afterwards.
timed(#{fence := Fence, acquired := {Invoked, Returned}} = Hold, Ranks, Judge) ->
    #{Fence := Rank} = Ranks,
    #{robot := Robot, released := Released} = Hold,
    Sigma = maps:get(sigma_us, Judge, 0),
    Came = came(Robot, Returned, maps:get(stills, Judge, [])),
    [
        {Invoked, Returned, {acquire, Rank, Released =:= ends}},
        {max(Invoked, Came - Sigma), Returned, {held, Rank}}
        | [{From, To, {release, Rank}} || {From, To} <- [Released]]
    ].

came(Robot, Told, Stills) ->
    lists:min([
        Told
        | [From || {R, From, To} <- Stills, R =:= Robot, From =< Told, Told =< To]
    ]).

%% The lock: the rank of the last fencing number, and whether it is held; a hold that `ends' may have
%% ended.
step({acquire, Rank, Ends}, {Last, Lock}) when Rank =:= Last + 1 ->
    case Lock of
        {held, _, false} -> no;
        _ -> {ok, {Rank, {held, Rank, Ends}}}
    end;
step({held, Rank}, {_, {held, Rank, _}} = Lock) ->
    {ok, Lock};
step({release, Rank}, {Last, {held, Rank, _}}) ->
    {ok, {Last, free}};
step(_Call, _Lock) ->
    no.
