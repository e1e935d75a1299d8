%% @doc The exercise of mutual exclusion: each robot again and again holds one or two tokens for
%% some time.
%%
%% It promises that a token is granted, and that tokens asked for after the last fault is over are
%% not lost. This does not hold if the home of any token has died: robots that wait for that token
%% keep their others. It also promises that all robots know the last announced owner of a token,
%% unless a newer announcement is under way.
-module(starl_mutex_exercise).
-behaviour(starl_block_exercise).

-export([flags/0, block_options/1, within_ms/1, again_ms/1, draw/1, work/3, final/3]).
-export([watches/0, seen/1, noted/2, promise/3]).

-type fence() :: starl_mutex:fence().

-record(seen, {
    robots :: [starl:robot_id()],
    %% the time at which each robot asked for its present tokens: it may hold one long before it has
    %% them all
    held = #{} :: #{starl:robot_id() => integer()},
    %% the homes of the tokens that any robot has asked for
    homes = #{} :: #{starl:robot_id() => true},
    %% the hand-overs that homes have confirmed, by the hash of their announcement; the newest hand-over of
    %% each token, and since when that is announced
    confirmed = #{} :: #{
        Hash :: non_neg_integer() => {starl_mutex:token(), starl:robot_id(), fence()}
    },
    newest = #{} :: #{
        starl_mutex:token() => {fence(), under_way | {starl:robot_id(), SinceUs :: integer()}}
    }
}).

%% All robots may be in front, each with its longest holds, and a lease has to end first.
-define(WITHIN_MS, 20000).
%% At the end a robot waits before it asks for owners; an announcement takes one message, and some steps.
-define(REST_MS, 10000).
-define(ANNOUNCED_US, 1000000).

-spec flags() -> [starl_options:option()].
flags() ->
    [
        {tokens, {integer, 1, 100000}, 3, "mutex: the number of tokens"},
        {hold, {integer, 1, 1000000}, 300, "mutex: the longest hold, ms"},
        {lease, {integer, 100, 1000000}, 2000,
            "mutex: the duration of a hold that is not renewed, ms"},
        {retry, {integer, 10, 1000000}, 3000,
            "mutex, barrier: the time after which a waiting robot asks again, ms"}
    ].

-spec block_options(starl_block_exercise:use()) -> starl_block:options().
block_options(#{lease := Lease, retry := Retry}) -> #{lease_ms => Lease, retry_ms => Retry}.

-spec within_ms(starl_block_exercise:use()) -> pos_integer().
within_ms(#{team := N, hold := Hold, lease := Lease, retry := Retry}) ->
    ?WITHIN_MS + round(2 * (Lease + Retry + N * Hold)).

-spec again_ms(starl_block_exercise:use()) -> pos_integer().
again_ms(#{retry := Retry}) -> Retry.

-spec draw(starl_block_exercise:draw()) -> #{atom() => term()}.
draw(Draw) ->
    Lease = Draw(lease, [500, 1000, 2000, 4000]),
    %% up to twice a lease
    #{lease => Lease, hold => Draw(hold, {50, 2 * Lease}), retry => Draw(retry, [500, 1000, 3000])}.

-spec work(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
work(Robot, _Turn, #{patience := Patience, tokens := Count, hold := Hold}) ->
    Tokens =
        case pick(Robot, 3) of
            1 -> {token, pick(Robot, Count)};
            _ -> [{token, pick(Robot, Count)} || _ <- [1, 2]]
        end,
    hold(Robot, Tokens, Patience, pick(Robot, Hold)).

%% One by one, the next time all at once. Then all should know whose they are.
-spec final(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
final(Robot, N, #{tokens := Count, last_patience := Patience}) ->
    Tokens = [{token, T} || T <- lists:seq(1, Count)],
    Held = [hold(Robot, Some, Patience, 50) || Some <- in_turn(N, Tokens)],
    ok = starl:sleep(Robot, ?REST_MS),
    _ = [owner(Robot, Token) || Token <- Tokens],
    Held.

owner(Robot, Token) ->
    Owner = fun() -> starl_mutex:owner(Robot, Token) end,
    starl_block_exercise:call(Robot, {owner, Token}, Owner).

in_turn(N, Tokens) when N rem 2 =:= 1 -> Tokens;
in_turn(_N, Tokens) -> [Tokens].

hold(Robot, Tokens, Patience, Ms) ->
    Acquire = fun() -> starl_mutex:acquire(Robot, Tokens, Patience) end,
    case starl_block_exercise:call(Robot, {acquire, Tokens}, Patience, Acquire) of
        {ok, _} ->
            ok = starl:sleep(Robot, Ms),
            Release = fun() -> starl_mutex:release(Robot, Tokens) end,
            starl_block_exercise:call(Robot, {release, Tokens}, Release);
        {error, _} = Error ->
            Error
    end.

pick(Robot, N) -> starl_block_exercise:pick(Robot, N).

%% @doc Hand-overs, and what announces them.
-spec watches() -> [starl_machine:name()].
watches() -> [mutex, sap].

-spec seen([starl:robot_id()]) -> #seen{}.
seen(Robots) -> #seen{robots = Robots}.

-spec noted(starl_monitor:trace_event(), #seen{}) -> #seen{}.
noted({_, _, app, {call, {acquire, Tokens}, _}}, #seen{homes = Homes, robots = Robots} = Seen) ->
    New = [starl_mutex:home(Token, Robots) || Token <- lists:flatten([Tokens])],
    Seen#seen{homes = maps:merge(Homes, maps:from_keys(New, true))};
noted({_, Robot, app, {answered, #{what := {acquire, _}} = Call, {ok, _}}}, Seen) ->
    #{since_us := Since} = Call,
    Seen#seen{held = (Seen#seen.held)#{Robot => Since}};
noted({_, _, mutex, {granted, Token, Fence, To}}, #seen{confirmed = Confirmed} = Seen) ->
    Base = starl_mutex_home:hand_over(Fence),
    Hash = erlang:phash2({owner, Token, Base}),
    moved(Token, Base, Seen#seen{confirmed = Confirmed#{Hash => {Token, To, Base}}});
noted({_, _, mutex, {handed_over, Token, Fence, _To}}, Seen) ->
    moved(Token, starl_mutex_home:hand_over(Fence), Seen);
noted({T, Robot, sap, {sent, _, _, mutex, Hash}}, #seen{confirmed = Confirmed} = Seen) ->
    #seen{newest = Newest} = Seen,
    case Confirmed of
        #{Hash := {Token, Robot, Base}} when map_get(Token, Newest) =:= {Base, under_way} ->
            Seen#seen{newest = Newest#{Token := {Base, {Robot, T}}}};
        #{} ->
            Seen
    end;
noted(_Event, Seen) ->
    Seen.

moved(Token, Base, #seen{newest = Newest} = Seen) ->
    case Newest of
        #{Token := {Known, _}} when Known >= Base -> Seen;
        #{} -> Seen#seen{newest = Newest#{Token => {Base, under_way}}}
    end.

-spec promise(starl_promise:call(), starl_promise:team(), #seen{}) -> starl_promise:t().
promise(#{what := {owner, Token}} = Call, Team, Seen) ->
    owned(Token, Call, Team, Seen);
promise(Call, Team, #seen{homes = Homes} = Seen) ->
    case starl_promise:has_died(maps:keys(Homes), Team) orelse is_slow(Call, Team) of
        true -> none;
        false -> with_homes(Call, Team, Seen)
    end.

%% It has been announced since the heal, and the announcement has arrived.
owned(Token, #{since_us := Now} = Call, #{healed_us := Healed} = Team, #seen{newest = Newest}) ->
    Reach = maps:get(reach_us, Team, 0),
    case Newest of
        #{Token := {_, {Owner, Since}}} when
            Since >= Healed, is_integer(Reach), Since + Reach + ?ANNOUNCED_US =< Now
        ->
            case starl_promise:has_died([Owner], Team) of
                true -> none;
                false -> starl_promise:soon(Call, fun(Is) -> Is =:= {ok, Owner} end, Team)
            end;
        #{} ->
            none
    end.

%% A claim and its answer must come within a lease, by a clock that is 1 % fast; a hold is renewed at its
%% half.
is_slow(#{what := What}, #{use := #{lease := Lease}, reach_us := Reach}) ->
    Part =
        case What of
            {release, _} -> 2;
            _ -> 1
        end,
    Part * Reach * 101 >= 100 * 1000 * Lease;
is_slow(_Call, _Team) ->
    false.

with_homes(#{what := {acquire, _}} = Call, Team, _Seen) ->
    starl_promise:soon(Call, fun starl_promise:is_some/1, Team);
with_homes(#{what := {release, _}, robot := Robot} = Call, Team, #seen{held = Held}) ->
    case maps:get(Robot, Held, 0) < maps:get(healed_us, Team) of
        true -> none;
        false -> starl_promise:soon(Call, fun starl_promise:is_ok/1, Team)
    end;
with_homes(_Call, _Team, _Seen) ->
    none.
