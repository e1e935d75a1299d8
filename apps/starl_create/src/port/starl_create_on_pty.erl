%% @doc Puts an emulated Create ({@link starl_create_emulated}) behind a pty, so that programs drive
%% it through a device like a real one. It passes on the speed of the line, its pulses (BRC) and the
%% state of its cable.
-module(starl_create_on_pty).
-behaviour(gen_server).

-export([start_link/2, in/1, name/1, pull/1, put_back/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-record(on_pty, {
    create :: pid(), pty :: pid(), line = gone :: gone | attached, baud = any :: any | pos_integer()
}).

%% @doc A pty for this robot, and a link to it if one is named.
-spec start_link(Create :: pid(), Link :: file:filename() | none) -> gen_server:start_ret().
start_link(Create, Link) -> gen_server:start_link(?MODULE, {Create, Link}, []).

%% @doc As {@link starl_create:emulated/2} wants it: the port of a robot, and what it opens, a link in
%% this directory.
-spec in(file:filename()) -> fun((Create, Model) -> {{module(), map()}, Device :: string()}) when
    Create :: pid(), Model :: starl_create_packet:model().
in(Dir) ->
    fun(Create, _Model) ->
        Link = filename:join(Dir, "create-" ++ integer_to_list(erlang:unique_integer([positive]))),
        ok = filelib:ensure_dir(Link),
        {ok, Pid} = start_link(Create, Link),
        {{starl_create_port, #{}}, name(Pid)}
    end.

%% @doc The device to open.
-spec name(pid()) -> string().
name(Pid) -> gen_server:call(Pid, name).

%% @doc Pulls the cable.
-spec pull(pid()) -> ok.
pull(Pid) -> gen_server:cast(Pid, pull).

%% @doc Puts the cable back; without a link the device has another name then.
-spec put_back(pid()) -> ok.
put_back(Pid) -> gen_server:cast(Pid, put_back).

-spec init({pid(), file:filename() | none}) -> {ok, #on_pty{}} | {stop, term()}.
init({Create, Link}) ->
    %% bytes come before what happens after them
    _ = process_flag(priority, high),
    case starl_create_pty:start_link(self(), Link) of
        {ok, Pty} -> {ok, #on_pty{create = Create, pty = Pty}};
        {error, Reason} -> {stop, {shutdown, Reason}}
    end.

-spec handle_call(name, gen_server:from(), #on_pty{}) -> {reply, string(), #on_pty{}}.
handle_call(name, _From, #on_pty{pty = Pty} = State) ->
    {reply, starl_create_pty:name(Pty), State}.

-spec handle_cast(pull | put_back, #on_pty{}) -> {noreply, #on_pty{}}.
handle_cast(pull, #on_pty{pty = Pty} = State) ->
    ok = starl_create_pty:pull(Pty),
    {noreply, gone(State)};
handle_cast(put_back, #on_pty{pty = Pty} = State) ->
    ok = starl_create_pty:put_back(Pty),
    {noreply, State}.

-spec handle_info(term(), #on_pty{}) -> {noreply, #on_pty{}}.
handle_info({pty, Pty, Event}, #on_pty{pty = Pty} = State) ->
    {noreply, line(Event, State)};
handle_info({serial, Create, {data, Bytes}}, #on_pty{create = Create, pty = Pty} = State) ->
    ok = starl_create_pty:send(Pty, Bytes),
    {noreply, State};
handle_info({serial, Create, {cable, pulled}}, #on_pty{create = Create} = State) ->
    handle_cast(pull, State);
handle_info({serial, Create, {cable, back}}, #on_pty{create = Create} = State) ->
    handle_cast(put_back, State);
handle_info({serial, Create, sync}, #on_pty{create = Create, pty = Pty} = State) ->
    ok = starl_create_pty:sync(Pty),
    {noreply, State};
handle_info(_Message, State) ->
    {noreply, State}.

line(attached, #on_pty{baud = Baud} = State) ->
    say({attach, Baud}, State#on_pty{line = attached});
line(detached, State) ->
    gone(State);
line({baud, hung_up}, State) ->
    say({brc, low}, State);
line({baud, Baud}, State) ->
    say({baud, Baud}, say({brc, high}, State#on_pty{baud = Baud}));
line({data, Bytes, AtUs}, State) ->
    say({data, Bytes, AtUs}, State);
line({upto, AtUs}, State) ->
    say({upto, AtUs}, State);
line({error, _Why}, State) ->
    State.

gone(State) -> say(detach, State#on_pty{line = gone, baud = any}).

say(Word, #on_pty{create = Create} = State) ->
    Create ! {serial, self(), Word},
    State.
