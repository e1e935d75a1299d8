%% The pages that teach: everything that they say to write and to run, in empty directories. That of an
%% application has a project that builds StarL: it is followed in `starl_library_SUITE', which has built it.
-module(starl_tutorial_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0]).
-export([half_a_page_of_erlang/1, a_block_of_your_own/1, coming_from_elsewhere/1, links/1]).

suite() -> [{timetrap, {minutes, 10}}].

all() -> [half_a_page_of_erlang, a_block_of_your_own, coming_from_elsewhere, links].

half_a_page_of_erlang(Config) ->
    ?assertEqual(1, starl_tutorial_page:follow("doc/erlang.md", dir(erlang, Config), #{})).

a_block_of_your_own(Config) ->
    ?assertEqual(8, starl_tutorial_page:follow("doc/tutorial/block.md", dir(block, Config), #{})).

coming_from_elsewhere(Config) ->
    Options = #{env => [{"STARL", starl_first_hour_ct:root()}]},
    ?assertEqual(
        9, starl_tutorial_page:follow("doc/coming_from.md", dir(elsewhere, Config), Options)
    ).

links(_Config) ->
    [
        starl_tutorial_page:links_lead_somewhere(Page)
     || Page <- [
            "doc/erlang.md",
            "doc/tutorial/block.md",
            "doc/tutorial/application.md",
            "doc/coming_from.md"
        ]
    ].

dir(Name, Config) ->
    filename:join(proplists:get_value(priv_dir, Config), atom_to_list(Name)).
