%% @doc Shows a recording in a window: plays it, and jumps to any moment of it. The recording is
%% read once. Then its file is read again from near the moment that a page shows, so a long
%% recording is never in memory.
%% ```
%%   all pages <-- the hub <-- the first part of the recording
%%   a page --- moment, At --> the recording --- reset, state at T0, rows from T0 to T1 --> this page
%%   a page --- look, Robot, At --> the recording --- what the trace has told of the robot --> this page
%% '''
%% During the first reading, states of the team are kept, one for each section of a few thousand
%% rows ({@link starl_view_playback}).
-module(starl_view_recording).
-behaviour(gen_server).

-export([load/2, load/3]).
-export([init/1, handle_continue/2, handle_call/3, handle_cast/2, handle_info/2]).

-record(recording, {
    file :: file:filename_all(),
    hub :: pid(),
    cursor :: starl_trace_reader:cursor(),
    past = starl_view_playback:new() :: starl_view_playback:t(),
    %% the states at the beginnings of sections, the latest first
    sections = [] :: [section()],
    section_rows :: pos_integer(),
    head = [] :: [starl_view_row:row()],
    begun = 0 :: integer(),
    %% the end of what the hub is told; the time and the number of rows at its last frame
    first = open :: open | integer(),
    framed = {0, 0} :: {Us :: integer(), Rows :: integer()},
    ended = none :: none | {ok, starl_trace_reader:ended()} | {error, starl_trace_reader:reason()},
    caller = none :: gen_server:from() | none
}).

-type section() :: {FromUs :: integer(), starl_view_playback:t()}.

%% Of more rows at once the hub would leave out packets.
-define(FRAME_US, 1000000).
-define(FRAME_ROWS, 200).
-define(SECTION_ROWS, 5000).
%% What a page gets at once: sections, of which some are before the moment that it wants.
-define(SECTIONS, 10).
-define(BEFORE, 2).
-define(PIECE_ROWS, 4000).
%% Pieces that a page has not read yet.
-define(MOST_UNREAD, 2).

%% @doc Reads a recording and shows it by a hub. Returns whether it was whole. The calling process
%% is linked to the process that shows it.
-spec load(file:filename_all(), Hub :: pid()) ->
    {ok, starl_trace_reader:ended()} | {error, starl_trace_reader:reason()}.
load(File, Hub) -> load(File, Hub, #{}).

%% @doc The same with the number of rows of a section.
-spec load(file:filename_all(), Hub :: pid(), #{section_rows => pos_integer()}) ->
    {ok, starl_trace_reader:ended()} | {error, starl_trace_reader:reason()}.
load(File, Hub, Options) ->
    case starl_trace_reader:start(File) of
        {ok, Cursor} ->
            ok = starl_trace_reader:stop(Cursor),
            {ok, Recording} = gen_server:start_link(?MODULE, {File, Hub, Options}, []),
            gen_server:call(Recording, await, infinity);
        {error, _} = Error ->
            Error
    end.

-spec init({file:filename_all(), pid(), map()}) ->
    {ok, #recording{}, {continue, read}} | {stop, term()}.
init({File, Hub, Options}) ->
    ok = starl_view_hub:lead(Hub, self()),
    case starl_trace_reader:start(File) of
        {ok, Cursor} ->
            Rows = maps:get(section_rows, Options, ?SECTION_ROWS),
            {ok, #recording{file = File, hub = Hub, cursor = Cursor, section_rows = Rows},
                {continue, read}};
        {error, Reason} ->
            {stop, Reason}
    end.

-spec handle_continue(read, #recording{}) -> {noreply, #recording{}}.
handle_continue(read, Recording) -> {noreply, read(Recording)}.

-spec handle_call(await, gen_server:from(), #recording{}) ->
    {reply, term(), #recording{}} | {noreply, #recording{}}.
handle_call(await, From, #recording{ended = none} = Recording) ->
    {noreply, Recording#recording{caller = From}};
handle_call(await, _From, #recording{ended = Ended} = Recording) ->
    {reply, Ended, Recording}.

-spec handle_cast(term(), #recording{}) -> {noreply, #recording{}}.
handle_cast(_Request, Recording) -> {noreply, Recording}.

-spec handle_info(term(), #recording{}) -> {noreply, #recording{}}.
handle_info(read, Recording) ->
    {noreply, read(Recording)};
handle_info({starl_view, Page, Command}, Recording) ->
    ok = do(Command, Page, Recording),
    {noreply, Recording};
handle_info(_Message, Recording) ->
    {noreply, Recording}.

%% -- reading all of it ----------------------------------------------------------------------

read(#recording{cursor = Cursor} = Recording) ->
    case starl_trace_reader:next(Cursor) of
        {ok, Messages, Next} ->
            self() ! read,
            lists:foldl(fun message/2, Recording#recording{cursor = Next}, Messages);
        {ended, Ended} ->
            ended({ok, Ended}, Recording);
        {error, _} = Error ->
            ended(Error, Recording)
    end.

message({scenario, _, #{robots := Robots} = Facts} = Message, #recording{file = File} = Recording) ->
    Begun = maps:get(begun_us, Facts, 0),
    Extra = #{
        kind => recording,
        begun => Begun,
        until => until(File),
        %% by the world: robots do not judge
        judged => maps:get(has_motions, Facts, not is_map_key(told_by, Facts))
    },
    Rows = starl_view_head:rows(Facts, Extra),
    ok = starl_view_hub:head(Recording#recording.hub, {Rows, length(Robots)}),
    told(Message, Recording#recording{head = Rows, begun = Begun});
message(Message, Recording) ->
    told(Message, section(element(2, Message), Recording)).

%% The end is known before all has been read.
until(File) ->
    case starl_trace_reader:tail(File) of
        {ok, #{until_us := Until}} -> Until;
        {error, _} -> null
    end.

section(T, #recording{sections = []} = Recording) ->
    Recording#recording{sections = [{min(0, T), Recording#recording.past}]};
section(T, #recording{sections = [{_, Last} | _] = Sections, past = Past} = Recording) ->
    Rows = starl_view_playback:count(Past) - starl_view_playback:count(Last),
    case Rows >= Recording#recording.section_rows andalso T > starl_view_playback:now_us(Past) of
        true -> first(T, Recording#recording{sections = [{T, Past} | Sections]});
        false -> Recording
    end.

%% The hub has got its part.
first(T, #recording{first = open, sections = Sections} = Recording) when
    length(Sections) > ?SECTIONS
->
    framed(T, Recording#recording{first = T});
first(_T, Recording) ->
    Recording.

told(Message, #recording{past = Past, hub = Hub, first = First} = Recording) ->
    {Rows, Next} = starl_view_playback:add(Message, Past),
    _ = First =:= open andalso [ok = starl_view_hub:put(Hub, Row) || Row <- Rows],
    due(Recording#recording{past = Next}).

due(#recording{first = open, framed = {Us, Rows}, past = Past} = Recording) ->
    {Now, Count} = {starl_view_playback:now_us(Past), starl_view_playback:count(Past)},
    case Now >= Us + ?FRAME_US orelse Count >= Rows + ?FRAME_ROWS of
        true -> framed(Now, Recording);
        false -> Recording
    end;
due(Recording) ->
    Recording.

framed(Now, #recording{hub = Hub, past = Past} = Recording) ->
    ok = starl_view_hub:clock(Hub, (clock(Recording))#{now_us => Now}),
    Recording#recording{framed = {Now, starl_view_playback:count(Past)}}.

clock(#recording{ended = none}) ->
    #{speed => 1, paused => true, running => 0, ending => null};
clock(#recording{ended = Ended, past = Past} = Recording) ->
    Clock = clock(Recording#recording{ended = none}),
    case {Ended, starl_view_playback:ending(Past)} of
        {{ok, closed}, null} -> Clock#{ending := recorded};
        {{ok, closed}, Ending} -> Clock#{ending := Ending};
        _ -> Clock#{ending := cut_off}
    end.

ended(Ended, #recording{cursor = Cursor, first = First, past = Past, hub = Hub} = Recording) ->
    ok = starl_trace_reader:stop(Cursor),
    Known = Recording#recording{ended = Ended},
    Upto =
        case First of
            open -> starl_view_playback:now_us(Past);
            _ -> First
        end,
    _ = [ok = starl_view_hub:put(Hub, Row) || Row <- later(Upto, Known), First =/= open],
    _ = Known#recording.caller =/= none andalso gen_server:reply(Known#recording.caller, Ended),
    framed(Upto, Known).

%% What is marked on the time line after this part.
later(Upto, #recording{past = Past}) ->
    [Row || [_, T | _] = Row <- starl_view_playback:said(Past), T >= Upto].

%% -- what pages want ------------------------------------------------------------------------

do(#{<<"do">> := <<"moment">>, <<"at">> := At}, Page, Recording) when is_number(At) ->
    case {is_read(At, Recording), process_info(Page, message_queue_len)} of
        {false, _} ->
            #recording{past = Past, begun = Begun} = Recording,
            Read = (starl_view_playback:now_us(Past) - Begun) div 1000000,
            said(io_lib:format("the recording is still being read, ~b s so far", [Read]), Page);
        {true, {_, Unread}} when Unread =< ?MOST_UNREAD ->
            moment(max(0, trunc(At)), Page, Recording);
        {true, _} ->
            ok
    end;
do(#{<<"do">> := <<"look">>, <<"robot">> := Robot, <<"at">> := At}, Page, Recording) when
    is_integer(Robot), is_number(At)
->
    case is_read(At, Recording) of
        true -> look(Robot, max(0, trunc(At)), Page, Recording);
        false -> ok
    end;
do(_Command, Page, _Recording) ->
    said("a recording can only be looked at", Page).

is_read(_At, #recording{sections = []}) -> false;
is_read(_At, #recording{ended = Ended}) when Ended =/= none -> true;
is_read(At, #recording{sections = [{Last, _} | _]}) -> At < Last.

said(Text, Page) ->
    Page ! {tell, [<<"no">>, unicode:characters_to_binary(Text)]},
    ok.

%% The part around a moment, and the end of it: where a section begins, or that of the recording.
part(At, #recording{sections = Latest}) ->
    {Later, Earlier} = lists:splitwith(fun({From, _}) -> From > At end, Latest),
    Before = min(?BEFORE, length(Earlier) - 1),
    Begin = lists:nth(1 + Before, Earlier),
    case lists:nthtail(min(?SECTIONS - Before - 1, length(Later)), lists:reverse(Later)) of
        [{End, _} | _] -> {Begin, End};
        %% an atom is above all numbers
        [] -> {Begin, infinity}
    end.

moment(At, Page, #recording{head = Head} = Recording) ->
    {{From, Past}, To} = part(At, Recording),
    State = [[<<"reset">>] | Head] ++ [[<<"gap">>, From] | starl_view_playback:rows(Past)],
    {Rows, Reached} = fold(
        fun(Message, {Rows, Before}) ->
            {New, Next} = starl_view_playback:add(Message, Before),
            {lists:reverse(New, Rows), Next}
        end,
        {lists:reverse(State), Past},
        {From, To},
        Recording
    ),
    End = min(To, starl_view_playback:now_us(Reached)),
    Last = later(End, Recording) ++ [[<<"w">>, End, clock(Recording)]],
    pieces(lists:reverse(Rows, Last), Page).

fold(Fun, Acc, {From, To}, #recording{file = File}) ->
    case starl_trace_reader:start(File, From) of
        {ok, Cursor} -> folded(Fun, Acc, {From, To}, Cursor);
        {error, _} -> Acc
    end.

folded(Fun, Acc, {From, To} = Times, Cursor) ->
    case starl_trace_reader:next(Cursor) of
        {ok, Messages, Next} ->
            Now = [M || M <- Messages, element(2, M) >= From, element(2, M) < To],
            Folded = lists:foldl(Fun, Acc, Now),
            case lists:any(fun(M) -> element(2, M) >= To end, Messages) of
                false -> folded(Fun, Folded, Times, Next);
                true -> closed(Folded, Next)
            end;
        _EndedOrDamaged ->
            closed(Acc, Cursor)
    end.

closed(Acc, Cursor) ->
    ok = starl_trace_reader:stop(Cursor),
    Acc.

pieces(Rows, Page) ->
    {Piece, Left} = lists:split(min(?PIECE_ROWS, length(Rows)), Rows),
    Page ! {rows, iolist_to_binary(lists:join($,, [starl_json:encode(Row) || Row <- Piece]))},
    case Left of
        [] -> ok;
        _ -> pieces(Left, Page)
    end.

%% A section more, so that there are some events.
look(Robot, At, Page, #recording{sections = Sections} = Recording) ->
    Earlier = lists:dropwhile(fun({From, _}) -> From > At end, Sections),
    {From, Past} = lists:last(lists:sublist(Earlier, 2)),
    Reached = fold(
        fun(Message, Before) -> element(2, starl_view_playback:add(Message, Before)) end,
        starl_view_playback:watch(Robot, Past),
        {From, At + 1},
        Recording
    ),
    Page ! {tell, [<<"look">>, At, Robot, starl_view_playback:look(Robot, At, Reached)]},
    ok.
