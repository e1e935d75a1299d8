%% @doc Geocast: a message to every robot inside an area. The interface.
%% ```
%%   ok = starl_geocast:listen(Robot, warning),
%%   ok = starl_geocast:send(Robot, {circle, {3000.0, 3000.0}, 1500.0}, warning, Body,
%%                           #{lifetime_ms => 5000}),
%%   {ok, From, Body} = starl:await(Robot, warning)
%% '''
%% The window of a message is from its sending, t0, to t0 + its lifetime. Guarantee: whoever is
%% outside the area during the whole window never gets it; nobody gets it after the window, and
%% nobody twice; whoever is inside during the whole window gets it, over several hops, when
%% packets get through. What that rests on stands in {@link starl_geocast_flood}.
-module(starl_geocast).

-export([block/0, block/1, send/5, listen/2]).

-export_type([area/0, options/0]).

%% A circle, an axis-parallel rectangle or a polygon; millimetres.
-type area() :: starl_geocast_area:area().

%% `lifetime_ms': how long the message may be delivered (default 5000); `hops': over how many
%% transmissions it may travel (default 32).
-type options() :: #{lifetime_ms => pos_integer(), hops => pos_integer()}.

-define(SEND, {?MODULE, send, 5}).

%% @doc The machine that a robot needs to send, relay and receive geocasts.
-spec block() -> starl_robot_sup:machine().
block() -> block(#{}).

%% @doc The same with a configuration of its own.
-spec block(starl_geocast_flood:config()) -> starl_robot_sup:machine().
block(Config) -> {geocast, starl_geocast_flood, Config}.

%% @doc Sends a message to all robots inside an area, this one included, and does not wait for
%% them. `full': too many geocasts are alive. A term that is no area, or an option that is none,
%% is the caller's mistake.
-spec send(starl:robot(), area(), Type :: atom(), Body :: term(), options()) ->
    ok | {error, full | restarted}.
send(Robot, Area, Type, Body, Options) ->
    ok = checked(starl_geocast_area:check(Area), Area),
    ok = starl_caller:check(?SEND, 'Type', name, Type),
    ok = known(Options),
    Lifetime = maps:get(lifetime_ms, Options, 5000),
    ok = starl_caller:check(?SEND, lifetime_ms, positive_ms, Lifetime),
    Hops = maps:get(hops, Options, 32),
    ok = starl_caller:check(?SEND, hops, number, Hops),
    case starl:call(Robot, geocast, {send, Area, Type, Body, Lifetime * 1000, Hops}, infinity) of
        {ok, Answer} -> Answer;
        {error, restarted} -> {error, restarted}
    end.

%% @doc From now on geocasts of this type come to the application ({@link starl:await/2}), those
%% included that are still alive here. To be called again after `{error, restarted}'; a
%% configuration with `listeners' outlives restarts.
-spec listen(starl:robot(), Type :: atom()) -> ok.
listen(_Robot, Type) ->
    ok = starl_caller:check({?MODULE, listen, 2}, 'Type', name, Type),
    starl_app_proc:perform([{cast, geocast, {listen, Type, app}}]).

checked(ok, _Area) ->
    ok;
checked({error, Reason}, Area) ->
    starl_caller:mistake(?SEND, 'Area', Area, starl_geocast_area:format_error(Reason)).

known(Options) ->
    case is_map(Options) andalso maps:without([lifetime_ms, hops], Options) =:= #{} of
        true -> ok;
        false -> starl_caller:mistake(?SEND, 'Options', Options, "a map of lifetime_ms and hops")
    end.
