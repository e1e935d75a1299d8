%% @doc The facts that only a checked robot tells: it stands still within a step, and goes on with it.
-module(starl_check_fact).

-export([vocabulary/0]).

-export_type([robot/0]).

%% Facts of machine `robot'.
-type robot() :: stands | goes_on.

%% @doc These facts, as a monitor lists those of its machines.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{robot => [{stands, 0}, {goes_on, 0}]}.
