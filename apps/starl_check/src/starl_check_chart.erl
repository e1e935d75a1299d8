%% @doc Formats a way through the states as a message sequence chart in plain text.
%% ```
%%          robot 1     robot 2
%%     1    o           |            calls
%%     2    |---------->o            ballot {first, {7, 1}}
%%     3    |           x            election crashes
%% '''
%% Each robot has a column. `o' marks the robot at which an event happens; an arrow is an arriving
%% message, a dotted arrow the report of an outcome. The events that the robots traced in a step
%% stand below it.
-module(starl_check_chart).

-export([format/2, text/1]).

-export_type([step/0, event/0]).

%% An event, and the events that the robots traced in it.
-type step() :: {event(), [starl_monitor:trace_event()]}.

-type event() ::
    {arrow, From :: starl_check_term:place(), To :: starl_check_term:place(), solid | dotted,
        iodata()}
    | {mark, starl_check_term:place(), happens | crash, iodata()}
    | {note, iodata()}.

-define(COLUMN, 12).
-define(MARGIN, 8).

%% @doc The chart of these steps for this number of robots.
-spec format(pos_integer(), [step()]) -> [iodata(), ...].
format(Robots, Steps) ->
    Numbered = lists:zip(lists:seq(1, length(Steps)), Steps),
    [head(Robots) | [step(N, Step, Robots) || {N, Step} <- Numbered]].

head(Robots) ->
    Titles = [string:pad("robot " ++ integer_to_list(N), ?COLUMN) || N <- lists:seq(1, Robots)],
    [lists:duplicate(?MARGIN - 1, $\s), Titles, "\n"].

step(N, {Event, Traces}, Robots) ->
    [
        row(io_lib:format("~5b", [N]), lanes(Event, Robots), text(Event)),
        [row("     ", bare(Robots), traced(Trace)) || Trace <- Traces]
    ].

row(Number, Lanes, Text) ->
    Line = [Number, lists:duplicate(?MARGIN - 5, $\s), Lanes, Text],
    [string:trim(lists:flatten(Line), trailing), "\n"].

%% @doc The text of an event.
-spec text(event()) -> iodata().
text({arrow, _, _, _, Text}) -> Text;
text({mark, _, _, Text}) -> Text;
text({note, Text}) -> Text.

traced({_, Id, Name, Event}) ->
    io_lib:format("  ~b ~ts: ~0tp", [
        starl_check_term:number(Id), Name, starl_check_term:shown(Event)
    ]).

bare(Robots) -> lists:append([lane($|, $\s) || _ <- lists:seq(1, Robots)]).

lane(Mark, Fill) -> [Mark | lists:duplicate(?COLUMN - 1, Fill)].

lanes({note, _}, Robots) ->
    bare(Robots);
lanes({mark, Place, Kind, _}, Robots) ->
    Mark =
        case Kind of
            happens -> $o;
            crash -> $x
        end,
    lists:append([
        case N of
            Place -> lane(Mark, $\s);
            _ -> lane($|, $\s)
        end
     || N <- lists:seq(1, Robots)
    ]);
lanes({arrow, From, To, Kind, _}, Robots) ->
    Low = ?COLUMN * (min(From, To) - 1),
    High = ?COLUMN * (max(From, To) - 1),
    Bare = bare(Robots),
    Before = lists:sublist(Bare, Low),
    After = lists:nthtail(High + 1, Bare),
    Before ++ shaft(From < To, High - Low - 2, Kind) ++ After.

shaft(true, Length, Kind) -> "|" ++ stroke(Length, Kind) ++ ">o";
shaft(false, Length, Kind) -> "o<" ++ stroke(Length, Kind) ++ "|".

stroke(Length, solid) -> lists:duplicate(Length, $-);
stroke(Length, dotted) -> lists:duplicate(Length, $.).
