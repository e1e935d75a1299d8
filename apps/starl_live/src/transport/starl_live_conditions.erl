%% @doc The conditions under which a robot hears packets, for tests and for clusters on one computer.
%% They are loss, delay, duplicates and cut links on any transport, and disturbances of single links. The
%% settings can be changed while the robot runs. The random choices come from a seed.
-module(starl_live_conditions).

-export([new/1, set/2, pass/2, is_cut/2]).

-export_type([t/0, settings/0, disturbance/0]).

%% What happens to this fraction of the packets of a robot: they are lost; they are heard so many times
%% more; they are up to so much later.
-type disturbance() ::
    {lost, Fraction :: number()}
    | {again, Fraction :: number(), Times :: pos_integer()}
    | {late, Fraction :: number(), {LeastMs :: non_neg_integer(), MostMs :: non_neg_integer()}}.

%% `loss' and `duplicates': probabilities; `delay_ms': lowest and highest, in real time; `cut': the
%% robots that cannot be heard; `disturbed': what happens on the links from some robots. Settings that are
%% not given stay as they are.
-type settings() :: #{
    loss => number(),
    duplicates => number(),
    delay_ms => {Low :: non_neg_integer(), High :: non_neg_integer()},
    cut => [starl:robot_id()],
    disturbed => #{starl:robot_id() => [disturbance()]},
    seed => integer()
}.

-record(conditions, {
    loss = 0 :: number(),
    duplicates = 0 :: number(),
    delay_ms = {0, 0} :: {non_neg_integer(), non_neg_integer()},
    cut = [] :: [starl:robot_id()],
    disturbed = #{} :: #{starl:robot_id() => [disturbance()]},
    random :: rand:state()
}).

-opaque t() :: #conditions{}.

%% @doc Nothing is disturbed, but for these settings.
-spec new(settings()) -> {ok, t()} | {error, unicode:chardata()}.
new(Settings) ->
    set(Settings, #conditions{random = rand:seed_s(exsss, maps:get(seed, Settings, 0))}).

%% @doc Changes these settings; on a mistake, none.
-spec set(settings(), t()) -> {ok, t()} | {error, unicode:chardata()}.
set(Settings, Conditions) ->
    case starl_options:check(Settings, options(Conditions)) of
        {ok, Complete} -> {ok, changed(Complete, Conditions)};
        {error, Problems} -> {error, lists:join("; ", [text(Problem) || Problem <- Problems])}
    end.

text(Problem) -> ["air: ", starl_options:format_problem(Problem)].

options(
    #conditions{loss = Loss, duplicates = Duplicates, delay_ms = Delay, cut = Cut} = Conditions
) ->
    [
        {disturbed, {term, "what disturbs the links from robots", fun is_map/1},
            Conditions#conditions.disturbed, "what happens on the links from some robots"},
        {loss, {number, 0, 1}, Loss, "part of the packets that are lost"},
        {duplicates, {number, 0, 1}, Duplicates, "part of the packets that are heard twice"},
        {delay_ms, {between, {integer, 0, 60_000}}, Delay, "delay of packets, in ms"},
        {cut, {term, "a list of robots", fun robots/1}, Cut, "robots that cannot be heard"},
        {seed, {optional, {integer, -(1 bsl 58), 1 bsl 58}}, none, "seed of the chance"}
    ].

robots(Robots) -> is_list(Robots) andalso lists:all(fun is_integer/1, Robots).

changed(
    #{loss := Loss, duplicates := Duplicates, delay_ms := Delay, seed := Seed} = Given, Conditions
) ->
    #{cut := Cut, disturbed := Disturbed} = Given,
    Random =
        case Seed of
            none -> Conditions#conditions.random;
            _ -> rand:seed_s(exsss, Seed)
        end,
    #conditions{
        loss = Loss,
        duplicates = Duplicates,
        delay_ms = Delay,
        cut = Cut,
        disturbed = Disturbed,
        random = Random
    }.

%% @doc When a robot's packet is heard, in milliseconds from now: never, once or twice.
-spec pass(From :: starl:robot_id(), t()) -> {[DelayMs :: non_neg_integer()], t()}.
pass(
    _From, #conditions{loss = Loss, duplicates = Twice, delay_ms = {0, 0}, cut = []} = Conditions
) when
    Loss == 0, Twice == 0, map_size(Conditions#conditions.disturbed) =:= 0
->
    {[0], Conditions};
pass(From, #conditions{loss = Loss, duplicates = Twice, cut = Cut, random = Random0} = Conditions) ->
    %% Always the same number of draws: what one packet meets does not hang on the settings that
    %% others met.
    {Lost, Random1} = rand:uniform_s(Random0),
    {Doubled, Random2} = rand:uniform_s(Random1),
    {Once, Random3} = delay(Conditions, Random2),
    {Again, Random4} = delay(Conditions, Random3),
    Next = Conditions#conditions{random = Random4},
    case Lost < Loss orelse lists:member(From, Cut) of
        true -> {[], Next};
        false when Doubled < Twice -> disturbed(From, [Once, Again], Next);
        false -> disturbed(From, [Once], Next)
    end.

disturbed(From, Delays, #conditions{disturbed = Disturbed, random = Random} = Conditions) ->
    {Left, Next} = lists:foldl(
        fun disturb/2, {Delays, Random}, maps:get(From, Disturbed, [])
    ),
    {Left, Conditions#conditions{random = Next}}.

disturb(Disturbance, {Delays, Random0}) ->
    {Drawn, Random} = rand:uniform_s(Random0),
    case Drawn < element(2, Disturbance) of
        true -> disturbed_by(Disturbance, Delays, Random);
        false -> {Delays, Random}
    end.

disturbed_by({lost, _Fraction}, _Delays, Random) ->
    {[], Random};
disturbed_by({again, _Fraction, Times}, Delays, Random) ->
    {Delays ++ lists:append(lists:duplicate(Times, lists:sublist(Delays, 1))), Random};
disturbed_by({late, _Fraction, {Least, Most}}, Delays, Random0) ->
    {Part, Random} = rand:uniform_s(Random0),
    {[Delay + Least + trunc(Part * (Most - Least + 1)) || Delay <- Delays], Random}.

%% @doc Whether a robot cannot be heard at all.
-spec is_cut(From :: starl:robot_id(), t()) -> boolean().
is_cut(From, #conditions{cut = Cut}) -> lists:member(From, Cut).

delay(#conditions{delay_ms = {Low, High}}, Random0) ->
    {Part, Random} = rand:uniform_s(Random0),
    {Low + trunc(Part * (High - Low + 1)), Random}.
