%% @doc The application of a checked robot: it makes the calls of its script one after the other and
%% ends. The checker decides the time of each call: a call waits for the timer `go'.
%%
%% The steps of a script: {@link starl_block:script()}.
%%
%% A call ended by the crash of its machine is repeated, as in the blocks' interfaces. After a crash
%% of the client itself the script starts again. Its state is `running' or `done'.
-module(starl_check_client).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-export_type([event/0]).

%% The event that the client traces: its window of time is over.
-type event() :: {window, over}.

-record(client, {
    incarnation :: pos_integer(),
    script :: starl_block:script(),
    listens :: [atom()],
    %% the unanswered call: its machine and its mark
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
        [{start, _, _, _} = Start | _] ->
            {keep_state, Starting, Actions} = begin_step(Start, Client),
            {running, Starting, listen(Types) ++ Actions};
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
begin_step({start, Machine, Request, _}, #client{incarnation = 1} = Client) ->
    call(Machine, Request, start, [], Client);
begin_step({start, Machine, _, Later}, Client) ->
    call(Machine, Later, start, [], Client);
begin_step({talk, Module, Args}, Client) ->
    talk(Module:first(Args), [], Client).

talk({Machine, Request, Mark}, Before, Client) ->
    call(Machine, Request, {talk, Mark}, Before, Client).

call(Machine, Request, Mark, Before, #client{incarnation = Life} = Client) ->
    Waiting = Client#client{waits = {Machine, Mark}},
    {keep_state, Waiting, Before ++ [{call, Machine, Request, {Life, Mark}}]}.

answered({talk, Mark}, Answer, #client{script = [{talk, Module, Args} | _]} = Client) ->
    case Module:answered(Mark, Answer, Args) of
        {call, Call} -> talk(Call, [], Client);
        over -> step_over(Client);
        again -> once_more(Client)
    end;
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
%% The window begins with the previous step.
next([{window, Us} | _]) -> {running, [{{timeout, window}, Us, over}]};
next([_ | _]) -> {running, go()}.

go() -> [{{timeout, go}, 0, go}].

restarted({talk, Mark}, Heard, #client{script = [{talk, Module, Args} | _]} = Client) ->
    case Module:restarted(Mark, Args) of
        {call, Call} -> talk(Call, Heard, Client);
        over -> passed(Heard, Client);
        again -> {keep_state, Client, Heard ++ go()}
    end;
restarted('try', Heard, Client) ->
    passed(Heard, Client);
restarted(_, Heard, Client) ->
    {keep_state, Client, Heard ++ go()}.

passed(Heard, Client) ->
    {next_state, State, Next, Actions} = step_over(Client),
    {next_state, State, Next, Heard ++ Actions}.
