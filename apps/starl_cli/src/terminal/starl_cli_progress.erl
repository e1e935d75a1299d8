%% @doc The progress line of a long command. It is redrawn in place on standard error, at most ten
%% times a second and no wider than the window, and erased at the end. Without a terminal there is
%% no progress line.
-module(starl_cli_progress).

-export([new/1, show/3, erase/0, note/1, say/1, line/4]).

-export_type([t/0, part/0]).

-record(progress, {
    on :: boolean(),
    drawn_ms :: integer(),
    count = 0 :: non_neg_integer()
}).

-opaque t() :: #progress{}.

%% The completed fraction, from 0 to 1, if it is known.
-type part() :: float() | unknown.

-define(PERIOD_MS, 100).
-define(WIDEST_BAR, 30).
-define(LEAST_BAR, 5).

%% @doc A progress line; `quiet' draws nothing, `auto' draws on a terminal only.
-spec new(quiet | auto) -> t().
new(quiet) -> #progress{on = false, drawn_ms = 0};
new(auto) -> #progress{on = starl_cli_terminal:watched(), drawn_ms = now_ms() - ?PERIOD_MS}.

%% @doc Redraws the progress line if it is due. The words are made only when they are drawn; the
%% first ones are kept if the line is too short for all.
-spec show(t(), part(), fun(() -> [unicode:chardata()])) -> t().
show(#progress{on = false} = Progress, _Part, _Words) ->
    Progress;
show(#progress{drawn_ms = Drawn, count = Count} = Progress, Part, Words) ->
    case now_ms() of
        Now when Now - Drawn >= ?PERIOD_MS ->
            Line = line(Part, Count, Words(), starl_cli_terminal:window() - 1),
            starl_cli_terminal:draw(Line),
            Progress#progress{drawn_ms = Now, count = Count + 1};
        _ ->
            Progress
    end.

%% @doc Erases the line.
-spec erase() -> ok.
erase() ->
    case starl_cli_terminal:watched() of
        true -> starl_cli_terminal:draw("");
        false -> ok
    end.

%% @doc Erases the line and says something in its place, which stays; in a pipe, too.
-spec note(unicode:chardata()) -> ok.
note(Text) ->
    ?MODULE:erase(),
    starl_cli_terminal:complain(Text).

%% @doc Draws words in place of the line, on a terminal only.
-spec say([unicode:chardata()]) -> ok.
say(Words) ->
    case starl_cli_terminal:watched() of
        true ->
            Line = line(unknown, 0, Words, starl_cli_terminal:window() - 1),
            starl_cli_terminal:draw(Line);
        false ->
            ok
    end.

%% @doc The line for a window: a bar, then as many words as fit. `Count' moves the bar's mark if the
%% completed fraction is unknown.
-spec line(part(), Count :: non_neg_integer(), [unicode:chardata()], Width :: integer()) ->
    string().
line(Part, Count, Words, Width) ->
    Texts = [unicode:characters_to_list(Word) || Word <- Words],
    Text = fitting([T || T <- Texts, T =/= ""], Width),
    case min(?WIDEST_BAR, Width - length(Text) - 3) of
        Room when Room >= ?LEAST_BAR -> [$[ | bar(Part, Count, Room)] ++ "] " ++ Text;
        _ -> Text
    end.

fitting([], _Width) ->
    "";
fitting([First | Words], Width) ->
    Longer = fun(Word, Text) ->
        case length(Text) + 2 + length(Word) =< Width of
            true -> Text ++ ", " ++ Word;
            false -> Text
        end
    end,
    lists:sublist(lists:foldl(Longer, First, Words), max(0, Width)).

bar(unknown, Count, Room) ->
    Way = Room - 3,
    Place = Way - abs(Count rem (2 * Way) - Way),
    lists:duplicate(Place, $\s) ++ "<=>" ++ lists:duplicate(Way - Place, $\s);
bar(Part, _Count, Room) ->
    Full = round(max(0.0, min(1.0, Part)) * Room),
    lists:duplicate(Full, $=) ++ lists:duplicate(Room - Full, $\s).

now_ms() -> erlang:monotonic_time(millisecond).
