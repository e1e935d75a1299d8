%% @doc Reads a recording up to a moment, for `./starl onward': the scenario of its run, its facts,
%% and the snapshots of its robots. It also returns the events of a part of the recording.
-module(starl_lab_onward_recording).

-export([read/2, between/3, folded/4, refuse/1, format_error/1]).

-export_type([t/0, happened/0, reason/0]).

%% `told': how many snapshots of robots there are, and why others were not kept; `end_us': the time of the
%% last message.
-type t() :: #{
    scenario := starl_trace_message:scenario(),
    facts := [starl_monitor:trace_event()],
    images := [starl_sim_onward:image()],
    not_kept := [{starl:robot_id(), starl_snapshot:reason()}],
    end_us := integer()
}.

%% A fact of a robot's machine, a packet that it sent with its fate, or a fault that begins.
-type happened() ::
    {AtUs :: integer(), starl:robot_id(), {starl_machine:name(), term()}}
    | {AtUs :: integer(), fault, term()}.

-type reason() ::
    {unreadable, starl_trace_reader:reason()}
    | {no_scenario, file:filename_all()}
    | {hole, file:filename_all(), AtUs :: integer()}
    | {live, file:filename_all()}
    | {no_motions, file:filename_all()}.

-record(read, {
    file :: file:filename_all(),
    until :: integer(),
    scenario = none :: starl_trace_message:scenario() | none,
    facts = [] :: [starl_monitor:trace_event()],
    images = #{} :: #{integer() => #{starl:robot_id() => binary()}},
    not_kept = [] :: [{starl:robot_id(), starl_snapshot:reason()}],
    now = 0 :: integer()
}).

%% @doc Reads a recording up to this time; of the rest it returns only the end.
-spec read(file:filename_all(), UntilUs :: integer()) -> {ok, t()} | {error, reason()}.
read(File, Until) -> folded(fun message/2, #read{file = File, until = Until}, fun whole/1, File).

%% @doc What the messages of a recording come to; either function may {@link refuse/1} it.
-spec folded(Message, Acc, Whole, file:filename_all()) -> {ok, Read} | {error, reason()} when
    Message :: fun((starl_trace_message:t(), Acc) -> Acc), Whole :: fun((Acc) -> Read).
folded(Message, Begun, Whole, File) ->
    try
        case starl_trace_reader:fold(Message, Begun, File) of
            {ok, Read, _Ended} -> {ok, Whole(Read)};
            {error, Reason} -> {error, {unreadable, Reason}}
        end
    catch
        throw:{?MODULE, Why} -> {error, Why}
    end.

%% @doc Ends the reading of a recording.
-spec refuse(reason()) -> no_return().
refuse(Reason) -> throw({?MODULE, Reason}).

%% @doc What happened from a time until before another, in its order.
-spec between(file:filename_all(), FromUs :: integer(), ToUs :: integer()) ->
    {ok, [happened()]} | {error, reason()}.
between(File, From, To) ->
    Happened = fun(Message, Acc) ->
        case happened(Message) of
            {At, _, _} = One when At >= From, At < To -> [One | Acc];
            _ -> Acc
        end
    end,
    folded(Happened, [], fun(All) -> lists:keysort(1, lists:reverse(All)) end, File).

happened({trace, At, {Robot, Machine, Event}}) ->
    {At, Robot, {Machine, Event}};
happened({packets, At, {From, To, Brief, Bytes, Fate}}) ->
    {At, From, {radio, {packet, To, Brief, Bytes, Fate}}};
happened({faults, At, {began, Fault}}) ->
    {At, fault, Fault};
happened(_Other) ->
    none.

message({scenario, _, #{kind := simulation} = Scenario}, #read{scenario = none} = Read) ->
    Read#read{scenario = Scenario};
message({scenario, _, #{kind := live}}, #read{scenario = none, file = File}) ->
    refuse({live, File});
message({gap, At, _}, #read{until = Until, file = File}) when At =< Until ->
    refuse({hole, File, At});
message({_, At, _}, #read{until = Until} = Read) when At > Until ->
    Read#read{now = At};
message({trace, At, {Robot, Machine, Event}}, #read{facts = Facts} = Read) ->
    Read#read{now = At, facts = [{At, Robot, Machine, Event} | Facts]};
message({snapshots, At, {Robot, {ok, Bytes}}}, #read{images = Images} = Read) ->
    Known = maps:get(At, Images, #{}),
    Read#read{now = At, images = Images#{At => Known#{Robot => Bytes}}};
message({snapshots, At, {Robot, {error, Reason}}}, #read{not_kept = NotKept} = Read) ->
    Read#read{now = At, not_kept = lists:keystore(Robot, 1, NotKept, {Robot, Reason})};
message({_, At, _}, Read) ->
    Read#read{now = At}.

whole(#read{scenario = none, file = File}) ->
    refuse({no_scenario, File});
whole(#read{scenario = Scenario, facts = Facts, images = Images, not_kept = NotKept, now = End}) ->
    #{robots := Robots} = Scenario,
    #{
        scenario => Scenario,
        facts => lists:reverse(Facts),
        images => [
            Image
         || {At, Kept} <- lists:sort(maps:to_list(Images)),
            map_size(Kept) =:= length(Robots),
            {ok, Image} <- [image(At, Kept)]
        ],
        not_kept => NotKept,
        end_us => End
    }.

%% What cannot be read here is as if it had not been kept.
image(At, Kept) ->
    Read = [{Id, read(Bytes)} || {Id, Bytes} <- maps:to_list(Kept)],
    case [{Id, W, Robot} || {Id, {ok, {simulation, W, Robot}}} <- Read] of
        [{_, Windows, _} | _] = All when length(All) =:= map_size(Kept) ->
            {ok, {At, Windows, maps:from_list([{Id, Robot} || {Id, _, Robot} <- All])}};
        _ ->
            none
    end.

read(Bytes) ->
    case starl_trace_terms:read(Bytes) of
        {ok, Term} -> starl_snapshot:of_term(Term);
        {error, _} = Error -> Error
    end.

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({unreadable, Reason}) ->
    starl_trace_reader:format_error(Reason);
format_error({no_scenario, File}) ->
    io_lib:format("~ts: the recording does not begin with its scenario", [File]);
format_error({hole, File, At}) ->
    io_lib:format("~ts: the recording has a hole at ~.3f s; choose an earlier moment", [
        File, At / 1.0e6
    ]);
format_error({no_motions, File}) ->
    io_lib:format("~ts: the true motions are missing; merge the world's run.mcap, too", [File]);
format_error({live, File}) ->
    io_lib:format("~ts: a live run cannot be simulated onwards yet", [File]).
