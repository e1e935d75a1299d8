%% @doc Replicated registers: the last writer wins, by a hybrid logical clock.
%% ```
%%   writer                                  all others
%%     | write {Name, Value, Stamp} ------------>|   taken if the stamp is later than the own
%%
%%   robot          once in sync_ms          a random other
%%     | sync {hash of all stamps} ------------->|   equal: nothing to do
%%     |<---------------- digest [{Name, Stamp}] |   else
%%     | entries [{Name, Value, Stamp}] -------->|   what is later here
%%     | want [Name] --------------------------->|   what is later there
%%     |<--------- entries [{Name, Value, Stamp}]|
%% '''
%% What does not fit into one message goes in several. A digest then names the range of names that
%% it covers, in their order, and the entries come as `part's.
%%
%% A writer announces its writes by a broadcast of SAP. The exchange of digests repairs losses by
%% partitions, restarts and robots out of range. A restarted machine knows nothing. It first asks
%% some other robots, and answers its application when the first has sent its registers, or after
%% `recover_ms'. A stamp more than `ahead_ms' ahead of the own clock is not taken until the own
%% clock has come nearer, so `ahead_ms' must exceed the clocks' differences.
%%
%% A stamp that is ahead by more than twice that ({@link starl_hlc:is_beyond/3}) comes from a wrong
%% clock. The robot that sent it is informed by `{beyond, Stamp}'. A robot that most of the others
%% have refused in this way does two things:
%% <ul><li>refuses to write (`{error, refused}'), as nobody would read it;</li>
%% <li>goes back to its own clock as soon as that, too, shows that its last stamp is beyond. It
%% writes its own values anew, with stamps that all others accept, and forgets those of other robots
%% whose clocks were wrong. So a wrong clock does not outlive itself through the stored
%% time.</li></ul>
%%
%% The machine stores a time later than all stamps that it gives. Before a stamp reaches that time,
%% it stores a later one. The clock of a restarted machine starts there, later than all stamps that
%% it has ever given, at any value of the physical clock. If the store is damaged, the clock starts
%% so far ahead that only a physical clock that has run backwards can spoil it ({@link starl_hlc}).
%%
%% `limit' bounds the registers that a robot adds: it adds none while it is the last writer of
%% `limit' registers. `bytes' bounds the total size of the registers whose last writer it is. Other
%% robots accept up to twice these bytes, as a robot that has forgotten its writes may write more.
%% Beyond that they keep the writes with the latest stamps, so that they agree. So memory is bounded
%% for each robot of the team, and a robot that writes more takes no room from others. Writes of
%% robots outside the team are not accepted.
%%
%% A robot gets at most `?ANSWERS' messages with answers between two exchanges of the robot that it
%% asks.
%%
%% Calls: `{put, Name, Value}' (answer `ok', `{error, not_owner | full | refused}'), `{get, Name}' (answer
%% `{ok, Value}', `{error, unset}'). Cast: `{subscribe, Name, Machine}'; the subscriber gets the
%% cast `{message, Writer, register, {Name, Value}}'. Trace: {@link event()}.
-module(starl_registers_lww).
-behaviour(starl_machine).

-export([has_history/0, init/1, handle_event/5, accepts/2]).

-export_type([event/0]).

%% The trace of the registers; a hash is that of the value.
-type event() ::
    {put, starl_registers:name(), Hash :: non_neg_integer(), starl_hlc:stamp()}
    %% a read, and what it returned
    | {got, starl_registers:name(), Hash :: non_neg_integer(), starl_hlc:stamp()}
    | {got, starl_registers:name(), unset}
    %% the copy of this robot has changed
    | {holds, starl_registers:name(), starl_hlc:stamp()}
    %% another robot's entry is not taken: its stamp is too far ahead of the own clock, or its
    %% writer may not write the register
    | {too_far_ahead, starl_registers:name(), starl_hlc:stamp()}
    %% (or is not in the team)
    | {refused, starl_registers:name(), Writer :: starl:robot_id(), not_owner}
    %% that robot refuses this robot's stamps: they are beyond all clocks within their bound
    | {denied, By :: starl:robot_id()}
    %% the own stamps were beyond the own clock, which shows this: they go on from there
    | {set_right, ClockUs :: integer()}.

-type entry() :: {starl_registers:name(), Value :: term(), starl_hlc:stamp()}.

%% The number of other robots that are asked after a restart.
-define(ASKED, 3).
%% The stored time is ahead by this, so a time is stored at most once in this time.
-define(RESERVED_US, 1000000).
%% A refusal counts for so many exchanges, times the number of others. Two robots exchange twice as often.
-define(COUNTS, 4).
%% The bytes that a register takes beside its name, value and stamp.
-define(AROUND, 100).
%% The most messages with registers or stamps for one robot between two own exchanges.
-define(ANSWERS, 32).

-record(lww, {
    self :: starl:robot_id(),
    others :: [starl:robot_id()],
    owners :: #{starl_registers:name() => starl:robot_id()},
    clock :: starl_hlc:t(),
    random :: rand:state(),
    sync_us :: pos_integer(),
    limit :: pos_integer(),
    entries = #{} :: #{starl_registers:name() => {Value :: term(), starl_hlc:stamp()}},
    subscribers = #{} :: #{starl_registers:name() => starl_machine:name()},
    %% the calls that wait for the recovery, latest first
    waiting = [] :: [{starl_machine:from(), Request :: term()}],
    %% stamps are given before this time; it is stored
    reserved = none :: integer() | none,
    %% the robots that refuse the own stamps, each with the number of the last exchange in which it counts
    denied = #{} :: #{starl:robot_id() => non_neg_integer()},
    exchanges = 0 :: non_neg_integer(),
    team :: starl_team:t(),
    bytes :: pos_integer(),
    %% of the registers that have this robot as their last writer
    shares = #{} :: #{starl:robot_id() => share()},
    %% the messages with answers since the last exchange
    answered = #{} :: #{starl:robot_id() => pos_integer()}
}).

%% The number and the bytes of a robot's registers; if there was no room for all: the latest stamp of those that
%% are gone, and all others in the order of their stamps.
-type share() ::
    {non_neg_integer(), Bytes :: non_neg_integer(), none | {none | starl_hlc:stamp(), order()}}.
-type order() :: gb_sets:set({starl_hlc:stamp(), starl_registers:name()}).

-spec has_history() -> true.
has_history() -> true.

-spec init(starl_machine:config()) ->
    {ready | recovering, #lww{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, now := Now, incarnation := Start} = Config) ->
    Options = maps:merge(starl_options:defaults(starl_registers:options()), Config),
    #{ahead_ms := AheadMs, sync_ms := SyncMs, recover_ms := RecoverMs} = Options,
    %% A number of the stream, never the stream itself: that holds functions of OTP's module rand,
    %% which hash differently in every release of OTP.
    {Seed, _} = rand:uniform_s(1 bsl 32, maps:get(random, Config)),
    Lww = #lww{
        self = Self,
        others = starl_team:others(Self, Team),
        owners = map_get(owners, Options),
        clock = clock(maps:get(stored, Config, none), begun(Config), Self, 1000 * AheadMs, Now),
        %% not the draws of the life before
        random = rand:seed_s(exsss, erlang:phash2({Seed, Start}, 1 bsl 32)),
        sync_us = 1000 * SyncMs,
        limit = map_get(limit, Options),
        bytes = map_get(bytes, Options),
        team = Team
    },
    start(Start, 1000 * RecoverMs, Lww).

%% A machine that has stored nothing has given no stamp. A store that is older than the robot's last
%% life gives back a time at which that one may have given stamps: the counter tells the lives apart.
clock(Stored, {Life, Start}, Self, Ahead, Now) ->
    Writer = writer(Self, Life),
    New = starl_hlc:new(Writer, Ahead),
    case Stored of
        none -> New;
        {stored, Reserved} -> starl_hlc:observe({Reserved, Life bsl 32, Writer}, Reserved, New);
        damaged -> starl_hlc:after_restart(Writer, Ahead, Now, Start)
    end.

writer(Self, 0) -> Self;
writer(Self, Life) -> {Self, Life}.

%% The number of a later life of the robot, 0 in the first one; the number of this start.
begun(#{incarnation := Start} = Config) ->
    case maps:get(life, Config, {0, 1}) of
        {0, 1} -> {0, Start};
        {_, Life} -> {Life, Start}
    end.

start(Start, _RecoverUs, #lww{others = Others} = Lww0) when Start =:= 1; Others =:= [] ->
    {Tick, Lww} = tick(Lww0),
    {ready, Lww, [listen(), Tick]};
start(_Restarted, RecoverUs, #lww{others = Others} = Lww0) ->
    {Asked, Lww1} = draw(?ASKED, Others, Lww0),
    {Tick, Lww} = tick(Lww1),
    Ask = [post(Robot, {digest, []}) || Robot <- Asked],
    {recovering, Lww, [listen(), Tick, {{timeout, recover}, RecoverUs, recover} | Ask]}.

-spec handle_event(
    starl_machine:event_type(), term(), ready | recovering, #lww{}, starl_machine:meta()
) -> starl_machine:result().
handle_event({call, From}, Request, recovering, #lww{waiting = Waiting} = Lww, _Meta) ->
    {keep_state, Lww#lww{waiting = [{From, Request} | Waiting]}};
handle_event({call, From}, Request, ready, Lww, #{now := Now}) ->
    {Next, Actions} = serve(From, Request, Now, Lww),
    {keep_state, Next, Actions};
handle_event(cast, {message, Source, registers, Body}, State, Lww, #{now := Now}) ->
    {Next, Actions} = message(Body, Source, Now, Lww),
    recovered(Body, State, Now, Next, Actions);
handle_event({timeout, sync}, _, _State, Lww, #{now := Now}) ->
    sync(Now, Lww);
handle_event({timeout, recover}, _, recovering, Lww, #{now := Now}) ->
    be_ready(Now, Lww, []);
handle_event(cast, {subscribe, Name, Machine}, _State, Lww, _Meta) ->
    Subscribers = (Lww#lww.subscribers)#{Name => Machine},
    Next = Lww#lww{subscribers = Subscribers},
    {keep_state, Next, notify(Name, Next)};
handle_event(info, {restarted, sap}, _State, _Lww, _Meta) ->
    {keep_state_and_data, [listen()]};
handle_event(info, {restarted, _}, _State, _Lww, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

listen() -> starl_sap:listen(registers, registers).

%% -- recovery -------------------------------------------------------------------------------

%% The first answer to the questions of the start ends the recovery.
recovered({entries, _}, recovering, Now, Lww, Actions) -> be_ready(Now, Lww, Actions);
recovered(_Body, _State, _Now, Lww, Actions) -> {keep_state, Lww, Actions}.

be_ready(Now, #lww{waiting = Waiting} = Lww0, Before) ->
    {Lww, Actions} = lists:foldl(
        fun({From, Request}, {Acc, Done}) ->
            {Next, New} = serve(From, Request, Now, Acc),
            {Next, Done ++ New}
        end,
        {Lww0#lww{waiting = []}, Before ++ [{{timeout, recover}, cancel}]},
        lists:reverse(Waiting)
    ),
    {next_state, ready, Lww, Actions}.

%% -- the application's calls ----------------------------------------------------------------

serve(From, {put, Name, Value}, Now, Lww0) ->
    {Lww, Before} = set_right(Now, Lww0),
    {Next, Actions} =
        case may_put(Name, Value, Lww) of
            ok -> write(From, Name, Value, Now, Lww);
            {error, _} = Error -> {Lww, [{reply, From, Error}]}
        end,
    {Next, Before ++ Actions};
serve(From, {get, Name}, _Now, #lww{entries = Entries} = Lww) ->
    case Entries of
        #{Name := {Value, Stamp}} ->
            {Lww, [{trace, {got, Name, hash(Value), Stamp}}, {reply, From, {ok, Value}}]};
        #{} ->
            {Lww, [{trace, {got, Name, unset}}, {reply, From, {error, unset}}]}
    end.

may_put(Name, Value, #lww{self = Self, denied = Denied, others = Others} = Lww) ->
    case may_write(Name, Self, Lww) of
        true when 2 * map_size(Denied) > length(Others) -> {error, refused};
        true -> has_room(Name, Value, Lww);
        false -> {error, not_owner}
    end.

has_room(Name, Value, #lww{self = Self, entries = Entries, limit = Limit, bytes = Most} = Lww) ->
    {Count, Bytes, _} = share(Self, Lww),
    {New, Before} =
        case Entries of
            #{Name := {Old, Stamp}} -> {0, own_bytes(Self, {Name, Old, Stamp})};
            #{} -> {1, 0}
        end,
    After = Bytes - Before + bytes({Name, Value, {0, 0, Self}}),
    case New =:= 1 andalso Count >= Limit orelse (After > Most andalso After > Bytes) of
        true -> {error, full};
        false -> ok
    end.

own_bytes(Self, {_, _, Stamp} = Entry) ->
    case starl_hlc:robot(Stamp) of
        Self -> bytes(Entry);
        _ -> 0
    end.

may_write(Name, Writer, #lww{owners = Owners, team = Team}) ->
    maps:get(Name, Owners, Writer) =:= Writer andalso starl_team:has(Writer, Team).

write(From, Name, Value, Now, Lww) ->
    {Stamp, Reserve, Stamped} = stamp(Now, Lww),
    {Written, Actions} = store({Name, Value, Stamp}, Stamped),
    Announce = {cast, sap, {broadcast, registers, {write, Name, Value, Stamp}}},
    {Written,
        Reserve ++ [{trace, {put, Name, hash(Value), Stamp}} | Actions] ++
            [
                Announce, {reply, From, ok}
            ]}.

stamp(Now, #lww{clock = Clock0} = Lww) ->
    {Stamp, Clock} = starl_hlc:stamp(Now, Clock0),
    {Reserve, Reserved} = reserve(Stamp, Lww#lww{clock = Clock}),
    {Stamp, Reserve, Reserved}.

%% The store comes before every action that follows from the stamp.
reserve({Time, _, _}, #lww{reserved = Reserved} = Lww) when is_integer(Reserved), Time < Reserved ->
    {[], Lww};
reserve({Time, _, _}, Lww) ->
    Later = Time + ?RESERVED_US,
    {[{store, Later}], Lww#lww{reserved = Later}}.

%% -- a clock that was wrong -----------------------------------------------------------------

%% Another robot refuses the own stamps. An answer to a stamp from before {@link set_right/2} comes too late.
denied(Source, {Time, _, _}, Now, #lww{clock = Clock, denied = Denied} = Lww) ->
    case starl_hlc:now(Clock) of
        Own when is_integer(Own), Time =< Own ->
            Until = Lww#lww.exchanges + ?COUNTS * length(Lww#lww.others),
            {Next, Actions} = set_right(Now, Lww#lww{denied = Denied#{Source => Until}}),
            {Next, [{trace, {denied, Source}} | Actions]};
        _ ->
            {Lww, []}
    end.

%% Most of the others refuse the own stamps, and the own clock agrees with them. It alone proves nothing:
%% it may be this clock that is wrong now, and behind.
set_right(Now, #lww{clock = Clock, denied = Denied, others = Others} = Lww) ->
    case 2 * map_size(Denied) > length(Others) andalso starl_hlc:is_ahead(Now, Clock) of
        true -> rewrite(Now, Lww);
        false -> {Lww, []}
    end.

rewrite(Now, #lww{self = Self, clock = Clock, entries = Entries} = Lww0) ->
    Wrong = [
        Entry
     || {_, {_, Stamp}} = Entry <- lists:sort(maps:to_list(Entries)),
        starl_hlc:is_beyond(Stamp, Now, Clock)
    ],
    Lww = lists:foldl(fun drop/2, Lww0, [Name || {Name, _} <- Wrong]),
    Stamps = [Stamp || {_, Stamp} <- maps:values(Lww#lww.entries)],
    Lww1 = Lww#lww{clock = starl_hlc:restart(Stamps, Clock), reserved = none, denied = #{}},
    Own = [{Name, V} || {Name, {V, Stamp}} <- Wrong, starl_hlc:robot(Stamp) =:= Self],
    lists:foldl(
        fun({Name, Value}, {Acc, Actions}) ->
            {Stamp, Reserve, Stamped} = stamp(Now, Acc),
            Holds = [{trace, {put, Name, hash(Value), Stamp}}, {trace, {holds, Name, Stamp}}],
            {put_entry({Name, Value, Stamp}, Stamped), Actions ++ Reserve ++ Holds}
        end,
        {Lww1, [{trace, {set_right, Now}}]},
        Own
    ).

%% -- messages -------------------------------------------------------------------------------

%% @private What comes over the radio.
-spec accepts(starl_packet:type(), Body :: term()) -> boolean().
accepts(registers, {write, Name, Value, Stamp}) ->
    starl_shape:is(entry(), {Name, Value, Stamp});
accepts(registers, {entries, Entries}) ->
    starl_shape:is({list, entry()}, Entries);
accepts(registers, {sync, Hash}) ->
    starl_shape:is(natural, Hash);
accepts(registers, {part, Entries}) ->
    starl_shape:is({list, entry()}, Entries);
accepts(registers, {digest, Digest}) ->
    starl_shape:is({list, [label, stamp()]}, Digest);
accepts(registers, {digest, Digest, After, Last}) ->
    starl_shape:is([{list, [label, stamp()]}, bound(), bound()], {Digest, After, Last});
accepts(registers, {want, Names}) ->
    starl_shape:is({list, label}, Names);
accepts(registers, {beyond, Stamp}) ->
    starl_shape:is(stamp(), Stamp);
accepts(_Type, _Body) ->
    false.

stamp() -> [integer, {either, [{is, 0}, serial]}, {either, [count, [count, serial]]}].

bound() -> {either, [{is, none}, [{is, name}, label]]}.

entry() -> [label, content, stamp()].

message({write, Name, Value, Stamp}, Source, Now, Lww) ->
    take([{Name, Value, Stamp}], Source, Now, Lww);
message({Kind, Entries}, Source, Now, Lww) when Kind =:= entries; Kind =:= part ->
    take(Entries, Source, Now, Lww);
message({beyond, Stamp}, Source, Now, Lww) ->
    denied(Source, Stamp, Now, Lww);
message({sync, Hash}, Source, _Now, Lww) ->
    Own = digest(Lww),
    Parts = [Part || hash(Own) =/= Hash, Part <- starl_payload:parts(Own)],
    answer(Source, digests(Parts, none), Lww);
message({digest, Theirs}, Source, Now, Lww) ->
    message({digest, Theirs, none, none}, Source, Now, Lww);
message({digest, Theirs, After, Last}, Source, _Now, Lww) ->
    answer(Source, differences(Theirs, {After, Last}, Lww), Lww);
message({want, Names}, Source, _Now, #lww{entries = Entries} = Lww) ->
    %% each but once
    Wanted = [{N, V, S} || N <- maps:keys(maps:from_keys(Names, [])), #{N := {V, S}} <- [Entries]],
    answer(Source, entry_messages(starl_payload:parts(lists:sort(Wanted))), Lww).

%% What does not go now is asked for again in a later exchange.
answer(Source, Bodies, #lww{answered = Answered} = Lww) ->
    Before = maps:get(Source, Answered, 0),
    Now = lists:sublist(Bodies, max(0, ?ANSWERS - Before)),
    {Lww#lww{answered = Answered#{Source => Before + length(Now)}}, [
        post(Source, Body)
     || Body <- Now
    ]}.

%% What another robot does not know of the names in this range, and the names of which it knows more.
differences(Theirs, {After, Last}, #lww{entries = Entries}) ->
    Known = maps:from_list(Theirs),
    Later = [
        {Name, V, S}
     || {Name, {V, S}} <- lists:sort(maps:to_list(Entries)),
        After =:= none orelse {name, Name} > After,
        Last =:= none orelse {name, Name} =< Last,
        not is_map_key(Name, Known) orelse map_get(Name, Known) < S
    ],
    Want = [Name || {Name, Stamp} <- Theirs, is_later(Name, Stamp, Entries)],
    %% a robot that knows nothing waits for an answer, even an empty one
    IsAnswered = Later =/= [] orelse Theirs =:= [],
    [Body || IsAnswered, Body <- entry_messages(starl_payload:parts(Later))] ++
        [{want, Part} || Want =/= [], Part <- starl_payload:parts(Want)].

%% Parts do not end a recovery: another may be under way.
entry_messages([Entries]) -> [{entries, Entries}];
entry_messages(Parts) -> [{part, Part} || Part <- Parts].

%% Each but the last ends with its last name, and the next begins after that.
digests([], none) ->
    [];
digests([Digest], none) ->
    [{digest, Digest}];
digests([Digest], After) ->
    [{digest, Digest, After, none}];
digests([Digest | Digests], After) ->
    {Name, _} = lists:last(Digest),
    [{digest, Digest, After, {name, Name}} | digests(Digests, {name, Name})].

-spec take([entry()], starl:robot_id(), Now :: integer(), #lww{}) ->
    {#lww{}, [starl_machine:action()]}.
take(Entries, Source, Now, Lww0) ->
    {Lww, Actions} = lists:foldl(
        fun(Entry, {Acc, Done}) ->
            {Next, New} = take_one(Entry, Now, Acc),
            {Next, Done ++ New}
        end,
        {Lww0, []},
        Entries
    ),
    Kept = lists:foldl(fun keep_latest/2, Lww, lists:usort(maps:keys(Lww#lww.shares))),
    {Kept, Actions ++ deny(lists:max([none | [S || {_, _, S} <- Entries]]), Source, Now, Kept)}.

%% Who sent a stamp that is beyond all clocks hears of it. (An atom is less than every stamp.)
deny(none, _Source, _Now, _Lww) ->
    [];
deny(Latest, Source, Now, #lww{clock = Clock}) ->
    [post(Source, {beyond, Latest}) || starl_hlc:is_beyond(Latest, Now, Clock)].

take_one({Name, _Value, Stamp} = Entry, Now, #lww{clock = Clock} = Lww) ->
    Writer = starl_hlc:robot(Stamp),
    case {may_write(Name, Writer, Lww), starl_hlc:admits(Stamp, Now, Clock)} of
        {true, true} ->
            Observed = Lww#lww{clock = starl_hlc:observe(Stamp, Now, Clock)},
            case is_later(Name, Stamp, Lww#lww.entries) andalso fits(Entry, Lww) of
                true -> store(Entry, Observed);
                false -> {Observed, []}
            end;
        {true, false} ->
            {Lww, [{trace, {too_far_ahead, Name, Stamp}}]};
        {false, _} ->
            {Lww, [{trace, {refused, Name, Writer, not_owner}}]}
    end.

is_later(Name, Stamp, Entries) ->
    case Entries of
        #{Name := {_, Own}} -> Stamp > Own;
        #{} -> true
    end.

store({Name, _Value, Stamp} = Entry, Lww) ->
    Next = put_entry(Entry, Lww),
    {Next, [{trace, {holds, Name, Stamp}} | notify(Name, Next)]}.

notify(Name, #lww{subscribers = Subscribers, entries = Entries}) ->
    case {Subscribers, Entries} of
        {#{Name := Machine}, #{Name := {Value, Stamp}}} ->
            [{cast, Machine, {message, starl_hlc:robot(Stamp), register, {Name, Value}}}];
        {_, _} ->
            []
    end.

%% -- the room for registers -----------------------------------------------------------------

put_entry({Name, Value, Stamp} = Entry, Lww0) ->
    Lww = drop(Name, Lww0),
    Added = Lww#lww{entries = (Lww#lww.entries)#{Name => {Value, Stamp}}},
    counted(Entry, 1, fun gb_sets:add_element/2, Added).

drop(Name, #lww{entries = Entries} = Lww) ->
    case Entries of
        #{Name := {Value, Stamp}} ->
            Dropped = Lww#lww{entries = maps:remove(Name, Entries)},
            counted({Name, Value, Stamp}, -1, fun gb_sets:del_element/2, Dropped);
        #{} ->
            Lww
    end.

counted({Name, _Value, Stamp} = Entry, Number, Change, #lww{shares = Shares} = Lww) ->
    Writer = starl_hlc:robot(Stamp),
    {Count, Sum, Full} = share(Writer, Lww),
    Order =
        case Full of
            none -> none;
            {Gone, Left} -> {Gone, Change({Stamp, Name}, Left)}
        end,
    Share = {Count + Number, Sum + Number * bytes(Entry), Order},
    Lww#lww{shares = Shares#{Writer => Share}}.

share(Writer, #lww{shares = Shares}) -> maps:get(Writer, Shares, {0, 0, none}).

bytes({Name, Value, Stamp}) -> erlang:external_size({Name, Value, Stamp}) + ?AROUND.

%% A write that is no later than one for which there was no room is taken if there is room now.
fits({_, _, Stamp} = Entry, #lww{bytes = Most} = Lww) ->
    case share(starl_hlc:robot(Stamp), Lww) of
        {_, Bytes, {Gone, _}} when Stamp =< Gone -> Bytes + bytes(Entry) =< 2 * Most;
        _ -> true
    end.

%% The earliest writes of a robot go, as far as all are more than there is room for.
keep_latest(Writer, #lww{bytes = Most, shares = Shares} = Lww) ->
    case Shares of
        #{Writer := {_, Bytes, _}} when Bytes =< 2 * Most ->
            Lww;
        #{Writer := {Count, Bytes, none}} ->
            Ordered = {Count, Bytes, {none, in_order(Writer, Lww)}},
            keep_latest(Writer, Lww#lww{shares = Shares#{Writer := Ordered}});
        #{Writer := {_, _, {Before, Order}}} ->
            {{Stamp, Name}, _} = gb_sets:take_smallest(Order),
            #lww{shares = #{Writer := {Count, Bytes, {_, Left}}} = Later} = Next = drop(Name, Lww),
            %% an atom is less than every stamp
            Share = {Count, Bytes, {max(Stamp, Before), Left}},
            keep_latest(Writer, Next#lww{shares = Later#{Writer := Share}})
    end.

in_order(Writer, #lww{entries = Entries}) ->
    gb_sets:from_list([
        {Stamp, Name}
     || {Name, {_, Stamp}} <- maps:to_list(Entries), starl_hlc:robot(Stamp) =:= Writer
    ]).

%% -- the exchange ---------------------------------------------------------------------------

sync(_Now, #lww{others = []}) ->
    keep_state_and_data;
sync(Now, #lww{others = Others} = Lww0) ->
    {Lww1, Righted} = set_right(Now, older(Lww0#lww{answered = #{}})),
    {[Robot], Lww2} = draw(1, Others, Lww1),
    {Tick, Lww} = tick(Lww2),
    {keep_state, Lww, Righted ++ [Tick, post(Robot, {sync, hash(digest(Lww))})]}.

%% A refusal counts for some exchanges with each of the others; then it must be repeated.
older(#lww{denied = Denied} = Lww) when map_size(Denied) =:= 0 -> Lww;
older(#lww{denied = Denied, exchanges = Exchanges} = Lww) ->
    Left = maps:filter(fun(_, Until) -> Until > Exchanges end, Denied),
    Lww#lww{denied = Left, exchanges = Exchanges + 1}.

digest(#lww{entries = Entries}) ->
    lists:sort([{Name, Stamp} || {Name, {_, Stamp}} <- maps:to_list(Entries)]).

post(Robot, Body) -> starl_sap:post(Robot, registers, Body).

%% Between half and one and a half of the mean.
tick(#lww{random = Random0, sync_us = Mean} = Lww) ->
    {Us, Random} = rand:uniform_s(Mean, Random0),
    {{{timeout, sync}, Mean div 2 + Us, sync}, Lww#lww{random = Random}}.

%% `N' different robots, or all.
draw(0, _Robots, Lww) ->
    {[], Lww};
draw(_N, [], Lww) ->
    {[], Lww};
draw(N, Robots, #lww{random = Random0} = Lww0) ->
    {I, Random} = rand:uniform_s(length(Robots), Random0),
    Robot = lists:nth(I, Robots),
    {More, Lww} = draw(N - 1, lists:delete(Robot, Robots), Lww0#lww{random = Random}),
    {[Robot | More], Lww}.

hash(Term) -> erlang:phash2(Term).
