%% @doc Keeps the machines of one robot by name, with the number of starts of each. A machine is a
%% process or runs inline. An inline machine is the same {@link starl_machine}, run by the robot's
%% driver.
%%
%% A process gets an order ({@link starl_driver}) and is at work until it has answered; an inline
%% machine answers at once. Both crash, are restarted and begin a new incarnation in the same way. A
%% sequential application has a stack of its own and is always a process.
%%
%% The number of starts survives a crash of the machine, and must survive the robot's reboots, too:
%% incarnation 1 means that the machine has never run before. The number in the robot's store may be
%% lost, or older than the robot's last life. So the first number of a later life is beyond the
%% numbers of the store and the clock, by a random number. Clocks go on, so no earlier life has had
%% it. If the clock was set back, the random number makes it differ from theirs.
-module(starl_robot_machines).

-export([
    new/1,
    restore/3,
    resume/3,
    names/1,
    boots/1,
    news/3,
    has/2,
    incarnation/2,
    life/2,
    latest_life/1,
    starts/1, starts/2
]).
-export([boot/3, step/5, attach/3, lose/2, restart/3, update/3, down/1, up/2]).
-export([lots/0]).
-export([process/2, name_of/2, processes/1, inline/1, to_map/1]).
-export([part/1]).

-export_type([t/0, inline/0, answer/0, machine/0, starts/0, life/0, moment/0]).

%% How often each machine has started, or a number beyond that.
-type starts() :: #{starl_machine:name() => pos_integer()}.

%% The machines that get no process, by their names.
-type inline() :: #{starl_machine:name() => {module(), Config :: map()}}.

%% The number of a machine's last start before the present life of the robot, as far as its store knew
%% it, and that of its first start in this life. A number between the two is that of a life of which
%% the store knows nothing. A store without any numbers is known to be lost: then nothing lies between
%% them.
-type life() :: {Before :: non_neg_integer(), First :: pos_integer()}.

%% A robot that runs for the first time; or that comes up again, at this time of its clock, with a lot
%% from 0 to {@link lots/0} - 1.
-type moment() :: first | {ClockMs :: integer(), Lot :: non_neg_integer()}.

%% `waiting': the machine has yet to boot.
-type machine() :: pid() | starl_machine:t() | waiting.

%% The result of a step: a process has to carry out this order, the step is done, the machine has
%% crashed, or there is no such machine.
-type answer() ::
    {ask, pid(), starl_driver:order()}
    | {done, [starl_machine:action()], t()}
    | {crashed, Reason :: term()}
    | absent.

-define(LOT_BITS, 16).

%% No clock of a robot was ever ahead of its present one by more: 95 years. A clock that has forgotten the
%% time begins in 1970.
-define(AHEAD_MS, 3_000_000_000_000).
%% Seven eighths of the numbers that a packet can hold: after each life there can be later ones.
-define(LATEST, (7 bsl 56)).

%% What changes only when a machine starts.
-record(starts, {
    inline :: inline(),
    counts = #{} :: starts(),
    lives = #{} :: #{starl_machine:name() => life()},
    moment = first :: moment(),
    %% since the robot came up
    restarts = #{} :: #{starl_robot_sup:part() => pos_integer()}
}).

%% It is copied at each event.
-record(machines, {
    now = #{} :: #{starl_machine:name() => machine()},
    starts :: #starts{}
}).

-opaque t() :: #machines{}.

%% The services, without which a robot cannot work, in their order.
-define(SERVICES, [sap, location, motion]).

%% @doc The machines of a robot that starts for the first time; processes attach later.
-spec new(inline()) -> t().
new(Inline) -> up(first, restore(Inline, #{}, #{})).

%% @doc The machines of a robot that comes up and has started this often; processes attach.
-spec resume(inline(), moment(), starts()) -> t().
resume(Inline, Moment, Starts) -> up(Moment, restore(Inline, #{}, Starts)).

%% @doc Machines in a given state: all are inline.
-spec restore(inline(), #{starl_machine:name() => starl_machine:t()}, starts()) -> t().
restore(Inline, Now, Counts) ->
    #machines{now = Now, starts = #starts{inline = Inline, counts = Counts}}.

%% @doc The present machines, in the order in which they boot.
-spec names(t()) -> [starl_machine:name()].
names(#machines{now = Now}) -> boot_order(maps:keys(Now)).

%% @doc The local events by which they boot.
-spec boots(t()) -> [starl_robot:local()].
boots(Machines) -> [{Name, boot, none} || Name <- names(Machines)].

%% @doc The local events after restarts: these machines, which have come back, boot. The others are
%% notified of them, and of the machines that were given up. Without its application the robot
%% stops: no other machine knows its next goal.
-spec news(Back :: [starl_machine:name()], GivenUp :: [starl_machine:name()], t()) ->
    [starl_robot:local()].
news(Back, GivenUp, Machines) ->
    All = names(Machines),
    Ends = [End || Name <- GivenUp, End <- farewell(Name, All)],
    Ends ++ restarts(boot_order(Back), All).

farewell(Name, Others) ->
    Stop = [{motion, cast, stop} || Name =:= app, lists:member(motion, Others)],
    Stop ++ [{To, info, {given_up, Name}} || To <- Others].

restarts(Back, All) ->
    [{Name, boot, none} || Name <- Back] ++
        [{To, info, {restarted, Name}} || Name <- Back, To <- All, To =/= Name].

%% @doc Is there a machine of this name?
-spec has(starl_machine:name(), t()) -> boolean().
has(Name, #machines{now = Now}) -> is_map_key(Name, Now).

%% @doc The number of a machine's starts.
-spec incarnation(starl_machine:name(), t()) -> pos_integer().
incarnation(Name, #machines{starts = #starts{counts = Counts}}) -> maps:get(Name, Counts).

%% @doc The numbers between which the present life of the robot has begun for this machine.
-spec life(starl_machine:name(), t()) -> life().
life(_Name, #machines{starts = #starts{moment = first}}) -> {0, 1};
life(Name, #machines{starts = #starts{lives = Lives}}) -> maps:get(Name, Lives).

%% @doc The largest number of a life that the robot may have had and forgotten, by its clock. So
%% claims of others lead to no number that would be its last: the bound grows faster than the
%% numbers of lives.
-spec latest_life(t()) -> pos_integer().
latest_life(#machines{starts = #starts{moment = first}}) -> latest_at(0);
latest_life(#machines{starts = #starts{moment = {Ms, _Lot}}}) -> latest_at(max(0, Ms)).

latest_at(Ms) -> min((Ms + ?AHEAD_MS) bsl ?LOT_BITS, ?LATEST).

%% @doc The number of starts of each machine, those that are gone included.
-spec starts(t()) -> starts().
starts(#machines{starts = #starts{counts = Counts}}) -> Counts.

%% @doc The machines of a robot that is down, with other numbers of starts.
-spec starts(starts(), t()) -> t().
starts(Counts, #machines{starts = Starts} = Machines) ->
    Machines#machines{starts = Starts#starts{counts = Counts}}.

%% @doc Boots a machine with this configuration.
-spec boot(starl_machine:name(), starl_machine:config(), t()) -> answer().
boot(Name, Base, #machines{now = Now, starts = #starts{inline = Inline}} = Machines) ->
    case Now of
        #{Name := Pid} when is_pid(Pid) ->
            {ask, Pid, starl_driver:boot(Base)};
        #{Name := _} ->
            #{Name := {Module, Config}} = Inline,
            try starl_machine:new(Module, Config, Base) of
                {Actions, Machine} ->
                    {done, Actions, Machines#machines{now = Now#{Name := Machine}}}
            catch
                Class:Reason:Stack -> {crashed, starl_crash:reason(Class, Reason, Stack)}
            end;
        #{} ->
            absent
    end.

%% @doc Hands an event to a machine. An exception inside crashes the machine, as it crashes a
%% process.
-spec step(
    starl_machine:name(), starl_machine:event_type(), Content :: term(), starl_machine:meta(), t()
) -> answer().
step(Name, Type, Content, Meta, #machines{now = Now} = Machines) ->
    case Now of
        #{Name := Pid} when is_pid(Pid) ->
            {ask, Pid, starl_driver:step(Type, Content, Meta)};
        #{Name := Machine} ->
            try starl_machine:step(Type, Content, Meta, Machine) of
                {Actions, Next} -> {done, Actions, Machines#machines{now = Now#{Name := Next}}}
            catch
                Class:Reason:Stack -> {crashed, starl_crash:reason(Class, Reason, Stack)}
            end;
        #{} ->
            absent
    end.

%% @doc Registers a machine's process that has started and has to boot. `early': its predecessor is
%% still registered; the end of the predecessor must be handled first.
-spec attach(starl_machine:name(), pid(), t()) -> {ok, t()} | early.
attach(Name, _Pid, #machines{now = Now}) when is_map_key(Name, Now) -> early;
attach(Name, Pid, #machines{now = Now} = Machines) ->
    {ok, started(Name, Machines#machines{now = Now#{Name => Pid}})}.

%% @doc Removes a machine that has ended.
-spec lose(starl_machine:name(), t()) -> t().
lose(Name, #machines{now = Now} = Machines) -> Machines#machines{now = maps:remove(Name, Now)}.

%% @doc Restarts an inline machine that crashed, unless its part of the robot has had too many
%% restarts already: then the machine is given up; if it is a service, so is the robot.
-spec restart(starl_machine:name(), Bears :: non_neg_integer() | infinity, t()) ->
    {ok, t()} | given_up | gave_up.
restart(Name, Bears, #machines{now = Now, starts = Starts}) ->
    #starts{restarts = Restarts} = Starts,
    Part = part(Name),
    case {maps:get(Part, Restarts, 0), Part} of
        {N, _} when N < Bears ->
            Counted = Starts#starts{restarts = Restarts#{Part => N + 1}},
            {ok, started(Name, #machines{now = Now#{Name => waiting}, starts = Counted})};
        {_, services} ->
            gave_up;
        _ ->
            given_up
    end.

%% @doc Changes an inline machine that has booted.
-spec update(starl_machine:name(), fun((starl_machine:t()) -> starl_machine:t()), t()) -> t().
update(Name, Fun, #machines{now = Now} = Machines) ->
    Machines#machines{now = maps:update_with(Name, Fun, Now)}.

%% @doc The robot goes down: all its machines are gone.
-spec down(t()) -> t().
down(Machines) -> Machines#machines{now = #{}}.

%% @doc The robot comes up: its inline machines have to boot; processes attach.
-spec up(moment(), t()) -> t().
up(Moment, #machines{starts = #starts{inline = Inline} = Starts}) ->
    Up = #machines{
        now = maps:map(fun(_, _) -> waiting end, Inline),
        starts = Starts#starts{restarts = #{}, moment = Moment, lives = #{}}
    },
    lists:foldl(fun started/2, Up, maps:keys(Inline)).

started(Name, #machines{starts = Starts} = Machines) ->
    Machines#machines{starts = counted(Name, Starts)}.

counted(Name, #starts{counts = Counts, lives = Lives, moment = Moment} = Starts) ->
    Next = maps:get(Name, Counts, 0) + 1,
    case {Moment, Lives} of
        {{Ms, Lot}, #{}} when not is_map_key(Name, Lives) ->
            First = max(Next, max(0, Ms) bsl ?LOT_BITS) + Lot,
            Life = {maps:get(Name, Counts, First - 1), First},
            Starts#starts{counts = Counts#{Name => First}, lives = Lives#{Name => Life}};
        _ ->
            Starts#starts{counts = Counts#{Name => Next}}
    end.

%% @doc The number of lots. A first number of a life has at most 59 bits until the year 2248.
-spec lots() -> pos_integer().
lots() -> 1 bsl ?LOT_BITS.

%% @doc A machine's process; `none': the machine is inline, or there is none of this name.
-spec process(starl_machine:name(), t()) -> pid() | none.
process(Name, #machines{now = Now}) ->
    case Now of
        #{Name := Pid} when is_pid(Pid) -> Pid;
        #{} -> none
    end.

%% @doc The name of a process's machine.
-spec name_of(pid(), t()) -> {ok, starl_machine:name()} | none.
name_of(Pid, Machines) ->
    case processes(Machines) of
        #{Pid := Name} -> {ok, Name};
        #{} -> none
    end.

%% @doc The processes, with their machines' names.
-spec processes(t()) -> #{pid() => starl_machine:name()}.
processes(#machines{now = Now}) ->
    maps:from_list([{Pid, Name} || {Name, Pid} <- maps:to_list(Now), is_pid(Pid)]).

%% @doc The machines that get no process.
-spec inline(t()) -> inline().
inline(#machines{starts = #starts{inline = Inline}}) -> Inline.

%% @doc All machines in their present state.
-spec to_map(t()) -> #{starl_machine:name() => machine()}.
to_map(#machines{now = Now}) -> Now.

%% -- the order --------------------------------------------------------------------------------

%% Machines in the order in which they boot and hear of a crash: the services first, the application last,
%% the blocks by their names between them.
-spec boot_order([starl_machine:name()]) -> [starl_machine:name()].
boot_order(Names) ->
    First = [Name || Name <- ?SERVICES, lists:member(Name, Names)],
    Last = [app || lists:member(app, Names)],
    First ++ lists:sort(Names -- (First ++ Last)) ++ Last.

%% @doc The part of the robot to which a machine's restarts count ({@link starl_robot_sup}): the
%% services form one part, each other machine its own.
-spec part(starl_machine:name()) -> starl_robot_sup:part().
part(Name) ->
    case lists:member(Name, ?SERVICES) of
        true -> services;
        false -> Name
    end.
