%% @doc Reads the recording of a live run up to a moment, for `./starl onward'. For each robot it
%% returns the last snapshot, the inputs since then, its facts and its motion segment. It also
%% returns the packets in transit.
-module(starl_lab_onward_live).

-export([read/2]).

-export_type([t/0]).

-type t() :: #{
    scenario := starl_trace_message:scenario(), live := starl_sim_onward:live(), end_us := integer()
}.

-type id() :: starl:robot_id().

%% A robot: its last snapshot, its time, what has come since, newest first; the time of the last of it; is
%% the moment over for it?
-record(robot, {
    told = {error, no_snapshot} :: {ok, binary()} | {error, starl_sim_follow:reason()},
    at = 0 :: integer(),
    inputs = [] :: [{integer(), term()}],
    until = 0 :: integer(),
    is_over = false :: boolean(),
    is_up = true :: boolean()
}).

-record(read, {
    file :: file:filename_all(),
    until :: integer(),
    scenario = none :: starl_trace_message:scenario() | none,
    robots = #{} :: #{id() => #robot{}},
    pieces = #{} :: #{id() => starl_trajectory:piece()},
    %% newest first
    facts = [] :: [starl_monitor:trace_event()],
    %% packets that were sent before, by what they look like, with the times at which they arrive
    sent = #{} :: #{term() => [integer()]},
    %% what came after the moment
    came = [] :: [{id(), integer(), starl_packet:t()}],
    now = 0 :: integer()
}).

%% What is under way at a moment comes soon after it, and is heard soon after it has come.
-define(SOON_US, 2000000).
-define(HEARD_US, 500000).

%% @doc Reads a recording of a live run.
-spec read(file:filename_all(), UntilUs :: integer()) ->
    {ok, t()} | {error, starl_lab_onward_recording:reason()}.
read(File, Until) ->
    starl_lab_onward_recording:folded(
        fun message/2, #read{file = File, until = Until}, fun whole/1, File
    ).

message({scenario, _, #{robots := Robots} = Scenario}, #read{scenario = none, file = File} = Read) ->
    is_map_key(told_by, Scenario) andalso not is_map_key(has_motions, Scenario) andalso
        starl_lab_onward_recording:refuse({no_motions, File}),
    Read#read{scenario = Scenario, robots = maps:from_list([{Id, #robot{}} || {Id, _} <- Robots])};
message({gap, At, Why}, #read{until = Until, file = File} = Read) when At =< Until ->
    %% what was not judged may be there
    is_missing(Why) andalso starl_lab_onward_recording:refuse({hole, File, At}),
    Read#read{now = At};
message({_, At, _}, #read{until = Until} = Read) when At > Until + ?SOON_US ->
    Read#read{now = At};
message({snapshots, At, {Id, Told}}, #read{robots = Robots} = Read) when is_map_key(Id, Robots) ->
    told(Told, At, Id, Read#read{now = At});
message({trace, At, {Id, chassis, {motion, Piece}} = Fact}, #read{until = Until} = Read) when
    At =< Until
->
    #read{pieces = Pieces} = Read,
    fact(At, Fact, Read#read{pieces = Pieces#{Id => Piece}});
message({trace, At, {Id, robot, What} = Fact}, #read{until = Until} = Read) when At =< Until ->
    fact(At, Fact, turned(What, Id, Read));
message({trace, At, Fact}, Read) ->
    fact(At, Fact, Read);
message({packets, At, Packet}, #read{until = Until} = Read) when At =< Until ->
    packet(Packet, Read#read{now = At});
message({_, At, _}, Read) ->
    Read#read{now = At}.

packet({From, To, Brief, Bytes, {arrives, Copies}}, #read{until = Until, sent = Sent} = Read) ->
    Times = [Us || {Us, intact} <- Copies, Us > Until - ?HEARD_US],
    Key = {From, To, Brief, Bytes},
    Read#read{sent = Sent#{Key => Times ++ maps:get(Key, Sent, [])}};
packet(_Lost, Read) ->
    Read.

is_missing(N) when is_integer(N) -> true;
is_missing({hole, _}) -> true;
is_missing(Why) -> Why =:= no_end.

%% A simulated computer is never late.
fact(At, {_Id, robot, {late, _, _}}, Read) ->
    Read#read{now = At};
fact(At, {Id, Machine, Event}, #read{facts = Facts} = Read) ->
    Read#read{now = At, facts = [{At, Id, Machine, Event} | Facts]}.

%% A robot that starts again has no snapshot yet.
turned(down, Id, Read) -> with(Id, fun(_) -> #robot{is_up = false} end, Read);
turned(up, Id, Read) -> with(Id, fun(_) -> #robot{} end, Read);
turned(_Other, _Id, Read) -> Read.

with(Id, Fun, #read{robots = Robots} = Read) ->
    Read#read{robots = maps:update_with(Id, Fun, Robots)}.

told({input, {At, Input}}, _, Id, #read{until = Until} = Read) when At > Until ->
    after_moment(Input, At, Id, Read);
told({input, {At, Input}}, _, Id, Read) ->
    with(
        Id,
        fun(#robot{inputs = Ins} = R) -> R#robot{inputs = [{At, Input} | Ins], until = At} end,
        Read
    );
told(_Later, At, _Id, #read{until = Until} = Read) when At > Until ->
    Read;
told(Told, At, Id, Read) ->
    with(Id, fun(Robot) -> Robot#robot{told = Told, at = At, inputs = [], until = At} end, Read).

%% What has begun is ended.
after_moment(now, At, Id, #read{robots = Robots} = Read) ->
    case Robots of
        #{Id := #robot{is_over = false, inputs = Inputs} = Robot} ->
            Read#read{
                robots = Robots#{Id := Robot#robot{inputs = [{At, now} | Inputs], until = At}}
            };
        #{} ->
            Read
    end;
after_moment(Input, At, Id, Read) ->
    came(Input, At, Id, with(Id, fun(Robot) -> Robot#robot{is_over = true} end, Read)).

came({event, sap, packet, Packet}, At, Id, #read{came = Came} = Read) ->
    Read#read{came = [{Id, At, Packet} | Came]};
came(_Other, _At, _Id, Read) ->
    Read.

%% -- the moment -----------------------------------------------------------------------------

whole(#read{scenario = none, file = File}) ->
    starl_lab_onward_recording:refuse({no_scenario, File});
whole(#read{scenario = Scenario, facts = Reversed, robots = Robots, pieces = Pieces} = Read) ->
    #read{until = Until, now = End} = Read,
    #{app := App, scenario := Values} = Scenario,
    Ends = maps:map(fun(_, #robot{until = Us}) -> max(Us, Until) end, Robots),
    Facts = [
        Fact
     || {At, Id, Machine, _} = Fact <- lists:reverse(Reversed),
        At =< until(Machine, Id, Until, Ends)
    ],
    #{
        scenario => Scenario,
        end_us => End,
        live => #{
            scenario => Values#{app => App},
            facts => Facts,
            robots => maps:map(fun(Id, Robot) -> past(Id, Robot, Facts, Pieces) end, Robots),
            pieces => Pieces,
            packets => under_way(Read)
        }
    }.

until(Machine, _Id, Until, _Ends) when Machine =:= chassis; Machine =:= radio; Machine =:= robot ->
    Until;
until(_Machine, Id, Until, Ends) ->
    maps:get(Id, Ends, Until).

past(_Id, #robot{is_up = false}, _Facts, _Pieces) ->
    {error, down};
past(_Id, #robot{told = {error, Why}}, _Facts, _Pieces) ->
    {error, Why};
past(Id, #robot{told = {ok, Bytes}, inputs = Inputs}, Facts, Pieces) ->
    case snapshot(Bytes) of
        {ok, {live, #{at_us := At} = Snapshot}} ->
            {ok, #{
                snapshot => Snapshot,
                inputs => lists:reverse(Inputs),
                facts => [Fact || {Us, Of, _, _} = Fact <- Facts, Of =:= Id, Us > At],
                piece => maps:get(Id, Pieces)
            }};
        _ ->
            {error, other_code}
    end.

snapshot(Bytes) ->
    case starl_trace_terms:read(Bytes) of
        {ok, Term} -> starl_snapshot:of_term(Term);
        {error, _} = Error -> Error
    end.

%% What was sent before the moment and heard after it.
under_way(#read{sent = Sent, came = Came}) ->
    {Packets, _} = lists:foldl(fun under_way/2, {[], Sent}, lists:reverse(Came)),
    lists:reverse(Packets).

under_way({To, Heard, Packet}, {Packets, Sent}) ->
    From = starl_packet:source(Packet),
    Key = {From, To, starl_packet:brief(Packet), erlang:external_size(Packet)},
    case [Us || Us <- maps:get(Key, Sent, []), Us =< Heard + ?HEARD_US, Us >= Heard - ?HEARD_US] of
        [Us | _] when is_integer(From) ->
            Left = lists:delete(Us, maps:get(Key, Sent)),
            {[{To, Us, From, Packet} | Packets], Sent#{Key := Left}};
        _ ->
            {Packets, Sent}
    end.
