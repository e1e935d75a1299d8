%% @doc Draws the faults in a film that separate robots from the team, as the page of a run does.
%% Cut links are dashed red lines. Robots that are alone, frozen or paused have dashed red rings. A
%% pure module.
-module(starl_film_partitions).

-export([cuts/3, links/1, rings/2, holds/2, line/1, ring/1]).

-export_type([cut/0, mark/0]).

-type mark() :: {link, starl:robot_id(), starl:robot_id()} | {ring, starl:robot_id()}.

-type cut() :: {mark(), starl_film_cast:span()}.

-define(KINDS, [
    loss,
    drop,
    partition,
    one_way_partition,
    isolate,
    burst_loss,
    delay,
    corrupt,
    location_frozen,
    pause
]).
-define(RED, "#c40d2e").
-define(RADIUS_MM, 165).

%% @doc The cuts of faults among these robots. What concerns all is not drawn.
-spec cuts([tuple()], [starl:robot_id()], UntilUs :: integer()) -> [cut()].
cuts(Faults, Ids, Until) ->
    lists:usort([
        {Mark, {1000 * From, min(us(To), Until)}}
     || {_, From, To, Kind, Target, _} <- Faults,
        lists:member(Kind, ?KINDS),
        1000 * From < min(us(To), Until),
        Mark <- marks(Target),
        tl(tuple_to_list(Mark)) -- Ids =:= []
    ]).

%% Of a fault by hand nobody knows the end; an atom is above all numbers.
us(To) when is_integer(To) -> 1000 * To;
us(To) -> To.

marks({A, B}) when is_integer(A), is_integer(B) -> [{link, min(A, B), max(A, B)}];
marks(Robots) when is_list(Robots) -> [{ring, Robot} || Robot <- Robots];
marks(Robot) when is_integer(Robot) -> [{ring, Robot}];
marks(_All) -> [].

%% @doc The cut links.
-spec links([cut()]) -> [{starl:robot_id(), starl:robot_id(), starl_film_cast:span()}].
links(Cuts) -> [{A, B, Span} || {{link, A, B}, Span} <- Cuts].

%% @doc When a robot has a ring.
-spec rings(starl:robot_id(), [cut()]) -> [starl_film_cast:span()].
rings(Id, Cuts) -> [Span || {{ring, Robot}, Span} <- Cuts, Robot =:= Id].

%% @doc The cuts that hold at a time.
-spec holds(integer(), [cut()]) -> [cut()].
holds(T, Cuts) -> [Cut || {_, {From, To}} = Cut <- Cuts, From =< T, T < To].

%% @doc The attributes of a line.
-spec line(starl_film_draw:page()) -> iolist().
line(#{dot := Dot}) ->
    [
        "stroke=\"" ?RED "\" fill=\"none\" stroke-width=\"",
        [starl_film_draw:number(1.5 * Dot), "\" stroke-dasharray=\""],
        [starl_film_draw:number(6 * Dot), $\s, starl_film_draw:number(4 * Dot), $"]
    ].

%% @doc The beginning of a ring around the origin.
-spec ring(starl_film_draw:page()) -> iolist().
ring(#{dot := Dot} = Page) ->
    ["<circle r=\"", starl_film_draw:number(?RADIUS_MM + 7 * Dot), "\" ", line(Page)].
