%% @doc Runs a function with bounds on memory and work, to survive hostile documents. A part of the
%% SVG reader, {@link starl_svg}.
%%
%% Work is counted in reductions, not in time: what is read on a quiet machine is read on a busy one.
-module(starl_svg_bounded).

-export([run/1]).

-define(MAX_HEAP_WORDS, 64_000_000).
%% A path of 20 MB takes a quarter of it.
-define(MAX_REDUCTIONS, 1_000_000_000).
%% The time between two looks at the work done.
-define(LOOK_MS, 100).

%% @doc The result of the function, or an error if it exceeds the bounds.
-spec run(fun(() -> Result)) -> Result | {error, too_complex}.
run(Fun) ->
    Limit = #{size => ?MAX_HEAP_WORDS, kill => true, error_logger => false},
    Caller = self(),
    Tag = make_ref(),
    {Pid, Ref} = spawn_opt(
        fun() -> Caller ! {Tag, Fun()} end, [monitor, {max_heap_size, Limit}]
    ),
    watched(Pid, Ref, Tag).

%%% Internals

watched(Pid, Ref, Tag) ->
    receive
        {'DOWN', Ref, process, Pid, _} -> result(Tag)
    after ?LOOK_MS ->
        case process_info(Pid, reductions) of
            {reductions, N} when N > ?MAX_REDUCTIONS -> exit(Pid, kill);
            _ -> true
        end,
        watched(Pid, Ref, Tag)
    end.

%% A message arrives before the `DOWN' of its sender; a killed process has sent none.
result(Tag) ->
    receive
        {Tag, Result} -> Result
    after 0 -> {error, too_complex}
    end.
