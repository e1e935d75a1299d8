%% @doc Describes the steps of a way to a violation in words.
-module(starl_check_explain).

-export([step/1]).

%% @doc A step as a line of a chart.
-spec step({starl_check_choice:t(), starl_check_part:item() | none, [starl_monitor:trace_event()]}) ->
    starl_check_chart:step().
step({{still, Choice, {Step, Actions}}, Item, Traces}) ->
    {Happens, _} = step({Choice, Item, []}),
    {
        cut(Happens, io_lib:format("  (stands still: step ~b, action ~b)", [Step, Actions + 1])),
        Traces
    };
step({{go_on, Place}, none, Traces}) ->
    {{mark, Place, happens, "goes on with its step"}, Traces};
step({{fire, Place, {app, _}}, none, Traces}) ->
    {{mark, Place, happens, "the application goes on"}, Traces};
step({{fire, Place, {Name, Timer}}, none, Traces}) ->
    Text = io_lib:format("~ts: time-out ~0tp", [Name, starl_check_term:shown(Timer)]),
    {{mark, Place, happens, Text}, Traces};
step({{crash, Place, Name}, none, Traces}) ->
    {{mark, Place, crash, [atom_to_list(Name), " crashes"]}, Traces};
step({{down, Place}, none, Traces}) ->
    {{mark, Place, crash, "goes down"}, Traces};
step({{die, Place}, none, Traces}) ->
    {{mark, Place, crash, "dies"}, Traces};
step({{up, Place}, none, Traces}) ->
    {{mark, Place, happens, "starts anew"}, Traces};
step({{outcome, Place, _, Lost}, none, Traces}) ->
    {{mark, Place, happens, ["hears from SAP: ", heard(Lost)]}, Traces};
step({tick, none, Traces}) ->
    {{note, "time passes"}, Traces};
step({{Kind, _}, Item, Traces}) ->
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
