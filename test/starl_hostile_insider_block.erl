%% A block of somebody's own, with a machine that does not bear large numbers.
-module(starl_hostile_insider_block).
-behaviour(starl_block).

-export([options/0, machines/1, monitors/2, contract/0]).

options() -> [].

machines(_Options) -> [{victim, starl_hostile_insider_machine, #{}}].

monitors(_Options, _Context) -> [].

contract() -> "none".
