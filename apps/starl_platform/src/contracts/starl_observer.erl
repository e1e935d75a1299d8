%% @doc The behaviour and messages of observers, such as a recording or a window onto the team. A
%% run reports to its observer: its facts at the beginning, all trace events in the order of the
%% monitors, violations, and its end.
%%
%% An observer is a function that the judge of the run calls, so it must only pass the news on. A
%% simulation waits for it, a live run does not.
%%
%% A robot on a node of its own reports to an observer there what it knows itself. These are its
%% facts, its trace events, the packets that it sends and receives, its own poses as the positioning
%% system shows them, and its log. The observer of a robot comes with a process, a
%% <em>recorder</em>, which starts before the robot and outlives its restarts: a module with this
%% behaviour.
-module(starl_observer).

-export([tell/2, all/1, is_judged/1]).

-export_type([t/0, news/0, facts/0, ending/0, packet/0, fate/0, cause/0, way/0, recorder/0]).

%% `none': nobody observes.
-type t() :: fun((news()) -> ok) | none.

%% `begun' comes first, `ended' last. `unjudged': from now on nothing is judged that builds on what was
%% before. `fault': one that is not of the schedule begins or ends, by hand.
%% Only a robot itself tells: `started', with the names of its machines; `seen', a pose of its own;
%% `logged', a line.
-type news() ::
    {begun, facts()}
    | {judged, [starl_monitor:trace_event()], [starl_monitor:violation()]}
    | {fault, AtUs :: integer(), {began | ended, Fault :: tuple()}}
    | {unjudged, AtUs :: integer(), starl_unjudged:why()}
    | {ended, ending()}
    | {started, AtUs :: integer(), starl:robot_id(), [starl_machine:name()]}
    | {seen, AtUs :: integer(), starl:robot_id(), starl:pose()}
    | {logged, AtUs :: integer(), starl:robot_id(), info | warning | error, unicode:chardata()}.

%% The facts of a run. `scenario' holds all values with the faults that were drawn; `monitors' are
%% those of its contracts, ready to judge; `epoch_us' is the system time of the run's time 0;
%% `begun_us' the time at which the telling begins, if that is not 0; `run' the number of a team's run.
%% `told_by': the robots that tell what they know themselves, in the place of the world, which knows
%% all; `has_motions': the world tells the true motions; `was_up': this robot was up when its
%% previous recording ended.
-type facts() :: #{
    kind := simulation | live,
    app := module(),
    scenario := map(),
    robots := [{starl:robot_id(), starl:pose()}],
    monitors := [{module(), map()}],
    machines := #{starl_machine:name() => module()},
    waypoints := #{atom() => starl_geometry:point()},
    %% of a run with a floor plan
    floor => starl_floor:t(),
    epoch_us => integer(),
    begun_us => integer(),
    run => non_neg_integer(),
    told_by => [starl:robot_id(), ...],
    has_motions => boolean(),
    was_up => boolean()
}.

%% The end of a run: all violations, in the order of its report, and what was not judged. Contracts are
%% judged until `judged_us', if that is later than the end: until then nothing would have happened.
-type ending() :: #{
    ending := atom(),
    end_us := integer(),
    judged_us => integer(),
    violations := [starl_monitor:violation()],
    unjudged => [starl_unjudged:t()],
    digest := binary()
}.

%% The event of machine `radio' that tells each packet of a run with the option `packets': its
%% receiver, a short form of it ({@link starl_packet:brief/1}), its bytes in the external term format,
%% and its fate. Monitors do not get it.
-type packet() ::
    {packet, To :: starl:robot_id(), starl_packet:brief(), Bytes :: pos_integer(), fate()}.

%% The copies of a packet that arrive, with their times (us), or why it is lost.
-type fate() :: {arrives, [{AtUs :: integer(), intact | corrupt}, ...]} | {lost, cause()}.

%% By chance; because the receiver is out of range; by the fault of this name. Live: the link is
%% cut; the packet could not be sent at all; the receiver's filter was full; nobody knows.
-type cause() :: chance | out_of_range | {fault, atom()} | cut | refused | full | unheard.

%% What one end of a live robot's radio knows of a packet: that it was sent, or what became of it at
%% its receiver. Both ends give a packet the same number, a hash of it. {@link starl_packet_fates}
%% puts the two together.
-type way() ::
    {sent, To :: starl:robot_id(), starl_packet:brief(), Bytes :: pos_integer(), Hash :: integer()}
    | {came, From :: starl:robot_id(), starl_packet:brief(), Bytes :: pos_integer(),
        Hash :: integer(), fate()}.

%% The module of a recorder and its configuration.
-type recorder() :: {module(), map()}.

%% Starts the recorder of a robot. `now' is its clock; `before': the last events of the robot before
%% this start, which its former recorder may have lost.
-callback start_link(#{
    robot := starl:robot_id(),
    now := fun(() -> AtUs :: integer()),
    before := [starl_monitor:trace_event()],
    atom() => term()
}) -> {ok, pid()} | {error, unicode:chardata()}.
%% The observer, whom several processes may tell.
-callback observer(pid()) -> t().

%% @doc Reports to an observer.
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

%% @doc Checks whether monitors get this trace event: whether it is not about a packet.
-spec is_judged(starl_monitor:trace_event()) -> boolean().
is_judged({_, _, radio, {packet, _, _, _, _}}) -> false;
is_judged(_) -> true.
