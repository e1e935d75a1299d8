%% @doc Records messages of applications that nobody receives. It judges nothing: a program may send
%% such messages, but that is rarely meant.
%%
%% There are four kinds: messages to a robot that is not there; messages of a type to which the
%% receiver's application does not listen by the end of the run; messages that were not sent because
%% too many were under way; and messages to a robot that has ended and whose inbox is full.
-module(starl_run_mail_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

-export_type([stranger/0, unheard/0, overload/0, refused/0]).

%% A sender, the number of no robot, and a type: the time of the first message (us), and their count.
-type stranger() :: #{
    from := starl:robot_id(),
    to := starl:robot_id(),
    type := atom(),
    at_us := non_neg_integer(),
    count := pos_integer()
}.

%% A robot and a type that it does not listen to: the first sender, the time of that message, and the
%% count of all.
-type unheard() :: #{
    robot := starl:robot_id(),
    type := atom(),
    from := starl:robot_id(),
    at_us := non_neg_integer(),
    count := pos_integer()
}.

%% A sender and a type: the time of the first message that was not sent, and the count of all.
-type overload() :: #{
    robot := starl:robot_id(),
    type := atom(),
    at_us := non_neg_integer(),
    count := pos_integer()
}.

%% A robot that has ended and has no room for a type: the first sender, the time of that message, and
%% the count of all packets that were refused.
-type refused() :: unheard().

-record(state, {
    team :: pos_integer(),
    listening = #{} :: #{{starl:robot_id(), atom()} => true},
    strangers = #{} :: #{{From :: starl:robot_id(), To :: starl:robot_id(), atom()} => first()},
    waiting = #{} :: #{{starl:robot_id(), atom()} => {starl:robot_id(), first()}},
    overloads = #{} :: #{{starl:robot_id(), atom()} => first()},
    ended = #{} :: #{starl:robot_id() => true},
    refused = #{} :: #{{starl:robot_id(), atom()} => {starl:robot_id(), first()}}
}).

-type first() :: {AtUs :: non_neg_integer(), Count :: pos_integer()}.

%% @doc `robots': the number of robots in the team.
-spec init(#{robots := pos_integer()}) -> #state{}.
init(#{robots := Team}) -> #state{team = Team}.

-spec interests() -> [atom()].
interests() -> [sap, app].

-spec step(starl_monitor:trace_event(), #state{}) -> {ok, #state{}}.
step({T, From, sap, {sent, _Id, [To], {app, Type}, _Hash}}, #state{team = Team} = State) when
    To > Team
->
    #state{strangers = Strangers} = State,
    Key = {From, To, Type},
    {ok, State#state{strangers = Strangers#{Key => once_more(T, maps:find(Key, Strangers))}}};
step({T, Robot, sap, {delivered, {From, _, _}, {app, Type}, _Hash}}, State) ->
    {ok, delivered(T, {Robot, Type}, From, State)};
step({T, Robot, sap, {overload, {app, Type}}}, #state{overloads = Overloads} = State) ->
    Key = {Robot, Type},
    {ok, State#state{overloads = Overloads#{Key => once_more(T, maps:find(Key, Overloads))}}};
step({T, Robot, sap, {full, From, {app, Type}}}, #state{ended = Ended} = State) when
    is_map_key(Robot, Ended)
->
    Refused = once_more({Robot, Type}, From, T, State#state.refused),
    {ok, State#state{refused = Refused}};
step({_T, Robot, app, {done, _}}, #state{ended = Ended} = State) ->
    {ok, State#state{ended = Ended#{Robot => true}}};
step({_T, Robot, app, {listens, {app, Type}}}, #state{} = State) ->
    #state{listening = Listening, waiting = Waiting} = State,
    Key = {Robot, Type},
    {ok, State#state{listening = Listening#{Key => true}, waiting = maps:remove(Key, Waiting)}};
step(_, State) ->
    {ok, State}.

delivered(T, Key, From, #state{listening = Listening, waiting = Waiting} = State) ->
    case is_map_key(Key, Listening) of
        true -> State;
        false -> State#state{waiting = once_more(Key, From, T, Waiting)}
    end.

once_more(Key, From, T, Known) ->
    case Known of
        #{Key := {First, Count}} -> Known#{Key := {First, once_more(T, {ok, Count})}};
        #{} -> Known#{Key => {From, once_more(T, error)}}
    end.

once_more(T, error) -> {T, 1};
once_more(_T, {ok, {First, Count}}) -> {First, Count + 1}.

-spec finish(integer(), #state{}) ->
    {ok, #{
        strangers := [stranger()],
        unheard := [unheard()],
        overloads := [overload()],
        refused := [refused()]
    }}.
finish(_EndUs, #state{strangers = Strangers, overloads = Overloads} = State) ->
    {ok, #{
        strangers => [
            #{from => From, to => To, type => Type, at_us => At, count => Count}
         || {{From, To, Type}, {At, Count}} <- lists:sort(maps:to_list(Strangers))
        ],
        unheard => received(State#state.waiting),
        overloads => [
            #{robot => Robot, type => Type, at_us => At, count => Count}
         || {{Robot, Type}, {At, Count}} <- lists:sort(maps:to_list(Overloads))
        ],
        refused => received(State#state.refused)
    }}.

received(Known) ->
    [
        #{robot => Robot, type => Type, from => From, at_us => At, count => Count}
     || {{Robot, Type}, {From, {At, Count}}} <- lists:sort(maps:to_list(Known))
    ].
