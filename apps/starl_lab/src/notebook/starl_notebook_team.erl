%% @doc A team in a notebook: its simulation, and the picture of it. It ends with the process that
%% started it.
-module(starl_notebook_team).
-behaviour(gen_server).

-export([start/1, drive/2, go/3, rest/1, reload/2, show/2, status/1, picture/1, finish/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([status/0]).

%% `problems': broken contracts and crashed programs, a line each. `digest': of a run that has ended.
-type status() :: #{
    time_s := float(),
    running := non_neg_integer(),
    problems := [binary()],
    digest => binary()
}.

%% In the background: until when (us), and how many times as fast as real time.
-type going() :: {UntilUs :: integer(), Speed :: number()} | no.

-record(team, {
    sim :: starl_sim:sim() | ended,
    camera :: pid(),
    title :: string(),
    ref :: starl_notebook_output:ref(),
    cells = [] :: [pid()],
    going = no :: going()
}).

%% Between two pictures.
-define(PICTURE_MS, 200).

%% @doc Starts the simulation of a scenario.
-spec start(#{app := module(), atom() => term()}) -> {ok, pid()} | {error, starl_sim:reason()}.
start(Scenario) ->
    case gen_server:start(?MODULE, {self(), Scenario}, []) of
        {ok, Team} -> {ok, Team};
        {error, {cannot_start, Reason}} -> {error, Reason}
    end.

%% @doc Drives on for some seconds of virtual time.
-spec drive(pid(), number()) -> status().
drive(Team, Seconds) -> gen_server:call(Team, {drive, Seconds}, infinity).

%% @doc Drives on for some seconds of virtual time in the background.
-spec go(pid(), number(), number()) -> ok.
go(Team, Seconds, Speed) when Seconds > 0, Speed > 0 ->
    gen_server:call(Team, {go, Seconds, Speed}, infinity).

%% @doc Halts.
-spec rest(pid()) -> status().
rest(Team) -> gen_server:call(Team, rest, infinity).

%% @doc Gives new code: a module's as it is to be found, or this.
-spec reload(pid(), starl_version:source()) -> ok | {error, starl_sim:reason()}.
reload(Team, Code) -> gen_server:call(Team, {reload, Code}, infinity).

%% @doc Shows the team in a cell, from now on.
-spec show(pid(), Cell :: pid()) -> ok.
show(Team, Cell) -> gen_server:call(Team, {show, Cell}, infinity).

%% @doc How it stands.
-spec status(pid()) -> status().
status(Team) -> gen_server:call(Team, status, infinity).

%% @doc Its picture, as SVG.
-spec picture(pid()) -> binary().
picture(Team) -> gen_server:call(Team, picture, infinity).

%% @doc Ends the simulation, and the team.
-spec finish(pid()) -> status().
finish(Team) -> gen_server:call(Team, finish, infinity).

-spec init({pid(), #{app := module(), atom() => term()}}) ->
    {ok, #team{}} | {stop, {cannot_start, starl_sim:reason()}}.
init({Owner, #{app := App} = Scenario}) ->
    _ = monitor(process, Owner),
    {ok, Camera} = starl_film_camera:start_link(),
    case starl_sim:start(Scenario, #{observe => starl_film_camera:observer(Camera)}) of
        {ok, Sim} ->
            {ok, #team{
                sim = Sim,
                camera = Camera,
                title = lists:last(string:split(atom_to_list(App), "Elixir.")),
                ref = integer_to_binary(erlang:unique_integer([positive]))
            }};
        {error, Reason} ->
            {stop, {cannot_start, Reason}}
    end.

-spec handle_call(term(), gen_server:from(), #team{}) ->
    {reply, term(), #team{}} | {stop, normal, status(), #team{}}.
handle_call({drive, Seconds}, _From, Team) ->
    Driven = driven(now_us(Team) + round(Seconds * 1000000), Team#team{going = no}),
    {reply, status_of(Driven), Driven};
handle_call({go, Seconds, Speed}, _From, Team) ->
    ok = wake(),
    {reply, ok, Team#team{going = {now_us(Team) + round(Seconds * 1000000), Speed}}};
handle_call(rest, _From, Team) ->
    {reply, status_of(Team), Team#team{going = no}};
handle_call({reload, Code}, _From, #team{sim = Sim} = Team) ->
    {reply, starl_sim:reload(Sim, Code), Team};
handle_call({show, Cell}, _From, #team{cells = Cells, ref = Ref} = Team) ->
    ok = starl_notebook_output:frame(Ref, drawn(Team), Cell),
    {reply, ok, Team#team{cells = lists:usort([Cell | Cells])}};
handle_call(status, _From, Team) ->
    {reply, status_of(Team), Team};
handle_call(picture, _From, Team) ->
    {reply, drawn(Team), Team};
handle_call(finish, _From, #team{sim = Sim} = Team) ->
    Status = status_of(Team),
    {#{digest := Digest}, _Report} = starl_sim:finish(Sim),
    {stop, normal, Status#{digest => string:lowercase(binary:encode_hex(Digest))}, Team#team{
        sim = ended
    }}.

-spec handle_cast(term(), #team{}) -> {noreply, #team{}}.
handle_cast(_, Team) -> {noreply, Team}.

-spec handle_info(wake | {'DOWN', reference(), process, pid(), term()}, #team{}) ->
    {noreply, #team{}} | {stop, normal, #team{}}.
handle_info(wake, #team{going = no} = Team) ->
    {noreply, Team};
handle_info(wake, #team{going = {Until, Speed}} = Team) ->
    Next = now_us(Team) + round(Speed * ?PICTURE_MS * 1000),
    Driven = driven(min(Next, Until), Team),
    case now_us(Driven) >= min(Next, Until) andalso Next < Until of
        true ->
            ok = wake(),
            {noreply, Driven};
        false ->
            {noreply, Driven#team{going = no}}
    end;
handle_info({'DOWN', _, process, _Owner, _}, #team{sim = Sim} = Team) ->
    ok = starl_sim:close(Sim),
    {stop, normal, Team}.

wake() ->
    _ = erlang:send_after(?PICTURE_MS, self(), wake),
    ok.

%% -- the run --------------------------------------------------------------------------------

now_us(#team{sim = Sim}) ->
    #{now_us := Now} = starl_sim:status(Sim),
    Now.

%% In parts, with a picture after each, if anybody sees them.
driven(Until, #team{sim = Sim, cells = Cells} = Team) ->
    From = now_us(Team),
    Part = min(Until, From + ?PICTURE_MS * 1000),
    _ = starl_sim:run(Sim, Part / 1000000),
    Svg = [drawn(Team) || Cells =/= []],
    [ok = starl_notebook_output:change(Team#team.ref, Picture, C) || Picture <- Svg, C <- Cells],
    case now_us(Team) of
        Now when Now < Until, Now > From -> driven(Until, Team);
        _ReachedOrEnded -> Team
    end.

drawn(#team{camera = Camera, title = Title} = Team) ->
    Now = now_us(Team),
    case starl_film_cast:scene(starl_film_cast:until(Now, starl_film_camera:cast(Camera))) of
        {ok, Scene} ->
            starl_film_frame:at(Now, Title, Scene#{end_us := Now});
        {error, empty} ->
            <<"<svg xmlns=\"http://www.w3.org/2000/svg\"/>">>
    end.

status_of(#team{sim = Sim} = Team) ->
    #{running := Running} = starl_sim:status(Sim),
    Broken = [starl_violation:format(Violation) || Violation <- starl_sim:violations(Sim)],
    Crashed = [
        io_lib:format("robot ~b: ~ts", [Robot, starl_crash:format(Cause)])
     || {Robot, #{crashes := Crashes}} <- starl_sim:robots(Sim),
        {app, Reason} <- Crashes,
        {_, _} = Cause <- [starl_crash:cause(Reason)]
    ],
    Back = [
        starl_reload_monitor:format(Reload)
     || Reload <- starl_sim:reloads(Sim), starl_reload_monitor:is_back(Reload)
    ],
    #{
        time_s => now_us(Team) / 1000000,
        running => Running,
        problems => [unicode:characters_to_binary(Line) || Line <- Broken ++ Crashed ++ Back]
    }.
