%% @doc Collects the content of a simulation's film while the simulation runs.
%% ```
%%   {ok, Camera} = starl_film_camera:start_link(),
%%   {ok, Sim} = starl_sim:start(Scenario, #{observe => starl_film_camera:observer(Camera)}),
%%   ...
%%   Cast = starl_film_camera:stop(Camera)
%% '''
-module(starl_film_camera).
-behaviour(gen_server).

-export([start_link/0, observer/1, cast/1, stop/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

%% Events that may wait.
-define(WAITING, 20000).

-record(camera, {cast = starl_film_cast:new() :: starl_film_cast:t()}).

%% @doc Starts a camera.
-spec start_link() -> gen_server:start_ret().
start_link() -> gen_server:start_link(?MODULE, none, []).

%% @doc The observer for the options of the simulation.
-spec observer(pid()) -> starl_observer:t().
observer(Camera) -> starl_observer:feed(Camera, wait, ?WAITING).

%% @doc What the camera has seen until now.
-spec cast(pid()) -> starl_film_cast:t().
cast(Camera) -> gen_server:call(Camera, cast, infinity).

%% @doc Ends the camera; gives what it has seen.
-spec stop(pid()) -> starl_film_cast:t().
stop(Camera) ->
    Cast = cast(Camera),
    ok = gen_server:stop(Camera),
    Cast.

-spec init(none) -> {ok, #camera{}}.
init(none) -> {ok, #camera{}}.

-spec handle_call(cast | caught_up, gen_server:from(), #camera{}) -> {reply, term(), #camera{}}.
handle_call(cast, _From, #camera{cast = Cast} = Camera) -> {reply, Cast, Camera};
handle_call(caught_up, _From, Camera) -> {reply, ok, Camera}.

-spec handle_cast(term(), #camera{}) -> {noreply, #camera{}}.
handle_cast(_, Camera) -> {noreply, Camera}.

-spec handle_info({starl_news, starl_observer:feed(), starl_observer:delivery()}, #camera{}) ->
    {noreply, #camera{}}.
handle_info({starl_news, Feed, News}, #camera{cast = Cast} = Camera) ->
    ok = starl_observer:done(News, Feed),
    {noreply, Camera#camera{cast = seen(News, Cast)}}.

seen({begun, Facts}, Cast) ->
    starl_film_cast:message({scenario, 0, Facts}, Cast);
seen({judged, Events, _}, Cast) ->
    lists:foldl(
        fun({At, Robot, Machine, Event}, C) ->
            starl_film_cast:message({trace, At, {Robot, Machine, Event}}, C)
        end,
        Cast,
        Events
    );
seen({ended, #{end_us := End} = Ending}, Cast) ->
    starl_film_cast:message({verdicts, End, {ended, Ending}}, Cast);
seen(_Missed, Cast) ->
    Cast.
