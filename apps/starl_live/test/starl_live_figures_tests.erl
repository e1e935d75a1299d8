-module(starl_live_figures_tests).
-include_lib("eunit/include/eunit.hrl").

counted_test() ->
    ?assertEqual(
        #{a => 2, b => 5},
        starl_live_figures:count(a, starl_live_figures:count(b, 5, #{a => 1}))
    ).

%% Code that is not loaded would else make a robot deaf without a word.
unknown_atoms_are_said_once_test() ->
    Refuse = fun(Why, Figures) -> starl_live_figures:refused(Why, 3, Figures) end,
    Self = self(),
    Lines = starl_live_log_ct:lines(fun() ->
        Self ! {figures, lists:foldl(Refuse, #{}, [term, unknown_atom, unknown_atom])}
    end),
    ?assertMatch([<<"a packet of robot 3 bears an atom that is unknown here", _/binary>>], Lines),
    receive
        {figures, Figures} -> ?assertEqual(#{term => 1, unknown_atom => 2}, Figures)
    end,
    %% at once, not with the second
    ?assertMatch([_], starl_live_log_ct:lines(fun() -> Refuse(unknown_atom, #{}) end)).
