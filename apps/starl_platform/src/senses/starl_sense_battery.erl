%% @doc The battery sensor measures how full the battery is. A reading is a fraction from 1.0 (full)
%% to 0.0. Time and driving drain the battery.
-module(starl_sense_battery).
-behaviour(starl_sense).

-export([profile/0, errors/0, read/2, blurred/3, guess/2, is_reading/2]).

%% It lasts so many seconds at rest, or so many millimetres of driving; `noise' is the standard
%% deviation.
-spec profile() -> starl_sense:profile().
profile() -> #{rests_s => 10800, drives_mm => 3000000, noise => 0.002}.

-spec errors() -> [atom()].
errors() -> [noise].

-spec read(starl_sense:view(), starl_sense:profile()) -> float().
read(#{now_us := Now, driven_mm := Driven, draw := Draw}, Profile) ->
    #{rests_s := Rests, drives_mm := Drives, noise := Noise} = Profile,
    Left = 1.0 - Now / 1.0e6 / max(1, Rests) - Driven / max(1, Drives),
    max(0.0, min(1.0, max(0.0, Left) + Noise * starl_sense:normal(battery, Draw))).

%% @doc A reading with more noise.
-spec blurred(float(), starl_sense:draw(), starl_sense:profile()) -> float().
blurred(Part, Draw, #{noise := Noise}) ->
    max(0.0, min(1.0, Part + Noise * starl_sense:normal(battery, Draw))).

-spec guess(starl_sense:draw(), starl_sense:profile()) -> float().
guess(Draw, _Profile) -> Draw(guess).

-spec is_reading(term(), starl_sense:profile()) -> boolean().
is_reading(Part, _Profile) -> is_float(Part) andalso Part >= 0 andalso Part =< 1.
