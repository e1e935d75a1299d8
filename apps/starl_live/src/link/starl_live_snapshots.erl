%% @doc Takes snapshots of a live robot, if they are wanted, so that a simulation can go on from
%% there. It traces the robot as data and, from the first snapshot on, everything that comes to the
%% robot. Both are trace events of machine `snapshot'.
-module(starl_live_snapshots).

-export([new/1, are_told/1, drives/4, script/1, input/3, taken/2, encoded/1]).

-export_type([t/0, snapshot/0, input/0, script/0, given/0]).

%% What came to the robot since its last snapshot: an event; a timer's; what its application did; the
%% next order that its application got. `now': the time at which a machine has handled an event. `other':
%% what a simulation cannot repeat.
-type input() ::
    {event, starl_machine:name(), starl_machine:event_type(), term()}
    | {timer, starl_machine:name(), starl_robot_timers:timer(), starl_robot_timers:mark(), term()}
    | acts
    | order
    | now
    | {other, atom()}.

%% A live robot as data, at a time of its clock.
-type snapshot() :: #{
    at_us := integer(),
    machines := starl_robot_machines:snapshot(),
    parts := starl_robot:parts(),
    dues := #{starl_robot_timers:mark() => starl_live_timers:due()},
    marks := non_neg_integer(),
    stored := #{starl_machine:name() => term()},
    script := script(),
    result := starl_live_witnesses:result()
}.

%% The last script of the chassis, with its time and its owner.
-type script() ::
    {AtUs :: integer(), starl_chassis:script(), {starl_machine:name(), term()}} | none.

%% The machines and the robot's own parts, if all are at rest.
-type given() ::
    {ok, {starl_robot_machines:snapshot(), starl_robot:parts()}} | {error, starl_snapshot:reason()}.

-record(snapshots, {
    %% has the first one been told?
    told = no :: no | asked | begun,
    script = none :: script()
}).

-opaque t() :: #snapshots{}.

%% @doc No snapshots, or snapshots with this period.
-spec new(PeriodUs :: pos_integer() | none) -> t().
new(none) -> #snapshots{};
new(_Us) -> #snapshots{told = asked}.

%% @doc Are there any?
-spec are_told(t()) -> boolean().
are_told(#snapshots{told = Told}) -> Told =/= no.

%% @doc The chassis gets a script.
-spec drives(NowUs :: integer(), starl_chassis:script(), {starl_machine:name(), term()}, t()) ->
    t().
drives(Now, Script, Owner, Snapshots) -> Snapshots#snapshots{script = {Now, Script, Owner}}.

%% @doc The last script of the chassis.
-spec script(t()) -> script().
script(#snapshots{script = Script}) -> Script.

%% @doc The fact that this has come to the robot. Without a snapshot what comes is of no use.
-spec input(input(), NowUs :: integer(), t()) -> [{input, {integer(), input()}}].
input(Input, Now, #snapshots{told = begun}) ->
    %% the times of messages may be those of others in a recording
    [{input, {Now, Input}}];
input(_Input, _Now, _Snapshots) ->
    [].

%% @doc The bytes of a snapshot.
-spec encoded(snapshot()) -> {ok, binary()} | {error, starl_snapshot:reason()}.
encoded(Snapshot) -> starl_snapshot:encode({live, Snapshot}).

%% @doc A snapshot has been traced, or the reason why there is none.
-spec taken({ok, binary()} | {error, starl_snapshot:reason()}, t()) -> t().
taken({ok, _}, Snapshots) -> Snapshots#snapshots{told = begun};
taken({error, _}, Snapshots) -> Snapshots#snapshots{told = asked}.
