%% Messages that no robot's machine would send, at machines that take messages: an application
%% whose robot 1 sends those of the option `messages' in the names of its machines, to everybody and
%% to itself, and then, like all others, uses the block in the ordinary way. Its result is what
%% that came to. With the block `dpp' the team paints.
-module(starl_hostile_planted).
-behaviour(starl_app).
-behaviour(starl_scene).
-behaviour(starl_machine).

-export([options/0, scene/1]).
-export([init/1, init/2, step/2, handle_event/5]).

-define(QUIET_MS, 8000).

options() ->
    [
        {block, {term, "a block", fun is_atom/1}, election, "the block"},
        {messages, {term, "a list", fun is_list/1}, [], "{Type, Body}, sent or shouted"}
        | [O || O <- starl_painting:options(), element(1, O) =/= block]
    ].

scene(#{options := #{block := dpp, messages := Messages} = Options} = Context) ->
    Painting = maps:without([block, messages], Options),
    Known = Context#{options := Painting},
    {ok, #{blocks := Blocks} = Scene} = starl_painting:scene(Known),
    %% what is forged breaks contracts: only their machines
    {ok, {Machines, _Contracts}} = starl_block:expand(Blocks, Known),
    {ok, Scene#{blocks := Machines ++ [hostile(Messages)], monitors => []}};
scene(#{options := #{block := Block, messages := Messages}}) ->
    {ok, #{
        app => {sequential, ?MODULE, Block},
        sap => #{limit => 3},
        blocks => blocks(Block) ++ [hostile(Messages)]
    }}.

hostile(Messages) -> {hostile, ?MODULE, #{messages => Messages}}.

blocks(election) -> starl_election:machines(#{});
blocks(bully) -> starl_bully:machines(#{});
blocks(mutex) -> starl_mutex:machines(#{lease_ms => 1000});
blocks(barrier) -> starl_barrier:machines(#{});
blocks(registers) -> starl_registers:machines(#{});
blocks(geocast) -> starl_geocast:machines(#{}).

%% -- the machine that sends them ------------------------------------------------------------

init(#{robot := 1, messages := Messages}) -> {sending, Messages, [{{timeout, next}, 0, next}]};
init(_Config) -> {quiet, [], []}.

handle_event({timeout, next}, _, sending, [], _Meta) ->
    keep_state_and_data;
handle_event({timeout, next}, _, sending, [{Type, Body} | Rest], _Meta) ->
    {keep_state, Rest, [
        starl_sap:post(1, Type, Body),
        {cast, sap, {broadcast, Type, Body}},
        starl_sap:shout(Type, Body),
        {{timeout, next}, 100000, next}
    ]};
handle_event(_, _, _, _, _) ->
    keep_state_and_data.

%% -- the honest use -------------------------------------------------------------------------

init(Robot, Block) ->
    [starl_geocast:listen(Robot, news) || Block =:= geocast],
    Block.

step(Robot, Block) ->
    starl:sleep(Robot, ?QUIET_MS),
    {done, use(Block, Robot)}.

use(Block, Robot) when Block =:= election; Block =:= bully ->
    {elected, element(1, starl_election:elect(Robot, honest, 20000))};
use(mutex, Robot) ->
    case starl_mutex:acquire(Robot, honest, 30000) of
        {ok, _} -> starl_mutex:release(Robot, honest);
        {error, _} = Error -> Error
    end;
use(barrier, Robot) ->
    starl_barrier:sync(Robot, honest, 20000);
use(registers, Robot) ->
    Self = starl:id(Robot),
    ok = starl_registers:put(Robot, {honest, Self}, Self),
    starl:sleep(Robot, 10000),
    Read = [starl_registers:get(Robot, {honest, R}) || R <- starl:participants(Robot)],
    case Read =:= [{ok, R} || R <- starl:participants(Robot)] of
        true -> ok;
        false -> Read
    end;
use(geocast, Robot) ->
    Area = {circle, {0.0, 0.0}, 1.0e6},
    %% more than were forged: one that was forged under the name of a true one takes its place
    _ = [
        starl_geocast:send(Robot, Area, news, honest, #{})
     || starl:id(Robot) =:= 2, _ <- lists:seq(1, 30)
    ],
    heard(Robot).

%% What was forged well may come before.
heard(Robot) ->
    case starl:await(Robot, news, 10000) of
        {ok, 2, honest} -> ok;
        {ok, _, _} -> heard(Robot);
        timeout -> timeout
    end.
