%% @doc Shows a recording: its page gets everything that was recorded, to scrub through and to play.
%% ```
%%   {ok, View} = starl_view:start(#{most_bytes => 512 bsl 20}),
%%   {ok, closed} = starl_view_recording:load("out/painting-1/run.mcap", starl_view:hub(View)).
%% '''
-module(starl_view_recording).

-export([load/2]).

-record(load, {
    hub :: pid(),
    %% the time of the last frame; messages since then, newest first
    framed = 0 :: integer(),
    messages = [] :: [starl_trace_message:t()],
    now = 0 :: integer(),
    ending = null :: atom(),
    %% the robots whose motion is recorded in closed form
    moving = #{} :: #{starl:robot_id() => []}
}).

-define(FRAME_US, 1000000).

%% @doc Reads a recording into a hub; tells whether it was whole.
-spec load(file:filename_all(), Hub :: pid()) ->
    {ok, starl_trace_reader:ended()} | {error, starl_trace_reader:reason()}.
load(File, Hub) ->
    case starl_trace_reader:fold(fun message/2, #load{hub = Hub}, File) of
        {ok, Load, Ended} ->
            _ = framed(Load#load{ending = over(Ended, Load)}),
            {ok, Ended};
        {error, _} = Error ->
            Error
    end.

over(closed, #load{ending = null}) -> recorded;
over(closed, #load{ending = Ending}) -> Ending;
over(_, _Load) -> cut_off.

message({scenario, _, #{robots := Robots} = Facts}, #load{hub = Hub} = Load) ->
    Rows = starl_view_head:rows(Facts, #{kind => recording}),
    ok = starl_view_hub:head(Hub, {Rows, length(Robots)}),
    Load;
message({poses, T, #{robots := Poses}}, #load{moving = Moving} = Load) ->
    %% of real robots only positions are known
    Jumps = [
        {trace, T, {Id, chassis, {motion, starl_trajectory:standing(T, {X, Y}, Heading)}}}
     || {Id, {X, Y, Heading}, _, _} <- Poses, not is_map_key(Id, Moving)
    ],
    lists:foldl(fun kept/2, due(T, Load), Jumps);
message({verdicts, T, {ended, #{ending := Ending}}} = Message, Load) ->
    kept(Message, (due(T, Load))#load{ending = Ending});
message({trace, T, {Id, chassis, {motion, _}}} = Message, #load{moving = Moving} = Load) ->
    kept(Message, due(T, Load#load{moving = Moving#{Id => []}}));
message(Message, Load) ->
    kept(Message, due(element(2, Message), Load)).

kept(Message, #load{messages = Messages} = Load) -> Load#load{messages = [Message | Messages]}.

due(T, #load{framed = Before} = Load) when T >= Before + ?FRAME_US -> framed(Load#load{now = T});
due(T, #load{now = Now} = Load) -> Load#load{now = max(T, Now)}.

framed(#load{hub = Hub, messages = Messages, now = Now, ending = Ending} = Load) ->
    Hub ! {starl_trace, self(), lists:reverse(Messages)},
    ok = starl_view_hub:clock(Hub, #{
        now_us => Now, speed => 1, paused => true, running => 0, ending => Ending
    }),
    Load#load{messages = [], framed = Now}.
