%% @doc Runs continuations of a run ({@link starl_sim_continuation}) in several processes, and counts
%% their results. The numbers do not depend on how many run at a time.
%%
%% A process is cheaper here than a VM: continuations are short, and their number is known only step
%% by step.
-module(starl_lab_continuations).

-export([search/3]).

-export_type([search/0]).

%% The indices to begin with, the continuations of each, the number from which their branch seeds
%% follow, the number of processes, the message that ends the search, and the progress line.
-type search() :: #{
    grid := [starl_sim_timeline:index(), ...],
    draws := pos_integer(),
    branch_seed := integer(),
    jobs := pos_integer(),
    interrupt := reference(),
    progress := starl_cli_progress:t()
}.

-record(pool, {
    run :: starl_sim_continuation:run(),
    settings :: starl_sim_continuation:settings(),
    search :: search(),
    later :: [{starl_sim_timeline:index(), K :: pos_integer()}],
    running = #{} :: #{pid() => {reference(), starl_sim_timeline:index()}},
    done = 0 :: non_neg_integer(),
    total :: non_neg_integer(),
    curve = #{} :: #{starl_sim_timeline:index() => starl_sim_inevitable:tally()},
    progress :: starl_cli_progress:t()
}).

%% @doc Finds where the fraction of a run's failing continuations rises most
%% ({@link starl_sim_inevitable}). A continuation that crashes ends the search:
%% `throw({continuation, Reason})'.
-spec search(starl_sim_continuation:run(), starl_sim_continuation:settings(), search()) ->
    starl_sim_inevitable:result().
search(Run, Settings, #{grid := Grid, draws := K} = Search) ->
    starl_sim_inevitable:search(#{
        grid => Grid,
        draws => K,
        ask => fun(Questions) -> ask(Questions, Run, Settings, Search) end
    }).

ask(Questions, Run, Settings, #{progress := Progress} = Search) ->
    Later = [{Index, K} || {Index, {From, To}} <- Questions, K <- lists:seq(From, To)],
    work(
        fill(#pool{
            run = Run,
            settings = Settings,
            search = Search,
            later = Later,
            total = length(Later),
            progress = Progress
        })
    ).

fill(#pool{later = []} = Pool) ->
    Pool;
fill(#pool{running = Running, search = #{jobs := Jobs}} = Pool) when map_size(Running) >= Jobs ->
    Pool;
fill(#pool{later = [{Index, K} | Later], running = Running} = Pool) ->
    #pool{run = Run, settings = Settings, search = #{branch_seed := BranchSeed}} = Pool,
    Own = erlang:phash2({BranchSeed, K}, 1 bsl 32),
    Job = starl_sim_continuation:plan(Run, Index, Own, Settings),
    Self = self(),
    {Pid, Ref} = spawn_monitor(fun() ->
        Self ! {continuation, self(), starl_sim_continuation:play(Job)}
    end),
    fill(Pool#pool{later = Later, running = Running#{Pid => {Ref, Index}}}).

work(#pool{running = Running, curve = Curve}) when map_size(Running) =:= 0 ->
    {done, maps:to_list(Curve)};
work(#pool{running = Running, search = #{interrupt := Interrupt}, curve = Curve} = Pool) ->
    receive
        Interrupt ->
            ok = end_all(Running),
            %% what is asked later is not begun
            self() ! Interrupt,
            {stopped, maps:to_list(Curve)};
        {continuation, Pid, {ok, Verdict, Digest}} when is_map_key(Pid, Running) ->
            work(fill(show(count(Pid, Verdict, Digest, Pool))));
        {continuation, Pid, {error, Reason}} when is_map_key(Pid, Running) ->
            failed(Reason, Running);
        {'DOWN', _, process, Pid, Reason} when is_map_key(Pid, Running) ->
            failed({trial, {failed, Reason}}, maps:remove(Pid, Running))
    end.

-spec failed(term(), map()) -> no_return().
failed(Reason, Running) ->
    ok = end_all(Running),
    throw({continuation, Reason}).

end_all(Running) ->
    maps:foreach(
        fun(Pid, {Ref, _}) ->
            true = erlang:demonitor(Ref, [flush]),
            exit(Pid, kill)
        end,
        Running
    ).

count(Pid, Verdict, Digest, #pool{running = Running, curve = Curve, done = Done} = Pool) ->
    {{Ref, Index}, Others} = maps:take(Pid, Running),
    true = erlang:demonitor(Ref, [flush]),
    None = #{draws => 0, broken => 0, other => 0, unjudged => 0, digests => []},
    Tally = counted(Verdict, Digest, maps:get(Index, Curve, None)),
    Pool#pool{running = Others, done = Done + 1, curve = Curve#{Index => Tally}}.

counted(Verdict, Digest, #{draws := N, digests := Digests} = Tally) ->
    Counted = Tally#{draws := N + 1, digests := lists:usort([Digest | Digests])},
    case Verdict of
        kept -> Counted;
        _ -> maps:update_with(Verdict, fun(Count) -> Count + 1 end, Counted)
    end.

show(#pool{progress = Progress, done = Done, total = Total, later = Later} = Pool) ->
    Text = fun() -> [io_lib:format("~b of ~b continuations", [Done, Total]), from(Later, Pool)] end,
    Pool#pool{progress = starl_cli_progress:show(Progress, Done / Total, Text)}.

from([{Index, _} | _], #pool{run = #{timeline := Timeline}}) ->
    io_lib:format("from ~.3f s", [starl_sim_timeline:time_us(Index, Timeline) / 1.0e6]);
from([], _Pool) ->
    "".
