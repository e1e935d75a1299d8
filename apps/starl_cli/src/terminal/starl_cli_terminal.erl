%% @doc The terminal of the command line. It prints to outputs that may be closed pipes (`./starl
%% ... | head'), and knows the terminal's width and whether the output is a terminal.
%%
%% Printed text may come from robots, recordings, files and names. So control characters are
%% replaced here, in all of it: they could move the cursor, colour or retitle the terminal, or
%% reverse the text.
-module(starl_cli_terminal).

-export([bad_input/1, out/1, out/2, help/1, raw/1, complain/1, warn/1, draw/1, lost/0]).
-export([printable/1, flat/1]).
-export([columns/0, window/0, watched/0, wrap/3, quoted/1]).

-export_type([status/0]).

%% The exit status of a command: 0 done, 1 internal error, 2 bad usage or input, 3 a contract was
%% violated, 4 not complete, 5 not judged to the end, 6 it depends on the clocks, 130 interrupted.
-type status() :: 0 | 1 | 2 | 3 | 4 | 5 | 6 | 130.

%% @doc Prints one line per problem on standard error; gives the exit status of bad input.
-spec bad_input([unicode:chardata(), ...]) -> 2.
bad_input(Problems) ->
    lists:foreach(fun complain/1, Problems),
    2.

-define(HERE, "./starl").
-define(LOOK_MS, 5).
-define(USUAL, 80).
%% A name of the script longer than this is cut to its last part in a help text.
-define(LONG, 12).
%% Prose is never wrapped wider than this.
-define(WIDEST, 100).
-define(NARROWEST, 20).
-define(REPLACED, 16#FFFD).

%% @doc Prints to standard output. A closed pipe is not an error.
-spec out(unicode:chardata()) -> ok.
out(Text) -> write(standard_io, Text).

%% @doc Prints to standard output, formatted.
-spec out(io:format(), [term()]) -> ok.
out(Format, Args) -> out(io_lib:format(Format, Args)).

%% @doc Prints a help text to standard output. Called by a long path, the script has its short name
%% there: what is wrapped to the width of the terminal stays so.
-spec help(unicode:chardata()) -> ok.
help(Text) -> put_text(standard_io, as_called(Text, short(command()))).

short(?HERE) ->
    ?HERE;
short(Word) ->
    case string:length(Word) > ?LONG of
        true -> filename:basename(Word);
        false -> Word
    end.

%% @doc Prints to standard output without changing the name of the script.
-spec raw(unicode:chardata()) -> ok.
raw(Text) -> put_text(standard_io, Text).

%% @doc Prints one line per problem on standard error.
-spec complain(unicode:chardata() | [unicode:chardata()]) -> ok.
complain(Problem) -> write(standard_error, ["starl: ", one_line(Problem), "\n"]).

%% @doc Prints a note on standard error.
-spec warn(unicode:chardata()) -> ok.
warn(Text) -> write(standard_error, [Text, "\n"]).

%% @doc Writes a line over the last one on standard error: the progress line.
-spec draw(unicode:chardata()) -> ok.
draw(Text) -> put_text(standard_error, ["\r\e[K", as_called(printable(Text))]).

%% @doc The text without control characters, but for ends of lines and tabulators: a replacement character stands for
%% each, and for each byte that is no text.
-spec printable(unicode:chardata()) -> string().
printable(Text) -> [shown(C) || C <- characters(Text)].

%% @doc The text in one line, for a line of another program's language: names and options may hold anything, and
%% behind the end of a line many languages begin a command.
-spec flat(unicode:chardata()) -> string().
flat(Text) -> [in_line(C) || C <- printable(Text)].

in_line(C) when C =:= $\n; C =:= $\t; C =:= ?REPLACED -> $\s;
in_line(C) -> C.

characters(Text) ->
    case unicode:characters_to_list(Text) of
        Characters when is_list(Characters) -> Characters;
        {_, Good, Rest} -> Good ++ [?REPLACED | characters(after_one(iolist_to_binary([Rest])))]
    end.

after_one(<<_, Rest/binary>>) -> Rest;
after_one(<<>>) -> <<>>.

shown(C) when C =:= $\n; C =:= $\t -> C;
shown(C) when C < 16#20; C >= 16#7F, C < 16#A0 -> ?REPLACED;
%% marks of the direction of a text, and separators of lines
shown(C) when C >= 16#202A, C =< 16#202E; C >= 16#2066, C =< 16#2069 -> ?REPLACED;
shown(C) when C =:= 16#061C; C =:= 16#200E; C =:= 16#200F -> ?REPLACED;
shown(C) when C =:= 16#2028; C =:= 16#2029; C =:= 16#FEFF -> ?REPLACED;
shown(C) -> C.

%% @doc Whether standard output could not be written, and why: `epipe' if nobody reads it any more.
-spec lost() -> none | file:posix() | badarg | terminated | system_limit.
lost() ->
    ok = drained(),
    %% A device ends when a write has failed; it answers a question that came earlier.
    _ = io:columns(standard_io),
    try io:put_chars(standard_io, "") of
        ok -> none
    catch
        error:_ -> why_lost(file:open("/dev/stdout", [append, raw]))
    end.

%% Waits until the operating system has taken all output; halt/2 would wait for it, too.
drained() ->
    Queued = [
        Port
     || Port <- ports(), {queue_size, N} <- [erlang:port_info(Port, queue_size)], N > 0
    ],
    case Queued of
        [] ->
            ok;
        [_ | _] ->
            receive
            after ?LOOK_MS -> drained()
            end
    end.

ports() ->
    case process_info(group_leader(), links) of
        {links, Links} -> [Port || Port <- Links, is_port(Port)];
        undefined -> []
    end.

%% The device does not tell why: the reason comes from another attempt. A pipe without a reader, or a
%% closed terminal, cannot even be opened.
why_lost({ok, Device}) ->
    case file:write(Device, "\n") of
        {error, Posix} -> Posix;
        ok -> eio
    end;
why_lost({error, _}) ->
    epipe.

%% A device whose reader has gone answers with an error.
write(Device, Text) -> put_text(Device, as_called(printable(Text))).

put_text(Device, Text) ->
    try
        io:put_chars(Device, Text)
    catch
        error:_ -> ok
    end.

%% Commands in a text begin with ./starl, which works in the checkout; they are printed as the user
%% called it.
as_called(Text) -> as_called(Text, command()).

command() -> os:getenv("STARL_COMMAND", ?HERE).

as_called(Text, Word) ->
    case Word of
        ?HERE ->
            Text;
        _ ->
            re:replace(Text, "(?<![^\\s(\"`'])\\./starl(?![^\\s])", in_replacement(Word), [
                global, unicode
            ])
    end.

%% A word for a shell; in the replacement `&' and the backslash have a meaning.
in_replacement(Word) ->
    re:replace(quoted(Word), "[&\\\\]", "\\\\&", [global, unicode, {return, list}]).

one_line(Text) ->
    Flat = unicode:characters_to_list(Text),
    lists:join(" ", [Word || Word <- string:lexemes(Flat, "\r\n\t"), Word =/= ""]).

%% @doc The width for text, in columns: `COLUMNS' of the environment, else that of the terminal.
-spec columns() -> pos_integer().
columns() ->
    Width =
        case positive(os:getenv("COLUMNS")) of
            none -> window();
            Columns -> Columns
        end,
    max(?NARROWEST, min(?WIDEST, Width)).

%% @doc The width of the terminal at this moment, in columns.
-spec window() -> pos_integer().
window() -> first_width([fun() -> io:columns(standard_error) end, fun io:columns/0]).

first_width([]) ->
    case positive(os:getenv("STARL_COLUMNS")) of
        none -> ?USUAL;
        Columns -> Columns
    end;
first_width([Ask | Others]) ->
    case Ask() of
        {ok, Columns} when Columns > 0 -> Columns;
        {ok, _} -> first_width(Others);
        {error, _} -> first_width(Others)
    end.

positive(false) ->
    none;
positive(Text) ->
    case string:to_integer(Text) of
        {N, ""} when is_integer(N), N > 0 -> N;
        _ -> none
    end.

%% @doc Whether both outputs are a terminal. The script that starts the VM tells this in
%% `STARL_TTY'; without that variable the devices are asked.
-spec watched() -> boolean().
watched() ->
    Terminals =
        case os:getenv("STARL_TTY") of
            false -> [Name || {Name, Device} <- devices(), is_terminal(io:columns(Device))];
            Names -> string:lexemes(Names, " ")
        end,
    lists:member("stdout", Terminals) andalso lists:member("stderr", Terminals) andalso
        os:getenv("TERM") =/= "dumb".

devices() -> [{"stdout", standard_io}, {"stderr", standard_error}].

is_terminal({ok, _}) -> true;
is_terminal({error, _}) -> false.

%% @doc Breaks a text into lines of at most `Width' columns, the later ones indented. The first
%% line is assumed to begin at column `Indent' already.
-spec wrap(unicode:chardata(), Indent :: non_neg_integer(), Width :: pos_integer()) ->
    unicode:chardata().
wrap(Text, Indent, Width) ->
    Words = string:lexemes(unicode:characters_to_list(Text), " "),
    Lines = lines(Words, max(10, Width - Indent), []),
    lists:join(["\n", lists:duplicate(Indent, $\s)], Lines).

lines([], _Room, []) ->
    [];
lines([], _Room, Line) ->
    [finished(Line)];
lines([Word | Words], Room, []) ->
    lines(Words, Room, [Word]);
lines([Word | Words], Room, Line) ->
    case string:length(finished(Line)) + 1 + string:length(Word) =< Room of
        true -> lines(Words, Room, [Word | Line]);
        false -> [finished(Line) | lines(Words, Room, [Word])]
    end.

finished(Line) -> lists:flatten(lists:join(" ", lists:reverse(Line))).

%% @doc A text as one word of a command line that a user should type, quoted where a shell would not
%% take it as it is.
-spec quoted(string()) -> string().
quoted("") ->
    "''";
quoted(Text) ->
    case lists:all(fun is_plain/1, Text) of
        true -> Text;
        false -> "'" ++ lists:append(string:replace(Text, "'", "'\\''", all)) ++ "'"
    end.

is_plain(C) when C >= $a, C =< $z; C >= $A, C =< $Z; C >= $0, C =< $9 -> true;
is_plain(C) -> lists:member(C, "-_./,:=+@%").
