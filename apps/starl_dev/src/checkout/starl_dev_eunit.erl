%% @doc Reports the tests of EUnit for `./starl test': a line for each module as it ends, the failures
%% with their places, and the count. Reports of crashes that tests provoke go to a file.
%%
%% The environment tells the number of modules (`STARL_MODULES') and the file (`STARL_ERRORS').
-module(starl_dev_eunit).
-behaviour(eunit_listener).

-export([start/0, start/1]).
-export([init/1, handle_begin/3, handle_end/3, handle_cancel/3, terminate/2]).

%% Modules nest: a module's group holds that of its module of tests. `open': the passed and the failed
%% tests of each open module, the innermost first.
-record(state, {
    modules :: non_neg_integer(),
    ended = 0 :: non_neg_integer(),
    open = [] :: [{Passed :: non_neg_integer(), Failed :: non_neg_integer()}]
}).

-type state() :: #state{}.
-type data() :: [{atom(), term()}].

%% @doc Starts the listener.
-spec start() -> pid() | {pid(), reference()}.
start() -> start([]).

%% @doc Starts the listener.
-spec start(list()) -> pid() | {pid(), reference()}.
start(Options) -> eunit_listener:start(?MODULE, Options).

%% @private
-spec init(list()) -> state().
init(_Options) ->
    ok = to_file(os:getenv("STARL_ERRORS")),
    {Modules, _} = string:to_integer(os:getenv("STARL_MODULES", "0")),
    receive
        {start, _Reference} -> #state{modules = Modules}
    end.

to_file(false) ->
    ok;
to_file(File) ->
    _ = logger:remove_handler(default),
    logger:add_handler(default, logger_std_h, #{config => #{file => File}}).

%% @private
-spec handle_begin(group | test, data(), state()) -> state().
handle_begin(group, Data, #state{open = Open} = State) ->
    case module(Data) of
        none -> State;
        _ -> State#state{open = [{0, 0} | Open]}
    end;
handle_begin(test, _Data, State) ->
    State.

%% @private
-spec handle_end(group | test, data(), state()) -> state().
handle_end(group, Data, State) ->
    ended(module(Data), proplists:get_value(time, Data, 0), State);
handle_end(test, Data, State) ->
    case proplists:get_value(status, Data) of
        ok ->
            counted(1, 0, State);
        {error, Exception} ->
            failed(Data, eunit_lib:format_exception(Exception)),
            counted(0, 1, State);
        {skipped, Reason} ->
            failed(Data, io_lib:format("did not run: ~0tp", [Reason])),
            counted(0, 1, State)
    end.

%% @private
-spec handle_cancel(group | test, data(), state()) -> state().
handle_cancel(Kind, Data, State) ->
    _ = [
        failed(Data, why(Reason))
     || Reason <- [proplists:get_value(reason, Data)], is_cause(Reason)
    ],
    case Kind of
        group -> ended(module(Data), 0, State);
        test -> counted(0, 1, State)
    end.

is_cause(undefined) -> false;
is_cause({blame, _}) -> false;
is_cause(_) -> true.

why(timeout) -> "timed out";
why({abort, Reason}) -> eunit_lib:format_error(Reason);
why(Reason) -> io_lib:format("~tP", [Reason, 30]).

%% @private
-spec terminate({ok, data()} | {error, term()}, state()) -> ok.
terminate({ok, Data}, _State) ->
    [Passed, Failed, Skipped, Cancelled] =
        [proplists:get_value(Key, Data, 0) || Key <- [pass, fail, skip, cancel]],
    io:format("~b tests, ~b failures, ~b skipped, ~b cancelled~n", [
        Passed + Failed + Skipped + Cancelled, Failed, Skipped, Cancelled
    ]),
    answer(Failed + Skipped + Cancelled =:= 0);
terminate({error, Reason}, _State) ->
    io:format("the tests have ended early: ~tP~n", [Reason, 30]),
    answer(false).

answer(Good) ->
    receive
        {stop, Reference, ReplyTo} when Good -> ReplyTo ! {result, Reference, ok};
        {stop, Reference, ReplyTo} -> ReplyTo ! {result, Reference, error}
    end,
    ok.

counted(_Passed, _Failed, #state{open = []} = State) ->
    State;
counted(Passed, Failed, #state{open = [{P, F} | Open]} = State) ->
    State#state{open = [{P + Passed, F + Failed} | Open]}.

%% A module without tests of its own says nothing.
ended(none, _Ms, State) ->
    State;
ended(_Module, _Ms, #state{open = [{0, 0} | Open]} = State) ->
    State#state{open = Open};
ended(Module, Ms, #state{open = [{Passed, Failed} | Open], ended = Ended} = State) ->
    Number = io_lib:format("[~b/~b]", [Ended + 1, max(Ended + 1, State#state.modules)]),
    Failures = [io_lib:format(", ~b FAILED", [Failed]) || Failed > 0],
    io:format("~-9ts ~ts: ~b passed~ts, ~.1f s~n", [Number, Module, Passed, Failures, Ms / 1000]),
    State#state{open = Open, ended = Ended + 1}.

module(Data) ->
    case string:prefix(text(proplists:get_value(desc, Data)), "module '") of
        nomatch -> none;
        Name -> string:trim(Name, trailing, "'")
    end.

failed(Data, Why) ->
    Line = [[":", integer_to_list(N)] || N <- [proplists:get_value(line, Data, 0)], N > 0],
    Test =
        case proplists:get_value(source, Data) of
            {Module, Function, _} -> io_lib:format("~ts:~ts", [Module, Function]);
            _ -> "group"
        end,
    Output = proplists:get_value(output, Data, <<>>),
    io:format("FAILED ~ts~ts ~ts~n~ts~n~ts~n", [
        Test, Line, text(proplists:get_value(desc, Data)), Why, text(Output)
    ]).

text(undefined) -> "";
text(Text) -> Text.
