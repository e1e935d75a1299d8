%% @doc Makes the outputs of a notebook cell: sends Livebook's messages to the group leader of the
%% cell's process. Any other group leader refuses them, and then nothing is shown.
-module(starl_notebook_output).

-export([image/2, markdown/2, frame/3, change/3]).

-export_type([ref/0]).

%% The name of a frame, whose picture can be changed.
-type ref() :: binary().

%% @doc Shows a picture.
-spec image(Svg :: binary(), Cell :: pid()) -> ok.
image(Svg, Cell) -> shown(svg(Svg), Cell).

%% @doc Shows a text with tables.
-spec markdown(binary(), Cell :: pid()) -> ok.
markdown(Text, Cell) -> shown(#{type => markdown, text => Text, chunk => false}, Cell).

%% @doc Shows a frame with its first picture.
-spec frame(ref(), Svg :: binary(), Cell :: pid()) -> ok.
frame(Ref, Svg, Cell) ->
    shown(#{type => frame, ref => Ref, outputs => [svg(Svg)], placeholder => true}, Cell).

%% @doc Changes the picture of a frame.
-spec change(ref(), Svg :: binary(), Cell :: pid()) -> ok.
change(Ref, Svg, Cell) ->
    shown(#{type => frame_update, ref => Ref, update => {replace, [svg(Svg)]}}, Cell).

svg(Svg) -> #{type => image, content => Svg, mime_type => <<"image/svg+xml">>}.

%% The protocol of Erlang's input and output; a cell that is gone has no output.
shown(Output, Cell) ->
    Ref = monitor(process, Cell),
    Cell ! {io_request, self(), Ref, {livebook_put_output, Output}},
    receive
        {io_reply, Ref, _ShownOrNot} ->
            true = demonitor(Ref, [flush]),
            ok;
        {'DOWN', Ref, process, _, _} ->
            ok
    end.
