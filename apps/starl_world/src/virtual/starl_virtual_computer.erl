%% @doc The computer of a live robot in virtual time: its clock, its disk, and the code that the
%% operator has installed. It starts the robot's program anew at each boot.
-module(starl_virtual_computer).

-export([new/3, shows/2, due_us/3, start/4]).
-export([suffer/2, power/2, cut_after/2, disk/1, strike_store/2]).
-export([reload/3, take_back/2, heeded/5]).

-export_type([t/0]).

%% A clock stands still for this time at most, in all: datagrams are fresh for 15 s.
-define(FROZEN_US, 6000000).
-define(EPOCH_US, 1700000000000000).

-record(computer, {
    id :: starl:robot_id(),
    clock :: starl_sim_clock:t(),
    shown :: starl_virtual_clock:t(),
    disk :: starl_virtual_disk:name(),
    config :: starl_virtual_robot:config(),
    %% the code that its machines start with, as the operator knows it
    codes = #{} :: starl_reload:codes(),
    %% when the robot has told how a machine has heeded a reload
    heeded = #{} :: #{{starl_machine:name(), starl_reload:count()} => integer()}
}).

-opaque t() :: #computer{}.

%% @doc The computer of a robot of a plan, whose disk is commissioned; `Peers': the addresses of all.
-spec new(starl:robot_id(), Peers :: term(), starl_run_plan:t()) -> t().
new(Id, Peers, #{world := World, tree := Tree}) ->
    #{seed := Seed, profiles := Profiles} = World,
    Disk = "disk-" ++ integer_to_list(Id),
    ok = starl_virtual_disk:new(Disk, {Seed, Id, disk}),
    Dir = {starl_virtual_disk, filename:join(Disk, "robot")},
    ok = starl_live_store:commission(Dir),
    #computer{
        id = Id,
        clock = clock(Id, World),
        shown = starl_virtual_clock:new(0),
        disk = Disk,
        config = #{
            robot => Id,
            tree => Tree,
            profile => starl_chassis:of_robot(Id, Profiles),
            team_seed => Seed,
            dir => Dir,
            radio => {starl_live_udp, radio(Peers, Seed)}
        }
    }.

clock(Id, #{seed := Seed, clock := {OffsetUs, DriftPpb}, clocks := Clocks}) ->
    Offset = round(starl_run_draw:signed({Seed, Id, offset}) * OffsetUs),
    Drift = round(starl_run_draw:signed({Seed, Id, drift}) * DriftPpb),
    Hitting = bearable([Fault || Fault <- Clocks, starl_run_fault:hits(Id, Fault)], ?FROZEN_US),
    starl_sim_clock:new(Offset, Drift, Hitting).

radio(Peers, Seed) ->
    #{
        peers => Peers,
        fleet => "virtual",
        run => 1,
        key => fun() -> <<Seed:256>> end,
        %% nothing rests on beats; the radio's own runs have them
        beat_ms => infinity,
        sockets => starl_virtual_socket
    }.

%% A clock that is further off than the seal bears ends all talk with its robot, as it should.
bearable([], _Left) ->
    [];
bearable([{_, From, To, clock_freeze, _, _} | Faults], Left) when To - From > Left ->
    bearable(Faults, Left);
bearable([{_, From, To, clock_freeze, _, _} = Fault | Faults], Left) ->
    [Fault | bearable(Faults, Left - (To - From))];
bearable([Fault | Faults], Left) ->
    [Fault | bearable(Faults, Left)].

%% @doc Its clock shows the present time.
-spec shows(NowUs :: integer(), t()) -> ok.
shows(Now, #computer{clock = Clock, shown = Shown}) ->
    starl_virtual_clock:set(starl_sim_clock:local(Now, Clock), Shown).

%% @doc When its clock shows this time, which may be over.
-spec due_us(LocalUs :: integer(), NowUs :: integer(), t()) -> integer().
due_us(Local, Now, #computer{clock = Clock}) ->
    starl_sim_clock:due(Now, max(0, Local - starl_sim_clock:local(Now, Clock)), Clock).

%% @doc Starts the program of the robot's life of this number ({@link starl_virtual_robot:boot/2}).
-spec start(Life :: pos_integer(), NowUs :: integer(), starl_sim_world:t(), t()) ->
    {up | {down, term()}, [starl_virtual_robot:effect()], starl_virtual_robot:t()}.
start(Life, Now, #{seed := Seed} = World, #computer{id = Id, config = Config} = Computer) ->
    #{radio := {Module, Radio}} = Config,
    Shown = {starl_virtual_clock, Computer#computer.shown},
    Random = fun(Stream) ->
        rand:seed_s(exsss, erlang:phash2({Seed, Id, Life, Stream}, 4294967296))
    end,
    Own = Config#{
        codes => codes(Computer, World, Now),
        random => fun(Name, Incarnation) -> Random({Name, Incarnation}) end,
        radio := {Module, Radio#{random => fun() -> Random(radio) end}}
    },
    ok = shows(Now, Computer),
    starl_virtual_robot:boot(Own, starl_live_clock:on(Shown, starl_live_clock:new(?EPOCH_US, 1))).

%% A robot that starts before its machine has passed its trial is on trial from its start on.
codes(#computer{codes = Codes, heeded = Heeded}, #{reloads := Reloads}, Now) ->
    Passed = [
        N
     || {{_Name, N}, At} <- lists:sort(maps:to_list(Heeded)),
        Now > At + maps:get(trial_us, maps:get(order, maps:get(N, Reloads)))
    ],
    lists:foldl(fun starl_reload:passed/2, Codes, lists:sort(Passed));
codes(_Computer, _World, _Now) ->
    #{}.

%% -- its disk -------------------------------------------------------------------------------

%% @doc Its disk.
-spec disk(t()) -> starl_virtual_disk:name().
disk(#computer{disk = Disk}) -> Disk.

%% @doc Its disk is in trouble from now on.
-spec suffer(starl_virtual_disk:trouble(), t()) -> ok.
suffer(Trouble, #computer{disk = Disk}) -> starl_virtual_disk:suffer(Disk, Trouble).

%% @doc The power goes between two operations of the disk, after this many of them.
-spec cut_after(Operations :: pos_integer(), t()) -> ok.
cut_after(N, #computer{disk = Disk}) -> starl_virtual_disk:cut_after(Disk, N, between).

%% @doc The program has ended for this reason: without power, or with it.
-spec power(Why :: term(), t()) -> ok.
power({starl_power_cut, _}, #computer{disk = Disk}) -> starl_virtual_disk:cut_power(Disk);
power(_Killed, #computer{disk = Disk}) -> starl_virtual_disk:keep_power(Disk).

%% @doc Applies a fault to the store while the computer has no power. It replaces the disk by an
%% empty one, saves an image of it, or puts a saved image in its place. Returns the reports.
-spec strike_store(lose_store | {save_store | set_back_store, Image :: term()}, t()) ->
    [store_set_back].
strike_store(lose_store, #computer{disk = Disk}) ->
    ok = starl_virtual_disk:erase(Disk),
    [];
strike_store({save_store, Image}, #computer{disk = Disk}) ->
    ok = starl_virtual_disk:save(Image, Disk),
    [];
strike_store({set_back_store, Image}, #computer{disk = Disk}) ->
    [store_set_back || starl_virtual_disk:set_back(Image, Disk) =:= ok].

%% -- its code -------------------------------------------------------------------------------

%% @doc The operator gives the robot the code of a reload: the order.
-spec reload(starl_reload:count(), starl_sim_world:t(), t()) -> {starl_reload:order(), t()}.
reload(N, World, #computer{codes = Before} = Computer) ->
    #{reloads := #{N := #{order := Order}}, parts := Parts} = World,
    {_Words, Codes} = starl_reload:take(Order, Parts, Before),
    {Order, Computer#computer{codes = Codes}}.

%% @doc The operator has the robot go back.
-spec take_back(starl_reload:count(), t()) -> t().
take_back(N, #computer{codes = Codes} = Computer) ->
    Computer#computer{codes = starl_reload:without(N, Codes)}.

%% @doc Handles the report of a machine on a reload.
-spec heeded(starl_reload:outcome(), starl_machine:name(), starl_reload:count(), NowUs, t()) ->
    t()
when
    NowUs :: integer().
heeded(taken, Name, N, Now, #computer{heeded = Heeded} = Computer) ->
    Computer#computer{heeded = Heeded#{{Name, N} => Now}};
heeded(done, _Name, _N, _Now, Computer) ->
    Computer;
heeded(_Back, _Name, N, _Now, Computer) ->
    take_back(N, Computer).
