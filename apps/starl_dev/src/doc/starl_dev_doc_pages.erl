%% @doc Makes the pages of all modules with EDoc. Every message of
%% EDoc and every dead link between pages is a problem: documentation that does not build is as
%% wrong as code that does not compile.
-module(starl_dev_doc_pages).

-export([copies/2, for_edoc/1, make/3, dead_links/1]).

-export_type([problem/0]).

%% One line: the problem and its place.
-type problem() :: unicode:chardata().

%% @doc Makes the pages of these sources in a directory, which is emptied first. The first page is
%% `index.html', with the text of the overview. Gives the number of module pages.
-spec make([file:filename()], Overview :: file:filename(), Dir :: file:filename()) ->
    {ok, pos_integer()} | {error, [problem(), ...]}.
make(Files, Overview, Dir) ->
    _ = file:del_dir_r(Dir),
    Sources = filename:join(Dir, "src"),
    Copies = copies(Files, Sources),
    Options = [{overview, Overview}, {title, "StarL"}, {todo, false}],
    Said = said_by(fun() -> edoc:files(Copies, [{dir, Dir} | Options]) end),
    ok = file:del_dir_r(Sources),
    lists:foreach(fun to_otp/1, pages(Dir)),
    case [original(Line, Sources, Files) || Line <- Said] ++ dead_links(Dir) of
        [] -> {ok, length(Files)};
        Problems -> {error, Problems}
    end.

%% EDoc names the copy; the message should name the original file.
original(Line, Sources, Files) ->
    lists:foldl(
        fun(File, Text) ->
            string:replace(Text, filename:join(Sources, filename:basename(File)), File, all)
        end,
        Line,
        Files
    ).

%% -- what EDoc says -------------------------------------------------------------------------

%% EDoc reports its warnings only by printing them, so its output is captured.
said_by(Fun) ->
    Leader = spawn_link(fun() -> listen([]) end),
    {Pid, Ref} = spawn_monitor(fun() ->
        true = group_leader(Leader, self()),
        Fun()
    end),
    Ended =
        receive
            {'DOWN', Ref, process, Pid, normal} -> [];
            {'DOWN', Ref, process, Pid, Reason} -> [io_lib:format("EDoc ended: ~0tP", [Reason, 20])]
        end,
    Leader ! {text, self()},
    receive
        {text, Text} -> [L || L <- string:split(Text, "\n", all), string:trim(L) =/= ""] ++ Ended
    end.

listen(Said) ->
    receive
        {io_request, From, Ref, Request} ->
            From ! {io_reply, Ref, ok},
            listen([chars(Request) | Said]);
        {text, To} ->
            To ! {text, unicode:characters_to_list(lists:reverse(Said))}
    end.

chars({put_chars, _Encoding, Chars}) -> Chars;
chars({put_chars, _Encoding, Module, Function, Args}) -> apply(Module, Function, Args);
chars(_Other) -> "".

%% EDoc links the behaviours of OTP, of cowboy and of ranch as if they had pages here.
to_otp(Page) ->
    Text = re:replace(
        read(Page),
        "href=\"((?:gen_|supervisor|application|eunit_|cowboy|ranch_)[a-z_]*)\\.html\"",
        "href=\"https://www.erlang.org/doc/man/\\1.html\"",
        [global]
    ),
    starl_cli_out:sure(Page, file:write_file(Page, Text)).

pages(Dir) -> filelib:wildcard(filename:join(Dir, "*.html")).

%% -- links ----------------------------------------------------------------------------------

%% @doc Links to missing pages, and to missing anchors in pages, a line each.
-spec dead_links(Dir :: file:filename()) -> [problem()].
dead_links(Dir) ->
    Pages = [{filename:basename(File), read(File)} || File <- pages(Dir)],
    Places = maps:from_list([{Page, places(Page, Text)} || {Page, Text} <- Pages]),
    [
        io_lib:format("~ts: a link leads nowhere: ~ts", [filename:rootname(Page), Link])
     || {Page, Text} <- Pages, Link <- lists:usort(links(Text)), is_dead(Link, Page, Places)
    ].

read(File) ->
    {ok, Text} = file:read_file(File),
    Text.

links(Text) -> found(Text, " href=\"([^\"#]*(?:#[^\"]*)?)\"").

places(Page, Text) -> [Page | [[Page, "#", Name] || Name <- found(Text, " name=\"([^\"]*)\"")]].

found(Text, Pattern) ->
    case re:run(Text, Pattern, [global, {capture, all_but_first, list}]) of
        {match, Found} -> lists:append(Found);
        nomatch -> []
    end.

is_dead("#" ++ _ = Place, Page, Places) ->
    is_dead(Page ++ Place, Page, Places);
is_dead(Link, _Page, Places) ->
    case string:split(Link, "#") of
        ["http" ++ _ | _] -> false;
        [File | _] when is_map_key(File, Places) -> not is_place(Link, maps:get(File, Places));
        [File | _] -> filename:extension(File) =:= ".html"
    end.

is_place(Link, Places) -> lists:any(fun(Place) -> lists:flatten(Place) =:= Link end, Places).

%% -- sources for EDoc ----------------------------------------------------------------------

%% In StarL the comment on a type or a callback stands before it, but EDoc expects it after it: so the two
%% change places. The number of lines stays the same, so EDoc's line numbers are nearly right.

%% @doc Copies of these sources for EDoc, in a directory.
-spec copies([file:filename()], Dir :: file:filename()) -> [file:filename_all()].
copies(Files, Dir) ->
    ok = filelib:ensure_dir(filename:join(Dir, "any")),
    [copy(File, Dir) || File <- Files].

copy(File, Dir) ->
    {ok, Text} = file:read_file(File),
    Lines = string:split(unicode:characters_to_list(Text), "\n", all),
    Copy = filename:join(Dir, filename:basename(File)),
    Turned = unicode:characters_to_binary(lists:join("\n", for_edoc(Lines))),
    ok = starl_cli_out:sure(Copy, file:write_file(Copy, Turned)),
    Copy.

%% @doc The lines of a module, with the comment on each type and callback moved after it.
-spec for_edoc([string()]) -> [string()].
for_edoc([]) ->
    [];
for_edoc(Lines) ->
    case lists:splitwith(fun is_comment/1, Lines) of
        {[], [Line | Rest]} -> [Line | for_edoc(Rest)];
        {Comment, Rest} -> behind(Comment, Rest, is_type(Rest))
    end.

behind(Comment, Lines, false) ->
    Comment ++ for_edoc(Lines);
behind(Comment, Lines, true) ->
    {Type, Rest} = form(Lines, []),
    Type ++ Comment ++ for_edoc(Rest).

is_comment(Line) -> lists:prefix("%%", Line).

is_type(["-type " ++ _ | _]) -> true;
is_type(["-opaque " ++ _ | _]) -> true;
is_type(["-callback " ++ _ | _]) -> true;
is_type(_Lines) -> false.

%% The lines of a form, up to its full stop.
form([Line | Rest], Before) ->
    Lines = [Line | Before],
    Code = lists:flatten([[L, $\n] || L <- lists:reverse(Lines)]),
    case erl_scan:tokens([], Code, 1) of
        {more, _} when Rest =/= [] -> form(Rest, Lines);
        _ -> {lists:reverse(Lines), Rest}
    end.
