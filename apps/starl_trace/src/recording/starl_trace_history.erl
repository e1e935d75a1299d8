%% @doc Reads the history of calls from a recording ({@link starl_history}), up to its first hole.
%% After a hole, answers may belong to calls that the recording does not have.
-module(starl_trace_history).

-export([file/2]).

-export_type([t/0]).

%% The facts of the run; the history of the calls to the machines of some models; the contracts' models,
%% with their configuration; and until when: to its end, or to a hole.
-type t() :: #{
    facts := starl_trace_message:scenario(),
    history := starl_history:t(),
    models := [{module(), map()}],
    until_us := integer(),
    ends := closed | hole
}.

-record(reading, {
    file :: file:filename_all(),
    models :: [module()],
    facts = none :: starl_trace_message:scenario() | none,
    history = none :: starl_history:t() | none,
    until = 0 :: integer(),
    hole = false :: boolean()
}).

%% @doc Reads what these models speak of.
-spec file(file:filename_all(), Models :: [module()]) ->
    {ok, t()} | {error, starl_trace_judge:reason()}.
file(File, Models) ->
    case starl_trace_reader:start(File) of
        {ok, Cursor} ->
            try
                all(Cursor, #reading{file = File, models = Models})
            after
                starl_trace_reader:stop(Cursor)
            end;
        {error, _} = Error ->
            Error
    end.

all(Cursor, #reading{file = File} = Reading) ->
    case starl_trace_reader:next(Cursor) of
        {ok, Messages, Next} ->
            case lists:foldl(fun message/2, Reading, Messages) of
                #reading{hole = true} = Read -> read(hole, Read);
                Read -> all(Next, Read)
            end;
        {ended, closed} when Reading#reading.facts =:= none -> {error, {no_scenario, File}};
        {ended, _} when Reading#reading.facts =:= none -> {error, {too_short, File}};
        {ended, closed} ->
            read(closed, Reading);
        {ended, _} ->
            read(hole, Reading);
        {error, _} = Error ->
            Error
    end.

read(Ends, #reading{facts = Facts, history = History, until = Until, models = Models}) ->
    {ok, #{
        facts => Facts,
        history => History,
        models => starl_history:models(Models, maps:get(monitors, Facts)),
        until_us => Until,
        ends => Ends
    }}.

message(_Message, #reading{hole = true} = Reading) ->
    Reading;
message({scenario, _, Facts}, #reading{facts = none, models = Models} = Reading) ->
    Of = starl_history:models(Models, maps:get(monitors, Facts)),
    Machines = [Model:machine() || {Model, _} <- Of],
    Reading#reading{facts = Facts, history = starl_history:new(Machines)};
message({gap, _, _}, #reading{facts = Facts} = Reading) when Facts =/= none ->
    Reading#reading{hole = true};
message({trace, At, {Robot, Machine, Event}}, #reading{history = History} = Reading) when
    History =/= none
->
    Known = starl_history:event({At, Robot, Machine, Event}, History),
    Reading#reading{history = Known, until = max(At, Reading#reading.until)};
message(_Message, Reading) ->
    Reading.
