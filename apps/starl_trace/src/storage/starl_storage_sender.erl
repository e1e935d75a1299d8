%% @doc Sends recordings to a storage while they are being written, in the background.
%% ```
%%   {ok, Sender} = starl_storage_sender:start(fun() -> ["run.mcap"] end, "lab:runs", #{}),
%%   ...
%%   #{sent := 12, trouble := none} = starl_storage_sender:stop(Sender)
%% '''
%% Only whole pieces are sent; the rest of each file and the lists of pieces are {@link
%% starl_storage:upload/3}'s, when the files are whole. The process is linked to nobody and has a low
%% priority: what becomes of the storage holds no run up. What could not be sent is tried again with the
%% next look.
-module(starl_storage_sender).
-behaviour(gen_server).

-export([start/3, look/1, stop/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([options/0, done/0]).

%% As for {@link starl_storage:upload/3}; `every_ms': the time between two looks at the files.
-type options() :: #{every_ms => pos_integer(), atom() => term()}.

%% The pieces that were sent, and why the last look ended early.
-type done() :: #{sent := non_neg_integer(), trouble := none | starl_storage:reason()}.

-define(EVERY_MS, 5000).

-record(sender, {
    files :: fun(() -> [file:filename()]),
    remote :: starl_storage_rclone:path(),
    options :: options(),
    %% how many pieces of each file are there
    pieces = #{} :: #{file:filename() => non_neg_integer()},
    trouble = none :: none | starl_storage:reason()
}).

%% @doc Begins to send the files that the function gives, which only grow.
-spec start(fun(() -> [file:filename()]), starl_storage_rclone:path(), options()) ->
    {ok, pid()} | {error, starl_storage:reason()}.
start(Files, Remote, Options) ->
    case starl_storage_rclone:find() of
        {ok, _} ->
            Sender = #sender{files = Files, remote = Remote, options = Options},
            {ok, _} = gen_server:start(?MODULE, Sender, [{spawn_opt, [{priority, low}]}]);
        {error, _} = Error ->
            Error
    end.

%% @doc Looks at the files now, and waits until their whole pieces are sent.
-spec look(pid()) -> done().
look(Sender) -> gen_server:call(Sender, look, infinity).

%% @doc Ends; a piece that is under way is sent first.
-spec stop(pid()) -> done().
stop(Sender) -> gen_server:call(Sender, stop, infinity).

-spec init(#sender{}) -> {ok, #sender{}}.
init(Sender) -> {ok, waits(Sender)}.

waits(#sender{options = Options} = Sender) ->
    _ = erlang:send_after(maps:get(every_ms, Options, ?EVERY_MS), self(), look),
    Sender.

-spec handle_call(look | stop, gen_server:from(), #sender{}) ->
    {reply, done(), #sender{}} | {stop, normal, done(), #sender{}}.
handle_call(look, _From, Sender) ->
    Looked = looked(Sender),
    {reply, done(Looked), Looked};
handle_call(stop, _From, Sender) ->
    {stop, normal, done(Sender), Sender}.

done(#sender{pieces = Pieces, trouble = Trouble}) ->
    #{sent => lists:sum(maps:values(Pieces)), trouble => Trouble}.

-spec handle_cast(term(), #sender{}) -> {noreply, #sender{}}.
handle_cast(_Message, Sender) -> {noreply, Sender}.

-spec handle_info(term(), #sender{}) -> {noreply, #sender{}}.
handle_info(look, Sender) -> {noreply, waits(looked(Sender))};
handle_info(_Other, Sender) -> {noreply, Sender}.

looked(#sender{files = Files} = Sender) ->
    lists:foldl(fun grown/2, Sender#sender{trouble = none}, Files()).

%% Piece by piece, until there is no whole one left.
grown(_File, #sender{trouble = Trouble} = Sender) when Trouble =/= none -> Sender;
grown(File, #sender{remote = Remote, options = Options, pieces = Pieces} = Sender) ->
    Before = maps:get(File, Pieces, 0),
    case starl_storage:ahead(File, Before, Remote, Options) of
        {ok, Before} -> Sender;
        {ok, More} -> grown(File, Sender#sender{pieces = Pieces#{File => More}});
        {error, Reason} -> Sender#sender{trouble = Reason}
    end.
