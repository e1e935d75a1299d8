%% @doc Reloads as events of a run: at a virtual time, some robots or all switch to new code
%% ({@link starl_reload}). The versions run side by side ({@link starl_version}), so half of a team
%% may run new code. All files are read before the run, so a run stays what its scenario and the
%% code say.
%%
%% A robot on which a reload fails notifies the others, which then go back, too. This notice travels
%% on a channel of its own, in a tenth of a second: the channel is the operator's, not the robots'
%% radio.
-module(starl_run_reloads).

-export([are_entries/1, make/2, sources/1, world/2, strikes/1, news_us/1]).

-export_type([given/0, source/0, t/0]).

%% An entry of the scenario: when, who, what; and for how long the new code is on trial (5 s).
-type given() ::
    {AtMs :: non_neg_integer(), robots(), source()}
    | {AtMs :: non_neg_integer(), robots(), source(), #{trial_ms => non_neg_integer()}}.

-type robots() :: all | starl:robot_id() | [starl:robot_id(), ...].

-type source() :: starl_version:source() | [starl_version:source(), ...].

%% A reload, as the robots know it.
-type t() :: #{
    at_us := non_neg_integer(), robots := [starl:robot_id()], order := starl_reload:order()
}.

-define(NEWS_US, 100000).

%% @doc Are these entries of a scenario?
-spec are_entries(term()) -> boolean().
are_entries([]) -> true;
are_entries([Entry | Entries]) -> is_entry(Entry) andalso are_entries(Entries);
are_entries(_) -> false.

is_entry({AtMs, Robots, Source}) ->
    is_time(AtMs) andalso are_robots(Robots) andalso is_source(Source);
is_entry({AtMs, Robots, Source, #{trial_ms := Ms} = More}) ->
    map_size(More) =:= 1 andalso is_time(Ms) andalso is_entry({AtMs, Robots, Source});
is_entry(_) ->
    false.

is_time(Ms) -> is_integer(Ms) andalso Ms >= 0.

are_robots(all) -> true;
are_robots([_ | _] = Robots) -> lists:all(fun(R) -> is_integer(R) andalso R > 0 end, Robots);
are_robots(Robot) -> is_integer(Robot) andalso Robot > 0.

is_source({Module, _File, Beam}) -> is_atom(Module) andalso is_binary(Beam);
is_source(Module) when is_atom(Module) -> true;
is_source([C | _] = File) when is_integer(C) -> io_lib:printable_unicode_list(File);
is_source([_ | _] = Sources) -> lists:all(fun is_source/1, Sources);
is_source(_) -> false.

%% @doc The reloads of a scenario, in the order of their time, and the code of all versions, which
%% is loaded here. `Parts' has the modules of a robot's machines.
-spec make(starl_run_scenario:t(), #{starl_machine:name() => module()}) ->
    {ok, [t()], [starl_version:code()]} | {error, unicode:chardata()}.
make(#{reloads := []}, _Parts) ->
    {ok, [], []};
make(#{reloads := Given, robots := Team}, Parts) ->
    made(lists:keysort(1, Given), 1, Team, Parts, [], []).

made([], _N, _Team, _Parts, Made, Code) ->
    {ok, lists:reverse(Made), lists:usort(Code)};
made([Entry | Entries], N, Team, Parts, Made, Code) ->
    case reload(Entry, N, Team, Parts) of
        {ok, Reload, New} ->
            made(Entries, N + 1, Team, Parts, [Reload | Made], New ++ Code);
        {error, Why} ->
            {error, io_lib:format("the reload at ~b ms: ~ts", [element(1, Entry), Why])}
    end.

reload({AtMs, Robots, Source}, N, Team, Parts) ->
    reload({AtMs, Robots, Source, #{trial_ms => starl_reload:trial_ms()}}, N, Team, Parts);
reload({AtMs, Robots, Source, #{trial_ms := Ms}}, N, Team, Parts) ->
    case {[R || R <- chosen(Robots, Team), R > Team], order(N, Source, Parts, Ms)} of
        {[R | _], _} ->
            {error, io_lib:format("there is no robot ~b", [R])};
        {[], {ok, Order, Code}} ->
            At = 1000 * AtMs,
            {ok, #{at_us => At, robots => chosen(Robots, Team), order => Order}, Code};
        {[], {error, _} = Error} ->
            Error
    end.

chosen(all, Team) -> lists:seq(1, Team);
chosen(Robots, _Team) when is_list(Robots) -> lists:usort(Robots);
chosen(Robot, _Team) -> [Robot].

order(N, Source, Parts, TrialMs) ->
    case starl_reload:order(N, sources(Source), Parts, TrialMs) of
        {ok, Order, Code} -> loaded(starl_version:load(Code), Order, Code);
        {error, Reason} -> {error, hd(starl_reload:format_error(Reason))}
    end.

%% @doc The sources of a reload.
-spec sources(source()) -> [starl_version:source()].
sources([C | _] = File) when is_integer(C) -> [File];
sources([_ | _] = Sources) -> Sources;
sources(Source) -> [Source].

loaded(ok, Order, Code) -> {ok, Order, Code};
loaded({error, _} = Error, _Order, _Code) -> Error.

%% @doc What the robots know of the reloads.
-spec world([t()], #{starl_machine:name() => module()}) -> map().
world([], Parts) ->
    #{parts => Parts};
world(Reloads, Parts) ->
    ByNumber = [{N, R} || #{order := #{number := N}} = R <- Reloads],
    #{reloads => maps:from_list(ByNumber), parts => Parts}.

%% @doc The events of the robots.
-spec strikes([t()]) -> [{starl:robot_id(), non_neg_integer(), {reload, pos_integer()}}].
strikes(Reloads) ->
    [
        {Robot, At, {reload, N}}
     || #{at_us := At, robots := Robots, order := #{number := N}} <- Reloads, Robot <- Robots
    ].

%% @doc The time that the news of a failure takes: no less than a window.
-spec news_us(Window :: pos_integer()) -> pos_integer().
news_us(Window) -> max(?NEWS_US, Window).
