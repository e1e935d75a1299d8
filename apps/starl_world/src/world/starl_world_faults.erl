%% @doc The scheduled and manual faults of a run in real time ({@link starl_run_manual_fault}). The module
%% knows which faults last, how they change what each robot hears and senses, and the effects of
%% their beginnings and ends. {@link starl_world_run} reports them to the world and carries out the
%% effects. A pure module.
%% ```
%%     inject -- effects --> lasts -- end_fault: its time is over, or a heal -- effects --> ended
%%     reboot, lost store:   the robot is down until then, and the fault has ended when it is up again
%%     store set back:       at the beginning a restart, at the end another one with the store of the first
%% '''
%% A pause is handled differently, because only the world knows when a robot has stopped
%% ({@link starl_world:halt/3}).
-module(starl_world_faults).

-export([new/1, from_the_start/1, named/4, unnamed/2, inject/3, end_fault/3, up/3, healable/2]).
-export([link_conditions/3, senses/2, is_full/2, take_store/2, is_down/3]).

-export_type([t/0, fault/0, report/0, effect/0, store/0]).

%% A fault as of a scenario. The end of a fault that lasts may be unknown.
-type fault() ::
    {
        Id :: atom(),
        FromMs :: integer(),
        ToMs :: integer() | forever,
        starl_run_fault:kind(),
        starl_run_fault:target(),
        map()
    }.

%% A report for the world.
-type report() :: {began | ended, fault()}.

%% `kill': the robot's processes end, and it starts anew as soon as it may ({@link is_down/3}).
%% `dead': it is dead for good. `halt': it is halted for a time of the run, in the middle of its work
%% or at once. `machine': one of its machines is ended. `notify': these robots hear and sense
%% otherwise. `due': the fault is over at that time.
-type effect() ::
    {kill | start | dead | fill | clear, starl:robot_id()}
    | {halt, starl:robot_id(), Ms :: non_neg_integer(), now | at_work, Id :: atom()}
    | {machine, starl:robot_id(), starl_machine:name()}
    | {notify, [starl:robot_id()]}
    | {due, AtMs :: integer(), Id :: atom()}.

%% The state of a robot's store when the robot starts.
-type store() :: kept | lost | set_back.

-record(faults, {
    team :: starl_team:t(),
    count = 0 :: non_neg_integer(),
    %% in the order of their beginnings
    lasting = [] :: [fault()],
    stores = #{} :: #{starl:robot_id() => store()},
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

%% @doc Splits a schedule. Faults of links and senses that hold from time 0 begin before the robots
%% start, because a start on a node takes time. The others begin at their times.
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
-spec named(starl_run_manual_fault:t(), NowMs :: integer(), Speed :: number(), t()) ->
    {fault(), t()}.
named({pause, Target, Params, lasting}, Now, Speed, Faults) ->
    named({pause, Target, Params, ?PAUSE_MS}, Now, Speed, Faults);
named({pause, Target, Params, Ms}, Now, Speed, Faults) ->
    {Id, Next} = unnamed("manual", Faults),
    {{Id, Now, Now + round(Speed * Ms), pause, Target, Params}, Next};
named(Manual, Now, _Speed, Faults) ->
    {Id, Next} = unnamed("manual", Faults),
    {starl_run_manual_fault:fault(Id, {Now, forever}, Manual), Next}.

%% @doc A name for a fault that has none.
-spec unnamed(Prefix :: string(), t()) -> {atom(), t()}.
unnamed(Prefix, #faults{count = Count} = Faults) ->
    {
        list_to_atom(Prefix ++ "_" ++ integer_to_list(Count + 1)),
        Faults#faults{count = Count + 1}
    }.

%% @doc Begins a fault now: returns the reports for the world, and the effects to carry out.
-spec inject(fault(), NowMs :: integer(), t()) -> {[report()], [effect()], t()}.
inject({Id, From, To, pause, Robot, Params}, _Now, Faults) ->
    Moment =
        case Params of
            #{at_work := true} -> at_work;
            #{} -> now
        end,
    {[], [{halt, Robot, To - From, Moment, Id}], Faults};
inject({_, _, _, kill_machine, {Robot, Name}, _} = Fault, Now, Faults) ->
    {momentary(Fault, Now), [{machine, Robot, Name}], Faults};
inject({_, _, _, kill_robot, Robot, _} = Fault, Now, #faults{dead = Dead} = Faults) ->
    {momentary(Fault, Now), [{kill, Robot}, {dead, Robot}], Faults#faults{dead = [Robot | Dead]}};
inject({_, Time, Time, store_set_back, Robot, _} = Fault, _Now, Faults) ->
    %% a manual one undoes the whole last boot
    Start = maps:get(Robot, Faults#faults.starts, 0),
    lasts(setelement(2, Fault, Start), [{kill, Robot}], with_store(Robot, set_back, Faults));
inject({Id, _, To, store_set_back, Robot, _} = Fault, Now, Faults) ->
    lasts(setelement(2, Fault, Now), [{kill, Robot}, {due, To, Id}], Faults);
inject({_, _, _, store_lost, Robot, _} = Fault, Now, Faults) ->
    lasts(setelement(2, Fault, Now), down(Fault, Now), with_store(Robot, lost, Faults));
inject({_, _, _, reboot, _, _} = Fault, Now, Faults) ->
    lasts(setelement(2, Fault, Now), down(Fault, Now), Faults);
inject(Fault, Now, #faults{lasting = Lasting} = Faults) ->
    Held = Faults#faults{lasting = Lasting ++ [setelement(2, Fault, Now)]},
    {[{began, open(setelement(2, Fault, Now))}], does(Fault, Held) ++ due(Fault), Held}.

momentary(Fault, Now) -> [{began, setelement(3, setelement(2, Fault, Now), Now)}].

lasts(Fault, Effects, #faults{lasting = Lasting} = Faults) ->
    {[{began, open(Fault)}], Effects, Faults#faults{lasting = Lasting ++ [Fault]}}.

open(Fault) -> setelement(3, Fault, forever).

down({_, _, To, _, Robot, _} = Fault, Now) -> [{kill, Robot} | [D || To > Now, D <- due(Fault)]].

due({Id, _, To, _, _, _}) -> [{due, To, Id} || is_integer(To)].

%% A store that is lost and set back at once is lost.
with_store(Robot, lost, #faults{stores = Stores} = Faults) ->
    Faults#faults{stores = Stores#{Robot => lost}};
with_store(Robot, set_back, #faults{stores = Stores} = Faults) ->
    Faults#faults{stores = maps:merge(#{Robot => set_back}, Stores)}.

does({_, _, _, store_full, Robot, _}, _Faults) ->
    [{fill, Robot}];
does(Fault, Faults) ->
    changes(starl_run_fault:class(Fault), Fault, Faults).

changes(network, Fault, #faults{team = Team}) ->
    Ids = starl_team:members(Team),
    [
        {notify, [
            Id
         || Id <- Ids,
            lists:any(
                fun(Other) -> starl_sim_radio:is_on_link(Other, Id, Fault, Team) end,
                Ids -- [Id]
            )
        ]}
    ];
changes(sense, {_, _, _, _, all, _}, #faults{team = Team}) ->
    [{notify, starl_team:members(Team)}];
changes(sense, {_, _, _, _, Robot, _}, _Faults) ->
    [{notify, [Robot]}];
%% positions and cables are the world's
changes(_Class, _Fault, _Faults) ->
    [].

%% @doc Ends a fault: its time is over, or it is healed.
-spec end_fault(Id :: atom(), NowMs :: integer(), t()) -> {[report()], [effect()], t()}.
end_fault(Id, Now, #faults{lasting = Lasting} = Faults) ->
    case lists:keyfind(Id, 1, Lasting) of
        false ->
            {[], [], Faults};
        {_, _, _, store_set_back, Robot, _} = Fault ->
            Ends = lists:keyreplace(Id, 1, Lasting, setelement(3, Fault, Now)),
            {[], [{kill, Robot}], with_store(Robot, set_back, Faults#faults{lasting = Ends})};
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

%% @doc A robot is up: the faults that had sent it down have ended.
-spec up(starl:robot_id(), NowMs :: integer(), t()) -> {[report()], t()}.
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

%% @doc The names of the faults that can be healed: all that last, except restarts.
-spec healable(starl_run_manual_fault:heal(), t()) -> [atom()].
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
-spec link_conditions(starl:robot_id(), Speed :: number(), t()) -> starl_live_conditions:settings().
link_conditions(Robot, Speed, #faults{team = Team, lasting = Lasting}) ->
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

%% @doc The state of the store of a robot that starts now. A store is lost, or set back, once.
-spec take_store(starl:robot_id(), t()) -> {store(), t()}.
take_store(Robot, #faults{stores = Stores} = Faults) ->
    {maps:get(Robot, Stores, kept), Faults#faults{stores = maps:remove(Robot, Stores)}}.

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
