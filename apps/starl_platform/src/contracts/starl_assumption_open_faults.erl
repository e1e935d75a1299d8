%% @doc Faults of a live run whose end is still unknown: cut links, frozen positions, full disks.
%% Monitors are notified of them in slices, a little ahead of what is judged. So a fault without an
%% end excuses as much as one with an end ({@link starl_assumption}), and not for ever. A pure
%% module.
%% ```
%%     began            now                   ended
%%       |----slice-------|----slice----|----slice--|..    excused up to 5 s longer
%% '''
%% A halt of a robot is not among them: the judge waits for its end.
%%
%% A robot that is down is such a fault, whatever the cause: from its `down' to its `up'
%% ({@link traced/2}). So is a robot that comes later than the others, until its first event
%% ({@link absent/3}). So a recording of real robots, which has no schedule of faults, excuses what
%% a computer without power explains.
-module(starl_assumption_open_faults).

-export([new/0, absent/3, report/2, traced/2, windows/2]).

-export_type([t/0]).

%% For each fault what it breaks of which robots, until when monitors know of it, and its end.
-opaque t() :: #{Id :: term() => {[breaks()], ToldUs :: integer(), EndUs :: integer() | none}}.

-type breaks() :: {starl:robot_id() | all, fault | position}.

%% As in a recording's messages on faults: name, beginning, end, kind, target and parameters.
-type fault() :: {
    Id :: term(),
    FromMs :: integer(),
    ToMs :: integer() | forever,
    Kind :: atom(),
    Target :: term(),
    map()
}.

-define(SLICE_US, 5000000).

%% @doc No fault lasts.
-spec new() -> t().
new() -> #{}.

%% @doc A fault has begun, or ended.
-spec report({began | ended, fault()}, t()) -> t().
report({began, {Id, FromMs, forever, Kind, Target, _}}, Lasting) when
    Kind =/= pause, is_integer(FromMs)
->
    Position = [position || starl_assumption:misleads(Kind)],
    Breaks = [{Robot, What} || Robot <- robots(Target), What <- [fault | Position]],
    Lasting#{Id => {Breaks, 1000 * FromMs, none}};
report({ended, {Id, _, ToMs, _, _, _}}, Lasting) when is_map_key(Id, Lasting), is_integer(ToMs) ->
    {Breaks, Told, none} = maps:get(Id, Lasting),
    Lasting#{Id => {Breaks, Told, max(Told, 1000 * ToMs)}};
report(_Other, Lasting) ->
    Lasting.

%% @doc Declares robots that report their actions, but have not reported anything yet.
-spec absent([starl:robot_id()], SinceUs :: integer(), t()) -> t().
absent(Robots, Since, Lasting) ->
    Absent = maps:from_list([{{absent, R}, {[{R, fault}], Since, none}} || R <- Robots]),
    maps:merge(Lasting, Absent).

%% @doc Takes into account the robots that go down and come up, as their trace says.
-spec traced([starl_monitor:trace_event()], t()) -> t().
traced(Events, Lasting) -> lists:foldl(fun down_or_up/2, Lasting, Events).

down_or_up({At, Robot, _, _} = Event, Lasting) when is_map_key({absent, Robot}, Lasting) ->
    Id = {absent, Robot},
    {Breaks, Told, none} = maps:get(Id, Lasting),
    Came = {came, Robot, At},
    down_or_up(Event, (maps:remove(Id, Lasting))#{Came => {Breaks, Told, max(Told, At)}});
down_or_up({At, Robot, robot, down}, Lasting) ->
    Lasting#{{down, Robot, At} => {[{Robot, fault}], At, none}};
down_or_up({At, Robot, robot, up}, Lasting) ->
    maps:map(
        fun
            ({down, Of, _}, {Breaks, Told, none}) when Of =:= Robot ->
                {Breaks, Told, max(Told, At)};
            (_Id, Fault) ->
                Fault
        end,
        Lasting
    );
down_or_up(_Other, Lasting) ->
    Lasting.

robots(Robots) when is_list(Robots) -> lists:append([robots(R) || R <- Robots]);
robots(Link) when is_tuple(Link) -> robots(tuple_to_list(Link));
robots(Robot) when is_integer(Robot) -> [Robot];
robots(all) -> [all];
robots(_Other) -> [].

%% @doc What monitors must know before they judge what happened up to now.
-spec windows(NowUs :: integer(), t()) -> {[starl_assumption:window()], t()}.
windows(Now, Lasting) ->
    maps:fold(
        fun(Id, Fault, {Windows, Left}) -> due(Now, Id, Fault, Windows, Left) end,
        {[], #{}},
        Lasting
    ).

due(Now, Id, {Breaks, Told, none}, Windows, Left) when Told =< Now + ?SLICE_US div 2 ->
    Until = Now + ?SLICE_US,
    {windows(Breaks, Told, Until) ++ Windows, Left#{Id => {Breaks, Until, none}}};
due(_Now, Id, {_, _, none} = Fault, Windows, Left) ->
    {Windows, Left#{Id => Fault}};
%% it may be over before monitors were told
due(_Now, _Id, {Breaks, Told, End}, Windows, Left) when Told < End ->
    {windows(Breaks, Told, End) ++ Windows, Left};
due(_Now, _Id, _Over, Windows, Left) ->
    {Windows, Left}.

windows(Breaks, From, To) -> [{Robot, From, To, What} || {Robot, What} <- Breaks].
