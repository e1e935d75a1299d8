%% A chassis' driver without the callbacks that one may leave out.
-module(starl_live_bare_chassis).
-behaviour(starl_live_chassis).

-export([open/1, drive/4, actuate/4, stop/1, hear/2, close/1]).

open(#{fails := Why}) -> {error, Why};
open(#{test := Test}) -> {ok, Test}.
drive(_Script, _Until, _Mark, Test) -> {[], Test}.
actuate(_Device, _Value, _Mark, Test) -> {[], Test}.
stop(Test) -> Test.
hear(breaks, _Test) -> {stop, "broken"};
hear(_Message, _Test) -> unknown.
close(_Test) -> ok.
