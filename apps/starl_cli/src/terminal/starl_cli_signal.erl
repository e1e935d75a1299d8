%% @doc Handles Ctrl-C, and SIGTERM and SIGHUP alike (systemd, docker and Slurm, a closed terminal).
%% At the first signal the script `./starl' sends SIGUSR1 to the VM, because SIGINT reaches no Erlang
%% code. This handler of OTP's signal server then calls the reaction that the running command has
%% set, once: a signal may reach the VM directly, too. At the second signal the script kills the VM.
-module(starl_cli_signal).
-behaviour(gen_event).

-export([install/0, on_interrupt/1, leave/0]).
-export([init/1, handle_event/2, handle_call/2]).

%% The usual exit status of an interrupted command: 128 + SIGINT.
-define(INTERRUPTED, 130).
-define(LAST_WORDS_MS, 100).

-type reaction() :: fun(() -> term()).

%% @doc Replaces OTP's handler. An interrupt ends the VM at once until a reaction is set.
-spec install() -> ok.
install() ->
    Reaction = fun quit/0,
    ok = gen_event:swap_handler(
        erl_signal_server, {erl_signal_handler, []}, {?MODULE, Reaction}
    ),
    lists:foreach(fun(Signal) -> ok = os:set_signal(Signal, handle) end, [sigusr1, sigterm, sighup]).

%% @doc Sets the reaction to the next interrupt. It runs in the signal server and must not block.
-spec on_interrupt(reaction() | quit) -> ok.
on_interrupt(quit) -> on_interrupt(fun quit/0);
on_interrupt(Reaction) -> gen_event:call(erl_signal_server, ?MODULE, {on_interrupt, Reaction}).

-spec init({reaction(), term()}) -> {ok, reaction()}.
init({Reaction, _OldHandler}) -> {ok, Reaction}.

-spec handle_event(atom(), reaction()) -> {ok, reaction()}.
handle_event(Signal, Reaction) when Signal =:= sigusr1; Signal =:= sigterm; Signal =:= sighup ->
    _ = Reaction(),
    {ok, fun() -> ok end};
handle_event(_Other, Reaction) ->
    {ok, Reaction}.

-spec handle_call({on_interrupt, reaction()}, reaction()) -> {ok, ok, reaction()}.
handle_call({on_interrupt, Reaction}, _Old) -> {ok, ok, Reaction}.

-spec quit() -> no_return().
quit() ->
    starl_cli_progress:note("interrupted"),
    leave().

%% @doc Ends the VM as interrupted. What was written last has a moment to get out; a reader that
%% takes no more does not hold up the end.
-spec leave() -> no_return().
leave() ->
    ok = timer:sleep(?LAST_WORDS_MS),
    erlang:halt(?INTERRUPTED, [{flush, false}]).
