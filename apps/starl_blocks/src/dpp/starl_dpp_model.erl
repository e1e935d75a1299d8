%% @doc The model of path planning for the exhaustive checker: the votes, leases and terms of its
%% coordinators, which keep two of them from assigning at one time. A service that may act at any
%% moment stands for the planner ({@link starl_dpp_model_service}).
%%
%% The last robot is named as the first coordinator, and after a restart the first one: by its
%% place in the team and by its number a robot comes before another or after it, so no two are
%% alike. The lease is as short as the beats allow, so that its end is near.
-module(starl_dpp_model).

-export([new/1]).

-define(LEASE_US, 4000000).
%% The number of ticks in about a second.
-define(TICKS, 10000).
%% µs that a clock gains in a tick; the ratio of the slowest to the fastest is the default bound
%% on drift, 10000 ppm.
-define(SLOW, 99).
-define(FAST, 101).

%% @doc The model for a team.
-spec new(starl_block:team()) -> starl_block:model().
new(#{robots := Ids, terms := Terms}) ->
    Lease = #{lease_ms => ?LEASE_US div 1000, jump_ms => 0},
    #{
        blocks => [
            {dpp, starl_dpp_participant, Lease},
            {dpp_coordinator, starl_dpp_coordinator, Lease#{serve => starl_dpp_model_service}}
        ],
        stands => [motion, location],
        script => fun(_) -> [{start, dpp, {join, lists:last(Ids)}, {join, hd(Ids)}}] end,
        crash => [dpp, dpp_coordinator],
        monitor => {starl_dpp_model_monitor, #{tube_radius => 200.0, r_s => 330.0}},
        timed => [beat, recover, claim, missing, again, look, leave],
        steps => [serve],
        beyond => fun(Event) -> claims_more(Event, Terms) end,
        bounds => lists:concat(["up to term ", Terms]),
        rates => rates(length(Ids)),
        grain => 1,
        horizon_us => ?LEASE_US + 1,
        past_us => ?LEASE_US + 1,
        fixed => lists:seq(1, length(Ids))
    }.

%% The clock of the first coordinator is slow, so that its votes last longest, and those of the
%% robots that give them are fast; a tick is about a second.
rates(N) -> setelement(N, erlang:make_tuple(N, ?TICKS * ?FAST), ?TICKS * ?SLOW).

%% A robot that is alone claims in vain for ever.
claims_more({_, _, dpp_coordinator, {claims, {N, _, _}}}, Terms) -> N > Terms;
claims_more(_Event, _Terms) -> false.
