%% @doc Runs a function with bounds on memory and time, for documents of a hostile shape. A part of
%% the SVG reader, {@link starl_svg}.
-module(starl_svg_bounded).

-export([run/1]).

-define(MAX_HEAP_WORDS, 64_000_000).
-define(MAX_TIME_MS, 10_000).

%% @doc The result of the function, or an error if it exceeds the bounds.
-spec run(fun(() -> Result)) -> Result | {error, too_complex}.
run(Fun) ->
    Limit = #{size => ?MAX_HEAP_WORDS, kill => true, error_logger => false},
    Caller = self(),
    Tag = make_ref(),
    {Pid, Ref} = spawn_opt(
        fun() -> Caller ! {Tag, Fun()} end, [monitor, {max_heap_size, Limit}]
    ),
    receive
        {'DOWN', Ref, process, Pid, _} -> result(Tag)
    after ?MAX_TIME_MS ->
        exit(Pid, kill),
        receive
            {'DOWN', Ref, process, Pid, _} -> result(Tag)
        end
    end.

%%% Internals

%% A message arrives before the `DOWN' of its sender; a killed process has sent none.
result(Tag) ->
    receive
        {Tag, Result} -> Result
    after 0 -> {error, too_complex}
    end.
