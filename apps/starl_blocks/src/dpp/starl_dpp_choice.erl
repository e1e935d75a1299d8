%% @doc Which free edges a robot should paint next.
%%
%% One search from the robot visits vertices, nearest first. From each vertex with free edges a
%% chain of them is followed, straight on where possible, up to the horizon. The chain with the
%% most ink per distance driven wins; the search stops when no farther vertex can win.
-module(starl_dpp_choice).

-export([best/3]).
-export_type([task/0, job/0]).

-type edge_id() :: starl_dpp_graph:edge_id().
-type vertex() :: starl_dpp_graph:vertex().
-type task() :: #{
    space := starl_dpp_search:space(),
    free := #{edge_id() => true},
    horizon := float(),
    overhead_mm := float(),
    bias := fun((vertex(), vertex(), [{vertex(), edge_id()}]) -> float())
}.
%% What to choose from. `overhead_mm' is what one more assignment costs; `bias' multiplies the
%% score of a job by the places where it begins and ends.
-type job() :: #{from := vertex(), trail := [vertex()], chain := [{vertex(), edge_id()}]}.
%% Drive the trail with the pen up, then each edge of the chain to its vertex with the pen down.

-record(best, {score = 0.0 :: float(), from = 0 :: non_neg_integer(), chain = [] :: list()}).

-define(LONGEST_TRY, 60).
%% Vertices with free edges that are looked at before the best so far is taken.

%% @doc The best job that a search from these starts finds.
-spec best([starl_dpp_search:start()], task(), Tries :: pos_integer()) -> {ok, job()} | none.
best(Starts, #{space := Space} = Task, Tries) ->
    Visit = fun(V, Cost, Heading, Acc) -> visit(V, Cost, Heading, Task, Acc) end,
    {Labels, {_, Best}} =
        starl_dpp_search:run(Starts, Space, Visit, {min(Tries, ?LONGEST_TRY), #best{}}),
    case Best of
        #best{chain = []} ->
            none;
        #best{from = V, chain = Chain} ->
            {ok, #{from => V, trail => starl_dpp_search:trail(V, Labels), chain => Chain}}
    end.

%%% Internals

visit(V, Cost, Heading, Task, {Tries, #best{score = Score} = Best}) ->
    #{horizon := Horizon, overhead_mm := Overhead} = Task,
    Bound = Horizon / (Cost + Horizon + Overhead),
    case open_steps(V, Task, #{}) of
        _ when Bound =< Score -> {stop, {Tries, Best}};
        [] -> {continue, {Tries, Best}};
        Steps when Tries =< 1 -> {stop, {0, tried(Steps, V, Cost, Heading, Task, Best)}};
        Steps -> {continue, {Tries - 1, tried(Steps, V, Cost, Heading, Task, Best)}}
    end.

tried(Steps, V, Cost, Heading, Task, Best) ->
    lists:foldl(fun(Step, Acc) -> try_chain(Step, V, Cost, Heading, Task, Acc) end, Best, Steps).

try_chain(Step, V, Cost, Heading, Task, #best{score = Score} = Best) ->
    #{overhead_mm := Overhead, bias := Bias} = Task,
    {Ink, Spent, Chain} = chain(Step, V, Heading, Task),
    {End, _} = lists:last(Chain),
    case Ink / (Cost + Spent + Overhead) * Bias(V, End, Chain) of
        Better when Better > Score -> #best{score = Better, from = V, chain = Chain};
        _ -> Best
    end.

%% The free edges at a vertex that are safe and not yet in the chain.
open_steps(V, #{space := #{graph := Graph, masks := Masks, own := Own}, free := Free}, Used) ->
    [Step || {E, _, _, _} = Step <- starl_dpp_graph:adjacent(V, Graph),
             is_map_key(E, Free), not is_map_key(E, Used),
             maps:get(E, Masks, 0) band (bnot Own) =:= 0].

chain(Step, V, Heading, #{horizon := Horizon} = Task) ->
    follow(Step, V, Heading, Horizon, Task, #{}, {0.0, 0.0, []}).

follow({E, W, Length, Out}, _V, In, Left, Task, Used0, {Ink, Spent, Chain}) ->
    #{space := #{turn_mm := TurnMm}} = Task,
    Turn = starl_dpp_search:turn(In, Out, TurnMm),
    Used = Used0#{E => true},
    Acc = {Ink + Length, Spent + Length + Turn, [{W, E} | Chain]},
    Steps = case Left > Length of true -> open_steps(W, Task, Used); false -> [] end,
    case Steps of
        [] -> done(Acc);
        _ -> follow(straightest(Steps, Out, TurnMm), W, Out, Left - Length, Task, Used, Acc)
    end.

done({Ink, Spent, Chain}) -> {Ink, Spent, lists:reverse(Chain)}.

straightest(Steps, In, TurnMm) ->
    {_, Best} = lists:min([{starl_dpp_search:turn(In, Out, TurnMm), Step}
                           || {_, _, _, Out} = Step <- Steps]),
    Best.
