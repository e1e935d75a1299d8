%% @doc The lines of text about what a picture has left out ({@link starl_picture:left_out()}).
-module(starl_picture_omissions).

-export([lines/1]).

%% @doc One line for each kind that is left out, with the remedy.
-spec lines(starl_picture:left_out()) -> [unicode:chardata()].
lines(LeftOut) ->
    [line(What, maps:get(What, LeftOut)) || What <- kinds(), maps:get(What, LeftOut) > 0].

%%% Internals

kinds() -> [texts, images, markers, clips, backgrounds].

line(texts, 1) ->
    "1 text left out; convert it to a path";
line(texts, N) ->
    io_lib:format("~b texts left out; convert them to paths", [N]);
line(images, 1) ->
    "1 image left out; trace it";
line(images, N) ->
    io_lib:format("~b images left out; trace them", [N]);
line(markers, 1) ->
    "the markers of 1 line (arrow heads) left out; convert them to paths";
line(markers, N) ->
    io_lib:format("the markers of ~b lines (arrow heads) left out; convert them to paths", [N]);
line(clips, 1) ->
    "1 clipping path is too complex, what it hides is painted; cut the lines";
line(clips, N) ->
    Format = "~b clipping paths are too complex, what they hide is painted; cut the lines",
    io_lib:format(Format, [N]);
line(backgrounds, _) ->
    "the page background is not painted".
