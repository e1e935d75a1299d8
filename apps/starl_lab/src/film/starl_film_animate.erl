%% @doc The animations of a film. Each lasts as long as the whole film, so all of them stay
%% synchronous. A pure module.
-module(starl_film_animate).

-export([new/2, values/3, shown/2]).

-export_type([t/0, options/0]).

%% `seconds': of the film, before it rests; `once': it does not begin again.
-type options() :: #{seconds := float(), once => boolean(), atom() => term()}.

-record(film, {
    end_us :: pos_integer(),
    %% the part of the film that moves
    part :: float(),
    %% the attributes of each animation
    dur :: iodata()
}).

-opaque t() :: #film{}.

-define(REST_S, 4.0).
%% Times are told to within half of this: a robot drives about 2 mm meanwhile.
-define(STEP_US, 8000).

%% @doc The animations of a run that ends then.
-spec new(EndUs :: integer(), options()) -> t().
new(End, #{seconds := Seconds} = Options) ->
    #film{
        end_us = max(1, End),
        part = Seconds / (Seconds + ?REST_S),
        dur = dur(Seconds + ?REST_S, maps:get(once, Options, false))
    }.

dur(Seconds, Once) ->
    Again =
        case Once of
            true -> "\" fill=\"freeze\"";
            false -> "\" repeatCount=\"indefinite\""
        end,
    [" dur=\"", starl_film_draw:number(float(Seconds)), "s", Again].

%% @doc An animation: what it does, and its values by time.
-spec values(iodata(), [{TUs :: integer(), iodata()}, ...], t()) -> iolist().
values(What, [{First, Value} | _] = Keys, Film) ->
    All = [{0, Value} || First > 0] ++ Keys,
    Steps = steps(Film),
    Moments = [{moment(T, Steps, Film), V} || {T, V} <- All] ++ [{Steps, last(Keys)}],
    [
        [$<, What, Film#film.dur, " keyTimes=\""],
        lists:join($;, [decimal(M, Steps) || {M, _} <- Moments]),
        "\" values=\"",
        lists:join($;, [V || {_, V} <- Moments]),
        "\"/>"
    ].

%% @doc Shows its element in these spans of time only.
-spec shown([starl_film_cast:span()], t()) -> iolist().
shown(Spans, Film) ->
    Keys = [{0, "0"} | lists:append([[{From, "1"}, {To, "0"}] || {From, To} <- Spans])],
    values("animate attributeName=\"opacity\" calcMode=\"discrete\"", Keys, Film).

last(Keys) -> element(2, lists:last(Keys)).

%% The steps of the film's time: a power of ten.
steps(#film{end_us = End, part = Part}) -> power(1000, End / Part / ?STEP_US).

power(Steps, Least) when Steps < Least -> power(10 * Steps, Least);
power(Steps, _Least) -> Steps.

moment(T, Steps, #film{end_us = End, part = Part}) ->
    max(0, min(Steps, round(Steps * Part * T / End))).

decimal(0, _Steps) -> "0";
decimal(Steps, Steps) -> "1";
decimal(M, Steps) -> [$. | string:trim(tl(integer_to_list(Steps + M)), trailing, "0")].
