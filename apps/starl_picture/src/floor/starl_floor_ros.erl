%% @doc Reads an occupancy grid of ROS: a YAML file, and the PGM image that it names. A cell is a
%% wall where it is not free: also where nothing is known of it. The lower left corner of the image
%% becomes the origin of the floor; a frame that is turned is refused.
-module(starl_floor_ros).

-export([parse/2, pgm/1]).

-type problem() :: starl_floor_text:problem().

-define(MOST_PIXELS, 100000000).
-define(MOST_BYTES, 6 * ?MOST_PIXELS).
%% The most bytes of a header, with its remarks.
-define(HEADER_BYTES, 65536).
%% The grey level of a pixel of which nothing is known.
-define(UNKNOWN, 205).
-define(NEEDED, ["image", "resolution", "origin", "occupied_thresh", "free_thresh", "negate"]).

%% @doc The floor plan of a YAML file in this directory.
-spec parse(binary(), file:filename()) -> {ok, starl_floor:t()} | {error, problem()}.
parse(Bytes, Dir) ->
    case starl_floor_yaml:read(Bytes) of
        {ok, Keys} ->
            case [Key || Key <- ?NEEDED, not is_map_key(Key, Keys)] of
                [] -> keyed(Keys, Dir);
                [Key | _] -> {error, {none, ["the key ", Key, " is missing"]}}
            end;
        {error, _} = Error ->
            Error
    end.

keyed(#{"image" := {N, Image}} = Keys, Dir) ->
    Read = [{Key, read(Key, Value)} || {Key, {_, Value}} <- maps:to_list(Keys)],
    case [{maps:get(Key, Keys), Why} || {Key, {error, Why}} <- lists:sort(Read)] of
        [{{Line, _}, Why} | _] ->
            {error, {Line, Why}};
        [] ->
            image(
                filename:join(Dir, Image), N, maps:from_list([{Key, V} || {Key, {ok, V}} <- Read])
            )
    end.

%% What a key says; keys of other programs are passed over.
read("image", Value) ->
    case io_lib:char_list(Value) andalso Value =/= "" of
        true -> {ok, Value};
        false -> {error, "image needs the name of a file"}
    end;
read("resolution", Value) ->
    case starl_floor_yaml:number(Value) of
        {ok, Metres} when Metres > 0 -> {ok, Metres};
        _ -> {error, "resolution needs a number above 0, m"}
    end;
read(Key, Value) when Key =:= "free_thresh"; Key =:= "occupied_thresh" ->
    case starl_floor_yaml:number(Value) of
        {ok, Part} when Part >= 0, Part =< 1 -> {ok, Part};
        _ -> {error, [Key, " needs a number from 0 to 1"]}
    end;
read("negate", Value) ->
    case starl_floor_yaml:boolean(Value) of
        {ok, Is} -> {ok, Is};
        error -> {error, "negate is 0 or 1, true or false"}
    end;
read("mode", Value) ->
    case io_lib:char_list(Value) andalso string:lowercase(Value) of
        "trinary" -> {ok, trinary};
        "scale" -> {ok, scale};
        "raw" -> {ok, raw};
        _ -> {error, "mode is trinary, scale or raw"}
    end;
read("origin", [_, _, _] = Values) ->
    case [Number || Value <- Values, {ok, Number} <- [starl_floor_yaml:number(Value)]] of
        [_, _, Yaw] when abs(Yaw) < 1.0e-6 ->
            {ok, origin};
        [_, _, Yaw] ->
            Turned =
                "origin: the map is turned by ~.4f rad, which is not followed; turn the image, and write 0",
            {error, io_lib:format(Turned, [Yaw])};
        _ ->
            {error, "origin needs three numbers, m, m and rad"}
    end;
read("origin", _Value) ->
    {error, "origin needs three numbers, m, m and rad"};
read(_Other, _Value) ->
    {ok, other}.

image(File, N, Keys) ->
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
                {ok, Image} -> {ok, plan(Image, Keys)};
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

plan({W, H, Grey}, #{"resolution" := Metres} = Keys) ->
    Scale = 1000 * Metres,
    IsFree = free(maps:get("mode", Keys, trinary), Keys),
    Solid = maps:from_list([
        {{I rem W, H - 1 - I div W}, true}
     || {I, Level} <- lists:enumerate(0, binary_to_list(Grey)), not IsFree(Level)
    ]),
    starl_floor:new(#{
        size => {W * Scale, H * Scale}, walls => starl_floor_cells:walls(Solid, Scale)
    }).

%% Which levels are free, as map_server of Nav2 reads them; its savers write unknown as 205, also beside a
%% threshold above that.
free(raw, _Keys) ->
    fun(Level) -> Level =:= 0 end;
free(Mode, #{"free_thresh" := Free, "negate" := Negate}) ->
    fun
        (?UNKNOWN) when Mode =:= trinary -> false;
        (Level) when Negate -> Level / 255 =< Free;
        (Level) -> (255 - Level) / 255 =< Free
    end.

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
numbers(<<C, Rest/binary>>, Count, Numbers) when C =:= $\s; C >= $\t, C =< $\r ->
    numbers(Rest, Count, Numbers);
numbers(<<"#", Rest/binary>>, Count, Numbers) ->
    case binary:split(Rest, [<<"\n">>, <<"\r">>]) of
        [_, After] -> numbers(After, Count, Numbers);
        _ -> bad
    end;
numbers(Bytes, Count, Numbers) ->
    case string:to_integer(Bytes) of
        {N, Rest} when is_integer(N), N >= 0 -> numbers(Rest, Count - 1, [N | Numbers]);
        _ -> bad
    end.

raw(W, H, Max, Bytes) ->
    Width =
        case Max < 256 of
            true -> 1;
            false -> 2
        end,
    case pixels(Bytes, Width * W * H) of
        {ok, Raster} when Width =:= 1 -> levels(W, H, [round(V * 255 / Max) || <<V>> <= Raster]);
        {ok, Raster} -> levels(W, H, [round(V * 255 / Max) || <<V:16>> <= Raster]);
        error -> {error, "the PGM image is cut off"}
    end.

%% One byte of white space ends the header. A writer on Windows makes two of it, and some write a remark
%% there: then the number of bytes that are left tells where the pixels begin.
pixels(<<_White, Raster/binary>>, Size) when byte_size(Raster) =:= Size ->
    {ok, Raster};
pixels(Bytes, Size) ->
    case [Raster || Raster <- later(Bytes), byte_size(Raster) =:= Size] ++ [rest(Bytes)] of
        [Raster | _] when byte_size(Raster) >= Size -> {ok, binary:part(Raster, 0, Size)};
        _ -> error
    end.

later(<<"\r\n", Raster/binary>>) ->
    [Raster];
later(<<_White, "#", Remark/binary>>) ->
    case binary:split(Remark, [<<"\n">>, <<"\r">>]) of
        [_, Raster] -> [Raster];
        _ -> []
    end;
later(_Bytes) ->
    [].

rest(<<_White, Raster/binary>>) -> Raster;
rest(<<>>) -> <<>>.

plain(W, H, Max, Bytes) ->
    case numbers(Bytes, W * H, []) of
        {Values, _} -> levels(W, H, [round(V * 255 / Max) || V <- Values]);
        bad -> {error, "the PGM image is cut off"}
    end.

levels(W, H, Levels) ->
    {ok, {W, H, list_to_binary([min(255, Level) || Level <- Levels])}}.
