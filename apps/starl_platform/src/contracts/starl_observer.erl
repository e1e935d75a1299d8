%% @doc What a run tells an observer, such as a recording or a window onto the team: its facts at the
%% beginning, all trace events in the order in which the monitors get them, violations, and its end.
%%
%% An observer is a function that the judge of the run calls, so it only passes the news on. A
%% simulation waits for it, a live run does not.
-module(starl_observer).

-export([tell/2, all/1, is_packet/1]).

-export_type([t/0, news/0, facts/0, ending/0, packet/0, fate/0]).

%% `none': nobody observes.
-type t() :: fun((news()) -> ok) | none.

%% `begun' comes first, `ended' last.
-type news() ::
    {begun, facts()}
    | {judged, [starl_monitor:trace_event()], [starl_monitor:violation()]}
    | {ended, ending()}.

%% The facts of a run. `scenario' holds all values with the faults that were drawn; `monitors' are
%% those of its contracts, ready to judge; `epoch_us' is the system time of the run's time 0.
-type facts() :: #{
    kind := simulation | live,
    app := module(),
    scenario := map(),
    robots := [{starl:robot_id(), starl:pose()}],
    monitors := [{module(), map()}],
    machines := #{starl_machine:name() => module()},
    waypoints := #{atom() => starl_geometry:point()},
    epoch_us => integer()
}.

%% The end of a run: all violations, in the order of its report.
-type ending() :: #{
    ending := atom(),
    end_us := integer(),
    violations := [starl_monitor:violation()],
    digest := binary()
}.

%% The event of machine `radio' that tells each packet of a run with the option `packets': its
%% receiver, a short form of it ({@link starl_packet:brief/1}), its bytes in the external term format,
%% and its fate. Monitors do not get it.
-type packet() ::
    {packet, To :: starl:robot_id(), starl_packet:brief(), Bytes :: pos_integer(), fate()}.

%% The copies of a packet that arrive, with their times (us), or why it is lost: by chance, because
%% the receiver is out of range, or by the fault of this name.
-type fate() ::
    {arrives, [{AtUs :: integer(), intact | corrupt}, ...]}
    | {lost, chance | out_of_range | {fault, atom()}}.

%% @doc Tells an observer.
-spec tell(news(), t()) -> ok.
tell(_News, none) -> ok;
tell(News, Observer) -> Observer(News).

%% @doc One observer for several.
-spec all([t()]) -> t().
all(Observers) ->
    case [Observer || Observer <- Observers, Observer =/= none] of
        [] -> none;
        [Observer] -> Observer;
        Several -> fun(News) -> lists:foreach(fun(Each) -> ok = Each(News) end, Several) end
    end.

%% @doc Is this trace event that of a packet?
-spec is_packet(starl_monitor:trace_event()) -> boolean().
is_packet({_, _, radio, {packet, _, _, _, _}}) -> true;
is_packet(_) -> false.
