%% @doc Records how a geocast spreads: for each robot its deadline, the robot that gave it, and
%% when. Pure; a part of {@link starl_geocast_monitor}, which asks which clocks had a part in a
%% deadline.
%%
%% A robot measures the rest of a message's lifetime from when it asks for the message, and it asks
%% only when the giver has it. From then until it gives the message on, or delivers it, its own
%% clock counts. Before that the clock of the giver counts, and so on back to the source.
-module(starl_geocast_provenance).

-export([new/2, held/4, spans/3, spans_before/3]).

-export_type([t/0, span/0]).

%% The time during which the robot's clock counts (us).
-type span() :: {starl:robot_id(), FromUs :: integer(), UntilUs :: integer()}.

-record(way, {
    source :: starl:robot_id(),
    sent_us :: integer(),
    %% the givers of each robot, latest first
    gifts = #{} :: #{starl:robot_id() => [{AtUs :: integer(), From :: starl:robot_id()}]}
}).

-opaque t() :: #way{}.

%% @doc A message has been sent.
-spec new(Source :: starl:robot_id(), SentUs :: integer()) -> t().
new(Source, Sent) -> #way{source = Source, sent_us = Sent}.

%% @doc A robot holds the message until a deadline that robot `From' has given to it.
-spec held(integer(), starl:robot_id(), From :: starl:robot_id(), t()) -> t().
held(T, Robot, From, #way{gifts = Gifts} = Way) ->
    Way#way{gifts = Gifts#{Robot => [{T, From} | maps:get(Robot, Gifts, [])]}}.

%% @doc The robots whose clocks count for the deadline that a robot has at a time, each with the
%% time during which its clock counts.
-spec spans(starl:robot_id(), UntilUs :: integer(), t()) -> [span(), ...].
spans(Robot, Until, Way) -> listed(follow([{Robot, Until}], #{}, Way)).

%% @doc The same for the rest of the lifetime when the message was given to the robot: its own clock
%% counts only if it had given the message on before.
-spec spans_before(starl:robot_id(), UntilUs :: integer(), t()) -> [span()].
spans_before(Robot, Until, Way) ->
    Givers = [{Giver, At} || {At, Giver} <- gifts(Robot, Until, Way)],
    listed(follow(Givers, #{}, Way)).

listed(Spans) -> [{R, From, Until} || {R, {From, Until}} <- lists:sort(maps:to_list(Spans))].

follow([], Spans, _Way) ->
    Spans;
follow([{Robot, Until} | More], Spans, Way) ->
    case Spans of
        #{Robot := {_, Known}} when Known >= Until ->
            follow(More, Spans, Way);
        #{} ->
            Gifts = gifts(Robot, Until, Way),
            From = lists:min([Until | [had_since(Giver, Way) || {_, Giver} <- Gifts]]),
            Before = [{Giver, At} || {At, Giver} <- Gifts],
            follow(Before ++ More, Spans#{Robot => {earliest(Robot, From, Way), Until}}, Way)
    end.

gifts(Robot, Until, #way{gifts = Gifts}) ->
    [Gift || {At, _} = Gift <- maps:get(Robot, Gifts, []), At =< Until].

%% The source has the message from the beginning, even if it is given to it again later.
earliest(Source, _From, #way{source = Source, sent_us = Sent}) -> Sent;
earliest(_Robot, From, _Way) -> From.

had_since(Source, #way{source = Source, sent_us = Sent}) ->
    Sent;
had_since(Robot, #way{gifts = Gifts, sent_us = Sent}) ->
    lists:min([At || {At, _} <- maps:get(Robot, Gifts, [{Sent, none}])]).
