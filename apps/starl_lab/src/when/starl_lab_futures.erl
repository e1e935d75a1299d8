%% @doc Runs continuations of a run ({@link starl_sim_future}, {@link starl_sim_onward}) in several
%% processes, and counts their results. The numbers do not depend on how many run at a time.
%%
%% A process is cheaper here than a VM: continuations are short, and their number is known only step
%% by step.
-module(starl_lab_futures).

-export([step/3, ask/2]).

-export_type([search/0, plan/0]).

%% Moments of the grid, futures of each; the rest as of a {@link plan()}.
-type search() :: #{
    moments := pos_integer(),
    futures := pos_integer(),
    salt := integer(),
    jobs := pos_integer(),
    interrupt := reference(),
    progress := starl_cli_progress:t()
}.

%% The future of a moment and a salt, to be played in a process of its own; the time of a moment; the number
%% from which the salts follow; the number of processes; the message that ends all; and the progress line.
-type plan() :: #{
    future := fun((starl_sim_moments:moment(), Salt :: integer()) -> fun(() -> played())),
    time_us := fun((starl_sim_moments:moment()) -> integer()),
    salt := integer(),
    jobs := pos_integer(),
    interrupt := reference(),
    progress := starl_cli_progress:t()
}.

-type played() :: {ok, starl_sim_future:verdict(), Digest :: binary()} | {error, term()}.

-type question() :: starl_sim_inevitable:question().

-record(pool, {
    plan :: plan(),
    later :: [{starl_sim_moments:moment(), K :: pos_integer()}],
    running = #{} :: #{pid() => {reference(), starl_sim_moments:moment()}},
    done = 0 :: non_neg_integer(),
    total :: non_neg_integer(),
    curve = #{} :: #{starl_sim_moments:moment() => starl_sim_inevitable:tally()},
    progress :: starl_cli_progress:t()
}).

%% @doc Finds the step of the fraction of a run's failing continuations
%% ({@link starl_sim_inevitable}). A continuation that crashes ends the search: `throw({future,
%% Reason})'.
-spec step(starl_sim_future:run(), starl_sim_future:settings(), search()) ->
    starl_sim_inevitable:result().
step(#{violation := #{at_us := AtUs}, moments := Moments} = Run, Settings, Search) ->
    #{moments := N, futures := K} = Search,
    Plan = (maps:with([salt, jobs, interrupt, progress], Search))#{
        future => fun(Moment, Own) ->
            Job = starl_sim_future:plan(Run, Moment, Own, Settings),
            fun() -> starl_sim_future:play(Job) end
        end,
        time_us => fun(Moment) -> starl_sim_moments:time_us(Moment, Moments) end
    },
    starl_sim_inevitable:search(#{
        grid => starl_sim_inevitable:grid(N, starl_sim_moments:at(AtUs, Moments), Moments),
        futures => K,
        ask => fun(Questions) -> ask(Questions, Plan) end
    }).

%% @doc Runs the requested continuations. `stopped': the interruption came before all were done. A
%% continuation that crashes ends the search: `throw({future, Reason})'.
-spec ask([question()], plan()) -> {done | stopped, starl_sim_inevitable:curve()}.
ask(Questions, #{progress := Progress} = Plan) ->
    Later = [{Moment, K} || {Moment, {From, To}} <- Questions, K <- lists:seq(From, To)],
    Pool = #pool{plan = Plan, later = Later, total = length(Later), progress = Progress},
    work(fill(Pool)).

fill(#pool{later = []} = Pool) ->
    Pool;
fill(#pool{running = Running, plan = #{jobs := Jobs}} = Pool) when map_size(Running) >= Jobs ->
    Pool;
fill(#pool{later = [{Moment, K} | Later], running = Running, plan = Plan} = Pool) ->
    #{future := Future, salt := Salt} = Plan,
    Play = Future(Moment, erlang:phash2({Salt, K}, 1 bsl 32)),
    Self = self(),
    {Pid, Ref} = spawn_monitor(fun() -> Self ! {future, self(), Play()} end),
    fill(Pool#pool{later = Later, running = Running#{Pid => {Ref, Moment}}}).

work(#pool{running = Running, curve = Curve}) when map_size(Running) =:= 0 ->
    {done, maps:to_list(Curve)};
work(#pool{running = Running, plan = #{interrupt := Interrupt}, curve = Curve} = Pool) ->
    receive
        Interrupt ->
            ok = end_all(Running),
            %% what is asked later is not begun
            self() ! Interrupt,
            {stopped, maps:to_list(Curve)};
        {future, Pid, {ok, Verdict, Digest}} when is_map_key(Pid, Running) ->
            work(fill(show(came(Pid, Verdict, Digest, Pool))));
        {future, Pid, {error, Reason}} when is_map_key(Pid, Running) ->
            failed(Reason, Running);
        {'DOWN', _, process, Pid, Reason} when is_map_key(Pid, Running) ->
            failed({trial, {failed, Reason}}, maps:remove(Pid, Running))
    end.

-spec failed(term(), map()) -> no_return().
failed(Reason, Running) ->
    ok = end_all(Running),
    throw({future, Reason}).

end_all(Running) ->
    maps:foreach(
        fun(Pid, {Ref, _}) ->
            true = erlang:demonitor(Ref, [flush]),
            exit(Pid, kill)
        end,
        Running
    ).

came(Pid, Verdict, Digest, #pool{running = Running, curve = Curve, done = Done} = Pool) ->
    {{Ref, Moment}, Others} = maps:take(Pid, Running),
    true = erlang:demonitor(Ref, [flush]),
    Tally = maps:get(Moment, Curve, #{
        futures => 0, broken => 0, other => 0, unjudged => 0, digests => []
    }),
    Pool#pool{
        running = Others, done = Done + 1, curve = Curve#{Moment => counted(Verdict, Digest, Tally)}
    }.

counted(Verdict, Digest, #{futures := N, digests := Digests} = Tally) ->
    Counted = Tally#{futures := N + 1, digests := lists:usort([Digest | Digests])},
    case Verdict of
        kept -> Counted;
        _ -> maps:update_with(Verdict, fun(Count) -> Count + 1 end, Counted)
    end.

show(#pool{progress = Progress, done = Done, total = Total, later = Later} = Pool) ->
    Words = fun() -> [io_lib:format("~b of ~b futures", [Done, Total]), at(Later, Pool)] end,
    Pool#pool{progress = starl_cli_progress:show(Progress, Done / Total, Words)}.

at([{Moment, _} | _], #pool{plan = #{time_us := TimeUs}}) ->
    io_lib:format("from ~.3f s", [TimeUs(Moment) / 1.0e6]);
at([], _Pool) ->
    "".
