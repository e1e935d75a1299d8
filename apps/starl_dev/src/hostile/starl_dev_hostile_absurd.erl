%% @doc Packets of absurd fields: malformed ones, and such as are well formed ({@link
%% starl_packet:source/1}) and yet cannot be true. A pure module.
-module(starl_dev_hostile_absurd).

-export([malformed/2, packet/3, shaped/2]).

%% The types that the machines of a painting team listen to.
-define(TYPES, {
    ballot,
    leader,
    dpp_request,
    dpp_passed,
    dpp_state,
    dpp_here,
    dpp_refused,
    dpp_answer,
    dpp_recover,
    dpp_beat,
    {app, present},
    {app, nobody}
}).

%% @doc A term in a robot's name that is no packet.
-spec malformed(starl:robot_id(), pos_integer()) -> term().
malformed(Robot, N) ->
    element(
        1 + N rem 9,
        {
            {starl, 1, hello, Robot, -N},
            {starl, 1, hello, Robot, N bsl 100},
            {starl, 1, hello, Robot, 1 bsl 59},
            {starl, 2, hello, Robot, 1},
            {starl, 1, data, {Robot, 1, 1, 1, [], app, x}},
            {starl, 1, data, {Robot, 1, 1, {all, 0}, #{}, app, x}},
            {starl, 1, told, Robot, 1, 1, {1, x}},
            {starl, 1, told, Robot, 1, 1, {1 bsl 60, 1}},
            #{starl => N}
        }
    ).

%% @doc A packet in a robot's name to another one. None can be true, whatever the two have sent each
%% other so far.
-spec packet(starl:robot_id(), starl:robot_id(), rand:state()) -> {Packet :: term(), rand:state()}.
packet(By, To, Random0) ->
    {Kind, Random1} = rand:uniform_s(15, Random0),
    {N, Random2} = rand:uniform_s(1 bsl 56, Random1),
    {Body, Random} = body(Random2),
    {Type, Last} = type(Random),
    {packet(Kind, By, To, (1 bsl 57) + N, Type, Body), Last}.

packet(1, By, _To, Huge, _Type, _Body) ->
    starl_packet:hello(By, Huge);
packet(2, By, _To, Huge, _Type, _Body) ->
    starl_packet:ack(By, Huge, Huge, Huge);
packet(3, By, _To, Huge, _Type, _Body) ->
    starl_packet:ack(By, 1, 1, Huge);
packet(4, By, _To, Huge, _Type, _Body) ->
    starl_packet:refusal(By, Huge, Huge, Huge);
packet(5, By, _To, Huge, _Type, _Body) ->
    starl_packet:refusal(By, 1, 1, Huge);
packet(6, By, _To, Huge, _Type, _Body) ->
    starl_packet:ask(By, Huge, {Huge, Huge});
packet(7, By, _To, Huge, _Type, _Body) ->
    starl_packet:told(By, Huge, Huge, {Huge, Huge}, {Huge, Huge});
packet(8, By, _To, Huge, Type, Body) ->
    starl_packet:data({By, Huge, Huge, Huge, #{}, Type, Body});
packet(9, By, _To, Huge, Type, Body) ->
    starl_packet:data({By, 1, Huge, Huge, #{}, Type, Body});
packet(10, By, _To, Huge, Type, Body) ->
    starl_packet:data({By, 1, Huge, {all, Huge}, #{}, Type, Body});
%% for an incarnation that is a list, or another that the robot never had
packet(11, By, To, Huge, Type, Body) ->
    {starl, 1, data, {By, 1, Huge, 1, #{To => [Huge], [] => #{}}, Type, Body}};
packet(12, By, To, Huge, Type, Body) ->
    starl_packet:data({By, 1, Huge, {all, 1}, #{To => Huge}, Type, Body});
packet(_Shout, By, _To, _Huge, Type, Body) ->
    starl_packet:shout(By, Type, Body).

type(Random0) ->
    {Which, Random} = rand:uniform_s(tuple_size(?TYPES), Random0),
    {element(Which, ?TYPES), Random}.

%% Terms that no machine expects: at times the shape of a message, with absurd parts.
body(Random0) ->
    {Size, Random} = rand:uniform_s(8, Random0),
    parts(Size - 1, Random).

parts(0, Random) ->
    part(Random);
parts(Size, Random0) ->
    {Parts, Random} = lists:mapfoldl(
        fun(_, R) -> nested(Size, R) end, Random0, lists:seq(1, Size)
    ),
    {list_to_tuple(Parts), Random}.

nested(Size, Random0) ->
    case rand:uniform_s(3, Random0) of
        {1, Random} -> triple(Random);
        {_, Random} when Size > 6 -> parts(3, Random);
        {_, Random} -> part(Random)
    end.

triple(Random0) ->
    {Parts, Random} = lists:mapfoldl(fun(_, R) -> part(R) end, Random0, [1, 2, 3]),
    {list_to_tuple(Parts), Random}.

part(Random0) ->
    Parts = parts(),
    {Which, Random} = rand:uniform_s(tuple_size(Parts), Random0),
    {element(Which, Parts), Random}.

parts() ->
    {
        [],
        %% an improper list
        binary_to_term(<<131, 108, 1:32, 97, 1, 97, 2>>),
        #{},
        #{#{} => []},
        <<>>,
        <<0:800>>,
        -1,
        1 bsl 60,
        -(1 bsl 400),
        1.0e308,
        -1.0e308,
        {1.0e308, 1.0e308},
        lists:duplicate(30, [{}]),
        deep(40),
        undefined,
        {}
    }.

deep(0) -> [];
deep(N) -> [deep(N - 1)].

%% @doc A datagram of a shape that a machine accepts, with numbers far beyond any that robots count to.
%% They leave room for higher ones: a term of path planning with the largest number of all would be
%% the last.
-spec shaped(starl:robot_id(), rand:state()) -> {starl_packet:t(), rand:state()}.
shaped(By, Random0) ->
    {N, Random1} = rand:uniform_s(1 bsl 56, Random0),
    Bodies = shapes((1 bsl 57) + N),
    {Which, Random} = rand:uniform_s(tuple_size(Bodies), Random1),
    {Type, Body} = element(Which, Bodies),
    {starl_packet:shout(By, Type, Body), Random}.

shapes(Huge) ->
    Term = {Huge, Huge, Huge},
    Id = {Huge, Huge},
    {
        {ballot, {painting, {Huge, Huge}}},
        {leader, {painting, Huge}},
        {dpp_request, {Term, Id, {1.0e9, -1.0e9}, [Huge], -Huge}},
        {dpp_passed, {Term, Id, Huge}},
        {dpp_state, {Term, Id, {standing, {1.0e9, 1.0e9}}, [Huge], {-Huge, Huge, true}}},
        {dpp_state,
            {Term, Id, {moving, Huge, {1.0e9, 1.0e9}, [{{-1.0e9, 1.0e9}, {down, Huge}}]}, [], {
                Huge, Huge, false
            }}},
        {dpp_here, {Term, {Huge, -Huge, true}}},
        {dpp_refused, Term},
        {dpp_answer, {Term, Id, again, [Huge]}},
        {dpp_answer, {Term, Id, {assign, {1.0e9, 1.0e9}, [{{-1.0e9, 1.0e9}, up}]}, [Huge]}},
        {dpp_recover, {Term, -Huge, true}},
        {dpp_beat, {Term, Huge, [{Huge, Huge}]}}
    }.
