%% @doc A team that uses building blocks in turns while one of its robots, the insider, sends messages
%% of its own choice to the others' machines. `./starl hostile --insider' runs it.
%%
%% A turn begins at each multiple of the period, by the clock, or in the quarter after it; so robots that have restarted are back in
%% time for the next one. Each robot then uses each block once, in a way that needs the others, and traces
%% the outcome: `{used, Block, Turn, Outcome}'. With the block `dpp' the team paints instead.
%%
%% The insider sends in its own name, in the time `window' of its first life, and takes part in all turns.
-module(starl_hostile_insider).
%% It also has the callbacks of `starl_app'; it is no application that is offered to run.
-behaviour(starl_scene).
-behaviour(starl_machine).

-export([options/0, scene/1]).
-export([init/1, init/2, step/2, handle_event/5]).

-export_type([message/0, event/0]).

%% A message to all others, or a packet.
-type message() ::
    {starl_packet:type(), Body :: term()}
    | {packet, To :: starl:robot_id(), starl_packet:t()}.

-type event() :: {used, Block :: atom(), Turn :: integer(), Outcome :: term()}.

-type state() :: #{blocks := [atom()], period := pos_integer(), last := integer()}.

%% The patience of calls; the time in which all learn what all have written; between two looks.
-define(PATIENCE_MS, 9000).
-define(SHARED_MS, 8000).
-define(LOOK_MS, 500).

-spec options() -> [starl_options:option()].
options() ->
    [
        {blocks, {term, "a list of blocks", fun is_list/1}, [], "the blocks that are used"},
        {messages, {term, "a list", fun is_list/1}, [], "what the insider sends"},
        {insider, {integer, 0, 1000}, 0, "the robot that sends it; 0: none"},
        {window, {term, "{FromMs, ToMs}", fun is_tuple/1}, {0, 0}, "when it sends"},
        {period, {integer, 1000, 1000000}, 20000, "the time between two turns, ms"},
        {contracts, boolean, true, "whether the blocks' contracts judge the run, and so end it"}
        | starl_painting:options()
    ].

-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(#{options := #{contracts := Contracts} = Options} = Context) ->
    case used(Options, Context) of
        {ok, #{blocks := Blocks} = Scene} when Contracts ->
            {ok, Scene#{blocks := Blocks ++ [insider(Options)]}};
        {ok, #{blocks := Blocks} = Scene} ->
            {ok, {Machines, _Contracts}} = starl_block:expand(Blocks, Context),
            {ok, Scene#{blocks := Machines ++ [insider(Options)], monitors => []}};
        {error, _} = Error ->
            Error
    end.

used(#{blocks := [dpp]} = Options, Context) ->
    Own = [blocks, messages, insider, window, period, contracts],
    starl_painting:scene(Context#{options := maps:without(Own, Options)});
used(#{blocks := Names, period := Period}, _Context) ->
    {ok, #{
        app => {sequential, ?MODULE, #{blocks => Names, period => Period}},
        sap => #{limit => 6},
        blocks => [Block || Name <- Names, Block <- block(Name)]
    }}.

insider(Options) -> {insider, ?MODULE, maps:with([messages, insider, window], Options)}.

block(Name) ->
    {ok, Block} = starl_block_catalogue:find(Name),
    [{Block, own_options(Name)} || Block:machines(defaults(Block, own_options(Name))) =/= []].

own_options(mutex) -> #{lease_ms => 1000};
own_options(geocast) -> #{listeners => #{news => app}, position_error_mm => 400.0};
own_options(_Name) -> #{}.

defaults(Block, Own) ->
    maps:merge(maps:from_list([{Key, Value} || {Key, _, Value, _} <- Block:options()]), Own).

%% -- the machine of the insider -------------------------------------------------------------

-spec init(starl_machine:config()) -> {sending | quiet, list(), [starl_machine:action()]}.
init(
    #{robot := Robot, insider := Robot, incarnation := 1, messages := [_ | _] = Messages} = Config
) ->
    #{window := {From, To}} = Config,
    Gap = max(1, 1000 * (To - From) div length(Messages)),
    {sending, [Gap | Messages], [{{timeout, next}, 1000 * From, next}]};
init(_Config) ->
    {quiet, [], []}.

-spec handle_event(starl_machine:event_type(), term(), sending | quiet, list(), map()) ->
    starl_machine:result().
handle_event({timeout, next}, _, sending, [_Gap], _Meta) ->
    keep_state_and_data;
handle_event({timeout, next}, _, sending, [Gap, Message | Rest], _Meta) ->
    {keep_state, [Gap | Rest], sent(Message) ++ [{{timeout, next}, Gap, next}]};
handle_event(_, _, _, _, _) ->
    keep_state_and_data.

sent({packet, To, Packet}) -> [{transmit, To, Packet}];
sent({Type, Body}) -> [{cast, sap, {broadcast, Type, Body}}, starl_sap:shout(Type, Body)].

%% -- the honest use -------------------------------------------------------------------------

-spec init(starl:robot(), #{blocks := [atom()], period := pos_integer()}) -> state().
init(Robot, #{blocks := Blocks} = Given) ->
    _ = [starl:listen(Robot, word) || lists:member(sap, Blocks)],
    _ = [starl_geocast:listen(Robot, news) || lists:member(geocast, Blocks)],
    Given#{last => -1}.

-spec step(starl:robot(), state()) -> {continue, state()}.
step(Robot, #{blocks := Blocks, period := Period, last := Last} = State) ->
    Now = starl:now(Robot),
    Turn = Now div Period,
    case Turn =/= Last andalso Now rem Period =< Period div 4 of
        true ->
            _ = [used(Block, Robot, Turn) || Block <- Blocks],
            {continue, State#{last := Turn}};
        false ->
            ok = starl:sleep(Robot, Period - Now rem Period),
            {continue, State}
    end.

used(Block, Robot, Turn) ->
    starl:trace(Robot, {used, Block, Turn, use(Block, Turn, Robot)}).

%% What the insider has sent fills the inbox.
use(sap, Turn, Robot) ->
    ok = read(Robot),
    Sent = starl:broadcast(Robot, word, Turn),
    ok = read(Robot),
    Sent;
use(Election, Turn, Robot) when Election =:= election; Election =:= bully ->
    starl_election:elect(Robot, {honest, Turn}, ?PATIENCE_MS);
use(mutex, _Turn, Robot) ->
    Tokens = [{honest, N} || N <- [1, 2, 3, 4]],
    case starl_mutex:acquire(Robot, Tokens, ?PATIENCE_MS) of
        {ok, _} -> starl_mutex:release(Robot, Tokens);
        {error, _} = Error -> Error
    end;
use(barrier, _Turn, Robot) ->
    starl_barrier:sync(Robot, honest, ?PATIENCE_MS);
use(geocast, Turn, Robot) ->
    Area = {circle, {0.0, 0.0}, 1.0e6},
    ok = starl:sleep(Robot, ?LOOK_MS),
    _ = starl_geocast:send(Robot, Area, news, {honest, Turn}, #{}),
    heard(lists:delete(starl:id(Robot), starl:participants(Robot)), Turn, Robot);
use(registers, Turn, Robot) ->
    case starl_registers:put(Robot, {honest, starl:id(Robot)}, Turn) of
        ok -> all_read(Turn, Robot, starl:now(Robot) + ?SHARED_MS);
        {error, _} = Error -> Error
    end;
use(counter, _Turn, Robot) ->
    _ = starl_counter:increment(Robot),
    ok = starl:sleep(Robot, ?SHARED_MS),
    starl_counter:value(Robot);
use(_Block, _Turn, _Robot) ->
    ok.

read(Robot) ->
    case starl:await(Robot, word, ?LOOK_MS) of
        {ok, _, _} -> read(Robot);
        timeout -> ok
    end.

%% What the insider has sent may come before.
heard([], _Turn, _Robot) ->
    ok;
heard(From, Turn, Robot) ->
    case starl:await(Robot, news, ?SHARED_MS) of
        {ok, Robot2, {honest, Turn}} -> heard(lists:delete(Robot2, From), Turn, Robot);
        {ok, _, _} -> heard(From, Turn, Robot);
        timeout -> {error, {not_heard, From}}
    end.

all_read(Turn, Robot, Until) ->
    Read = fun(R) -> starl_registers:get(Robot, {honest, R}) end,
    Others = [R || R <- starl:participants(Robot), Read(R) =/= {ok, Turn}],
    case {Others, starl:now(Robot) < Until} of
        {[], _} ->
            ok;
        {_, true} ->
            ok = starl:sleep(Robot, ?LOOK_MS),
            all_read(Turn, Robot, Until);
        {_, false} ->
            {error, {not_read, Others}}
    end.
