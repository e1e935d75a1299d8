%% @doc An emulated Create in real time: runs {@link starl_create_emulator} as a process, with a
%% serial line to one other process and a body.
%%
%% A busy computer is sometimes late, and a command would last longer by that. So the robot's time
%% is not the present time, but the time up to which the other end has reported everything. Bytes
%% take effect at the time at which they arrived, whenever this process receives them, and that time
%% is passed to the body.
%% ```
%%     something is due ---- sync ---> other end
%%     the robot's time <--- upto ---- other end      all bytes until then were told before
%% '''
%% Messages of the other end are `{serial, Other, Word}': {@link word()}. It receives `{serial,
%% Create, {data, Bytes}}'. Only the end that has attached last is heard.
%%
%% `{starl_cable, pulled | pulled_in_time | back}' pulls its cable, at once or before a Create 2
%% could drive on without it, or puts it back. The process of the line then receives `{serial,
%% Create, {cable, pulled | back}}'.
%%
%% Its body is a robot of a simulated world ({@link starl_world}), or none. The process that has
%% started it with `tell' receives `{starl_create, Create, Out}' for its other outputs
%% ({@link starl_create_emulator:out()}).
-module(starl_create_emulated).
-behaviour(gen_server).

-export([start_link/1, start/1, feel/2, mode/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([options/0, word/0]).

%% Those of the emulator, its body, which output its pen is, and who is told.
-type options() :: #{
    model := starl_create_packet:model(),
    quirks => map(),
    axle_mm => number(),
    baud => pos_integer(),
    charge_mah => number(),
    body => none | {starl_world, World :: pid(), starl:robot_id()},
    pen => starl_create_instructions:pen(),
    tell => pid()
}.

%% What the other end of the line says: it is there, with this baud rate (`any': the right one);
%% bytes, with the time of their arrival; the level of BRC; the answer to `sync', the time up to which it
%% has told everything; it is gone. Times are of `erlang:monotonic_time(microsecond)'.
-type word() ::
    {attach, Baud :: pos_integer() | any}
    | {baud, pos_integer() | any}
    | {data, binary()}
    | {data, binary(), AtUs :: integer()}
    | {brc, low | high}
    | {upto, AtUs :: integer()}
    | detach.

-record(emulated, {
    model :: starl_create_packet:model(),
    create :: starl_create_emulator:t(),
    body :: none | {starl_world, pid(), starl:robot_id()},
    pen :: starl_create_instructions:pen(),
    tell :: pid() | none,
    other = none :: pid() | none,
    %% the process of the line, which may be pulled; is it to be pulled as soon as the wheels stand?
    line = none :: pid() | none,
    is_to_be_pulled = false :: boolean(),
    %% has the other end been asked up to when it has told everything?
    is_asking = false :: boolean(),
    %% what the body has felt meanwhile, latest first
    felt = [] :: [starl_create_emulator:sense()],
    %% the looks that wait until everything up to these times is told
    looks = [] :: [{World :: pid(), N :: pos_integer(), AtUs :: integer()}],
    %% the time of the next wake-up
    due = none :: integer() | none
}).

%% A command to the body that lasts until the next one.
-define(LONG_US, (1 bsl 40)).

%% @doc Starts a robot, switched on.
-spec start_link(options()) -> gen_server:start_ret().
start_link(Options) -> gen_server:start_link(?MODULE, Options, []).

%% @doc The same, without a link: a robot that ends with the world of its body.
-spec start(options()) -> gen_server:start_ret().
start(Options) -> gen_server:start(?MODULE, Options, []).

%% @doc Its body feels something.
-spec feel(pid(), starl_create_emulator:sense()) -> ok.
feel(Create, Sense) -> gen_server:cast(Create, {feel, Sense}).

%% @doc Its mode.
-spec mode(pid()) -> starl_create_emulator:mode().
mode(Create) -> gen_server:call(Create, mode).

-spec init(options()) -> {ok, #emulated{}} | {stop, term()}.
init(#{model := Model} = Options) ->
    %% a robot does not wait for other work of this computer
    _ = process_flag(priority, high),
    Body = maps:get(body, Options, none),
    case embodied(Body) of
        ok ->
            Phase = erlang:phash2(self(), 15000),
            Moment = #{phase_us => Phase, now_us => now_us()},
            {ok, #emulated{
                model = Model,
                create = starl_create_emulator:new(maps:merge(Options, Moment)),
                body = Body,
                pen = maps:get(pen, Options, starl_create_instructions:usual_pen(Model)),
                tell = maps:get(tell, Options, none)
            }};
        {error, Why} ->
            {stop, {shutdown, {create, unicode:characters_to_binary(Why)}}}
    end.

embodied(none) ->
    ok;
embodied({starl_world, World, Robot}) ->
    _ = erlang:monitor(process, World),
    starl_world:inhabit(World, Robot).

now_us() -> erlang:monotonic_time(microsecond).

-spec handle_call(mode, gen_server:from(), #emulated{}) -> {reply, term(), #emulated{}}.
handle_call(mode, _From, #emulated{create = Create} = Emulated) ->
    {reply, starl_create_emulator:mode(Create), Emulated}.

-spec handle_cast({feel, starl_create_emulator:sense()}, #emulated{}) ->
    {noreply, #emulated{}}.
handle_cast({feel, Sense}, Emulated) ->
    {noreply, feels(Sense, Emulated)}.

-spec handle_info(term(), #emulated{}) -> {noreply, #emulated{}} | {stop, normal, #emulated{}}.
handle_info({serial, Other, {attach, Baud}}, Emulated) ->
    {noreply,
        asked_again(
            line({baud, Baud}, Emulated#emulated{other = Other, line = Other, is_asking = false})
        )};
handle_info({serial, Other, Word}, #emulated{other = Other} = Emulated) ->
    {noreply, hears(Word, Emulated)};
handle_info({tick, Due}, #emulated{due = Due} = Emulated) ->
    {noreply, ask(Emulated#emulated{due = none})};
handle_info({starl_settle, World, N}, #emulated{looks = Looks} = Emulated) ->
    {noreply, ask(Emulated#emulated{looks = [{World, N, now_us()} | Looks]})};
handle_info({starl_cable, Cable}, Emulated) ->
    {noreply, cable(Cable, Emulated)};
handle_info({starl_body_says, Answers}, Emulated) ->
    {noreply, lists:foldl(fun body_says/2, Emulated, Answers)};
handle_info({starl_body_touches, {Bits, IsBlocked}}, Emulated) ->
    {noreply, feels({touches, Bits, IsBlocked}, Emulated)};
handle_info({'DOWN', _, process, World, _}, #emulated{body = {starl_world, World, _}} = Emulated) ->
    {stop, normal, Emulated};
handle_info(_Message, Emulated) ->
    {noreply, Emulated}.

hears({data, Bytes}, Emulated) ->
    hears({data, Bytes, now_us()}, Emulated);
hears({data, Bytes, At}, #emulated{create = Create} = Emulated) ->
    standing(wake(went(starl_create_emulator:hear(At, Bytes, Create), Emulated)));
hears({upto, At}, Emulated) ->
    up_to(At, Emulated#emulated{is_asking = false});
hears(detach, Emulated) ->
    ask(Emulated#emulated{other = none, is_asking = false});
hears({Line, _} = Word, Emulated) when Line =:= brc; Line =:= baud ->
    line(Word, Emulated);
hears(_Word, Emulated) ->
    Emulated.

%% A Create 2 goes on as it was told last, a Create 1 has its script.
cable(_Cable, #emulated{line = none} = Emulated) ->
    Emulated;
cable(pulled_in_time, #emulated{model = 2} = Emulated) ->
    standing(Emulated#emulated{is_to_be_pulled = true});
cable(back, #emulated{line = Line} = Emulated) ->
    Line ! {serial, self(), {cable, back}},
    Emulated#emulated{is_to_be_pulled = false};
cable(_Pulled, #emulated{line = Line} = Emulated) ->
    Line ! {serial, self(), {cable, pulled}},
    ask(Emulated#emulated{other = none, is_asking = false, is_to_be_pulled = false}).

standing(#emulated{is_to_be_pulled = true, create = Create} = Emulated) ->
    case starl_create_emulator:wheels(Create) of
        {Left, Right} when Left == 0, Right == 0 -> cable(pulled, Emulated);
        _ -> Emulated
    end;
standing(Emulated) ->
    Emulated.

line(Word, #emulated{create = Create} = Emulated) ->
    wake(went(starl_create_emulator:line(now_us(), Word, Create), Emulated)).

feels(Sense, #emulated{felt = Felt} = Emulated) ->
    ask(Emulated#emulated{felt = [Sense | Felt]}).

%% The drive of the body did not obey, and stands.
body_says({_Mark, {stalled, _}}, Emulated) -> feels({turning, {0.0, 0.0}}, Emulated);
body_says(_Answer, Emulated) -> Emulated.

%% Nothing happens before it is known that no bytes have come earlier.
ask(#emulated{other = none} = Emulated) ->
    up_to(now_us(), Emulated);
ask(#emulated{is_asking = true} = Emulated) ->
    Emulated;
ask(#emulated{other = Other} = Emulated) ->
    Other ! {serial, self(), sync},
    Emulated#emulated{is_asking = true}.

up_to(At, #emulated{create = Create, felt = Felt} = Emulated) ->
    Here = went(starl_create_emulator:advance(At, Create), Emulated#emulated{felt = []}),
    settled(At, wake(lists:foldr(fun(Sense, Before) -> felt(At, Sense, Before) end, Here, Felt))).

%% The answer may be to a question that was earlier than a look.
settled(_At, #emulated{looks = []} = Emulated) ->
    Emulated;
settled(At, #emulated{looks = Looks, body = {starl_world, _, Robot}} = Emulated) ->
    {Past, Later} = lists:partition(fun({_, _, Asked}) -> Asked =< At end, Looks),
    _ = [World ! {starl_settled, Robot, N} || {World, N, _} <- lists:reverse(Past)],
    asked_again(Emulated#emulated{looks = Later}).

asked_again(#emulated{looks = []} = Emulated) -> Emulated;
asked_again(Emulated) -> ask(Emulated).

felt(At, Sense, #emulated{create = Create} = Emulated) ->
    went(starl_create_emulator:feel(At, Sense, Create), Emulated).

went({Outs, Create}, #emulated{} = Emulated) ->
    ok = lists:foreach(fun({At, Out}) -> out(Out, At, Emulated) end, Outs),
    Emulated#emulated{create = Create}.

%% A wake-up that comes when there is nothing to do any more does no harm, but there must not be
%% more and more of them.
wake(#emulated{create = Create, due = Planned} = Emulated) ->
    case starl_create_emulator:next_due(Create) of
        none ->
            Emulated#emulated{due = none};
        Planned ->
            Emulated;
        Due ->
            _ = erlang:send_after(ceil(Due / 1000), self(), {tick, Due}, [{abs, true}]),
            Emulated#emulated{due = Due}
    end.

out({bytes, Bytes}, _At, #emulated{other = Other}) when is_pid(Other) ->
    Other ! {serial, self(), {data, Bytes}},
    ok;
out({bytes, _Bytes}, _At, _Emulated) ->
    ok;
out(Out, At, #emulated{tell = Tell, pen = Pen, body = Body}) ->
    _ = is_pid(Tell) andalso (Tell ! {starl_create, self(), Out}),
    tell_body(to_body(Out, Pen), At, Body).

to_body({wheels, {Left, Right}}, _Pen) ->
    {drive, {starl_chassis_differential, [{Left, Right, ?LONG_US}]}, ?LONG_US, wheels};
to_body({Kind, Bits}, {Kind, N}) ->
    {actuate, {pen, pen(Bits, N)}, none};
to_body({leds, Bits, _Colour, _Intensity}, {leds, N}) ->
    {actuate, {pen, pen(Bits, N)}, none};
to_body(_Out, _Pen) ->
    nothing.

pen(Bits, N) when Bits band (1 bsl N) =/= 0 -> down;
pen(_Bits, _N) -> up.

tell_body(nothing, _At, _Body) ->
    ok;
tell_body(_What, _At, none) ->
    ok;
tell_body(What, At, {starl_world, World, Robot}) ->
    World ! {starl_body, Robot, self(), {at, At + erlang:time_offset(microsecond), What}},
    ok.
