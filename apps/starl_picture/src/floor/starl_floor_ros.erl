%% @doc Reads an occupancy grid of ROS: a YAML file, and the PGM image that it names. A cell is a
%% wall where it is not free: also where nothing is known of it. The lower left corner of the image
%% becomes the origin of the floor; a frame that is turned is not turned back.
-module(starl_floor_ros).

-export([parse/2, pgm/1]).

-type problem() :: starl_floor_text:problem().

-define(MOST_PIXELS, 100000000).
-define(MOST_BYTES, 6 * ?MOST_PIXELS).
%% The most bytes of a header, with its remarks.
-define(HEADER_BYTES, 65536).
-define(NEEDED, ["image", "resolution", "origin", "occupied_thresh", "free_thresh", "negate"]).

%% @doc The floor plan of a YAML file in this directory.
-spec parse(binary(), file:filename()) -> {ok, starl_floor:t()} | {error, problem()}.
parse(Bytes, Dir) ->
    Keys = maps:from_list(lists:append([key(N, L) || {N, L} <- lists:enumerate(1, lines(Bytes))])),
    case [Key || Key <- ?NEEDED, not is_map_key(Key, Keys)] of
        [] -> keyed(Keys, Dir);
        [Key | _] -> {error, {none, ["the key ", Key, " is missing"]}}
    end.

lines(Bytes) -> [string:trim(L) || L <- string:split(Bytes, "\n", all)].

key(N, Line) ->
    case string:split(hd(string:split(Line, "#")), ":") of
        [Key, Value] ->
            [{string:trim(to_list(Key)), {N, string:trim(to_list(Value), both, " \t\"'")}}];
        _ ->
            []
    end.

to_list(Text) -> unicode:characters_to_list(Text).

keyed(#{"image" := {N, Image}} = Keys, Dir) ->
    Numbers = [{Key, number(maps:get(Key, Keys))} || Key <- ["resolution", "free_thresh"]],
    case {[{Key, L} || {Key, {bad, L}} <- Numbers], negate(maps:get("negate", Keys))} of
        {[{Key, L} | _], _} ->
            {error, {L, [Key, " needs a number"]}};
        {[], {bad, L}} ->
            {error, {L, "negate is 0 or 1, true or false"}};
        {[], Negate} ->
            image(filename:join(Dir, Image), N, Numbers, Negate)
    end.

number({N, Text}) ->
    case {string:to_float(Text), string:to_integer(Text)} of
        {{F, ""}, _} when F > 0 -> F;
        {_, {I, ""}} when is_integer(I), I > 0 -> float(I);
        _ -> {bad, N}
    end.

negate({_, Text}) when Text =:= "0"; Text =:= "false" -> false;
negate({_, Text}) when Text =:= "1"; Text =:= "true" -> true;
negate({N, _}) -> {bad, N}.

image(File, N, Numbers, Negate) ->
    %% as an image of the most pixels may have, each as a number with a blank
    case {filename:extension(File), read(File)} of
        {".png", _} ->
            {error, {N, "PNG cannot be read; convert it: ffmpeg -i map.png map.pgm"}};
        {_, {error, efbig}} ->
            {error, {N, [File, ": this is larger than any image that is read"]}};
        {_, {error, Posix}} ->
            {error, {N, [File, ": ", file:format_error(Posix)]}};
        {_, {ok, Bytes}} ->
            case pgm(Bytes) of
                {ok, Image} -> {ok, plan(Image, maps:from_list(Numbers), Negate)};
                {error, What} -> {error, {N, [File, ": ", What]}}
            end
    end.

%% Of a file that does not begin as an image no more than its beginning is read.
read(File) ->
    case starl_small_file:beginning(File, ?HEADER_BYTES) of
        {ok, <<"P", _, Rest/binary>> = Beginning} ->
            case header(Rest) of
                {ok, _} -> starl_small_file:read(File, ?MOST_BYTES);
                {error, _} -> {ok, Beginning}
            end;
        Other ->
            Other
    end.

%% A pixel is free if its darkness is less than the threshold.
plan({W, H, Grey}, #{"resolution" := Metres, "free_thresh" := Free}, Negate) ->
    Scale = 1000 * Metres,
    Solid = maps:from_list([
        {{I rem W, H - 1 - I div W}, true}
     || {I, Level} <- lists:enumerate(0, binary_to_list(Grey)),
        dark(Level, Negate) / 255 >= Free
    ]),
    starl_floor:new(#{
        size => {W * Scale, H * Scale}, walls => starl_floor_cells:walls(Solid, Scale)
    }).

dark(Level, true) -> Level;
dark(Level, false) -> 255 - Level.

%% @doc The width, the height and the grey levels (0 black, 255 white) of a PGM image, row by row
%% from the top.
-spec pgm(binary()) -> {ok, {pos_integer(), pos_integer(), binary()}} | {error, string()}.
pgm(<<"P5", Rest/binary>>) -> raster(fun raw/4, header(Rest));
pgm(<<"P2", Rest/binary>>) -> raster(fun plain/4, header(Rest));
pgm(_) -> {error, "this is no PGM image"}.

raster(Read, {ok, {W, H, Max, Rest}}) -> Read(W, H, Max, Rest);
raster(_Read, {error, _} = Error) -> Error.

header(Bytes) ->
    case numbers(Bytes, 3, []) of
        {[W, H, Max], Rest} when W > 0, H > 0, Max > 0, Max < 65536, W * H =< ?MOST_PIXELS ->
            {ok, {W, H, Max, Rest}};
        _ ->
            {error, "the header of the PGM image is not sound"}
    end.

%% Numbers between white space and remarks.
numbers(Bytes, 0, Numbers) ->
    {lists:reverse(Numbers), Bytes};
numbers(<<C, Rest/binary>>, Count, Numbers) when C =:= $\s; C =:= $\t; C =:= $\r; C =:= $\n ->
    numbers(Rest, Count, Numbers);
numbers(<<"#", Rest/binary>>, Count, Numbers) ->
    case binary:split(Rest, <<"\n">>) of
        [_, After] -> numbers(After, Count, Numbers);
        _ -> bad
    end;
numbers(Bytes, Count, Numbers) ->
    case string:to_integer(Bytes) of
        {N, Rest} when is_integer(N), N >= 0 -> numbers(Rest, Count - 1, [N | Numbers]);
        _ -> bad
    end.

raw(W, H, Max, <<_White, Raster/binary>>) when Max < 256, byte_size(Raster) >= W * H ->
    levels(W, H, [round(V * 255 / Max) || <<V>> <= binary:part(Raster, 0, W * H)]);
raw(W, H, Max, <<_White, Raster/binary>>) when Max > 255, byte_size(Raster) >= 2 * W * H ->
    levels(W, H, [round(V * 255 / Max) || <<V:16>> <= binary:part(Raster, 0, 2 * W * H)]);
raw(_W, _H, _Max, _Bytes) ->
    {error, "the PGM image is cut off"}.

plain(W, H, Max, Bytes) ->
    case numbers(Bytes, W * H, []) of
        {Values, _} -> levels(W, H, [round(V * 255 / Max) || V <- Values]);
        bad -> {error, "the PGM image is cut off"}
    end.

levels(W, H, Levels) ->
    {ok, {W, H, list_to_binary([min(255, Level) || Level <- Levels])}}.
