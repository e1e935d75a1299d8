%% The pages that teach: everything that they say to write and to run, in empty directories.
-module(starl_tutorial_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0]).
-export([a_block_of_your_own/1, its_links/1]).

suite() -> [{timetrap, {minutes, 10}}].

all() -> [a_block_of_your_own, its_links].

a_block_of_your_own(Config) ->
    ?assertEqual(8, starl_tutorial_page:follow("doc/tutorial/block.md", dir(block, Config), #{})).

its_links(_Config) ->
    [
        starl_tutorial_page:links_lead_somewhere(Page)
     || Page <- ["doc/tutorial/block.md"]
    ].

dir(Name, Config) ->
    filename:join(proplists:get_value(priv_dir, Config), atom_to_list(Name)).
