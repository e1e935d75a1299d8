%% @doc The messages for {@link starl_picture:reason()}: one line that states the problem, its place
%% and the remedy.
-module(starl_picture_error).

-export([format/1]).

%% @doc One line of printable text without a line feed, as UTF-8.
-spec format(starl_picture:reason()) -> binary().
format(Reason) ->
    case text(Reason) of
        {svg, Problem} -> starl_svg_error:format(Problem);
        {Format, Arguments} -> starl_svg_error:line(Format, Arguments)
    end.

%%% Internals

text({cannot_read, File, Why}) ->
    {"cannot read ~ts: ~ts", [starl_svg_error:quote(File, 200), file_text(Why)]};
text({no_lines, #{texts := Texts, unseen := 0}}) when Texts > 0 ->
    {
        "the picture draws no lines, only text; convert the text to paths "
        "(in Inkscape: Path, Object to Path)",
        []
    };
text({no_lines, #{unseen := Unseen}}) when Unseen > 0 ->
    {
        "the picture draws no lines: ~ts; give them a stroke",
        [unseen(Unseen)]
    };
text({no_lines, #{images := Images}}) when Images > 0 ->
    {"the picture draws no lines, only an image; trace the image to paths first", []};
text({no_lines, _LeftOut}) ->
    {"the picture draws no lines; it needs a visible line, path or other shape", []};
text({too_many_segments, Max}) ->
    {
        "the picture has more than ~b line segments; simplify it, or allow a larger --tolerance or "
        "more --segments",
        [Max]
    };
text(Problem) ->
    {svg, Problem}.

unseen(1) -> "its only shape has neither stroke nor fill that is visible";
unseen(N) -> io_lib:format("its ~b shapes have neither stroke nor fill that is visible", [N]).

file_text(missing) -> "there is no such file";
file_text(directory) -> "it is a directory; give an SVG file";
file_text(no_permission) -> "no permission; make the file readable";
file_text(too_big) -> "it is larger than 20 MB; simplify the drawing";
file_text(Posix) -> file:format_error(Posix).
