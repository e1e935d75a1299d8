%% @doc Contracts of reading documents: any Unicode encoding with a byte order mark; nothing is
%% fetched; entities of plain text are expanded within bounds, others refused; no atoms are made.
-module(starl_svg_xml_tests).

-include_lib("eunit/include/eunit.hrl").

-define(PATH, "<path d='M1 1h1' stroke='red'/>").
-define(BODY,
    "<svg viewBox='0 0 9 9' stroke='red'><title>\x{e5}\x{3b1}</title><path d='M1 1h1'/></svg>"
).

encodings_test_() ->
    Latin = "<svg viewBox='0 0 9 9' stroke='red'><title>\x{e5}</title><path d='M1 1h1'/></svg>",
    [
        ?_assertEqual({Name, {ok, Title}}, {Name, title(Bytes)})
     || {Name, Title, Bytes} <- [
            {plain, "\x{e5}\x{3b1}", unicode:characters_to_binary(?BODY)},
            {utf8_bom, "\x{e5}\x{3b1}", bom(utf8, ?BODY)},
            {utf16_big, "\x{e5}\x{3b1}", bom({utf16, big}, ?BODY)},
            {utf16_little, "\x{e5}\x{3b1}", bom({utf16, little}, ?BODY)},
            {utf16_declared, "\x{e5}\x{3b1}",
                bom({utf16, little}, "<?xml version='1.0' encoding='UTF-16'?>" ++ ?BODY)},
            {utf16_no_bom, "\x{e5}\x{3b1}",
                unicode:characters_to_binary(?BODY, unicode, {utf16, little})},
            {latin1, "\x{e5}",
                list_to_binary("<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?>\n" ++ Latin)}
        ]
    ].

bad_encodings_test_() ->
    [
        ?_assertEqual({error, {bad_encoding, Name}}, title(Bytes))
     || {Name, Bytes} <- [
            {"utf8", <<"<svg a='", 255, "'/>">>},
            {"utf-16", <<16#FE, 16#FF, 0, $<, 0>>},
            {"ebcdic", <<"<?xml version='1.0' encoding='EBCDIC'?><svg/>">>}
        ]
    ].

prolog_test_() ->
    [
        ?_assertMatch(
            {Prolog, {ok, _}},
            {Prolog, title(unicode:characters_to_binary([Prolog, ?BODY]))}
        )
     || Prolog <- [
            "\n  ",
            "<!-- a comment < > -->",
            "<?xml-stylesheet href='a.css'?>",
            "<?xml version='1.0' standalone='no'?>\n<!DOCTYPE svg PUBLIC '-//W3C//DTD SVG 1.1//EN'\n"
            " 'http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd'>\n",
            "<!DOCTYPE svg>",
            "<!DOCTYPE svg SYSTEM \"x[y>z\">"
        ]
    ].

%% The line of an error is the line of the file, whatever the prolog.
lines_test() ->
    Document = <<
        "<?xml version='1.0'?>\n<!-- a\n b -->\n<!DOCTYPE svg\n>\n"
        "<svg>\n<path d='M'/></svg>"
    >>,
    ?assertMatch({error, {bad_path, {<<"path">>, none, 7}, 1, _}}, title(Document)).

%% Illustrator writes its namespaces as entities, and uses them in attributes.
entities_test_() ->
    [
        ?_assertEqual({Subset, {ok, Title}}, {Subset, entity_title(Subset)})
     || {Title, Subset} <- [
            {"xy", "<!ENTITY a 'x'><!ENTITY b \"y\">"},
            {"xxy", "<!ENTITY a 'x'>\n <!-- <!ENTITY a 'z'> -->\n<!ENTITY b '&a;y'>"},
            {"xy", "<!ENTITY a 'x'><!ENTITY a 'second'><!ENTITY b 'y'>"},
            {"xy", "<?p ?><!ENTITY a 'x'><!ATTLIST svg b CDATA '>'><!ENTITY b 'y'> "},
            {"& y", "<!ENTITY a '&amp;'><!ENTITY b '\ny'><!ENTITY amp 'no'>"}
        ]
    ].

entity_title(Subset) ->
    title(
        iolist_to_binary([
            "<!DOCTYPE svg [",
            Subset,
            "]><svg stroke='red'><title>&a;&b;</title><path d='M1 1h1'/></svg>"
        ])
    ).

%% A reference in literal text is none.
literal_test() ->
    Document = <<
        "<!DOCTYPE svg [<!ENTITY a 'x'>]><svg stroke='red'><!-- &a; -->"
        "<title><![CDATA[&a;]]>&a;</title><path d='M1 1h1'/></svg>"
    >>,
    ?assertEqual({ok, "&a;x"}, title(Document)).

refused_entities_test_() ->
    [
        ?_assertEqual({Document, {error, Problem}}, {Document, title(Document)})
     || {Problem, Document} <- [
            {{entities, 1}, <<"<!DOCTYPE svg [<!ENTITY a SYSTEM 'b'>]><svg>&a;</svg>">>},
            {{entities, 1}, <<"<!DOCTYPE svg [<!ENTITY a PUBLIC 'b' 'c'>]><svg>&a;</svg>">>},
            {{entities, 2}, <<"<!DOCTYPE svg [\n<!ENTITY % a 'b'>]><svg/>">>},
            {{entities, 2}, <<"<?xml version='1.0'?>\n<!DOCTYPE svg SYSTEM 'a' [ %b; ]><svg/>">>},
            {{entities, 1}, <<"<!DOCTYPE svg><!DOCTYPE svg [<!ENTITY a SYSTEM 'b'>]><svg/>">>},
            {{truncated, 2}, <<"<!DOCTYPE svg [\n<!ENTITY a 'b'">>},
            {{truncated, 1}, <<"<!DOCTYPE svg [<!ENTITY a 'b'>">>}
        ]
    ].

%% An entity that contains itself, or that nobody declares, stays as it is.
unknown_entity_test_() ->
    [
        ?_assertMatch({ok, [$&, _, $;]}, title(Document))
     || Document <- [
            <<"<!DOCTYPE svg [<!ENTITY a '&a;'>]><svg><title>&a;</title>" ?PATH "</svg>">>,
            <<
                "<!DOCTYPE svg [<!ENTITY a '&b;'><!ENTITY b '&a;'>]><svg><title>&a;</title>"
                ?PATH
                "</svg>"
            >>,
            <<"<!DOCTYPE svg [<!ENTITY a 'x'>]><svg><title>&b;</title>" ?PATH "</svg>">>
        ]
    ].

%% The line feeds of an entity do not count where it is used.
entity_lines_test() ->
    Document = <<"<!DOCTYPE svg [<!ENTITY a '\n\n\n'>\n]><svg>\n&a;&a;<path d='M'/></svg>">>,
    ?assertMatch({error, {bad_path, {<<"path">>, none, 6}, 1, _}}, title(Document)).

long_entity_test_() ->
    Title = fun(Length) ->
        Text = binary:copy(<<"x">>, Length),
        title(<<"<!DOCTYPE svg [<!ENTITY a '", Text/binary, "'>]><svg>" ?PATH "</svg>">>)
    end,
    [
        ?_assertEqual({ok, ""}, Title(10_000)),
        ?_assertEqual({error, {entities_too_big, 1}}, Title(10_001))
    ].

%% A short entity, often used, is bounded as well.
much_inserted_test() ->
    Text = binary:copy(<<"x">>, 10_000),
    Uses = binary:copy(<<"&a;">>, 101),
    Document = <<
        "<!DOCTYPE svg [<!ENTITY a '",
        Text/binary,
        "'>]>\n<svg><title>",
        Uses/binary,
        "</title></svg>"
    >>,
    ?assertEqual({error, {entities_too_big, 2}}, title(Document)).

%% A document type after the root has begun is no way round either.
late_doctype_test() ->
    ?assertMatch(
        {error, {bad_xml, 1, _}},
        title(<<"<svg><!DOCTYPE svg [<!ENTITY a 'b'>]>&a;</svg>">>)
    ).

%% Billion laughs: refused in milliseconds and without memory.
bomb_test() ->
    Levels = [
        io_lib:format(
            "<!ENTITY a~b \"~s\">\n",
            [I, lists:duplicate(10, io_lib:format("&a~b;", [I - 1]))]
        )
     || I <- lists:seq(1, 20)
    ],
    Bomb = iolist_to_binary([
        "<!DOCTYPE svg [\n<!ENTITY a0 \"lol\">\n",
        Levels,
        "]>\n<svg><text>&a20;</text></svg>"
    ]),
    %% The process may not grow beyond 8 MB of heap.
    {Pid, Ref} = spawn_opt(
        fun() ->
            {reductions, Before} = process_info(self(), reductions),
            Answer = title(Bomb),
            {reductions, After} = process_info(self(), reductions),
            exit({After - Before, Answer})
        end,
        [monitor, {max_heap_size, #{size => 1_000_000, kill => true, error_logger => false}}]
    ),
    receive
        {'DOWN', Ref, process, Pid, Result} ->
            {Work, Refusal} = Result,
            ?assertEqual({error, {entities_too_big, 6}}, Refusal),
            %% no more than a look at each character of the document
            ?assert(Work < 100 * byte_size(Bomb), {Work, byte_size(Bomb)})
    end.

%% Neither an external DTD nor an external entity is opened: a named pipe without a writer would
%% hang whoever opens it, and a listening socket would see whoever connects.
nothing_is_fetched_test_() ->
    {timeout, 20, fun() ->
        {ok, Listen} = gen_tcp:listen(0, [{ip, {127, 0, 0, 1}}]),
        {ok, Port} = inet:port(Listen),
        Url = io_lib:format("http://127.0.0.1:~b/x.dtd", [Port]),
        File = filename:absname("no_such_place/entity.dtd"),
        Fifo = fifo(),
        [
            begin
                Dtd = ["<!DOCTYPE svg SYSTEM '", Place, "'>"],
                ?assertMatch(
                    {ok, _},
                    title(iolist_to_binary([Dtd, "<svg stroke='red'><path d='M1 1h1'/></svg>"]))
                ),
                Entity = ["<!DOCTYPE svg [<!ENTITY x SYSTEM '", Place, "'>]>"],
                ?assertMatch(
                    {error, {entities, 1}},
                    title(iolist_to_binary([Entity, "<svg>&x;</svg>"]))
                )
            end
         || Place <- [Url, File, "file://" ++ File, Fifo]
        ],
        _ = file:delete(Fifo),
        ?assertEqual({error, timeout}, gen_tcp:accept(Listen, 0)),
        ok = gen_tcp:close(Listen)
    end}.

%% An element or attribute name of the document never becomes an atom.
no_atoms_test() ->
    Names = [io_lib:format("n~b", [erlang:unique_integer([positive])]) || _ <- lists:seq(1, 500)],
    Body = [
        [$<, Name, $\s, Name, "='1'><path id='", Name, "' d='M1 1h1'/></", Name, $>]
     || Name <- Names
    ],
    Document = iolist_to_binary(["<svg stroke='red'><path d='M1 1h1'/>", Body, "</svg>"]),
    {ok, _} = title(Document),
    Before = erlang:system_info(atom_count),
    {ok, _} = title(Document),
    {ok, _} = title(
        <<"<svg stroke='red'><zq81x ", "zq82x='1'/><path id='zq83x' d='M1 1h1'/></svg>">>
    ),
    ?assertEqual(Before, erlang:system_info(atom_count)).

endless_reference_test() ->
    Refused = fun(Many) ->
        Digits = binary:copy(<<"1">>, Many),
        Document = <<"<svg>&#", Digits/binary, ";</svg>">>,
        {Work, Result} = starl_platform_ct:work(fun() -> title(Document) end),
        ?assertMatch({error, {bad_xml, 1, _}}, Result),
        Work
    end,
    {Few, Many} = {Refused(30_000), Refused(3_000_000)},
    ?assert(Many < 130 * Few, {Few, Many}).

title(Bytes) ->
    case starl_picture:parse(Bytes, #{area => {0, 0, 1000, 1000}}) of
        {ok, Picture} -> {ok, starl_picture:title(Picture)};
        {error, Reason} -> {error, Reason}
    end.

bom(Encoding, Text) ->
    <<
        (unicode:encoding_to_bom(Encoding))/binary,
        (unicode:characters_to_binary(Text, unicode, Encoding))/binary
    >>.

%% The path of a pipe that nobody writes to, if the system can make one.
fifo() ->
    Name = "/tmp/starl_picture_fifo_" ++ os:getpid(),
    _ = os:cmd("mkfifo " ++ Name),
    Name.
