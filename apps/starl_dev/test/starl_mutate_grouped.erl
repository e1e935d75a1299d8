%% What a suite is for starl_mutate_suite: its case passes only between the beginnings of its suite and group.
-module(starl_mutate_grouped).

-export([all/0, groups/0, init_per_suite/1, init_per_group/2, both/1]).

all() -> [{group, inner}].

groups() -> [{inner, [], [both]}].

init_per_suite(Config) -> [suite | Config].

init_per_group(inner, Config) -> [group | Config].

both(Config) -> [group, suite | _] = Config.
