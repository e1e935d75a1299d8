%% @doc Checks that actions are well formed. An action is checked when a machine or an application
%% hands it to the platform. So a mistake crashes the machine that made it, with a reason that shows
%% the action. It never crashes the platform, which carries out actions for many robots.
%%
%% Requests to the robot's services are checked too; other machines check their own requests. A term
%% for the radio or the store must be a payload ({@link starl_payload}): on a real robot any other
%% term would be lost there.
-module(starl_action).

-export([check/1, without_latest/1, longest_us/0]).

-export_type([mistake/0]).

%% The reason of the error: the action, and the expected form; or the kind of the action with the
%% type of the message, whose body may be of any size, and what is wrong with that.
-type mistake() ::
    {bad_action, Action :: term(), Expected :: string()}
    | {bad_payload, {message | datagram, starl_packet:type()} | store, Why :: string()}.

%% The longest timer: 35 years.
-define(LONGEST_US, (1 bsl 50)).
%% The largest coordinate of a point (mm).
-define(FARTHEST, 1.0e9).

-define(IS_ROBOT(R), is_integer(R), R > 0).
-define(IS_TIME(Us), is_integer(Us), Us >= 0, Us =< ?LONGEST_US).
-define(IS_WITHIN(X, Most), is_number(X), X =< Most, X >= -Most).

%% @doc The longest duration of a timer, in microseconds.
-spec longest_us() -> pos_integer().
longest_us() -> ?LONGEST_US.

%% @doc Fails with a {@link mistake()} unless all actions are well formed.
-spec check([starl_machine:action()]) -> ok.
check([]) ->
    ok;
check([{trace, _} | Rest]) ->
    check(Rest);
check([{cast, To, Word} | Rest]) when is_atom(To), is_tuple(Word) -> asked(To, Word, Rest);
check([{cast, To, _} | Rest]) when is_atom(To) -> check(Rest);
check([{{timeout, _}, cancel} | Rest]) ->
    check(Rest);
check([{state_timeout, cancel} | Rest]) ->
    check(Rest);
check([{{timeout, _}, Us, _} | Rest]) when ?IS_TIME(Us) -> check(Rest);
check([{state_timeout, Us, _} | Rest]) when ?IS_TIME(Us) -> check(Rest);
check([{transmit, all, _} | Rest]) ->
    check(Rest);
check([{transmit, To, {starl, _, shout, _, Type, Body}} | Rest]) when ?IS_ROBOT(To) ->
    payload({datagram, Type}, message, Body),
    check(Rest);
check([{transmit, To, _} | Rest]) when ?IS_ROBOT(To) -> check(Rest);
check([{reply, {To, _}, _} | Rest]) when is_atom(To) -> check(Rest);
check([{call, To, Word, _} | Rest]) when is_atom(To), is_tuple(Word) -> asked(To, Word, Rest);
check([{call, To, _, _} | Rest]) when is_atom(To) -> check(Rest);
check([Action | Rest]) ->
    of_robot(Action),
    check(Rest);
check(Other) ->
    error({bad_action, Other, "a list of actions (starl_machine:action())"}).

%% Of its senses, its body, its store, its program and its clock.
of_robot({sense, {near, Mm}, _Tag}) when is_number(Mm), Mm >= 0 -> ok;
of_robot({sense, Robots, _Tag} = Action) -> right(are_robots(Robots), Action);
of_robot({feel, Kind, _Tag} = Action) -> right(starl_sense:is_kind(Kind), Action);
of_robot({drive, Script, _} = Action) -> driven(starl_chassis:check(Script), Action);
of_robot({actuate, Device, _}) when is_atom(Device) -> ok;
of_robot({actuate, Device, _, _}) when is_atom(Device) -> ok;
of_robot({store, Term}) -> payload(store, kept, Term);
of_robot({done, _}) -> ok;
of_robot({outlived, N}) when is_integer(N) -> ok;
of_robot({reloaded, #{}}) -> ok;
of_robot({until, Us, Actions, _Mark}) when is_integer(Us), is_list(Actions) -> check(Actions);
of_robot(Action) -> wrong(Action).

asked(To, Word, Rest) ->
    case is_request(To, Word) of
        true -> said(To, Word, Rest);
        false -> error({bad_action, {To, Word}, request(element(1, Word))})
    end.

%% What SAP puts on the air comes through here, but for packets of its own.
said(sap, {send, _To, Type, Body}, Rest) -> said(message, Type, Body, Rest);
said(sap, {send, _To, Type, Body, _Until}, Rest) -> said(message, Type, Body, Rest);
said(sap, {broadcast, Type, Body}, Rest) -> said(message, Type, Body, Rest);
said(sap, {shout, Type, Body}, Rest) -> said(datagram, Type, Body, Rest);
said(sap, {shout, Type, Body, _Until}, Rest) -> said(datagram, Type, Body, Rest);
said(_To, _Word, Rest) -> check(Rest).

said(What, Type, Body, Rest) ->
    payload({What, Type}, message, Body),
    check(Rest).

payload(What, Kind, Term) ->
    case starl_payload:check(Kind, Term) of
        ok -> ok;
        {error, Reason} -> error({bad_payload, What, starl_payload:format_error(Kind, Reason)})
    end.

%% Requests that a service does not know pass: the service traces them itself.
is_request(sap, {send, To, Type, _}) when ?IS_ROBOT(To) -> is_type(Type);
is_request(sap, {send, _, _, _}) -> false;
is_request(sap, {send, To, Type, _, Until}) when ?IS_ROBOT(To), is_integer(Until) -> is_type(Type);
is_request(sap, {send, _, _, _, _}) -> false;
is_request(sap, {Cast, Type, _}) when Cast =:= broadcast; Cast =:= shout -> is_type(Type);
is_request(sap, {listen, Type, Machine}) -> is_type(Type) andalso is_atom(Machine);
is_request(location, {pose, Robot}) -> are_robots([Robot]);
is_request(location, {sense, Kind}) -> starl_sense:is_kind(Kind);
is_request(location, {subscribe, Kind, Us}) -> starl_sense:is_kind(Kind) andalso is_duration(Us);
is_request(motion, {go_to, Point}) -> is_point(Point);
is_request(motion, {velocity, {VX, VY}, Us}) -> is_point({VX, VY}) andalso is_duration(Us);
is_request(motion, {velocity, _, _}) -> false;
is_request(motion, {go_along, {From, To}}) -> is_point(From) andalso is_point(To);
is_request(motion, {go_along, _}) -> false;
is_request(_, _) -> true.

%% `{app, Type}' is the type of a sequential application's message.
is_type({app, Type}) -> is_atom(Type);
is_type(Type) -> is_atom(Type).

request(send) -> "{send, Robot, Type, Body}: Robot is a number from 1, Type an atom";
request(listen) -> "{listen, Type, Machine}: both are atoms";
request(pose) -> "{pose, Robot}: Robot is a number from 1";
request(sense) -> "{sense, Kind}: a sense of starl_sense:kinds/0";
request(subscribe) -> "{subscribe, Kind, Us}: a sense of starl_sense:kinds/0, Us from 1 to 2^50";
request(go_to) -> "{go_to, {X, Y}}: mm, within 1.0e9";
request(velocity) -> "{velocity, {VX, VY}, Us}: mm/s, within 1.0e9, Us from 1 to 2^50";
request(go_along) -> "{go_along, {{X0, Y0}, {X1, Y1}}}: mm, within 1.0e9";
request(_) -> "{broadcast | shout, Type, Body}: Type is an atom".

is_point({X, Y}) when ?IS_WITHIN(X, ?FARTHEST), ?IS_WITHIN(Y, ?FARTHEST) -> true;
is_point(_) -> false.

is_duration(Us) when ?IS_TIME(Us) -> Us > 0;
is_duration(_) -> false.

are_robots([]) -> true;
are_robots([Robot | Robots]) when ?IS_ROBOT(Robot) -> are_robots(Robots);
are_robots(_) -> false.

%% The chassis checks its own scripts.
driven(ok, _Action) -> ok;
driven({error, Expected}, Action) -> error({bad_action, Action, Expected}).

right(true, _Action) -> ok;
right(false, Action) -> wrong(Action).

-spec wrong(term()) -> no_return().
wrong(Action) -> error({bad_action, Action, expected(Action)}).

expected({{timeout, _}, _, _}) -> "microseconds: a whole number from 0 to 2^50";
expected({state_timeout, _, _}) -> "microseconds: a whole number from 0 to 2^50";
expected({transmit, _, _}) -> "a robot's number from 1, or all";
expected({sense, _, _}) -> "a list of robots' numbers from 1, or {near, Mm}";
expected({feel, _, _}) -> "a sense of starl_sense:kinds/0";
expected({actuate, _, _}) -> "a device, which is an atom";
expected({actuate, _, _, _}) -> "a device, which is an atom";
expected({until, _, _, _}) -> "{until, Us, Actions, Mark}: Us is a whole number";
expected({reply, _, _}) -> "{Machine, Tag} as it came with the call";
expected({Word, _, _}) when Word =:= cast -> "the name of a machine, which is an atom";
expected({call, _, _, _}) -> "the name of a machine, which is an atom";
expected(_) -> "an action (starl_machine:action())".

%% @doc The actions in their order without their latest moments, groups taken apart: for tests and
%% planted bugs, which look at what a machine does, not until when.
-spec without_latest([starl_machine:action()]) -> [starl_machine:action()].
without_latest(Actions) -> lists:flatmap(fun plain/1, Actions).

plain({until, _Us, Group, _Mark}) -> without_latest(Group);
plain({call, sap, {send, To, Type, Body, _Us}, Tag}) -> [{call, sap, {send, To, Type, Body}, Tag}];
plain({cast, sap, {shout, Type, Body, _Us}}) -> [{cast, sap, {shout, Type, Body}}];
plain({reply, From, {until, _Us, Answer}}) -> [{reply, From, Answer}];
plain(Action) -> [Action].
