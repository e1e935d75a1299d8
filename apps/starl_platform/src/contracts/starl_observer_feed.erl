%% @doc Carries the reports of a run to a process, with a bound on how many may wait there. When the
%% bound is reached, a simulation waits. A live run does not wait: it leaves reports out, and says
%% how many events they had.
%%
%% The process receives `{starl_news, Feed, News}' and answers each with {@link done/2}. Reports
%% that were left out are `{missed, Events}'. Several processes may report to one observer.
-module(starl_observer_feed).

-export([observer/3, done/2]).

-export_type([t/0, news/0]).

-opaque t() :: atomics:atomics_ref().

-type news() :: starl_observer:news() | {missed, Events :: pos_integer()}.

%% The counters: events told, events done, events missed and not said yet.
-define(TOLD, 1).
-define(DONE, 2).
-define(MISSED, 3).

%% The facts of the run, its end and the starts of robots always come through.
-define(MAY_MISS(News),
    (element(1, News) =:= judged orelse element(1, News) =:= seen orelse
        element(1, News) =:= logged)
).

%% @doc An observer that passes news on to a process. `Most': the events that may wait there.
-spec observer(pid(), wait | leave_out, Most :: pos_integer()) -> starl_observer:t().
observer(Pid, Policy, Most) ->
    Feed = atomics:new(3, []),
    fun(News) -> told(News, {Pid, Policy, Most}, Feed) end.

%% @doc The process has dealt with these news.
-spec done(news(), t()) -> ok.
done(News, Feed) -> atomics:add(Feed, ?DONE, size_of(News)).

told(News, {Pid, Policy, Most}, Feed) ->
    Size = size_of(News),
    Waiting = atomics:get(Feed, ?TOLD) - atomics:get(Feed, ?DONE),
    case {Waiting > Most, Policy} of
        {true, leave_out} when ?MAY_MISS(News) ->
            atomics:add(Feed, ?MISSED, Size);
        {true, wait} ->
            ok = catch_up(Pid),
            pass(News, Size, Pid, Feed);
        _ ->
            ok = say_missed(Pid, atomics:exchange(Feed, ?MISSED, 0), Feed),
            pass(News, Size, Pid, Feed)
    end.

pass(News, Size, Pid, Feed) ->
    atomics:add(Feed, ?TOLD, Size),
    Pid ! {starl_news, Feed, News},
    ok.

say_missed(_Pid, 0, _Feed) ->
    ok;
say_missed(Pid, Missed, Feed) ->
    pass({missed, Missed}, 1, Pid, Feed).

size_of({judged, Trace, _}) -> length(Trace);
size_of(_) -> 1.

%% The process answers when it has dealt with everything before.
catch_up(Pid) ->
    try
        gen_server:call(Pid, caught_up, infinity)
    catch
        exit:_ -> ok
    end.
