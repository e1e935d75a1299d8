%% @doc Records messages of applications that nobody gets: those to a robot that is not there, and
%% those of a type to which the receiver's application does not listen by the end of the run. It
%% judges nothing: a program may send what nobody wants, but that is rarely meant.
-module(starl_sim_mail_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

-export_type([stranger/0, unheard/0]).

%% A sender, the number of no robot, and a type: the time of the first message (us), and their count.
-type stranger() :: #{
    from := starl:robot_id(),
    to := starl:robot_id(),
    type := atom(),
    at_us := starl_sim_queue:time(),
    count := pos_integer()
}.

%% A robot and a type that it does not listen to: the first sender, the time of that message, and the
%% count of all.
-type unheard() :: #{
    robot := starl:robot_id(),
    type := atom(),
    from := starl:robot_id(),
    at_us := starl_sim_queue:time(),
    count := pos_integer()
}.

-record(state, {
    team :: pos_integer(),
    listening = #{} :: #{{starl:robot_id(), atom()} => true},
    strangers = #{} :: #{{From :: starl:robot_id(), To :: starl:robot_id(), atom()} => first()},
    waiting = #{} :: #{{starl:robot_id(), atom()} => {starl:robot_id(), first()}}
}).

-type first() :: {AtUs :: starl_sim_queue:time(), Count :: pos_integer()}.

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
    #state{listening = Listening} = State,
    case is_map_key({Robot, Type}, Listening) of
        true -> {ok, State};
        false -> {ok, waits({Robot, Type}, From, T, State)}
    end;
step({_T, Robot, app, {listens, {app, Type}}}, #state{} = State) ->
    #state{listening = Listening, waiting = Waiting} = State,
    Key = {Robot, Type},
    {ok, State#state{listening = Listening#{Key => true}, waiting = maps:remove(Key, Waiting)}};
step(_, State) ->
    {ok, State}.

waits(Key, From, T, #state{waiting = Waiting} = State) ->
    Known =
        case Waiting of
            #{Key := {First, Count}} -> {First, once_more(T, {ok, Count})};
            #{} -> {From, once_more(T, error)}
        end,
    State#state{waiting = Waiting#{Key => Known}}.

once_more(T, error) -> {T, 1};
once_more(_T, {ok, {First, Count}}) -> {First, Count + 1}.

-spec finish(integer(), #state{}) -> {ok, #{strangers := [stranger()], unheard := [unheard()]}}.
finish(_EndUs, #state{strangers = Strangers, waiting = Waiting}) ->
    {ok, #{
        strangers => [
            #{from => From, to => To, type => Type, at_us => At, count => Count}
         || {{From, To, Type}, {At, Count}} <- lists:sort(maps:to_list(Strangers))
        ],
        unheard => [
            #{robot => Robot, type => Type, from => From, at_us => At, count => Count}
         || {{Robot, Type}, {From, {At, Count}}} <- lists:sort(maps:to_list(Waiting))
        ]
    }}.
