%% The pages that teach: everything that they say to write and to run, in empty directories.
-module(starl_tutorial_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0]).
-export([a_block_of_your_own/1, an_application_of_your_own/1, coming_from_elsewhere/1, links/1]).

suite() -> [{timetrap, {minutes, 10}}].

all() -> [a_block_of_your_own, an_application_of_your_own, coming_from_elsewhere, links].

a_block_of_your_own(Config) ->
    ?assertEqual(8, starl_tutorial_page:follow("doc/tutorial/block.md", dir(block, Config), #{})).

%% The project depends on the sources that are tested here.
an_application_of_your_own(Config) ->
    Sources = starl_first_hour_ct:repository(dir(sources, Config)),
    Url = [
        "sed -i 's|git, \".*|git, \"file://",
        Sources,
        "\", {branch, \"main\"}}}]}.|' charge/rebar.config"
    ],
    Options = #{env => [{"ERL_LIBS", false}], also => #{"starl new" => lists:append(Url)}},
    ?assertEqual(
        10,
        starl_tutorial_page:follow("doc/tutorial/application.md", dir(application, Config), Options)
    ).

coming_from_elsewhere(Config) ->
    Options = #{env => [{"STARL", starl_first_hour_ct:root()}]},
    ?assertEqual(
        9, starl_tutorial_page:follow("doc/coming_from.md", dir(elsewhere, Config), Options)
    ).

links(_Config) ->
    [
        starl_tutorial_page:links_lead_somewhere(Page)
     || Page <- ["doc/tutorial/block.md", "doc/tutorial/application.md", "doc/coming_from.md"]
    ].

dir(Name, Config) ->
    filename:join(proplists:get_value(priv_dir, Config), atom_to_list(Name)).
