%% The names of nodes that a user gives.
-module(starl_sim_net_name_tests).
-include_lib("eunit/include/eunit.hrl").

%% A name or host that ends in a newline is none: it would go on into what is written of it.
newline_test() ->
    ?assertEqual({ok, 'a@b'}, starl_sim_net:full_name("a@b")),
    [
        ?assertEqual({error, {bad_name, Text}}, starl_sim_net:full_name(Text))
     || Text <- ["a@b\n", "a\n@b", "a\n"]
    ].
