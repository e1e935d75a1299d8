%% @doc Checks that the owners of tokens are announced (the paper's Proposition 2(c)). A robot whose
%% claim the home has confirmed sends all others one message: that it is the owner of this
%% hand-over. Pure; a part of {@link starl_mutex_monitor}.
%%
%% The holder of a token has announced its hand-over at most `announce_us' after the hold has begun,
%% or later by what its own pauses and slowness explain. No other robot announces it. The messages
%% are recognized by their hashes. A missing announcement is excused if the robot's SAP has had no
%% room or has restarted since, or if its mutex machine has crashed since.
-module(starl_mutex_monitor_owners).

-export([new/1, broken/2, event/4, overdue/2]).

-export_type([t/0]).

-type robot_id() :: starl_monitor:robot_id().
-type token() :: starl_mutex:token().
-type fence() :: starl_mutex:fence().
-type hand_over() :: {token(), robot_id(), fence()}.

-record(owners, {
    announce_us :: pos_integer() | infinity,
    assumption :: starl_assumption:t(),
    %% what the homes have confirmed, by the hash of its announcement, and of each token the latest ones
    confirmed = #{} :: #{Hash :: non_neg_integer() => hand_over()},
    latest = #{} :: #{token() => [Hash :: non_neg_integer()]},
    announced = #{} :: #{{robot_id(), token()} => fence()},
    %% holds of hand-overs that are not announced yet, and when they began
    due = [] :: [{AtUs :: integer(), hand_over()}]
}).

-opaque t() :: #owners{}.

%% The steps of an announcement: the machine's and SAP's.
-define(STEPS, 2).
-define(DRIFT_PPM, 10000).
%% The hand-overs of a token that are remembered: a confirmation may be long under way.
-define(KEPT, 8).

%% @doc Without `announce_us' nothing is judged.
-spec new(#{announce_us => pos_integer(), broken => [starl_assumption:window()], _ => _}) -> t().
new(Config) ->
    #owners{
        announce_us = maps:get(announce_us, Config, infinity),
        assumption = starl_assumption:new(maps:get(broken, Config, []), ?DRIFT_PPM)
    }.

%% @doc The window excuses what it meets.
-spec broken(starl_assumption:window(), t()) -> t().
broken(Window, #owners{assumption = Assumption} = Owners) ->
    Owners#owners{assumption = starl_assumption:broken(Window, Assumption)}.

%% @doc An event of a machine of a robot: what has been announced by whom that is not its owner.
-spec event({Machine :: atom(), term()}, TimeUs :: integer(), robot_id(), t()) ->
    {[{false_owner, robot_id(), hand_over()}], t()}.
event(_Event, _T, _Robot, #owners{announce_us = infinity} = Owners) ->
    {[], Owners};
event({mutex, {granted, Token, Fence, To}}, _T, _Home, Owners) ->
    {[], confirmed({Token, To, starl_mutex_home:hand_over(Fence)}, Owners)};
event({mutex, {acquired, Token, Fence}}, T, Robot, Owners) ->
    {[], holds({Token, Robot, starl_mutex_home:hand_over(Fence)}, T, Owners)};
event({sap, {sent, _Id, _To, mutex, Hash}}, _T, Robot, #owners{confirmed = Confirmed} = Owners) ->
    case Confirmed of
        #{Hash := {_, Robot, _} = HandOver} -> {[], announced(HandOver, Owners)};
        #{Hash := HandOver} -> {[{false_owner, Robot, HandOver}], Owners};
        #{} -> {[], lists:foldl(fun announced/2, Owners, due(Robot, Hash, Owners))}
    end;
event({Machine, Event}, _T, Robot, Owners) ->
    case loses(Machine, Event) of
        true -> {[], excused(Robot, Owners)};
        false -> {[], Owners}
    end.

loses(sap, {overload, mutex}) -> true;
loses(sap, {started, _}) -> true;
loses(robot, {died, _}) -> true;
loses(Machine, crashed) -> Machine =:= sap orelse Machine =:= mutex;
loses(robot, down) -> true;
loses(_Machine, _Event) -> false.

%% A robot that stalls announces a hand-over when many later ones have been confirmed.
due(Robot, Hash, #owners{due = Due}) ->
    [HandOver || {_, {_, Of, _} = HandOver} <- Due, Of =:= Robot, hash(HandOver) =:= Hash].

hash({Token, _Owner, Fence}) -> erlang:phash2({owner, Token, Fence}).

confirmed({Token, _, _} = HandOver, #owners{confirmed = Confirmed, latest = Latest} = Owners) ->
    Hash = hash(HandOver),
    Hashes = [Hash | lists:delete(Hash, maps:get(Token, Latest, []))],
    Kept = lists:sublist(Hashes, ?KEPT),
    Owners#owners{
        confirmed = maps:without(Hashes -- Kept, Confirmed#{Hash => HandOver}),
        latest = Latest#{Token => Kept}
    }.

holds({Token, Robot, Fence} = HandOver, T, #owners{announced = Announced} = Owners) ->
    Known = is_map_key(hash(HandOver), Owners#owners.confirmed),
    case Announced of
        #{{Robot, Token} := Fence} -> Owners;
        #{} when Known -> Owners#owners{due = Owners#owners.due ++ [{T, HandOver}]};
        #{} -> Owners
    end.

announced({Token, Robot, Fence} = HandOver, #owners{announced = Announced, due = Due} = Owners) ->
    Owners#owners{
        announced = Announced#{{Robot, Token} => Fence},
        due = [One || {_, Of} = One <- Due, Of =/= HandOver]
    }.

excused(Robot, #owners{confirmed = Confirmed} = Owners) ->
    Own = [HandOver || {_, To, _} = HandOver <- maps:values(Confirmed), To =:= Robot],
    lists:foldl(fun announced/2, Owners, lists:sort(Own)).

%% @doc The hand-overs that should have been announced before this time, and when.
-spec overdue(TimeUs :: integer(), t()) -> {[{DueUs :: integer(), hand_over()}], t()}.
overdue(_T, #owners{due = []} = Owners) ->
    {[], Owners};
overdue(T, #owners{due = Due} = Owners) ->
    Dated = [{until(One, Owners), One} || One <- Due],
    {
        [{Until, HandOver} || {Until, {_, HandOver}} <- lists:sort(Dated), Until < T],
        Owners#owners{due = [One || {Until, One} <- Dated, Until >= T]}
    }.

until({At, {_, Robot, _}}, #owners{announce_us = Us, assumption = Assumption}) ->
    starl_assumption:delayed_us(Robot, At, At + Us, ?STEPS, Assumption).
