%% @doc The scheduled and manual faults of a run in real time ({@link starl_run_hand}). The module
%% knows which faults last, how they change what each robot hears and senses, and the effects of
%% their beginnings and ends. {@link starl_world_injection} reports them to the world. The process
%% that runs the robots carries out the other effects, in this VM ({@link starl_world_robots}) or on
%% nodes ({@link starl_cluster_faults}). A pure module.
%% ```
%%     begins -- effects --> lasts -- over, its time or a heal -- effects --> ended
%%     reboot, lost store:   the robot is down until then, and the fault has ended when it is up again
%%     store set back:       at the beginning a restart, at the end another one with the store of the first
%% '''
%% A pause is handled differently, because only the world knows when a robot has stopped
%% ({@link starl_world:halt/3}).
-module(starl_world_faults).

-export([new/1, from_the_start/1, named/4, unnamed/2, begins/3, over/3, up/3, healable/2]).
-export([air/3, senses/2, is_full/2, fate/2, is_down/3]).

-export_type([t/0, fault/0, told/0, effect/0, fate/0]).

%% A fault as of a scenario; while it lasts, nobody need know its end.
-type fault() ::
    {
        Id :: atom(),
        FromMs :: integer(),
        ToMs :: integer() | forever,
        starl_run_fault:kind(),
        starl_run_fault:target(),
        map()
    }.

%% What the world is told.
-type told() :: {began | ended, fault()}.

%% What is to be done: a robot's processes end, and it starts anew when it may ({@link is_down/3}), which may
%% be now; it is dead for good; it is halted for so long (ms of the run), in the middle of its work or at
%% once; one of its machines is ended; its disk is filled or cleared; these robots hear and sense
%% otherwise; at that time (ms) the fault is over.
-type effect() ::
    {kill | start | dead | fill | clear, starl:robot_id()}
    | {halt, starl:robot_id(), Ms :: non_neg_integer(), now | at_work, Id :: atom()}
    | {machine, starl:robot_id(), starl_machine:name()}
    | {tell, [starl:robot_id()]}
    | {due, AtMs :: integer(), Id :: atom()}.

%% What becomes of a robot's store before the robot starts.
-type fate() :: kept | lost | set_back.

-record(faults, {
    team :: starl_team:t(),
    count = 0 :: non_neg_integer(),
    %% in the order of their beginnings
    lasting = [] :: [fault()],
    fates = #{} :: #{starl:robot_id() => fate()},
    %% when each robot has started last, ms
    starts = #{} :: #{starl:robot_id() => integer()},
    dead = [] :: [starl:robot_id()]
}).

-opaque t() :: #faults{}.

-define(PAUSE_MS, 10000).
-define(RESTARTS, [reboot, store_lost, store_set_back]).

%% @doc No fault has begun.
-spec new([starl:robot_id()]) -> t().
new(Robots) -> #faults{team = starl_team:new(Robots)}.

%% @doc Those of a schedule by which robots hear and sense otherwise from the beginning of the run on: they begin
%% before any robot does, which takes its time on nodes. The others begin in theirs.
-spec from_the_start([fault()]) -> {AtOnce :: [fault()], InTime :: [fault()]}.
from_the_start(Schedule) ->
    lists:partition(
        fun(Fault) ->
            element(2, Fault) =< 0 andalso
                lists:member(starl_run_fault:class(Fault), [network, sense])
        end,
        Schedule
    ).

%% @doc The fault for a manual fault that is applied now. A manual pause is one of the computer, and
%% has an end.
-spec named(starl_run_hand:t(), NowMs :: integer(), Speed :: number(), t()) -> {fault(), t()}.
named({pause, Target, Params, lasting}, Now, Speed, Faults) ->
    named({pause, Target, Params, ?PAUSE_MS}, Now, Speed, Faults);
named({pause, Target, Params, Ms}, Now, Speed, Faults) ->
    {Id, Next} = unnamed("hand", Faults),
    {{Id, Now, Now + round(Speed * Ms), pause, Target, Params}, Next};
named(Hand, Now, _Speed, Faults) ->
    {Id, Next} = unnamed("hand", Faults),
    {starl_run_hand:fault(Id, {Now, forever}, Hand), Next}.

%% @doc A name for a fault that has none.
-spec unnamed(Prefix :: string(), t()) -> {atom(), t()}.
unnamed(Prefix, #faults{count = Count} = Faults) ->
    {
        list_to_atom(Prefix ++ "_" ++ integer_to_list(Count + 1)),
        Faults#faults{count = Count + 1}
    }.

%% @doc Begins a fault now: returns the reports for the world, and the effects to carry out.
-spec begins(fault(), NowMs :: integer(), t()) -> {[told()], [effect()], t()}.
begins({Id, From, To, pause, Robot, Params}, _Now, Faults) ->
    Moment =
        case Params of
            #{at_work := true} -> at_work;
            #{} -> now
        end,
    {[], [{halt, Robot, To - From, Moment, Id}], Faults};
begins({_, _, _, kill_machine, {Robot, Name}, _} = Fault, Now, Faults) ->
    {momentary(Fault, Now), [{machine, Robot, Name}], Faults};
begins({_, _, _, kill_robot, Robot, _} = Fault, Now, #faults{dead = Dead} = Faults) ->
    {momentary(Fault, Now), [{kill, Robot}, {dead, Robot}], Faults#faults{dead = [Robot | Dead]}};
begins({_, Time, Time, store_set_back, Robot, _} = Fault, _Now, Faults) ->
    %% by hand: its whole last life has not been
    Start = maps:get(Robot, Faults#faults.starts, 0),
    lasts(setelement(2, Fault, Start), [{kill, Robot}], fated(Robot, set_back, Faults));
begins({Id, _, To, store_set_back, Robot, _} = Fault, Now, Faults) ->
    lasts(setelement(2, Fault, Now), [{kill, Robot}, {due, To, Id}], Faults);
begins({_, _, _, store_lost, Robot, _} = Fault, Now, Faults) ->
    lasts(setelement(2, Fault, Now), down(Fault, Now), fated(Robot, lost, Faults));
begins({_, _, _, reboot, _, _} = Fault, Now, Faults) ->
    lasts(setelement(2, Fault, Now), down(Fault, Now), Faults);
begins(Fault, Now, #faults{lasting = Lasting} = Faults) ->
    Held = Faults#faults{lasting = Lasting ++ [setelement(2, Fault, Now)]},
    {[{began, open(setelement(2, Fault, Now))}], does(Fault, Held) ++ due(Fault), Held}.

momentary(Fault, Now) -> [{began, setelement(3, setelement(2, Fault, Now), Now)}].

lasts(Fault, Effects, #faults{lasting = Lasting} = Faults) ->
    {[{began, open(Fault)}], Effects, Faults#faults{lasting = Lasting ++ [Fault]}}.

open(Fault) -> setelement(3, Fault, forever).

down({_, _, To, _, Robot, _} = Fault, Now) -> [{kill, Robot} | [D || To > Now, D <- due(Fault)]].

due({Id, _, To, _, _, _}) -> [{due, To, Id} || is_integer(To)].

%% Of a store that is lost and set back at once nothing is left.
fated(Robot, lost, #faults{fates = Fates} = Faults) ->
    Faults#faults{fates = Fates#{Robot => lost}};
fated(Robot, set_back, #faults{fates = Fates} = Faults) ->
    Faults#faults{fates = maps:merge(#{Robot => set_back}, Fates)}.

does({_, _, _, store_full, Robot, _}, _Faults) ->
    [{fill, Robot}];
does(Fault, Faults) ->
    changes(starl_run_fault:class(Fault), Fault, Faults).

changes(network, Fault, #faults{team = Team}) ->
    Ids = starl_team:members(Team),
    [
        {tell, [
            Id
         || Id <- Ids,
            lists:any(
                fun(Other) -> starl_sim_radio:is_on_link(Other, Id, Fault, Team) end,
                Ids -- [Id]
            )
        ]}
    ];
changes(sense, {_, _, _, _, all, _}, #faults{team = Team}) ->
    [{tell, starl_team:members(Team)}];
changes(sense, {_, _, _, _, Robot, _}, _Faults) ->
    [{tell, [Robot]}];
%% positions and cables are the world's
changes(_Class, _Fault, _Faults) ->
    [].

%% @doc The time of a fault is over, or it is healed.
-spec over(Id :: atom(), NowMs :: integer(), t()) -> {[told()], [effect()], t()}.
over(Id, Now, #faults{lasting = Lasting} = Faults) ->
    case lists:keyfind(Id, 1, Lasting) of
        false ->
            {[], [], Faults};
        {_, _, _, store_set_back, Robot, _} = Fault ->
            Ends = lists:keyreplace(Id, 1, Lasting, setelement(3, Fault, Now)),
            {[], [{kill, Robot}], fated(Robot, set_back, Faults#faults{lasting = Ends})};
        {_, _, _, Kind, Robot, _} when Kind =:= reboot; Kind =:= store_lost ->
            {[], [{start, Robot}], Faults};
        Fault ->
            Left = Faults#faults{lasting = lists:delete(Fault, Lasting)},
            {[{ended, setelement(3, Fault, Now)}], undone(Fault, Left), Left}
    end.

undone({_, _, _, store_full, Robot, _}, Left) ->
    [{clear, Robot} || not is_full(Robot, Left)];
undone(Fault, Left) ->
    does(Fault, Left).

%% @doc A robot is up: what had sent it down has ended.
-spec up(starl:robot_id(), NowMs :: integer(), t()) -> {[told()], t()}.
up(Robot, Now, #faults{lasting = Lasting, starts = Starts} = Faults) ->
    {Over, Left} = lists:partition(
        fun({_, _, To, Kind, Target, _}) ->
            Target =:= Robot andalso To =< Now andalso lists:member(Kind, ?RESTARTS)
        end,
        Lasting
    ),
    {
        [{ended, setelement(3, Fault, Now)} || Fault <- Over],
        Faults#faults{lasting = Left, starts = Starts#{Robot => Now}}
    }.

%% @doc The names of the faults that can be healed. A restart is no such.
-spec healable(starl_run_hand:heal(), t()) -> [atom()].
healable(What, #faults{lasting = Lasting}) ->
    [
        element(1, Fault)
     || Fault <- Lasting,
        not lists:member(element(4, Fault), ?RESTARTS),
        is_healed(What, Fault)
    ].

is_healed(all, _Fault) -> true;
is_healed({fault, Id}, Fault) -> element(1, Fault) =:= Id;
is_healed({Kind, Target}, {_, _, _, Kind, Target, _}) -> true;
is_healed({sense, Robot, Sense}, {_, _, _, _, Robot, #{sense := Sense}}) -> true;
is_healed(_Other, _Fault) -> false.

%% @doc The link conditions of a robot in a run at this multiple of real time.
-spec air(starl:robot_id(), Speed :: number(), t()) -> starl_live_conditions:settings().
air(Robot, Speed, #faults{team = Team, lasting = Lasting}) ->
    Network = [Fault || Fault <- Lasting, starl_run_fault:class(Fault) =:= network],
    Links = [
        {Other, [
            D
         || Fault <- Network,
            starl_sim_radio:is_on_link(Other, Robot, Fault, Team),
            D <- disturbance(Fault, Speed)
        ]}
     || Network =/= [], Other <- starl_team:members(Team), Other =/= Robot
    ],
    {Cut, Disturbed} = lists:partition(fun({_, D}) -> lists:member(cut, D) end, Links),
    #{
        cut => [Other || {Other, _} <- Cut],
        disturbed => maps:from_list([Link || {_, [_ | _]} = Link <- Disturbed])
    }.

disturbance({_, _, _, loss, _, #{part := Part}}, _Speed) when Part < 1 -> [{lost, Part}];
disturbance({_, _, _, duplicate, _, #{part := Part}}, _Speed) ->
    [{again, Part, 1}];
disturbance({_, _, _, babble, _, #{copies := Copies}}, _Speed) ->
    [{again, 1, Copies - 1}];
disturbance({_, _, _, delay, _, #{extra_ms := Ms}}, Speed) ->
    [{late, 1, {round(Ms / Speed), round(Ms / Speed)}}];
disturbance({_, _, _, reorder, _, #{part := Part, extra_ms := Ms}}, Speed) ->
    [{late, Part, {0, round(Ms / Speed)}}];
disturbance(_Fault, _Speed) ->
    [cut].

%% @doc The faults of a robot's senses; of one sense the latest holds.
-spec senses(starl:robot_id(), t()) -> starl_live_sense_fault:faults().
senses(Robot, #faults{lasting = Lasting}) ->
    maps:from_list([
        {Sense, starl_live_sense_fault:of_kind(Kind, Params)}
     || {_, _, _, Kind, _, #{sense := Sense} = Params} = Fault <- Lasting,
        starl_run_fault:hits(Robot, Fault)
    ]).

%% @doc Is the disk of a robot full?
-spec is_full(starl:robot_id(), t()) -> boolean().
is_full(Robot, #faults{lasting = Lasting}) ->
    lists:any(
        fun({_, _, _, Kind, Target, _}) -> {Kind, Target} =:= {store_full, Robot} end, Lasting
    ).

%% @doc What becomes of the store of a robot that starts now; what holds then.
-spec fate(starl:robot_id(), t()) -> {fate(), t()}.
fate(Robot, #faults{fates = Fates} = Faults) ->
    {maps:get(Robot, Fates, kept), Faults#faults{fates = maps:remove(Robot, Fates)}}.

%% @doc Must a robot not start now?
-spec is_down(starl:robot_id(), NowMs :: integer(), t()) -> boolean().
is_down(Robot, Now, #faults{lasting = Lasting, dead = Dead}) ->
    lists:member(Robot, Dead) orelse
        lists:any(
            fun({_, _, To, Kind, Target, _}) ->
                Target =:= Robot andalso To > Now andalso
                    (Kind =:= reboot orelse Kind =:= store_lost)
            end,
            Lasting
        ).
