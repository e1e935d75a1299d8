%% @doc Implements the blocking calls of a sequential application. Between two events the
%% application runs on its own stack. A blocking call hands control back to the driver, with the
%% actions gathered so far, and waits for its event ({@link starl_app_turn}).
-module(starl_app_call).

-export([call/3, await/2, sleep/1]).

-export_type([waits/0]).

%% What an application waits for: messages of these types, the answer of a machine, a time, or
%% nothing, after its end.
-type waits() ::
    {message, [starl_packet:type()]} | {answer, starl_machine:name()} | time | nothing.

%% The time that a caller waits after a crash of the machine that it called.
-define(RESTARTED_US, 250000).

%% @doc Calls another machine of the robot and waits for its answer. `{error, restarted}': the
%% machine crashed, a quarter of a second ago; the request may or may not have taken effect. `{ok,
%% late}': the answer granted something for a time, which ran out before the answer came.
-spec call(starl_machine:name(), Request :: term(), Us :: pos_integer() | infinity) ->
    {ok, Answer :: term()} | {error, timeout | restarted}.
call(Name, Request, Us) ->
    Tag = starl_app_turn:new_tag({answer, Name}),
    ok = starl_app_turn:history(Name, {invoked, Tag, Name, Request}),
    starl_app_turn:perform([{call, Name, Request, Tag} | timer(Tag, Us)]),
    Answer = starl_app_turn:wait(fun
        ({reply, T}, {no_such_machine, N}) when T =:= Tag, N =:= Name -> no_such_machine;
        ({reply, T}, Reply) when T =:= Tag -> {answer, Reply};
        ({timeout, T}, call) when T =:= Tag -> timeout;
        (info, {restarted, N}) when N =:= Name -> restarted;
        (info, {given_up, N}) when N =:= Name -> given_up;
        (_, _) -> skip
    end),
    stop_timer(Tag, Us),
    case Answer of
        {answer, {until, Latest, Reply}} -> returned(Name, Tag, {ok, in_time(Latest, Reply)});
        {answer, Reply} -> returned(Name, Tag, {ok, Reply});
        no_such_machine -> error(missing(Name));
        given_up -> error(missing(Name));
        timeout -> returned(Name, Tag, {error, timeout});
        restarted -> restarted(returned(Name, Tag, {error, restarted}))
    end.

returned(Name, Tag, Answer) ->
    ok = starl_app_turn:history(Name, {returned, Tag, Answer}),
    Answer.

%% The computer may have stood still on the way of the answer.
in_time(Latest, Reply) ->
    case starl_app_turn:present() =< Latest of
        true -> Reply;
        false -> late
    end.

%% The cause of the crash, such as a full store, may last: a caller that tried again at once would
%% crash the machine until it is given up.
restarted(Answer) ->
    ok = sleep(?RESTARTED_US),
    Answer.

%% A machine that was given up is missing, too.
missing(Name) ->
    case lists:member(Name, starl_app_turn:given_up()) of
        true -> {given_up, Name, it_crashed_too_often};
        false -> {no_such_machine, Name, add_it_to_blocks}
    end.

%% @doc Waits for a message of one of the given types; messages that came earlier count.
-spec await([starl_packet:type()], Us :: non_neg_integer() | infinity) ->
    {ok, starl_app_inbox:message()} | timeout.
await(Types, Us) ->
    case starl_app_turn:take(Types) of
        {ok, Message} -> {ok, Message};
        none -> await_new(Types, Us)
    end.

await_new(Types, Us) ->
    Tag = starl_app_turn:new_tag({message, Types}),
    starl_app_turn:perform(timer(Tag, Us)),
    Answer = starl_app_turn:wait(fun
        (cast, {message, From, Type, Body}) ->
            case lists:member(Type, Types) of
                true -> {message, {From, Type, Body}};
                false -> skip
            end;
        ({timeout, T}, call) when T =:= Tag ->
            timeout;
        (_, _) ->
            skip
    end),
    stop_timer(Tag, Us),
    case Answer of
        {message, Message} ->
            ok = starl_app_turn:read(Message),
            {ok, Message};
        timeout ->
            timeout
    end.

%% @doc Waits for this time by the robot's own clock.
-spec sleep(Us :: non_neg_integer()) -> ok.
sleep(Us) ->
    Tag = starl_app_turn:new_tag(time),
    starl_app_turn:perform(timer(Tag, Us)),
    timeout = starl_app_turn:wait(fun
        ({timeout, T}, call) when T =:= Tag -> timeout;
        (_, _) -> skip
    end),
    ok.

timer(_Tag, infinity) -> [];
timer(Tag, Us) -> [{{timeout, Tag}, Us, call}].

stop_timer(_Tag, infinity) -> ok;
stop_timer(Tag, _Us) -> starl_app_turn:perform([{{timeout, Tag}, cancel}]).
