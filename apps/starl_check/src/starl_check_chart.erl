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

-export([described/1, format/2, text/1]).

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

%% -- the steps -----------------------------------------------------------------------------

%% @doc A step of the search in words, as a line of a chart.
-spec described(
    {starl_check_choice:t(), starl_check_part:item() | none, [starl_monitor:trace_event()]}
) ->
    step().
described({{still, Choice, {Step, Actions}}, Item, Traces}) ->
    {Happens, _} = described({Choice, Item, []}),
    {
        cut(Happens, io_lib:format("  (stands still: step ~b, action ~b)", [Step, Actions + 1])),
        Traces
    };
described({{go_on, Place}, none, Traces}) ->
    {{mark, Place, happens, "goes on with its step"}, Traces};
described({{fire, Place, {app, _}}, none, Traces}) ->
    {{mark, Place, happens, "the application goes on"}, Traces};
described({{fire, Place, {Name, Timer}}, none, Traces}) ->
    Text = io_lib:format("~ts: time-out ~0tp", [Name, starl_check_term:shown(Timer)]),
    {{mark, Place, happens, Text}, Traces};
described({{crash, Place, Name}, none, Traces}) ->
    {{mark, Place, crash, [atom_to_list(Name), " crashes"]}, Traces};
described({{down, Place}, none, Traces}) ->
    {{mark, Place, crash, "goes down"}, Traces};
described({{die, Place}, none, Traces}) ->
    {{mark, Place, crash, "dies"}, Traces};
described({{up, Place}, none, Traces}) ->
    {{mark, Place, happens, "starts anew"}, Traces};
described({{outcome, Place, _, Lost}, none, Traces}) ->
    {{mark, Place, happens, ["hears from SAP: ", heard(Lost)]}, Traces};
described({tick, none, Traces}) ->
    {{note, "time passes"}, Traces};
described({{Kind, _}, Item, Traces}) ->
    {arrow(Kind, Item), Traces}.

cut({mark, Place, Kind, Text}, More) -> {mark, Place, Kind, [Text, More]};
cut({arrow, From, To, Line, Text}, More) -> {arrow, From, To, Line, [Text, More]}.

arrow(Kind, {packet, From, To, Packet}) ->
    {arrow, From, To, solid, [shown(Packet), again(Kind)]};
arrow(deliver, {message, From, To, Type, Body, _, Age}) ->
    {arrow, From, To, solid, [atom_to_list(Type), " ", shown(Body), slow(Age)]};
arrow(refuse, {message, From, To, Type, Body, _, _}) ->
    {arrow, From, To, dotted, [atom_to_list(Type), " ", shown(Body), "  (refused)"]}.

heard([]) ->
    "nothing is lost";
heard(Lost) ->
    ["lost at ", lists:join(", ", [integer_to_list(starl_check_term:number(R)) || R <- Lost])].

again(again) -> "  (and once more later)";
again(deliver) -> "".

slow(fresh) -> "";
slow(late) -> "  (slow)";
slow(ghost) -> "  (thought lost)".

shown(Term) -> io_lib:format("~0tp", [starl_check_term:shown(Term)]).
