%% @doc Collects the results of EUnit for `./starl test': the number of tests in each module, and
%% the failures with their places. At the end it sends them to a process as `{starl_dev_eunit,
%% Outcome}'.
-module(starl_dev_eunit).
-behaviour(eunit_listener).

-export([start/0, start/1]).
-export([init/1, handle_begin/3, handle_end/3, handle_cancel/3, terminate/2]).

%% Modules nest: a module's group holds that of its module of tests. `open': the passed and the failed
%% tests of each open module, the innermost first.
-record(state, {
    to :: pid(),
    open = [] :: [{Passed :: non_neg_integer(), Failed :: non_neg_integer()}],
    modules = [] :: [starl_test_vm:tested()],
    told = [] :: [unicode:chardata()]
}).

-type state() :: #state{}.
-type data() :: [{atom(), term()}].

%% @doc Starts the listener. Its results go to the caller.
-spec start() -> pid() | {pid(), reference()}.
start() -> start([{to, self()}]).

%% @doc Starts the listener. `{to, Pid}' says who gets its results.
-spec start([{to, pid()}]) -> pid() | {pid(), reference()}.
start(Options) -> eunit_listener:start(?MODULE, Options).

%% @private
-spec init([{to, pid()} | term()]) -> state().
init(Options) ->
    receive
        {start, _Reference} -> #state{to = proplists:get_value(to, Options)}
    end.

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
        ok -> counted(1, 0, Data, State);
        {error, Exception} -> failed(Data, eunit_lib:format_exception(Exception), State);
        {skipped, Reason} -> failed(Data, io_lib:format("did not run: ~0tp", [Reason]), State)
    end.

%% @private A cancelled test has failed. So has a cancelled group, since the number of its tests is not
%% known.
-spec handle_cancel(group | test, data(), state()) -> state().
handle_cancel(test, Data, State) ->
    failed(Data, why(proplists:get_value(reason, Data)), State);
handle_cancel(group, Data, State) ->
    Reason = proplists:get_value(reason, Data),
    Told =
        case is_cause(Reason) of
            true -> failed(Data, why(Reason), State);
            false -> State
        end,
    ended(module(Data), 0, Told).

is_cause(undefined) -> false;
is_cause({blame, _}) -> false;
is_cause(_) -> true.

why(timeout) -> "timed out";
why({abort, Reason}) -> eunit_lib:format_error(Reason);
why(Reason) -> io_lib:format("~tP", [Reason, 30]).

%% @private
-spec terminate({ok, data()} | {error, term()}, state()) -> ok.
terminate(Ending, #state{to = To} = State) ->
    {Good, Outcome} = outcome(Ending, State),
    To ! {?MODULE, Outcome},
    answer(Good).

outcome({ok, Data}, #state{modules = Modules, told = Told}) ->
    Failed = lists:sum([proplists:get_value(Key, Data, 0) || Key <- [fail, skip, cancel]]),
    {Failed =:= 0, #{modules => lists:reverse(Modules), told => lists:reverse(Told)}};
outcome({error, Reason}, State) ->
    Early = io_lib:format("FAILED: the tests have ended early: ~tP~n", [Reason, 30]),
    #state{modules = Modules, told = Told} = State,
    Ended = #{name => "EUnit", passed => 0, failed => 1, ms => 0},
    {false, #{modules => lists:reverse(Modules, [Ended]), told => lists:reverse(Told, [Early])}}.

answer(Good) ->
    receive
        {stop, Reference, ReplyTo} when Good -> ReplyTo ! {result, Reference, ok};
        {stop, Reference, ReplyTo} -> ReplyTo ! {result, Reference, error}
    end,
    ok.

%% EUnit makes no group for a module with a single test. What has no source, such as a module that does
%% not exist, stands under EUnit's own name.
counted(Passed, Failed, Data, #state{open = [], modules = Modules} = State) ->
    Name =
        case proplists:get_value(source, Data) of
            {Module, _, _} -> atom_to_list(Module);
            _ -> "EUnit"
        end,
    Ms = proplists:get_value(time, Data, 0),
    State#state{
        modules = [#{name => Name, passed => Passed, failed => Failed, ms => Ms} | Modules]
    };
counted(Passed, Failed, _Data, #state{open = [{P, F} | Open]} = State) ->
    State#state{open = [{P + Passed, F + Failed} | Open]}.

%% A module without tests of its own says nothing.
ended(none, _Ms, State) ->
    State;
ended(_Module, _Ms, #state{open = [{0, 0} | Open]} = State) ->
    State#state{open = Open};
ended(Name, Ms, #state{open = [{Passed, Failed} | Open], modules = Modules} = State) ->
    Ended = #{name => Name, passed => Passed, failed => Failed, ms => Ms},
    State#state{open = Open, modules = [Ended | Modules]}.

module(Data) ->
    case string:prefix(text(proplists:get_value(desc, Data)), "module '") of
        nomatch -> none;
        Name -> unicode:characters_to_list(string:trim(Name, trailing, "'"))
    end.

failed(Data, Why, #state{told = Told} = State) ->
    Line = [[":", integer_to_list(N)] || N <- [proplists:get_value(line, Data, 0)], N > 0],
    Test =
        case proplists:get_value(source, Data) of
            {Module, Function, _} -> io_lib:format("~ts:~ts", [Module, Function]);
            _ -> "group"
        end,
    Output = proplists:get_value(output, Data, <<>>),
    Text = io_lib:format("FAILED ~ts~ts ~ts~n~ts~n~ts~n", [
        Test, Line, text(proplists:get_value(desc, Data)), Why, text(Output)
    ]),
    counted(0, 1, Data, State#state{told = [Text | Told]}).

text(undefined) -> "";
text(Text) -> Text.
