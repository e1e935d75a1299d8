%% @doc Tracks the holder of each token from the events, and reports violations. It is the safety
%% part of {@link starl_mutex_monitor}. Pure.
%%
%% Under every fault:
%% ```
%%   grant_not_larger    a home has confirmed a hand-over whose number is not larger than the last
%%   never_granted       a hold of a hand-over that the home has not confirmed to this robot
%%   fence_not_larger    a fence that is not larger than that of the robot's hold before
%%   not_held            a hold that does not exist is released, lost or answered
%% '''
%% A hand-over belongs to one robot, and a robot's fences grow, so no fence is used twice.
%%
%% A home whose store was set back, and in whose run a clock was set, may have a smaller incarnation
%% than before, if no other robot has heard of the earlier one. Then the numbers of its tokens begin
%% anew, once.
%%
%% As long as clocks keep the assumptions:
%% ```
%%   two_holders         a second hold of a token begins before the first can be over
%%   fence_overtaken     a fence that is older than one of another robot's that was held before
%%   held_too_long       a hold goes on after its lease, and its robot should have noticed
%% '''
%% A hold is over when it is released or lost, when its machine has crashed, or `lag_us' after the
%% end of its lease by the holder's clock. A robot that stalls for longer finds its lease over when
%% it goes on, and can do nothing before. So no pause excuses an overlap.
%%
%% Wrong clocks explain an overlap in two ways. The older of the two holders overestimates its lease
%% by the time that its clock has lost since it claimed it. The home underestimates the lease by the
%% time that its own clock has gained since then. An overlap that is not longer than the sum of the
%% two is excused, no other. An older fence that comes late is excused likewise, counted from the
%% beginning of the newer hold. A hold may go on longer by the time that the holder's clock has lost
%% since the lease was reported, and to the end of a pause that it runs into.
-module(starl_mutex_holds).

-export([is_held/2]).
-export([
    new/1,
    set_back/2,
    broken/2,
    granted/6,
    leased/6,
    acquired/5,
    answered/4,
    ended/6,
    forget/2,
    finish/2
]).
-export([tokens/1, timeless/1]).

-export_type([t/0, config/0]).

-type token() :: term().
-type fence() :: integer().

%% `lease_us', `drift_ppm', `lag_us': as the machines have them; `broken': the times at which
%% assumptions are broken, by default never.
-type config() :: #{
    lease_us => pos_integer(),
    drift_ppm => non_neg_integer(),
    lag_us => non_neg_integer(),
    broken => [starl_assumption:window()]
}.

%% A lease as its holder told it at a time: by a clock that is right, it was claimed then at the
%% earliest, and lasts until then at the latest. The end is sure unless the holder stood still
%% before it told of it: then the lease is over earlier by as much.
-record(lease, {
    fence :: fence(),
    claimed_us = 0 :: integer(),
    told_us = 0 :: integer(),
    sure_us = infinity :: integer() | infinity,
    end_us = infinity :: integer() | infinity
}).

-record(hold, {robot :: starl:robot_id(), fence :: fence(), since_us :: integer()}).

-record(holds, {
    lease_us :: integer(),
    ppm :: non_neg_integer(),
    lag_us :: non_neg_integer(),
    assumption :: starl_assumption:t(),
    %% the last hand-over that was confirmed, to whom and by which home
    grants = #{} :: #{token() => {fence(), starl:robot_id(), Home :: starl:robot_id()}},
    %% the same of each robot
    hand_overs = #{} :: #{{token(), starl:robot_id()} => fence()},
    %% the last fence of each robot, and the largest of all, with the beginning of that hold
    fences = #{} :: #{{token(), starl:robot_id()} => fence()},
    largest = #{} :: #{token() => {fence(), SinceUs :: integer()}},
    leases = #{} :: #{{token(), starl:robot_id()} => #lease{}},
    %% whose store was set back, and the tokens whose numbers have begun anew since
    set_back = #{} :: #{starl:robot_id() => [token()]},
    holds = #{} :: #{token() => [#hold{}]}
}).

-opaque t() :: #holds{}.

-define(LEASE_US, 8000000).
-define(DRIFT_PPM, 10000).
-define(LAG_US, 250000).

%% @doc No robot holds a token.
-spec new(config()) -> t().
new(Config) ->
    Ppm = maps:get(drift_ppm, Config, ?DRIFT_PPM),
    #holds{
        lease_us = maps:get(lease_us, Config, ?LEASE_US),
        ppm = Ppm,
        lag_us = maps:get(lag_us, Config, ?LAG_US),
        assumption = starl_assumption:new(maps:get(broken, Config, []), Ppm)
    }.

%% @doc An assumption was broken in this window.
-spec broken(starl_assumption:window(), t()) -> t().
broken(Window, #holds{assumption = Assumption} = Holds) ->
    Holds#holds{assumption = starl_assumption:broken(Window, Assumption)}.

%% @doc The store of a robot was set back.
-spec set_back(starl:robot_id(), t()) -> t().
set_back(Robot, #holds{set_back = Back} = Holds) -> Holds#holds{set_back = Back#{Robot => []}}.

%% @doc Does a robot hold the token?
-spec is_held(token(), t()) -> boolean().
is_held(Token, #holds{holds = Holds}) -> maps:get(Token, Holds, []) =/= [].

%% @doc A home confirms a hand-over of a token to a robot.
-spec granted(integer(), Home :: starl:robot_id(), token(), fence(), To :: starl:robot_id(), t()) ->
    {[starl_monitor:violation()], t()}.
granted(T, Home, Token, Fence, To, Before) ->
    #holds{grants = Grants, hand_overs = HandOvers} = Holds = anew(Home, Token, Fence, Before),
    Broken =
        case Grants of
            #{Token := {Last, Whose, _}} when Fence < Last; Fence =:= Last, To =/= Whose ->
                Details = #{token => Token, fence => Fence, last => Last},
                [violation(grant_not_larger, T, [To], Details)];
            #{} ->
                []
        end,
    {Broken, Holds#holds{
        grants = Grants#{Token => {Fence, To, Home}},
        hand_overs = HandOvers#{{Token, To} => Fence}
    }}.

anew(Home, Token, Fence, #holds{grants = Grants, set_back = Back} = Holds) ->
    case {Grants, Back} of
        {#{Token := {Last, _, Home}}, #{Home := Begun}} when Fence < Last ->
            case
                lists:member(Token, Begun) orelse starl_assumption:is_kept(Holds#holds.assumption)
            of
                true -> Holds;
                false -> forgotten(Token, Holds#holds{set_back = Back#{Home := [Token | Begun]}})
            end;
        {_, _} ->
            Holds
    end.

forgotten(Token, #holds{hand_overs = HandOvers, fences = Fences} = Holds) ->
    Others = fun({Of, _}, _) -> Of =/= Token end,
    Holds#holds{
        grants = maps:remove(Token, Holds#holds.grants),
        largest = maps:remove(Token, Holds#holds.largest),
        hand_overs = maps:filter(Others, HandOvers),
        fences = maps:filter(Others, Fences)
    }.

%% @doc A robot that holds a token, or will at once, reports the rest of its lease by its clock.
-spec leased(integer(), starl:robot_id(), token(), fence(), LeftUs :: integer(), t()) -> t().
leased(T, Robot, Token, Fence, Left, #holds{leases = Leases, ppm = Ppm} = Holds) ->
    Gone = max(0, Holds#holds.lease_us - Left),
    Begun = starl_assumption:begun_us(Robot, T, Holds#holds.assumption),
    Lease = #lease{
        fence = Fence,
        claimed_us = Begun - starl_assumption:longest_us(Gone, Ppm),
        told_us = T,
        sure_us = Begun + starl_assumption:longest_us(Left, Ppm),
        end_us = T + starl_assumption:longest_us(Left, Ppm)
    },
    Holds#holds{leases = Leases#{{Token, Robot} => Lease}}.

%% @doc A hold begins.
-spec acquired(integer(), starl:robot_id(), token(), fence(), t()) ->
    {[starl_monitor:violation()], t()}.
acquired(T, Robot, Token, Fence, #holds{fences = Fences, largest = Largest} = Holds) ->
    New = #hold{robot = Robot, fence = Fence, since_us = T},
    Others = holds_of(Token, Holds),
    Broken =
        never_granted(T, New, Token, Holds) ++
            not_larger(T, New, Token, Holds) ++
            overtaken(T, New, Token, Holds) ++
            lists:append([beside(T, Old, New, Token, Holds) || Old <- Others]),
    Last = maps:get(Token, Largest, {Fence, T}),
    {Broken,
        put_holds(Token, [New | Others], Holds#holds{
            fences = Fences#{{Token, Robot} => Fence},
            largest = Largest#{Token => max({Fence, T}, Last)}
        })}.

%% @doc The application gets the answer that it holds these.
-spec answered(integer(), starl:robot_id(), [{token(), fence()}], t()) ->
    [starl_monitor:violation()].
answered(T, Robot, Fences, Holds) ->
    lists:append([not_held(T, Robot, Token, Fence, Holds) || {Token, Fence} <- Fences]).

%% @doc A hold ends: it is released, or lost.
-spec ended(released | lost, integer(), starl:robot_id(), token(), fence(), t()) ->
    {[starl_monitor:violation()], t()}.
ended(How, T, Robot, Token, Fence, Holds) ->
    case lists:partition(fun(Hold) -> is_hold(Robot, Fence, Hold) end, holds_of(Token, Holds)) of
        {[], _} ->
            {not_held(T, Robot, Token, Fence, Holds), Holds};
        {[Hold], Others} ->
            {
                too_long(T, ended_by(How, Hold, Token, Holds), Hold, Token),
                put_holds(Token, Others, Holds)
            }
    end.

is_hold(Robot, Fence, #hold{robot = R, fence = F}) -> R =:= Robot andalso F =:= Fence.

%% @doc The holds of a robot end with its machine.
-spec forget(starl:robot_id(), t()) -> t().
forget(Robot, #holds{holds = All} = Holds) ->
    Left = maps:map(fun(_, Of) -> [Hold || #hold{robot = R} = Hold <- Of, R =/= Robot] end, All),
    Holds#holds{holds = maps:filter(fun(_, Of) -> Of =/= [] end, Left)}.

%% @doc The holds that go on too long at the end.
-spec finish(integer(), t()) -> [starl_monitor:violation()].
finish(T, #holds{holds = All} = Holds) ->
    lists:append([
        too_long(T, ended_by(lost, Hold, Token, Holds), Hold, Token)
     || {Token, Of} <- lists:sort(maps:to_list(All)), Hold <- Of
    ]).

%% @doc The number of tokens that have been held.
-spec tokens(t()) -> non_neg_integer().
tokens(#holds{largest = Largest}) -> map_size(Largest).

%% @doc The part of the state that decides while no time passes.
-spec timeless(t()) -> term().
timeless(#holds{grants = Grants, hand_overs = HandOvers, fences = Fences} = Holds) ->
    #holds{largest = Largest, holds = All} = Holds,
    {
        maps:map(fun(_, {Fence, To, _}) -> {Fence, To} end, Grants),
        HandOvers,
        Fences,
        maps:map(fun(_, {Fence, _}) -> Fence end, Largest),
        maps:map(fun(_, Of) -> [{R, F} || #hold{robot = R, fence = F} <- Of] end, All)
    }.

holds_of(Token, #holds{holds = All}) -> maps:get(Token, All, []).

put_holds(Token, [], #holds{holds = All} = Holds) -> Holds#holds{holds = maps:remove(Token, All)};
put_holds(Token, Of, #holds{holds = All} = Holds) -> Holds#holds{holds = All#{Token => Of}}.

%% -- the clauses that hold under every fault --------------------------------------------------

never_granted(T, #hold{robot = Robot, fence = Fence}, Token, #holds{hand_overs = HandOvers}) ->
    HandOver = starl_mutex_home:hand_over(Fence),
    case HandOvers of
        #{{Token, Robot} := HandOver} -> [];
        #{} -> [violation(never_granted, T, [Robot], #{token => Token, fence => Fence})]
    end.

not_larger(T, #hold{robot = Robot, fence = Fence}, Token, #holds{fences = Fences}) ->
    case Fences of
        #{{Token, Robot} := Last} when Fence =< Last ->
            Details = #{token => Token, fence => Fence, last => Last},
            [violation(fence_not_larger, T, [Robot], Details)];
        #{} ->
            []
    end.

not_held(T, Robot, Token, Fence, Holds) ->
    Details = #{token => Token, fence => Fence},
    case lists:any(fun(Hold) -> is_hold(Robot, Fence, Hold) end, holds_of(Token, Holds)) of
        true -> [];
        false -> [violation(not_held, T, [Robot], Details)]
    end.

%% -- the clauses that rest on clocks and promptness -------------------------------------------

overtaken(T, #hold{robot = Robot, fence = Fence} = Hold, Token, Holds) ->
    case Holds#holds.largest of
        #{Token := {Last, Since}} when Fence < Last ->
            Details = #{token => Token, fence => Fence, last => Last},
            [
                violation(fence_overtaken, T, [Robot], Details)
             || not is_excused(Since, Hold, Token, Holds)
            ];
        #{} ->
            []
    end.

%% A hold begins while there is another one.
beside(T, #hold{robot = Other, fence = Fence} = Old, #hold{robot = Robot} = New, Token, Holds) ->
    [Older, Newer] = lists:keysort(#hold.fence, [Old, New]),
    case T < over_us(Old, Token, Holds) of
        true ->
            Details = #{token => Token, fence => Fence, holder => Other},
            [
                violation(two_holders, T, lists:usort([Other, Robot]), Details)
             || not is_excused(Newer#hold.since_us, Older, Token, Holds)
            ];
        false ->
            too_long(T, ended_by(lost, Old, Token, Holds), Old, Token)
    end.

%% Until when a hold counts, by a right clock.
over_us(Hold, Token, #holds{lag_us = Lag} = Holds) ->
    case lease(Hold, Token, Holds) of
        #lease{sure_us = infinity} -> infinity;
        #lease{sure_us = End} -> End + Lag
    end.

lease(#hold{robot = Robot, fence = Fence}, Token, #holds{leases = Leases}) ->
    case Leases of
        #{{Token, Robot} := #lease{fence = Fence} = Lease} -> Lease;
        #{} -> #lease{fence = Fence}
    end.

%% Do clocks explain that a newer hold began, then, before an older one was over?
is_excused(Began, #hold{robot = Robot} = Older, Token, #holds{assumption = A} = Holds) ->
    case lease(Older, Token, Holds) of
        #lease{end_us = infinity} ->
            false;
        #lease{told_us = Told, sure_us = End} = Lease ->
            Claimed = starl_assumption:clock_earlier(Robot, Told, Lease#lease.claimed_us, A),
            Lost = starl_assumption:lost_us(Robot, Claimed, Told, A),
            End + Holds#holds.lag_us - Began =< Lost + gained(Claimed, Began, Token, Holds)
    end.

gained(Claimed, Began, Token, #holds{grants = Grants, assumption = Assumption}) ->
    case Grants of
        #{Token := {_, _, Home}} ->
            starl_assumption:gained_us(Home, Claimed, Began, Assumption);
        #{} ->
            0
    end.

%% When the holder must have noticed at the latest that its lease is over. It releases nothing
%% later than that by its clock; one that was paused meanwhile may find its clock set back.
ended_by(How, #hold{robot = Robot} = Hold, Token, #holds{assumption = A, lag_us = Lag} = Holds) ->
    case lease(Hold, Token, Holds) of
        #lease{end_us = infinity} ->
            infinity;
        #lease{told_us = Told, end_us = End} ->
            Due = starl_assumption:clock_later(Robot, Told, End, A),
            Noticed = starl_assumption:handled(Robot, Due, Lag, A),
            case How of
                lost -> Noticed;
                released when Noticed =< Due + Lag -> Due;
                released -> min(Noticed, Due + starl_assumption:lost_us(Robot, Due, Noticed, A))
            end
    end.

too_long(T, By, #hold{robot = Robot, fence = Fence}, Token) ->
    Details = #{token => Token, fence => Fence},
    [violation(held_too_long, T, [Robot], Details) || T > By].

violation(What, T, Robots, Details) ->
    starl_violation:new(mutex, What, T, Robots, Details).
