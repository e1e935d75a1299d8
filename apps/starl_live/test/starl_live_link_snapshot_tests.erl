%% The link of a live robot tells snapshots at their times, and after each all that comes.
-module(starl_live_link_snapshot_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_live_link_ct, [
    with_link/2, with_link/3,
    tree/1,
    set/3,
    took/2,
    app_hangs/1,
    heard/0
]).

%% They are due at whole multiples of their period of the run's clock. A robot whose application computes tells
%% none; once it has told one, each event that comes is told.
snapshots_are_told_at_their_times_test() ->
    %% a process is no data, its name is
    true = register(?MODULE, self()),
    Given = #{sink => self(), snapshots_us => 300_000, tree => tree(?MODULE)},
    with_link(1, Given, fun(Link, Times) ->
        Due = fun() ->
            receive
                {snapshot_at, Ms} -> Ms
            end
        end,
        Told = fun() ->
            Link ! {timeout, make_ref(), snapshot},
            told_snapshot()
        end,
        ?assertEqual(300, Due()),
        ok = set(650_000, 10_000, Times),
        ?assertMatch({ok, _}, Told()),
        %% 250 ms later, by the computer's monotonic time
        ?assertEqual(260, Due()),
        650_000 = took(here, Link),
        ?assertEqual([{event, sap, packet, here}, now], inputs(Link)),
        App = app_hangs(Link),
        ?assertEqual({error, at_work}, Told()),
        App ! go_on,
        650_000 = took(again, Link),
        ?assertNot(lists:member({event, sap, packet, again}, inputs(Link))),
        ok
    end),
    true = unregister(?MODULE).

told_snapshot() ->
    receive
        {starl_traced, 1, _, {_, _, Facts}} ->
            case [Told || {_, 1, snapshot, {How, _} = Told} <- Facts, How =/= input] of
                [Told] -> Told;
                [] -> told_snapshot()
            end
    end.

%% The inputs that it has told so far.
inputs(Link) ->
    _ = starl_live_link:metrics(Link),
    [
        Input
     || {starl_traced, 1, _, {_, _, Facts}} <- heard(),
        {_, 1, snapshot, {input, {_, Input}}} <- Facts
    ].

%% A robot whose snapshots nobody wants tells none.
no_snapshots_test() ->
    with_link(1, fun(Link, _Times) ->
        0 = took(here, Link),
        ?assertEqual([], [Ms || {snapshot_at, Ms} <- heard()]),
        ok
    end).
