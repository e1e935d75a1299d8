%% @doc The link conditions between live robots in virtual time. Datagrams are lost, doubled,
%% delayed and damaged like the simulator's packets ({@link starl_sim_radio}). An attacker sends
%% some of them again, to any robot. A pure module; all draws are stateless.
-module(starl_virtual_air).

-export([arrivals/5]).

-export_type([arrival/0]).

%% A datagram for a robot.
-type arrival() :: {starl:robot_id(), AtUs :: integer(), binary()}.

%% The part of the datagrams that the attacker sends again, and after what time at most.
-define(PLAYED, 0.02).
-define(PLAYED_US, 40000000).

%% @doc What arrives of a robot's N-th datagram to another, among this many robots.
-spec arrivals({From, To, N :: pos_integer()}, binary(), Robots, NowUs, World) -> [arrival()] when
    From :: starl:robot_id(),
    To :: starl:robot_id(),
    Robots :: pos_integer(),
    NowUs :: integer(),
    World :: starl_sim_world:t().
arrivals({From, To, N}, Bytes, Robots, Now, #{seed := Seed} = World) ->
    Link = {Seed, From, To, N},
    Heard =
        case starl_sim_radio:arrivals(Link, Now, World) of
            lost -> [];
            Arrivals -> Arrivals
        end,
    [{To, Now + Us, state(State, Bytes, {Link, Us})} || {Us, State} <- Heard] ++
        played(Link, Bytes, Robots, Now).

state(intact, Bytes, _Key) ->
    Bytes;
state(corrupt, Bytes, Key) ->
    Bit = starl_run_draw:between({Key, bit}, 0, 8 * byte_size(Bytes) - 1),
    case starl_run_draw:between({Key, how}, 1, 4) of
        1 ->
            binary:part(Bytes, 0, Bit div 8);
        _ ->
            <<Before:Bit, B:1, After/bits>> = Bytes,
            <<Before:Bit, (1 - B):1, After/bits>>
    end.

%% An attacker has recorded the datagram, and sends it to some robot.
played(Link, Bytes, Robots, Now) ->
    case starl_run_draw:uniform({Link, played}) < ?PLAYED of
        true ->
            At = Now + starl_run_draw:between({Link, played_at}, 1, ?PLAYED_US),
            [{starl_run_draw:between({Link, played_to}, 1, Robots), At, Bytes}];
        false ->
            []
    end.
