%% @doc Handles the acquisitions ("jobs") of a robot's application: they begin, wait, hold, fail and
%% end. Pure. With {@link starl_mutex_robot}, which never calls back, it implements the operations
%% of {@link starl_mutex_tokens}. An operation on a token leaves notices for jobs in the state;
%% {@link settle/1} handles them afterwards.
-module(starl_mutex_acquire).

-export([acquire/5, release/4, again/2, give_up/3, caller_restarted/2]).
-export([settle/1, lapse_all/1, late/2, anew/2, forgo/4]).

-import(starl_mutex_state, [act/2, acts/2, until/4, post_home/3]).

-type t() :: starl_mutex_state:t().
-type token() :: starl_mutex:token().
-type job_id() :: starl_mutex_job:id().

%% @doc Begins an acquisition.
-spec acquire(starl_machine:name(), starl_machine:from(), token() | [token()], pos_integer(), t()) ->
    t().
acquire(_Caller, From, [], _Us, Robot) ->
    act({reply, From, {ok, []}}, Robot);
acquire(Caller, From, Tokens, Us, Robot) ->
    {Id, Numbered} = starl_mutex_state:next_job(Robot),
    Begun = act({{timeout, {patience, Id}}, Us, patience}, Numbered),
    proceed(Id, starl_mutex_job:new(Caller, From, Tokens), Begun).

proceed(Id, Job, Robot) ->
    Kept = starl_mutex_state:keep_job(Id, Job, Robot),
    case starl_mutex_job:next(Job) of
        complete ->
            answer(Id, Job, Kept);
        {wait, Token} ->
            Retry = {{timeout, {again, Id}}, starl_mutex_state:retry_us(Kept), again},
            search(Token, Id, acts([{trace, {requested, Token}}, Retry], Kept))
    end.

%% The application is told until when it holds all that it wants.
answer(Id, Job, Robot) ->
    Entries = entries(starl_mutex_job:held(Job), Robot),
    Until = lists:min([End || #{lease_end := End} <- Entries]) - 1,
    Answer = {until, Until, {ok, starl_mutex_job:answer(Job)}},
    Told = [
        {trace, {answered, starl_mutex_job:fences(Job)}},
        {reply, starl_mutex_job:from(Job), Answer}
        | [{{timeout, {T, Id}}, cancel} || T <- [again, patience]]
    ],
    until(Entries, Told, {answer, Id}, Robot).

entries(Tokens, Robot) -> [starl_mutex_state:entry(Token, Robot) || Token <- Tokens].

search(Token, Id, Robot) ->
    Request = {starl_mutex_state:self(Robot), Id},
    settle(starl_mutex_robot:route(Token, Request, 0, none, Robot)).

%% @doc A job that still waits asks the home of its token again.
-spec again(job_id(), t()) -> t().
again(Id, Robot) ->
    case starl_mutex_state:waiting(Id, Robot) of
        {wait, Token, _Job} ->
            Retry = starl_mutex_state:retry_us(Robot),
            Next = act({{timeout, {again, Id}}, Retry, again}, Robot),
            Request = {starl_mutex_state:self(Robot), Id},
            case starl_mutex_state:entry(Token, Robot) of
                none -> post_home(Token, {request, Token, Request, 0, home}, Next);
                #{} -> search(Token, Id, Next)
            end;
        none ->
            Robot
    end.

%% @doc A job that still waits fails; it gives back what it has got so far.
-spec give_up(job_id(), timeout | restarted, t()) -> t().
give_up(Id, Why, Robot) ->
    case starl_mutex_state:waiting(Id, Robot) of
        {wait, Token, Job} ->
            Reply = {reply, starl_mutex_job:from(Job), {error, Why}},
            Told = acts([{trace, {failed, Token, Why}}, Reply], Robot),
            give_back(starl_mutex_job:held(Job), starl_mutex_state:forget_job(Id, Told));
        none ->
            Robot
    end.

%% A robot that gets a token goes on before the next one is given back.
give_back(Tokens, Robot) ->
    lists:foldl(fun(T, R) -> settle(starl_mutex_robot:unlock(T, R)) end, Robot, Tokens).

%% @doc All jobs of a machine that has crashed end.
-spec caller_restarted(starl_machine:name(), t()) -> t().
caller_restarted(Caller, Robot) ->
    lists:foldl(fun end_job/2, Robot, starl_mutex_state:jobs_of(Caller, Robot)).

end_job(Id, Robot) ->
    Job = starl_mutex_state:job(Id, Robot),
    case starl_mutex_job:next(Job) of
        complete ->
            give_back(starl_mutex_job:held(Job), starl_mutex_state:forget_job(Id, Robot));
        {wait, _} ->
            give_up(Id, restarted, Robot)
    end.

%% @doc Ends the caller's holds of these tokens.
-spec release(starl_machine:name(), starl_machine:from(), token() | [token()], t()) -> t().
release(Caller, From, Names, Robot) ->
    List = listed(Names),
    Held = [{Token, Id} || Token <- List, Id <- holder(Caller, Token, Robot)],
    Tokens = [Token || {Token, _} <- Held],
    Freed = lists:foldl(fun({Token, Id}, R) -> drop(Id, Token, R) end, Robot, Held),
    Given = give_back(Tokens, Freed),
    case length(Held) =:= length(List) of
        true -> until(entries(Tokens, Robot), [{reply, From, ok}], {release, From}, Given);
        false -> act({reply, From, {error, lost}}, Given)
    end.

%% @doc Ends the caller's last acquisition of these tokens, which it has given up: the answer came too
%% late. One of them may have been lost meanwhile.
-spec forgo(starl_machine:name(), starl_machine:from(), token() | [token()], t()) -> t().
forgo(Caller, From, Names, Robot) ->
    Asked = listed(Names),
    Jobs = [
        {Id, starl_mutex_state:job(Id, Robot)}
     || Id <- starl_mutex_state:jobs_of(Caller, Robot)
    ],
    case [Made || {_, Job} = Made <- Jobs, starl_mutex_job:asked(Job) =:= Asked] of
        [] -> act({reply, From, ok}, Robot);
        Made -> act({reply, From, ok}, forgo_job(lists:last(Made), Robot))
    end.

forgo_job({Id, Job}, Robot) ->
    Held = starl_mutex_job:held(Job),
    give_back(Held, starl_mutex_state:forget_job(Id, failed(Job, Robot))).

failed(Job, Robot) ->
    case starl_mutex_job:next(Job) of
        {wait, Token} -> act({trace, {failed, Token, lease_lost}}, Robot);
        complete -> Robot
    end.

listed(Tokens) when is_list(Tokens) -> lists:usort(Tokens);
listed(Token) -> [Token].

%% The job of this caller that holds the token, as one that has all it wants.
holder(Caller, Token, Robot) ->
    case starl_mutex_state:entry(Token, Robot) of
        #{lock := {Id, _}} ->
            Job = starl_mutex_state:job(Id, Robot),
            [Id || starl_mutex_job:next(Job) =:= complete, starl_mutex_job:caller(Job) =:= Caller];
        _ ->
            []
    end.

%% A job has one token less.
drop(Id, Token, Robot) ->
    case starl_mutex_job:without(Token, starl_mutex_state:job(Id, Robot)) of
        none -> starl_mutex_state:forget_job(Id, Robot);
        Rest -> starl_mutex_state:keep_job(Id, Rest, Robot)
    end.

%% -- notices to jobs ------------------------------------------------------------------------

%% @doc Ends all holds whose lease is over; to be called before anything else.
-spec lapse_all(t()) -> t().
lapse_all(Robot) ->
    lists:foldl(
        fun(T, R) -> settle(starl_mutex_robot:lapse(T, R)) end,
        Robot,
        starl_mutex_state:over(Robot)
    ).

%% @doc Hands the jobs the notices of the last operation on a token.
-spec settle(t()) -> t().
settle(Robot) ->
    {Notices, Noticed} = starl_mutex_state:take_notices(Robot),
    lists:foldl(fun settle/2, Noticed, Notices).

-spec settle(starl_mutex_state:notice(), t()) -> t().
settle({locked, Id, Token, Fence}, Robot) ->
    proceed(Id, starl_mutex_job:got(Token, Fence, starl_mutex_state:job(Id, Robot)), Robot);
settle({lost, Id, Token, Queue}, Robot) ->
    starl_mutex_robot:orphan(Token, Queue, lost(Id, Token, Robot)).

%% A job that has all it wants is told at the release; one that waits begins anew.
lost(Id, Token, Robot) ->
    case starl_mutex_state:waiting(Id, Robot) of
        none ->
            drop(Id, Token, Robot);
        {wait, _, Job} ->
            anew(Id, Job, lists:delete(Token, starl_mutex_job:held(Job)), Robot)
    end.

%% @doc A job of which a token has never been held begins anew, unless it has done so meanwhile.
-spec anew(job_id(), t()) -> t().
anew(Id, Robot) ->
    case starl_mutex_state:waiting(Id, Robot) of
        {wait, _, Job} ->
            case starl_mutex_job:is_broken(Job) of
                true -> anew(Id, Job, starl_mutex_job:held(Job), Robot);
                false -> Robot
            end;
        none ->
            Robot
    end.

%% Begins a job anew, when it has given back these tokens. While it does so, it is in no queue.
anew(Id, Job, Tokens, Robot) ->
    Suspended = failed(Job, starl_mutex_state:suspend_job(Id, Robot)),
    proceed(Id, starl_mutex_job:anew(Job), lapse_all(give_back(Tokens, Suspended))).

%% -- what was too late ----------------------------------------------------------------------

%% @doc A lease was over when what rests on it was to leave the step ({@link starl_machine:action()}).
%% Nobody has learned of a hold whose beginning was late: it has never been, and its job begins anew,
%% as soon as it is known what else of the step was late. So does a job whose answer alone was late. An
%% application that is late with a release learns that it had lost a token.
-spec late(Mark, t()) -> t() when
    Mark ::
        {hold, token(), starl_mutex:fence()}
        | leased
        | {answer, job_id()}
        | {released, token(), starl_mutex:fence()}
        | {release, starl_machine:from()}.
late({hold, Token, Fence}, Robot) ->
    missed(Token, Fence, starl_mutex_state:void(Token, Fence, Robot));
late(leased, Robot) ->
    Robot;
late({answer, Id}, Robot) ->
    case starl_mutex_state:complete(Id, Robot) of
        {ok, Job} -> anew(Id, Job, starl_mutex_job:held(Job), Robot);
        none -> Robot
    end;
late({released, Token, Fence}, Robot) ->
    case starl_mutex_state:is_void(Token, Fence, Robot) of
        true -> Robot;
        false -> act({trace, {lease_lost, Token, Fence}}, Robot)
    end;
late({release, From}, Robot) ->
    act({reply, From, {error, lost}}, Robot).

missed(Token, Fence, Robot) ->
    case starl_mutex_state:entry(Token, Robot) of
        #{lock := {Id, Fence}, queue := Queue} ->
            %% it waits for this one, no more for the one after it
            Job = starl_mutex_state:job(Id, Robot),
            Gone = starl_mutex_state:forget_entry(Token, failed(Job, Robot)),
            Kept = starl_mutex_state:keep_job(Id, starl_mutex_job:misses(Token, Job), Gone),
            starl_mutex_robot:orphan(Token, Queue, act({{timeout, {anew, Id}}, 0, anew}, Kept));
        _ ->
            Robot
    end.
