%% @doc The interface of geocast: it sends a message to every robot inside an area.
%% ```
%%   ok = starl_geocast:listen(Robot, warning),
%%   ok = starl_geocast:send(Robot, {circle, {3000.0, 3000.0}, 1500.0}, warning, Body,
%%                           #{lifetime_ms => 5000}),
%%   {ok, From, Body} = starl:await(Robot, warning)
%% '''
%% The window of a message is from its sending, t0, to t0 + its lifetime. Guarantee: a robot that is
%% outside the area during the whole window never gets the message. No robot gets it after the
%% window, or twice. A robot that is inside during the whole window gets it, over several hops, when
%% packets get through. For the assumptions see {@link starl_geocast_flood}.
-module(starl_geocast).
-behaviour(starl_block).

-export([send/5, listen/2]).
-export([
    options/0,
    machines/1,
    monitors/2,
    guarantees/0,
    propositions/0,
    contract/0,
    exercise/0,
    models/0,
    benchmark/0
]).

-export_type([area/0, id/0, options/0]).

%% A circle, an axis-parallel rectangle or a polygon; millimetres.
-type area() :: starl_geocast_area:area().

%% A message: its source, the incarnation of the source's machine, and a sequence number.
-type id() :: {starl:robot_id(), Incarnation :: pos_integer(), N :: pos_integer()}.

%% `lifetime_ms': the time during which the message may be delivered (default 5000, at most a day).
%% `hops': the most transmissions over which it may travel (default 32).
-type options() :: #{lifetime_ms => pos_integer(), hops => pos_integer()}.

-define(SEND, {?MODULE, send, 5}).

%% A message's lifetime, and the smallest part of it that the checker distinguishes.
-define(CAST_US, 400000).
-define(TICK_US, 50000).
%% Parts of a hundred: the ratio is the default bound on drift, 10000 ppm.
-define(SLOW, 99).
-define(FAST, 101).

%% @doc Sends a message to all robots inside an area, this robot included, and does not wait for
%% them. `full': too many geocasts are alive. A term that is not an area, or an unknown option, is
%% the caller's mistake.
-spec send(starl:robot(), area(), Type :: atom(), Body :: term(), options()) ->
    ok | {error, full | restarted}.
send(Robot, Area, Type, Body, Options) ->
    ok = checked(starl_geocast_area:check(Area), Area),
    ok = starl_caller:check(?SEND, 'Type', name, Type),
    ok = starl_caller:payload(?SEND, 'Body', content, {Area, Body}),
    ok = known(Options),
    Lifetime = maps:get(lifetime_ms, Options, 5000),
    ok = starl_caller:check(?SEND, lifetime_ms, positive_ms, Lifetime),
    ok = at_most_a_day(Lifetime),
    Hops = maps:get(hops, Options, 32),
    ok = starl_caller:check(?SEND, hops, number, Hops),
    case starl:call(Robot, geocast, {send, Area, Type, Body, Lifetime * 1000, Hops}, infinity) of
        {ok, Answer} -> Answer;
        {error, restarted} -> {error, restarted}
    end.

%% @doc Subscribes the application to geocasts of this type; {@link starl:await/2} returns them. It
%% also gets those that are still alive here. Call it again after `{error, restarted}'; the option
%% `listeners' survives restarts.
-spec listen(starl:robot(), Type :: atom()) -> ok.
listen(_Robot, Type) ->
    ok = starl_caller:check({?MODULE, listen, 2}, 'Type', name, Type),
    starl_app_turn:perform([{cast, geocast, {listen, Type, app}}]).

at_most_a_day(Ms) ->
    case 1000 * Ms =< starl_geocast_lifetime:longest_us() of
        true -> ok;
        false -> starl_caller:mistake(?SEND, lifetime_ms, Ms, "at most a day: 86400000 ms")
    end.

checked(ok, _Area) ->
    ok;
checked({error, Reason}, Area) ->
    starl_caller:mistake(?SEND, 'Area', Area, starl_geocast_area:format_error(Reason)).

known(Options) ->
    case is_map(Options) andalso maps:without([lifetime_ms, hops], Options) =:= #{} of
        true -> ok;
        false -> starl_caller:mistake(?SEND, 'Options', Options, "a map of lifetime_ms and hops")
    end.

%% -- the block ------------------------------------------------------------------------------

-spec options() -> [starl_options:option()].
options() ->
    [
        {position_error_mm, {number, 0, 100000}, 2.0, "the greatest error of a position, mm"},
        {drift_ppm, {integer, 0, 100000}, 10000, "the greatest drift of a clock, ppm"},
        {first_ms, {integer, 1, 1000000}, 50, "the first wait before an offer is repeated, ms"},
        {longest_ms, {integer, 1, 1000000}, 1000,
            "the longest wait before an offer is repeated, ms"},
        {jitter_ms, {integer, 0, 1000000}, 5,
            "a relay waits up to this before its first offer, ms"},
        {ask_ms, {integer, 1, 1000000}, 100,
            "the wait for a message before it is asked for again, ms"},
        {gather_ms, {integer, 0, 1000000}, 3,
            "the wait for other robots that ask for the same message, ms"},
        {check_ms, {integer, 1, 1000000}, 250,
            "the time between two checks whether a robot has come into an area, ms"},
        {limit, {integer, 1, 1000000}, 256, "the most messages that a robot knows at a time"},
        {listeners, {term, "a map of types and machines, as #{news => app}", fun is_map/1}, #{},
            "who listens from the start on, also after a restart"},
        {all_listen, boolean, false,
            "everything that is sent has a listener: then delivery is judged, too"}
    ].

-spec machines(starl_block:options()) -> [starl_robot_sup:machine()].
machines(Options) -> [{geocast, starl_geocast_flood, maps:remove(all_listen, Options)}].

-spec monitors(starl_block:options(), starl_block:context()) -> [{module(), map()}].
monitors(#{position_error_mm := Error, drift_ppm := Ppm, all_listen := All} = Options, Context) ->
    #{first_ms := First, longest_ms := Longest} = Options,
    [
        {starl_geocast_monitor, #{
            robots => maps:get(robots, Context),
            progress => All,
            margin_mm => 2.0 * Error,
            drift_ppm => Ppm,
            offers_us => {1000 * First, 1000 * max(First, Longest)}
        }}
    ].

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {inside, safety, "never delivered outside the area or after its time", [
            positions, clock_rate, clock_set
        ]},
        {once, safety,
            "at most once in each life of a robot's machine, whatever clocks do; never changed",
            []},
        {once_ever, safety, "at most once per robot, over restarts too", [clock_rate, clock_set]},
        {delivered, progress,
            "delivered to every robot that is inside all the time, over several hops", [
                delivery, positions, clock_rate, clock_set, no_restart
            ]}
    ].

-spec propositions() -> [starl_guarantee:proposition()].
propositions() ->
    [
        {"Geocast, exclusion", inside, [too_late, outside]},
        {"Geocast, delivery", delivered, [not_delivered]}
    ].

-spec contract() -> string().
contract() -> "never delivered outside the area or after its time, and at most once".

-spec exercise() -> module().
exercise() -> starl_geocast_exercise.

-spec models() -> [starl_block:model_entry()].
models() ->
    Doc = "a message to an area and its lifetime, with drifting clocks",
    [{geocast, Doc, fun model/1}].

%% A geocast is offered after 0, 50, 150, 350, 750, 1550, … ms, a hundredth of its lifetime left for
%% the drift of clocks: nine times in five seconds.
-spec benchmark() -> starl_block:benchmark().
benchmark() ->
    #{
        workload => #{turns => 1, lifetime => 5000, work => 20},
        operations => sent,
        packets => fun(N) -> 9 * N + N end,
        formula => "9 N offers, N - 1 questions, an answer"
    }.

%% -- the model --------------------------------------------------------------------------------

%% The model of geocast for the exhaustive checker: one message to an area that all robots are
%% in, its lifetime, and its window. The source's clock is the true one; the second robot's clock is
%% slow, so it holds the message for longest; the others are fast.

%% The model for a team.
-spec model(starl_block:team()) -> starl_block:model().
model(#{robots := Ids}) ->
    Config = #{
        jitter_ms => 0,
        gather_ms => 0,
        check_ms => ?CAST_US div 2000,
        listeners => #{note => app}
    },
    #{
        blocks => [{geocast, starl_geocast_flood, Config}],
        stands => [location],
        script => fun script/1,
        crash => [geocast],
        monitor => {starl_geocast_model_monitor, #{robots => Ids, lifetime_us => ?CAST_US}},
        timed => [offer, give, ask, over, forget, check, window],
        rates => list_to_tuple([rate(Place) || Place <- places(Ids)]),
        grain => 2,
        horizon_us => 2 * ?CAST_US,
        past_us => 2 * ?CAST_US,
        fixed => places(Ids)
    }.

places(Ids) -> lists:seq(1, length(Ids)).

%% All robots are inside.
script(1) ->
    Area = {circle, {0.0, 0.0}, 1.0e6},
    [{'try', geocast, {send, Area, note, hello, ?CAST_US, 8}}, {window, ?CAST_US}];
script(_) ->
    [].

rate(1) -> ?TICK_US;
rate(2) -> ?TICK_US * ?SLOW div 100;
rate(_) -> ?TICK_US * ?FAST div 100.
