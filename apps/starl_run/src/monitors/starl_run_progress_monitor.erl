%% @doc The contract of bounded convergence: the applications of all living robots finish within a
%% bound after the last fault has ended.
%%
%% An application that crashes has to finish again; only a dead robot need not.
%%
%% Events of machine `app': `done', `crashed'; of machine `robot': `died'.
-module(starl_run_progress_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

-record(state, {
    deadline_us :: non_neg_integer(),
    open :: #{starl:robot_id() => true},
    died = #{} :: #{starl:robot_id() => true}
}).

%% @doc `robots' have to finish by `deadline_us' of virtual time.
-spec init(#{robots := [starl:robot_id()], deadline_us := non_neg_integer()}) -> #state{}.
init(#{robots := Robots, deadline_us := Deadline}) ->
    #state{deadline_us = Deadline, open = maps:from_keys(Robots, true)}.

%% @doc The events of applications and robots.
-spec interests() -> [atom()].
interests() -> [app, robot].

%% @doc Judges one event: nothing is too late before the end.
-spec step(starl_monitor:trace_event(), #state{}) -> {ok, #state{}}.
step({_, Robot, app, {done, _}}, State) ->
    {ok, closed(Robot, State)};
step({_, Robot, app, crashed}, #state{open = Open, died = Died} = State) ->
    {ok, State#state{open = maps:merge(Open, maps:without(maps:keys(Died), #{Robot => true}))}};
step({_, Robot, robot, {died, _}}, #state{died = Died} = State) ->
    {ok, closed(Robot, State#state{died = Died#{Robot => true}})};
step(_, State) ->
    {ok, State}.

closed(Robot, #state{open = Open} = State) -> State#state{open = maps:remove(Robot, Open)}.

%% @doc Each robot that has not finished by the deadline breaks the contract.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndUs, #state{deadline_us = Deadline, open = Open}) ->
    Late = lists:sort(maps:keys(Open)),
    Found = [
        starl_violation:new(progress, not_finished, EndUs, Late, #{deadline_us => Deadline})
     || Late =/= [], EndUs >= Deadline
    ],
    starl_violation:finish(Found, #{unfinished => length(Late)}).
