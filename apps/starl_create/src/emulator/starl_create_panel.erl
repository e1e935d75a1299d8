%% @doc The songs of an emulated Create, and its buttons, which a command can push.
-module(starl_create_panel).

-export([new/1, song/3, play/3, push/3, readings/2]).

-export_type([t/0]).

-record(panel, {
    songs = #{} :: #{byte() => DurationUs :: non_neg_integer()},
    song :: {Number :: byte(), EndsUs :: integer()},
    %% the buttons pushed by command, until then
    pushed :: {Bits :: byte(), Until :: integer()}
}).

-opaque t() :: #panel{}.

%% A button pushed by command comes back after a sixth of a second.
-define(BUTTON_US, 166667).

%% @doc No song, no button.
-spec new(NowUs :: integer()) -> t().
new(Now) -> #panel{song = {0, Now}, pushed = {0, Now}}.

%% @doc A song is written: notes and their durations, in 64ths of a second.
-spec song(byte(), [{byte(), byte()}], t()) -> t().
song(Number, Notes, #panel{songs = Songs} = Panel) ->
    Us = lists:sum([Duration * 1000000 div 64 || {_, Duration} <- Notes]),
    Panel#panel{songs = Songs#{Number => Us}}.

%% @doc A song is played, unless another one still is.
-spec play(byte(), NowUs :: integer(), t()) -> t().
play(Number, Now, #panel{songs = Songs, song = {_, Ends}} = Panel) ->
    case Songs of
        #{Number := Us} when Now >= Ends -> Panel#panel{song = {Number, Now + Us}};
        #{} -> Panel
    end.

%% @doc Buttons are pushed by command.
-spec push(Bits :: byte(), NowUs :: integer(), t()) -> t().
push(Bits, Now, Panel) -> Panel#panel{pushed = {Bits, Now + ?BUTTON_US}}.

%% @doc What the sensors show.
-spec readings(NowUs :: integer(), t()) -> starl_create_packet:readings().
readings(Now, #panel{song = {Song, Ends}, pushed = Pushed}) ->
    #{song => Song, song_playing => playing(Now, Ends), buttons => pushed(Now, Pushed)}.

playing(Now, Ends) when Now < Ends -> 1;
playing(_Now, _Ends) -> 0.

pushed(Now, {Bits, Until}) when Now < Until -> Bits;
pushed(_Now, _Pushed) -> 0.
