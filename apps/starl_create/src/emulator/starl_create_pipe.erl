%% @doc A port without hardware: the messages of the port to a serial line, with an emulated Create
%% ({@link starl_create_emulated}) at its other end. For tests, and for robots that are simulated in
%% one VM or on several nodes.
%%
%% The messages are those of erlang-serial (`{open, Device, Baud}', `{send, Bytes}', `{data,
%% Bytes}') and the others of {@link starl_create_word:command()} and
%% {@link starl_create_word:message()}. The device is the emulated robot's process.
%%
%% When its owner ends, it writes the stop bytes.
-module(starl_create_pipe).
-behaviour(gen_server).

-export([start_link/2]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-record(pipe, {
    owner :: pid(),
    create = none :: pid() | none,
    baud = any :: pos_integer() | any,
    is_plugged = true :: boolean(),
    stop = <<>> :: binary(),
    script = none :: none | {Ref :: term(), [{binary(), pos_integer()}], Stop :: binary()},
    %% the time at which the next bytes of the script are due
    due = 0 :: integer()
}).

%% @doc Starts a port for this process.
-spec start_link(Owner :: pid(), map()) -> gen_server:start_ret().
start_link(Owner, _Options) -> gen_server:start_link(?MODULE, Owner, []).

-spec init(pid()) -> {ok, #pipe{}}.
init(Owner) ->
    process_flag(trap_exit, true),
    _ = erlang:monitor(process, Owner),
    {ok, #pipe{owner = Owner}}.

-spec handle_call(term(), gen_server:from(), #pipe{}) -> {reply, ok, #pipe{}}.
handle_call(_Question, _From, Pipe) -> {reply, ok, Pipe}.

pulled(Pipe) ->
    ok = serial(detach, Pipe),
    ok = tell({closed, {eio, "the cable was pulled"}}, Pipe),
    Pipe#pipe{is_plugged = false, script = none}.

plugged(#pipe{is_plugged = true} = Pipe) ->
    Pipe;
plugged(#pipe{create = Create, baud = Baud, stop = Stop} = Pipe) ->
    Plugged = Pipe#pipe{is_plugged = true},
    ok = serial({attach, Baud}, Plugged),
    ok = serial({data, Stop}, Plugged),
    ok = tell({opened, Create}, Plugged),
    Plugged.

-spec handle_cast(term(), #pipe{}) -> {noreply, #pipe{}}.
handle_cast(_Request, Pipe) -> {noreply, Pipe}.

-spec handle_info(term(), #pipe{}) -> {noreply, #pipe{}} | {stop, term(), #pipe{}}.
handle_info(step, Pipe) ->
    {noreply, steps(now_us(), Pipe)};
handle_info({serial, Create, What}, #pipe{create = Create} = Pipe) ->
    {noreply, heard(What, Pipe)};
handle_info({brc, high}, Pipe) ->
    ok = serial({brc, high}, Pipe),
    {noreply, Pipe};
handle_info(close, Pipe) ->
    {stop, normal, Pipe};
handle_info({'DOWN', _, process, Owner, _}, #pipe{owner = Owner} = Pipe) ->
    {stop, normal, Pipe};
handle_info({'EXIT', Owner, _}, #pipe{owner = Owner} = Pipe) ->
    {stop, normal, Pipe};
handle_info(Command, Pipe) ->
    {noreply, obey(Command, Pipe)}.

%% The commands of the driver ({@link starl_create_word:command()}); there may be other messages.
obey({open, _Create, _Baud}, #pipe{is_plugged = false} = Pipe) ->
    ok = tell({error, {enoent, "the cable is not plugged in"}}, Pipe),
    Pipe;
obey({open, Create, Baud}, Pipe) ->
    Open = Pipe#pipe{create = Create, baud = Baud},
    ok = serial({attach, Baud}, Open),
    ok = tell({opened, Create}, Open),
    Open;
obey({send, Bytes}, Pipe) ->
    ok = serial({data, Bytes}, Pipe),
    Pipe;
obey({drive_script, Ref, Steps, Stop}, Pipe) ->
    script(now_us(), {Ref, Steps, Stop}, Pipe);
obey({join_script, Ref, Steps, Stop}, #pipe{script = none} = Pipe) ->
    script(now_us(), {Ref, Steps, Stop}, Pipe);
obey({join_script, Ref, Steps, Stop}, #pipe{due = Due} = Pipe) ->
    script(Due, {Ref, Steps, Stop}, Pipe);
obey({stop_bytes, Bytes}, Pipe) ->
    Pipe#pipe{stop = Bytes};
obey({pulse, _Line, Ms, _Times}, Pipe) ->
    ok = serial({brc, low}, Pipe),
    _ = erlang:send_after(Ms, self(), {brc, high}),
    Pipe;
obey(_Message, Pipe) ->
    Pipe.

%% What the robot's end of the line says.
heard(sync, Pipe) ->
    Now = now_us(),
    Stepped = steps(Now, Pipe),
    ok = serial({upto, Now}, Stepped),
    Stepped;
heard({cable, pulled}, Pipe) ->
    pulled(Pipe);
heard({cable, back}, Pipe) ->
    plugged(Pipe);
heard({data, Bytes}, #pipe{is_plugged = true} = Pipe) ->
    ok = tell({data, Bytes}, Pipe),
    Pipe;
heard(_What, Pipe) ->
    Pipe.

%% A script begins at this time, which may be to come.
script(Begin, {Ref, Steps, _Stop} = Script, Pipe) ->
    _ = Steps =/= [] andalso tell({sent, Ref, Begin}, Pipe),
    steps(now_us(), Pipe#pipe{script = Script, due = Begin}).

-spec terminate(term(), #pipe{}) -> ok.
terminate(_Reason, #pipe{stop = Stop} = Pipe) ->
    ok = serial({data, Stop}, Pipe),
    serial(detach, Pipe).

%% Bytes bear the time at which they were due, even if this process was late.
steps(Now, #pipe{script = Script, due = Due} = Pipe) when Script =/= none, Due =< Now ->
    steps(Now, step(Pipe));
steps(_Now, Pipe) ->
    Pipe.

step(#pipe{script = {Ref, [], Stop}, due = Due} = Pipe) ->
    ok = serial({data, Stop, Due}, Pipe),
    ok = tell({ended, Ref, Due}, Pipe),
    Pipe#pipe{script = none};
step(#pipe{script = {Ref, [{Bytes, Us} | Steps], Stop}, due = Due} = Pipe) ->
    ok = serial({data, Bytes, Due}, Pipe),
    _ = erlang:send_after(ceil((Due + Us) / 1000), self(), step, [{abs, true}]),
    Pipe#pipe{script = {Ref, Steps, Stop}, due = Due + Us}.

now_us() -> erlang:monotonic_time(microsecond).

serial(_Word, #pipe{create = none}) ->
    ok;
serial(_Word, #pipe{is_plugged = false}) ->
    ok;
serial(Word, #pipe{create = Create}) ->
    Create ! {serial, self(), Word},
    ok.

tell(Word, #pipe{owner = Owner}) ->
    Owner ! Word,
    ok.
