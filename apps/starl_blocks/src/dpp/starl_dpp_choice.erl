%% @doc Chooses the free edges that a robot should paint next.
%%
%% One search from the robot visits vertices, nearest first. From each vertex with free edges it
%% follows a chain of them, straight on where possible, up to the horizon. The chain with the
%% highest score wins; the team's rule computes the scores ({@link starl_dpp_rule}). Of equal scores
%% the first chain wins, so no rule leaves work undone. If the rule has a bound on scores, the
%% search stops when no farther vertex can win. The bound rests on two facts: no chain has more ink
%% than the largest connected set of open edges, and no chain begins where no open edge ends.
-module(starl_dpp_choice).

-export([best/3, fold_begins/3]).
-export_type([settings/0, job/0]).

-type edge_id() :: starl_dpp_graph:edge_id().
-type waypoint() :: {starl_geometry:point(), up | {down, edge_id()}}.
-type settings() :: #{
    choice := starl_dpp_rule:name(),
    horizon := float(),
    overhead_mm := float(),
    middle := float(),
    reach := starl_dpp_search:within()
}.
%% `choice': the rule. `horizon': paint per assignment (mm). `overhead_mm' and `middle': see {@link
%% starl_dpp_rule:settings()}. `reach': the greatest
%% cost of getting to a chain; farther chains are not looked at.
-type job() :: #{path := [waypoint()], ink_mm := float(), travel_mm := float()}.
%% `travel_mm': the distance driven with the pen up.

-record(task, {
    space :: starl_dpp_search:space(),
    free :: starl_dpp_free:t(),
    horizon :: float(),
    %% the most ink of any chain up to the horizon; and with the line on which it passes the horizon
    most = 0.0 :: float(),
    longest = 0.0 :: float(),
    robot :: pos_integer(),
    rule :: module(),
    %% does the rule tell how far a better chain can be?
    bounded :: boolean(),
    settings :: starl_dpp_rule:settings(),
    reach :: starl_dpp_search:within()
}).
-record(best, {
    %% nothing found yet: any chain is better
    score = none :: number() | none,
    %% a vertex that costs more cannot win
    within = infinity :: starl_dpp_search:within(),
    from = 0 :: non_neg_integer(),
    chain = [] :: [{starl_dpp_graph:vertex(), edge_id()}]
}).

-define(TRIES, 40).
%% Vertices with free edges that are looked at before the best so far is taken.
-define(BESIDE, 3.0).
%% A robot farther than this from where a line begins drives there before it lowers the pen.

%% @doc The best job for a robot. `Stands' is where the robot really is, beside the place that is
%% reserved for it.
-spec best(Stands :: starl_geometry:point(), starl_dpp_route:view(), settings()) ->
    {ok, job()} | none.
best(Stands, #{robot := Robot, free := Free} = View, Settings) ->
    #{choice := Choice, horizon := Horizon, reach := Reach} = Settings,
    Rule = starl_dpp_rule:module(Choice),
    Task = #task{
        space = starl_dpp_route:space([Robot], View),
        free = Free,
        horizon = Horizon,
        robot = Robot,
        rule = Rule,
        bounded = starl_callback:exported(Rule, farthest, 3),
        settings = maps:with([overhead_mm, middle], Settings),
        reach = Reach
    },
    case open_edges(Task) of
        {_, 0} -> none;
        {Most, Ends} -> search(Stands, min(Ends, ?TRIES), bounded(Most, Task), View)
    end.

%% @doc Folds over the points where work for the robot could begin, until the function returns
%% `stop'. Some points come more than once.
-spec fold_begins(Fun, Acc, starl_dpp_route:view()) -> Acc when
    Fun :: fun((starl_geometry:point(), Acc) -> {continue, Acc} | {stop, Acc}).
fold_begins(Fun, First, #{robot := Robot, free := Free, graph := Graph} = View) ->
    #{masks := Masks, own := Own} = starl_dpp_route:space([Robot], View),
    Each = fun(E, Acc) ->
        case is_blocked(E, Masks, Own) of
            true -> {continue, Acc};
            false -> both(Fun, starl_dpp_graph:segment(E, Graph), Acc)
        end
    end,
    starl_dpp_free:fold_while(Each, First, Free).

both(Fun, {A, B}, Acc) ->
    case Fun(A, Acc) of
        {continue, Next} -> Fun(B, Next);
        {stop, _} = Stop -> Stop
    end.

%%% Internals

%% Bounds of the search: the ink of the largest connected set of open edges, up to the horizon, and
%% the number of ends of open edges, up to the number of tries. Nearly always the first edges answer
%% this. Whole millimetres, rounded up, add to the same sum in any order of the map.
open_edges(#task{free = Free, horizon = Horizon} = Task) ->
    Count = fun(E, Seen) -> count_open(E, open(E, Task), Seen, Task) end,
    case starl_dpp_free:fold_while(Count, {0, #{}, #{}}, Free) of
        {enough, Ends} ->
            {Horizon, map_size(Ends)};
        {_, Open, Ends} ->
            {min(float(heaviest(maps:keys(Open), Open, 0, Task)), Horizon), map_size(Ends)}
    end.

count_open(_E, false, Seen, _Task) ->
    {continue, Seen};
count_open(E, true, {Ink0, Open, Ends0}, #task{space = #{graph := Graph}, horizon = Horizon}) ->
    {A, B} = starl_dpp_graph:ends(E, Graph),
    Mm = length_mm(E, Graph),
    Ends = Ends0#{A => true, B => true},
    case Ink0 + Mm of
        Ink when Ink >= Horizon, map_size(Ends) >= ?TRIES -> {stop, {enough, Ends}};
        Ink -> {continue, {Ink, Open#{E => Mm}, Ends}}
    end.

bounded(Most, #task{horizon = Horizon} = Task) when Most < Horizon ->
    Task#task{most = Most, longest = Most};
bounded(Most, #task{space = #{graph := Graph}} = Task) ->
    Task#task{most = Most, longest = Most + starl_dpp_graph:longest(Graph)}.

length_mm(E, Graph) -> ceil(starl_dpp_graph:edge_length(E, Graph)).

%% The ink of the largest connected set of open edges: a chain stays within one set.
heaviest([], _Open, Most, _Task) ->
    Most;
heaviest([E | Edges], Open, Most, Task) ->
    {Ink, Left} = piece([E], Open, 0, Task),
    heaviest(Edges, Left, max(Ink, Most), Task).

piece([], Open, Ink, _Task) ->
    {Ink, Open};
piece([E | Edges], Open, Ink, #task{space = #{graph := Graph}} = Task) ->
    case maps:take(E, Open) of
        {Mm, Left} ->
            {A, B} = starl_dpp_graph:ends(E, Graph),
            Next = [N || V <- [A, B], {N, _, _, _} <- starl_dpp_graph:lines(V, Graph)],
            piece(Next ++ Edges, Left, Ink + Mm, Task);
        error ->
            piece(Edges, Open, Ink, Task)
    end.

search(Stands, Tries, #task{space = Space} = Task, View) ->
    Obstacles = starl_dpp_route:obstacles(View),
    Starts = starl_dpp_route:starts(starl_dpp_route:nearby(View), Obstacles, View),
    Visit = fun(V, Cost, Heading, Acc) -> visit(V, Cost, Heading, Task, Acc) end,
    Nothing = #best{within = Task#task.reach},
    case starl_dpp_search:run(Starts, Space, Visit, {Tries, Nothing}) of
        {_, {_, #best{chain = []}}} ->
            none;
        {Labels, {_, #best{from = V} = Best}} ->
            Trail = starl_dpp_search:trail(V, Labels),
            {ok, job(Stands, Best, starl_dpp_route:travel(Trail, Obstacles, View), View)}
    end.

job(Stands, #best{from = V, chain = Chain}, Travel0, #{at := P, graph := Graph}) ->
    Begin = starl_dpp_graph:point(V, Graph),
    Travel =
        case Travel0 =:= [] andalso starl_geometry:distance(Stands, Begin) > ?BESIDE of
            true -> [{Begin, up}];
            false -> Travel0
        end,
    #{
        path => Travel ++ [{starl_dpp_graph:point(W, Graph), {down, E}} || {W, E} <- Chain],
        ink_mm => lists:sum([starl_dpp_graph:edge_length(E, Graph) || {_, E} <- Chain]),
        travel_mm => driven([P | [Q || {Q, up} <- Travel]])
    }.

driven([P, Q | Rest]) -> starl_geometry:distance(P, Q) + driven([Q | Rest]);
driven([_]) -> 0.0.

visit(_V, Cost, _Heading, _Task, {_Tries, #best{within = Within}} = Acc) when Cost > Within ->
    {stop, Acc};
visit(V, Cost, Heading, #task{free = Free} = Task, {Tries, #best{within = Within} = Best} = Acc) ->
    case open_steps(starl_dpp_free:steps(V, Free), Task, #{}) of
        [] ->
            {continue, Within, Acc};
        Steps when Tries =< 1 ->
            {stop, {0, tried(Steps, V, Cost, Heading, Task, Best)}};
        Steps ->
            Tried = tried(Steps, V, Cost, Heading, Task, Best),
            {continue, Tried#best.within, {Tries - 1, Tried}}
    end.

%% No vertex that costs more can win.
within(#task{bounded = false, reach = Reach}, _Score) ->
    Reach;
within(#task{most = Most, rule = Rule, settings = Settings, reach = Reach}, Score) ->
    min(Rule:farthest(Score, Most, Settings), Reach).

tried(Steps, V, Cost, Heading, #task{free = Free} = Task, Best) ->
    %% To begin in the middle of a line leaves two pieces of it instead of one.
    Middle = length(starl_dpp_free:steps(V, Free)) rem 2 =:= 0,
    try_each(Steps, V, Cost, Heading, Middle, Task, Best).

try_each([], _V, _Cost, _Heading, _Middle, _Task, Best) ->
    Best;
try_each([Step | Steps], V, Cost, Heading, Middle, Task, Best) ->
    Next =
        case may_win(Step, V, Cost, Heading, Middle, Task, Best) of
            true -> try_one(Step, V, Cost, Heading, Middle, Task, Best);
            false -> Best
        end,
    try_each(Steps, V, Cost, Heading, Middle, Task, Next).

%% Could a vertex of this cost win, with the most ink that any chain has?
may_win(_Step, _V, _Cost, _Heading, _Middle, _Task, #best{score = none}) ->
    true;
may_win(_Step, _V, _Cost, _Heading, _Middle, #task{bounded = false}, _Best) ->
    true;
may_win({_, _, _, Out}, V, Cost, Heading, Middle, Task, #best{score = Score}) ->
    #task{longest = Ink, space = #{turn_mm := TurnMm}} = Task,
    Spent = starl_dpp_search:turn(Heading, Out, TurnMm) + Ink,
    score(Ink, Spent, Cost, V, Middle, Task) * (1.0 + 1.0e-9) > Score.

try_one(Step, V, Cost, Heading, Middle, Task, #best{score = Score} = Best) ->
    {Ink, Spent, Chain} = follow(Step, Heading, Task#task.horizon, Task, #{}, 0.0, 0.0, []),
    case score(Ink, Spent, Cost, V, Middle, Task) of
        Better when Score =:= none; Better > Score ->
            #best{score = Better, within = within(Task, Better), from = V, chain = Chain};
        _ ->
            Best
    end.

score(Ink, Spent, Cost, V, Middle, #task{rule = Rule, robot = Robot, space = Space} = Task) ->
    #{graph := Graph} = Space,
    Work = #{
        robot => Robot,
        begins => starl_dpp_graph:point(V, Graph),
        ink_mm => Ink,
        spent_mm => Spent,
        way_mm => Cost,
        middle => Middle
    },
    Rule:score(Work, Task#task.settings).

%% The edges that are safe and not yet in the chain.
open_steps([{E, _, _, _} = Step | Steps], Task, Used) when not is_map_key(E, Used) ->
    case open(E, Task) of
        true -> [Step | open_steps(Steps, Task, Used)];
        false -> open_steps(Steps, Task, Used)
    end;
open_steps([_ | Steps], Task, Used) ->
    open_steps(Steps, Task, Used);
open_steps([], _Task, _Used) ->
    [].

open(E, #task{space = #{masks := Masks, own := Own}}) -> not is_blocked(E, Masks, Own).

is_blocked(E, Masks, Own) -> starl_dpp_array:get(E, Masks) band (bnot Own) =/= 0.

%% Paints on along open edges until the horizon; the ink, the mm spent and the chain.
follow({E, W, Length, Out}, In, Left, Task, Used0, Ink0, Spent0, Chain0) when
    is_float(Length), is_float(Left), is_float(Ink0), is_float(Spent0)
->
    #task{space = #{turn_mm := TurnMm}, free = Free} = Task,
    Ink = Ink0 + Length,
    Spent = Spent0 + Length + starl_dpp_search:turn(In, Out, TurnMm),
    Chain = [{W, E} | Chain0],
    Used = Used0#{E => true},
    case Left > Length andalso open_steps(starl_dpp_free:steps(W, Free), Task, Used) of
        [_ | _] = Steps ->
            Next = straightest(Steps, Out, TurnMm),
            follow(Next, Out, Left - Length, Task, Used, Ink, Spent, Chain);
        _None ->
            {Ink, Spent, lists:reverse(Chain)}
    end.

straightest([Step], _In, _TurnMm) ->
    Step;
straightest(Steps, In, TurnMm) ->
    {_, Best} = lists:min([
        {starl_dpp_search:turn(In, Out, TurnMm), Step}
     || {_, _, _, Out} = Step <- Steps
    ]),
    Best.
