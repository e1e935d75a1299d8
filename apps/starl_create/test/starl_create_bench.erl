%% A driver, a port, a line and an emulated Create with its body, in virtual time: the driver's
%% actions are carried out, bytes take their time, and everything happens in the order of time.
-module(starl_create_bench).

-export([new/1, run/2, until/3, drive/2, actuate/2, stop/1, pose/1, now_us/1, driver/1, create/1]).
-export([answers/1, said/1, events/1, wheels/1, outs/1, pull/2, plug/1, line/2, feel/2, inject/2]).
-export([profile/1, faults/2, rest/1, hear/2, commands/1]).

-record(bench, {
    now = 0 :: integer(),
    model :: 1 | 2,
    random :: rand:state(),
    %% least and greatest delay of bytes, each way (us)
    latency :: {non_neg_integer(), non_neg_integer()},
    driver :: term(),
    create :: term(),
    body :: term(),
    %% {At, N, What}
    queue = gb_sets:new() :: term(),
    n = 0 :: integer(),
    timers = #{} :: map(),
    script = none :: term(),
    %% when its next step is due
    due = 0 :: integer(),
    is_plugged = true :: boolean(),
    last = #{} :: map(),
    answers = [] :: list(),
    said = [] :: list(),
    events = [] :: list(),
    outs = [] :: list(),
    %% what the driver has written, newest first
    written = [] :: [binary()],
    %% of a worn wheel: what it really turns
    worn = 1.0 :: number()
}).

%% model, latency, seed, quirks, options of the driver, charge
new(#{model := Model} = Options) ->
    Seed = maps:get(seed, Options, 1),
    Quirks = maps:get(quirks, Options, #{}),
    Robot = maps:merge(
        #{
            model => maps:get(robot_model, Options, Model),
            quirks => Quirks,
            phase_us => 3700,
            axle_mm => 258
        },
        maps:with([baud, charge_mah], Options)
    ),
    Own = maps:merge(#{device => "bench", model => Model}, maps:get(driver, Options, #{})),
    {Actions, Driver} = starl_create_driver:open(Own),
    {_, Body} = starl_world_vehicle:new(1, {0.0, 0.0, 0.0}, world(Seed, Model)),
    does(Actions, #bench{
        model = Model,
        random = rand:seed_s(exsss, Seed),
        latency = maps:get(latency, Options, {0, 0}),
        driver = Driver,
        create = starl_create_emulator:new(Robot),
        worn = maps:get(worn, Options, 1.0),
        body = Body
    }).

profile(_Model) -> starl_chassis:profile(starl_chassis_differential, #{latency_ms => 25}).

world(Seed, Model) ->
    #{profiles => [profile(Model)], seed => Seed, actuation => [], location => []}.

now_us(#bench{now = Now}) -> Now.
driver(#bench{driver = Driver}) -> Driver.
create(#bench{create = Create}) -> Create.
pose(#bench{now = Now, body = Body}) -> starl_world_vehicle:pose(Now, Body).
answers(#bench{answers = Answers}) -> lists:reverse(Answers).
said(#bench{said = Said}) -> lists:reverse(Said).
events(#bench{events = Events}) -> lists:reverse(Events).
outs(#bench{outs = Outs}) -> lists:reverse(Outs).

%% What the driver has written, as commands.
commands(#bench{written = Written, model = Model}) ->
    decoded(iolist_to_binary(lists:reverse(Written)), Model).

decoded(Bytes, Model) ->
    case starl_create_command:decode(Bytes, Model) of
        more -> [];
        {ok, Command, Rest} -> [Command | decoded(Rest, Model)]
    end.

wheels(#bench{create = Create}) -> starl_create_emulator:wheels(Create).

%% -- what a test does -----------------------------------------------------------------------

drive({Commands, Mark}, #bench{driver = Driver} = Bench) ->
    after_driver(starl_create_driver:drive(Commands, Mark, Driver), Bench).

actuate({Device, Value, Mark}, #bench{driver = Driver} = Bench) ->
    after_driver(starl_create_driver:actuate(Device, Value, Mark, Driver), Bench).

stop(#bench{driver = Driver} = Bench) -> after_driver(starl_create_driver:stop(Driver), Bench).

rest(#bench{driver = Driver} = Bench) -> after_driver(starl_create_driver:rest(Driver), Bench).

%% The port, or the chassis, says this.
hear(Message, Bench) -> said_driver(Message, Bench).

%% The cable: nothing on the way arrives.
pull(Why, #bench{} = Bench) ->
    said_driver({closed, Why}, Bench#bench{is_plugged = false, script = none, last = #{}}).

plug(Bench) -> said_driver({opened, "bench"}, Bench#bench{is_plugged = true}).

line(What, #bench{now = Now, create = Create} = Bench) ->
    after_create(starl_create_emulator:line(Now, What, Create), Bench).

feel(What, #bench{now = Now, create = Create} = Bench) ->
    after_create(starl_create_emulator:feel(Now, What, Create), Bench).

%% Bytes on the line that nobody has sent: to the robot, or to the driver.
inject({robot, Bytes}, #bench{now = Now, create = Create} = Bench) ->
    after_create(starl_create_emulator:hear(Now, Bytes, Create), Bench);
inject({driver, Bytes}, Bench) ->
    said_driver({data, Bytes}, Bench).

faults(Turning, Bench) -> feel({turning, Turning}, Bench).

%% Lets this much time pass.
run(Us, #bench{now = Now} = Bench) ->
    {_, Next} = go(Now + Us, fun(_) -> false end, Bench),
    Next.

%% Lets time pass until the test is satisfied.
until(Fun, MostUs, #bench{now = Now} = Bench) ->
    case go(Now + MostUs, Fun, Bench) of
        {true, Next} -> Next;
        {false, Next} -> error({never, said(Next), starl_create_emulator:mode(Next#bench.create)})
    end.

go(End, Fun, Bench) ->
    case Fun(Bench) of
        true -> {true, Bench};
        false -> next(End, Fun, Bench)
    end.

next(End, Fun, #bench{queue = Queue, create = Create} = Bench) ->
    Due = starl_create_emulator:next_due(Create),
    First =
        case gb_sets:is_empty(Queue) of
            true -> none;
            false -> element(1, gb_sets:smallest(Queue))
        end,
    case earliest(First, Due) of
        none ->
            {false, at(End, Bench)};
        {_, At} when At > End ->
            {false, at(End, Bench)};
        {own, At} ->
            go(
                End,
                Fun,
                after_create(starl_create_emulator:advance(At, Create), Bench#bench{now = At})
            );
        {queue, At} ->
            {{At, _, What}, Rest} = gb_sets:take_smallest(Queue),
            go(End, Fun, happens(What, Bench#bench{queue = Rest, now = At}))
    end.

at(End, #bench{now = Now} = Bench) -> Bench#bench{now = max(Now, End)}.

earliest(none, none) -> none;
earliest(First, none) -> {queue, First};
earliest(none, Due) -> {own, Due};
earliest(First, Due) when First =< Due -> {queue, First};
earliest(_First, Due) -> {own, Due}.

later(At, What, #bench{queue = Queue, n = N} = Bench) ->
    Bench#bench{queue = gb_sets:add({At, N, What}, Queue), n = N + 1}.

happens({robot, Bytes}, #bench{now = Now, create = Create, is_plugged = true} = Bench) ->
    after_create(starl_create_emulator:hear(Now, Bytes, Create), Bench);
happens({driver, Bytes}, #bench{is_plugged = true} = Bench) ->
    said_driver({data, Bytes}, Bench);
happens({timer, Name, N}, #bench{timers = Timers} = Bench) ->
    case Timers of
        #{Name := N} ->
            said_driver({timeout, Name}, Bench#bench{timers = maps:remove(Name, Timers)});
        #{} ->
            Bench
    end;
happens({script, Ref, Steps, Stop}, #bench{script = Ref} = Bench) ->
    write(Ref, Steps, Stop, Bench);
happens({opens, Device}, #bench{is_plugged = true} = Bench) ->
    said_driver({opened, Device}, Bench);
happens({opens, _}, Bench) ->
    said_driver({error, {enoent, "no such device"}}, Bench);
happens({brc, Level}, Bench) ->
    line({brc, Level}, Bench);
happens(_, Bench) ->
    Bench.

%% -- the port -------------------------------------------------------------------------------

after_driver({Actions, Driver}, Bench) -> does(Actions, Bench#bench{driver = Driver}).

said_driver(Message, #bench{now = Now, driver = Driver} = Bench) ->
    after_driver(starl_create_driver:hear(Message, Now, Driver), Bench).

does(Actions, Bench) -> lists:foldl(fun act/2, Bench, Actions).

act({port, Word}, Bench) ->
    port(Word, Bench);
act({timer, Name, Ms}, #bench{now = Now, n = N, timers = Timers} = Bench) ->
    later(Now + 1000 * Ms, {timer, Name, N}, Bench#bench{timers = Timers#{Name => N}});
act({answer, Mark, Answer}, #bench{now = Now, answers = Answers} = Bench) ->
    Bench#bench{answers = [{Now, Mark, Answer} | Answers]};
act({event, Event}, #bench{now = Now, events = Events} = Bench) ->
    Bench#bench{events = [{Now, Event} | Events]};
act({say, _Level, Line}, #bench{said = Said} = Bench) ->
    Bench#bench{said = [unicode:characters_to_list(Line) | Said]}.

port({open, Device, Baud}, #bench{now = Now} = Bench) ->
    later(Now + 1000, {opens, Device}, line({baud, Baud}, Bench));
port({send, Bytes}, Bench) ->
    send(Bytes, Bench);
port({stop_bytes, _}, Bench) ->
    Bench;
port({pulse, _, Ms, 1}, #bench{now = Now} = Bench) ->
    later(Now + 1000 * Ms, {brc, high}, line({brc, low}, Bench));
port({drive_script, Ref, Steps, Stop}, Bench) ->
    write(Ref, Steps, Stop, Bench#bench{script = Ref});
port({join_script, Ref, Steps, Stop}, #bench{script = none} = Bench) ->
    port({drive_script, Ref, Steps, Stop}, Bench);
port({join_script, Ref, Steps, Stop}, #bench{due = Due} = Bench) ->
    later(Due, {script, Ref, Steps, Stop}, Bench#bench{script = Ref});
port(close, Bench) ->
    Bench#bench{is_plugged = false}.

write(Ref, [], Stop, #bench{now = Now} = Bench) ->
    said_driver({ended, Ref, Now}, send(Stop, Bench#bench{script = none}));
write(Ref, [{Bytes, Us} | Steps], Stop, #bench{now = Now} = Bench) ->
    Sent = said_driver({sent, Ref, Now}, send(Bytes, Bench)),
    later(Now + Us, {script, Ref, Steps, Stop}, Sent#bench{due = Now + Us}).

send(_Bytes, #bench{is_plugged = false} = Bench) ->
    Bench;
send(Bytes, #bench{written = W} = Bench) ->
    travel(robot, Bytes, Bench#bench{written = [Bytes | W]}).

%% Bytes keep their order.
travel(To, Bytes, #bench{now = Now, latency = {Least, Most}, random = Random, last = Last} = Bench) ->
    {Delay, Next} = rand:uniform_s(Most - Least + 1, Random),
    Arrives = max(Now + Least + Delay - 1, maps:get(To, Last, 0)),
    later(Arrives, {To, Bytes}, Bench#bench{random = Next, last = Last#{To => Arrives}}).

%% -- the robot ------------------------------------------------------------------------------

after_create({Outs, Create}, Bench) -> lists:foldl(fun out/2, Bench#bench{create = Create}, Outs).

out({At, {bytes, Bytes}}, #bench{now = Now} = Bench) ->
    Then = travel(driver, Bytes, Bench#bench{now = max(At, Now)}),
    Then#bench{now = Now};
out({At, {wheels, {Left, Right}} = Out}, #bench{body = Body, outs = Outs} = Bench) ->
    Worn = Bench#bench.worn,
    Script = {starl_chassis_differential, [{Worn * Left, Worn * Right, 1 bsl 40}]},
    {_, _, Next} = starl_world_vehicle:drive(Script, none, At, Body),
    Bench#bench{body = Next, outs = [{At, Out} | Outs]};
out(Out, #bench{outs = Outs} = Bench) ->
    Bench#bench{outs = [Out | Outs]}.
