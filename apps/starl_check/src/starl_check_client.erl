%% @doc The application of a checked robot: it makes the calls of its script one after the other
%% and ends. When it makes the next one is up to the checker: each call waits for the timer `go'.
%%
%% A step of the script:
%% ```
%%   {call, Machine, Request}           again until it succeeds ({ok, _}, or ok)
%%   {try, Machine, Request}            once, whatever the answer
%%   {hold, Token}                      acquire it from the mutex, and in a further step release it
%%   {sync, Name, Last}                 a round of a barrier, unless all up to the Last are passed
%%   {join, First, Later}               a coordinator of path planning; after a restart the other;
%%                                      as the first step at once
%%   {window, Us}                       says when so much time has passed
%%   {listen, Type}                     to messages, which it forgets
%% '''
%% A call that its machine's crash ended is made again, as the blocks' interfaces do it. After its
%% own crash the client begins anew. Its state is `running' or `done'.
-module(starl_check_client).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-export_type([script/0, event/0]).

%% What it traces: the time that it was to wait is over.
-type event() :: {window, over}.

-type script() :: [
    {call | 'try', starl_machine:name(), Request :: term()}
    | {hold, starl_mutex:token()}
    %% what that turns into
    | hold
    | {release, starl_mutex:token()}
    | {sync, starl_barrier:name(), Last :: pos_integer()}
    | {listen, Type :: atom()}
    | {window, Us :: pos_integer()}
    | {join, First :: starl:robot_id(), Later :: starl:robot_id()}
].

%% So patient that it is the checker that decides when a call fails.
-define(PATIENCE_US, 30000000).

-record(client, {
    incarnation :: pos_integer(),
    script :: script(),
    listens :: [atom()],
    %% the call that is not answered yet: to whom, and its mark
    waits = none :: none | {starl_machine:name(), Mark :: term()}
}).

-spec init(starl_machine:config()) -> {running | done, #client{}, [starl_machine:action()]}.
init(#{incarnation := Incarnation, script := Script}) ->
    Types = [Type || {listen, Type} <- Script],
    Client = #client{
        incarnation = Incarnation,
        script = [Step || Step <- Script, not is_listen(Step)],
        listens = Types
    },
    case Client#client.script of
        [{join, _, _} = Join | _] ->
            {keep_state, Joining, Actions} = begin_step(Join, Client),
            {running, Joining, listen(Types) ++ Actions};
        Steps ->
            {State, Actions} = next(Steps),
            {State, Client, listen(Types) ++ Actions}
    end.

-spec handle_event(
    starl_machine:event_type(), term(), running | done, #client{}, starl_machine:meta()
) -> starl_machine:result().
handle_event({timeout, go}, _, running, #client{script = [Step | _]} = Client, _Meta) ->
    begin_step(Step, Client);
handle_event({timeout, window}, _, running, Client, _Meta) ->
    {next_state, State, Next, Actions} = step_over(Client),
    {next_state, State, Next, [{trace, {window, over}} | Actions]};
handle_event({reply, {Life, Mark}}, Answer, running, #client{incarnation = Life} = Client, _) ->
    case Client#client.waits of
        {_, Mark} -> answered(Mark, Answer, Client#client{waits = none});
        _ -> keep_state_and_data
    end;
handle_event({reply, _Earlier}, _, _, _Client, _Meta) ->
    keep_state_and_data;
handle_event(cast, {message, _, _, _}, _, _Client, _Meta) ->
    keep_state_and_data;
handle_event(info, {restarted, Machine}, State, #client{listens = Types} = Client, _Meta) ->
    Heard = [Action || Machine =:= sap, Action <- listen(Types)],
    case {State, Client#client.waits} of
        {running, {Machine, Mark}} -> restarted(Mark, Heard, Client#client{waits = none});
        _ -> {keep_state_and_data, Heard}
    end;
handle_event(_, _, _, _, _) ->
    unknown_event.

listen(Types) -> [starl_sap:listen(Type, app) || Type <- Types].

is_listen({listen, _}) -> true;
is_listen(_) -> false.

begin_step({Kind, Machine, Request}, Client) when Kind =:= call; Kind =:= 'try' ->
    call(Machine, Request, Kind, [], Client);
begin_step({hold, Token}, Client) ->
    call(mutex, {acquire, Token, ?PATIENCE_US}, acquire, [], Client);
begin_step({release, Token}, Client) ->
    call(mutex, {release, Token}, 'try', [], Client);
begin_step({join, First, _}, #client{incarnation = 1} = Client) ->
    call(dpp, {join, First}, join, [], Client);
begin_step({join, _, Later}, Client) ->
    call(dpp, {join, Later}, join, [], Client);
begin_step({sync, Name, _Last}, Client) ->
    call(barrier, {round, Name}, round, [], Client).

call(Machine, Request, Mark, Before, #client{incarnation = Life} = Client) ->
    Waiting = Client#client{waits = {Machine, Mark}},
    {keep_state, Waiting, Before ++ [{call, Machine, Request, {Life, Mark}}]}.

answered(round, Round, #client{script = [{sync, _, Last} | _]} = Client) when Round > Last ->
    step_over(Client);
answered(round, Round, #client{script = [{sync, Name, _} | _]} = Client) ->
    call(barrier, {sync, Name, Round, ?PATIENCE_US}, {sync, Round}, [], Client);
answered({resume, _}, ok, Client) ->
    once_more(Client);
answered(acquire, {ok, _}, #client{script = [{hold, Token} | Rest]} = Client) ->
    step_over(Client#client{script = [hold, {release, Token} | Rest]});
answered('try', _, Client) ->
    step_over(Client);
answered(_, {error, _}, Client) ->
    once_more(Client);
answered(_, _, Client) ->
    step_over(Client).

step_over(#client{script = [_ | Rest]} = Client) ->
    {State, Actions} = next(Rest),
    {next_state, State, Client#client{script = Rest}, Actions}.

once_more(Client) -> {keep_state, Client, go()}.

next([]) -> {done, []};
%% The window begins with the step before.
next([{window, Us} | _]) -> {running, [{{timeout, window}, Us, over}]};
next([_ | _]) -> {running, go()}.

go() -> [{{timeout, go}, 0, go}].

%% Whoever waits for a barrier tells its new machine which round that was.
restarted({_, Round}, Heard, #client{script = [{sync, Name, _} | _]} = Client) ->
    call(barrier, {resume, Name, Round}, {resume, Round}, Heard, Client);
restarted('try', Heard, Client) ->
    {State, Client1, Actions} = stepped(step_over(Client)),
    {next_state, State, Client1, Heard ++ Actions};
restarted(_, Heard, Client) ->
    {keep_state, Client, Heard ++ go()}.

stepped({next_state, State, Client, Actions}) -> {State, Client, Actions}.
