%% @doc An acquisition ("job") of a robot's application. It holds the tokens that it has got and the
%% tokens that it still waits for, one after the other in Erlang's order of terms. Pure; a part of
%% {@link starl_mutex_acquire}.
-module(starl_mutex_job).

-export([new/3, caller/1, from/1, next/1, asked/1, waits_for/2, answer/1, held/1, fences/1]).
-export([got/3, without/2, misses/2, is_broken/1, anew/1]).

-export_type([t/0, id/0]).

-type token() :: starl_mutex:token().

-type id() :: pos_integer().

%% A job waits for the first token of `todo', or holds all its tokens.
-record(job, {
    caller :: starl_machine:name(),
    from :: starl_machine:from(),
    shape :: one | set,
    %% in the order of terms; one that it has lost is neither waited for nor held
    asked :: [token()],
    todo :: [token()],
    got = [] :: [{token(), starl_mutex:fence()}],
    %% it misses a token that it seemed to have got, and must begin anew
    broken = false :: boolean()
}).

-opaque t() :: #job{}.

%% @doc A job of a machine for these tokens, at least one.
-spec new(starl_machine:name(), starl_machine:from(), token() | [token(), ...]) -> t().
new(Caller, From, Tokens) when is_list(Tokens) ->
    Asked = lists:usort(Tokens),
    #job{caller = Caller, from = From, shape = set, asked = Asked, todo = Asked};
new(Caller, From, Token) ->
    #job{caller = Caller, from = From, shape = one, asked = [Token], todo = [Token]}.

%% @doc The machine whose job it is.
-spec caller(t()) -> starl_machine:name().
caller(#job{caller = Caller}) -> Caller.

%% @doc The caller that gets the job's answer.
-spec from(t()) -> starl_machine:from().
from(#job{from = From}) -> From.

%% @doc The token that it waits for, or `complete'.
-spec next(t()) -> {wait, token()} | complete.
next(#job{todo = []}) -> complete;
next(#job{todo = [Token | _]}) -> {wait, Token}.

%% @doc The tokens of which it was made, in the order of terms: got, not got or lost.
-spec asked(t()) -> [token()].
asked(#job{asked = Asked}) -> Asked.

%% @doc Does it wait for this token now?
-spec waits_for(token(), t()) -> boolean().
waits_for(Token, #job{todo = [Token | _]}) -> true;
waits_for(_Token, #job{}) -> false.

%% @doc The answer to a complete job.
-spec answer(t()) -> starl_mutex:fence() | [{token(), starl_mutex:fence()}].
answer(#job{shape = one, got = [{_, Fence}]}) -> Fence;
answer(#job{shape = set} = Job) -> fences(Job).

%% @doc The tokens that it has got, the last one first.
-spec held(t()) -> [token()].
held(#job{got = Got}) -> [Token || {Token, _} <- Got].

%% @doc The same with their fences, in the order of terms.
-spec fences(t()) -> [{token(), starl_mutex:fence()}].
fences(#job{got = Got}) -> lists:sort(Got).

%% @doc It has got the token that it waited for.
-spec got(token(), starl_mutex:fence(), t()) -> t().
got(Token, Fence, #job{todo = [Token | Rest], got = Got} = Job) ->
    Job#job{todo = Rest, got = [{Token, Fence} | Got]}.

%% @doc The job with one token less; `none' is left of one that had only this one.
-spec without(token(), t()) -> t() | none.
without(Token, #job{got = Got} = Job) ->
    case lists:keydelete(Token, 1, Got) of
        [] -> none;
        Rest -> Job#job{got = Rest}
    end.

%% @doc A job that no longer has a token, and waits for it before all others.
-spec misses(token(), t()) -> t().
misses(Token, #job{todo = Todo, got = Got} = Job) ->
    Job#job{todo = [Token | Todo], got = lists:keydelete(Token, 1, Got), broken = true}.

%% @doc Does it miss such a token?
-spec is_broken(t()) -> boolean().
is_broken(#job{broken = Broken}) -> Broken.

%% @doc The same job from its beginning.
-spec anew(t()) -> t().
anew(#job{todo = Todo} = Job) ->
    Job#job{todo = lists:usort(held(Job) ++ Todo), got = [], broken = false}.
