%% The contract of the shared registers once more: who has broken it, when, at the edge of each
%% bound; and what the hybrid logical clock promises.
-module(starl_registers_contract_tests).
-include_lib("eunit/include/eunit.hrl").

s(T, Robot) -> {T, 0, Robot}.

put(T, Robot, Name) -> {T, Robot, {put, Name, T, s(T, Robot)}}.

holds(T, Robot, Name, Stamp) -> {T, Robot, {holds, Name, Stamp}}.

got(T, Robot, Name, Hash, Stamp) -> {T, Robot, {got, Name, Hash, Stamp}}.

%% -- who, what, when, and how much --------------------------------------------------------------

%% Each violation as it is told, and the results.
told(Events, End, Config) ->
    Start = starl_registers_monitor:init(maps:merge(#{robots => [1, 2]}, Config)),
    {Found, Last} = lists:foldl(
        fun(Event, {Acc, State}) ->
            case starl_registers_monitor:step(trace(Event), State) of
                {ok, Next} -> {Acc, Next};
                {violation, V, Next} -> {Acc ++ [V], Next}
            end
        end,
        {[], Start},
        Events
    ),
    {Verdict, Results} = starl_registers_monitor:finish(End, Last),
    Late =
        case Verdict of
            ok -> [];
            {violation, Vs} -> Vs
        end,
    {[facts(V) || V <- Found ++ Late], Results}.

facts(#{contract := registers, what := What, at_us := T, robots := Robots, details := Details}) ->
    {What, T, Robots, Details}.

trace({T, Robot, {died, _} = Died}) -> {T, Robot, robot, Died};
trace({T, Robot, Event}) -> {T, Robot, registers, Event}.

%% A violation names the robot that has broken the contract, the register and the moment.
whose_test() ->
    Broken = fun(Events, Config) -> element(1, told(Events, 0, Config)) end,
    Stamped = #{name => x, stamp => s(5, 2)},
    ?assertEqual([{never_written, 6, [2], Stamped}], Broken([got(6, 2, x, 5, s(5, 2))], #{})),
    Writes = [put(5, 1, x), put(6, 1, x), got(7, 2, x, 6, s(6, 1))],
    Back = {read_goes_back, 8, [2], #{name => x}},
    ?assertEqual([Back], Broken(Writes ++ [got(8, 2, x, 5, s(5, 1))], #{})),
    ?assertEqual([Back], Broken(Writes ++ [{8, 2, {got, x, unset}}], #{})),
    ?assertEqual(
        [{stamp_goes_back, 7, [2], #{name => x, stamp => s(5, 2)}}],
        Broken([put(6, 2, y), {7, 2, {put, x, 7, s(5, 2)}}], #{})
    ),
    ?assertEqual(
        [{stamp_of_another, 7, [2], #{name => x}}], Broken([{7, 2, {put, x, 7, s(5, 1)}}], #{})
    ),
    ?assertEqual(
        [{not_owner, 5, [2], #{name => mine}}], Broken([put(5, 2, mine)], #{owners => #{mine => 1}})
    ),
    ?assertEqual(
        [{no_agreement, 15, [1, 2], #{name => x}}],
        element(1, told([put(5, 1, x), holds(5, 1, x, s(5, 1))], 90, #{bound_us => 10}))
    ).

%% Stamps grow from one to the next, whatever they are of; each robot's own only.
stamps_test() ->
    Judge = fun(Events) -> [W || {W, _, _, _} <- element(1, told(Events, 0, #{}))] end,
    ?assertEqual([stamp_goes_back], Judge([put(5, 1, x), {6, 1, {put, y, 5, s(5, 1)}}])),
    ?assertEqual([], Judge([{5, 1, {put, x, 0, {5, 0, 1}}}, {5, 1, {put, x, 1, {5, 1, 1}}}])),
    ?assertEqual([], Judge([put(5, 1, x), put(4, 2, x)])),
    %% unless what its machine had stored is damaged, that of this robot
    ?assertEqual([], Judge([put(5, 1, x), {6, 1, store_damaged}, {7, 1, {put, x, 4, s(4, 1)}}])),
    ?assertEqual(
        [stamp_goes_back],
        Judge([put(5, 1, x), {6, 2, store_damaged}, {7, 1, {put, x, 4, s(4, 1)}}])
    ),
    ?assertEqual(
        [stamp_goes_back],
        Judge([put(5, 1, x), {6, 1, store_damaged}, put(7, 1, x), {8, 1, {put, x, 6, s(6, 1)}}])
    ).

%% Reads of a register at one robot may repeat, and go back only after its machine crashed.
reads_test() ->
    Judge = fun(Events) -> [W || {W, _, _, _} <- element(1, told(Events, 0, #{}))] end,
    Writes = [put(5, 1, x), put(6, 1, y), put(7, 1, x), got(8, 2, x, 7, s(7, 1))],
    Older = got(9, 2, x, 5, s(5, 1)),
    ?assertEqual([], Judge(Writes ++ [got(9, 2, x, 7, s(7, 1)), got(9, 2, y, 6, s(6, 1))])),
    ?assertEqual([], Judge(Writes ++ [{9, 2, {got, y, unset}}, {9, 1, {got, x, unset}}])),
    ?assertEqual([read_goes_back], Judge(Writes ++ [got(9, 2, y, 6, s(6, 1)), Older])),
    ?assertEqual([], Judge(Writes ++ [{8, 2, crashed}, Older])),
    ?assertEqual([read_goes_back], Judge(Writes ++ [{8, 1, crashed}, Older])),
    %% the value that was written with the stamp
    ?assertEqual([never_written], Judge(Writes ++ [got(9, 2, x, 6, s(6, 1))])),
    ?assertEqual([never_written], Judge([put(5, 1, x), {5, 2, {got, x, 6, s(5, 1)}}])).

results_test() ->
    Writes = [put(5, 1, x), put(6, 1, y), put(7, 1, x)],
    Copies = [holds(8, R, N, S) || R <- [1, 2], {N, S} <- [{x, s(7, 1)}, {y, s(6, 1)}]],
    Reads = [got(9, R, x, 7, s(7, 1)) || R <- [1, 2]] ++ [{9, 1, {got, z, unset}}],
    {[], Results} = told(Writes ++ Copies ++ Reads, 90, #{bound_us => 10}),
    Counted = #{writes => 3, reads => 2, agreements => 2, sometimes => #{clocks_apart => 0}},
    ?assertEqual(Counted, Results),
    {[], Open} = told(Writes ++ Copies ++ Reads, 90, #{}),
    ?assertMatch(#{agreements := 0}, Open).

%% -- agreement ------------------------------------------------------------------------------------

%% All agree within the bound of the last write of the register: at the bound itself is in time.
bound_test() ->
    Judge = fun(Events, End) ->
        [{W, T} || {W, T, _, _} <- element(1, told(Events, End, #{bound_us => 10}))]
    end,
    One = [put(5, 1, x), holds(5, 1, x, s(5, 1))],
    ?assertEqual([], Judge(One, 15)),
    ?assertEqual([{no_agreement, 15}], Judge(One, 16)),
    ?assertEqual([], Judge(One ++ [holds(15, 2, x, s(5, 1))], 16)),
    ?assertEqual([{no_agreement, 15}], Judge(One ++ [holds(16, 2, x, s(5, 1))], 90)),
    %% at the bound of one register those that are due before it are judged, and it is not
    ?assertEqual(
        [],
        Judge(
            One ++ agree(x, s(5, 1)) ++
                [put(8, 1, y), holds(8, 1, y, s(8, 1)), holds(18, 2, y, s(8, 1))],
            90
        )
    ),
    %% once told
    ?assertEqual(
        [{no_agreement, 15}], Judge(One ++ [{20, 1, {got, z, unset}}, {30, 1, {got, z, unset}}], 90)
    ),
    %% a later write of this register puts it off, one of another does not
    ?assertEqual([{no_agreement, 22}], Judge(One ++ [put(12, 2, x)], 90)),
    ?assertEqual([{no_agreement, 15}], Judge(One ++ [put(12, 1, y) | agree(y, s(12, 1))], 90)),
    %% a copy of something else is no agreement
    ?assertEqual([{no_agreement, 15}], Judge([put(4, 2, x), holds(4, 2, x, s(4, 2)) | One], 90)),
    %% so does a crash or a death, of all that was written
    Two = One ++ agree(x, s(5, 1)) ++ [put(6, 1, y) | agree(y, s(6, 1))],
    ?assertEqual([], Judge(Two, 90)),
    ?assertEqual([{no_agreement, 22}, {no_agreement, 22}], Judge(Two ++ [{12, 2, crashed}], 90)),
    ?assertEqual([], Judge(Two ++ [{12, 2, crashed}], 22)),
    ?assertEqual(
        [],
        Judge(
            Two ++
                [{12, 2, crashed} | [holds(20, 2, N, S) || {N, S} <- [{x, s(5, 1)}, {y, s(6, 1)}]]],
            90
        )
    ),
    ?assertEqual([], Judge(One ++ [{12, 2, {died, killed}}], 90)),
    ?assertEqual(
        [{no_agreement, 22}],
        Judge([put(5, 1, x), holds(5, 1, x, s(5, 1)), {12, 3, {died, killed}}], 90)
    ).

agree(Name, Stamp) -> [holds(7, R, Name, Stamp) || R <- [1, 2]].

%% Faults put it off until they are over; never, while they are not. `within_us' asks for more.
healed_test() ->
    Judge = fun(End, Config) ->
        [
            {W, T}
         || {W, T, _, _} <- element(1, told([put(5, 1, x), holds(5, 1, x, s(5, 1))], End, Config))
        ]
    end,
    ?assertEqual([{no_agreement, 15}], Judge(90, #{bound_us => 10, healed_us => 4})),
    ?assertEqual([{no_agreement, 50}], Judge(90, #{bound_us => 10, healed_us => 40})),
    ?assertEqual([], Judge(90, #{bound_us => 10, healed_us => never})),
    ?assertEqual([], Judge(90, #{})),
    ?assertEqual([{no_agreement, 12}], Judge(90, #{bound_us => 10, within_us => 7})).

%% What is to be judged while no time passes: what was written and read, in which order, not when.
timeless_test() ->
    At = fun(Delay, Events) ->
        starl_registers_monitor:timeless(
            lists:foldl(
                fun({T, R, E}, S) ->
                    element(2, starl_registers_monitor:step(trace({T + Delay, R, E}), S))
                end,
                starl_registers_monitor:init(#{robots => [1, 2]}),
                Events
            )
        )
    end,
    Base = [put(5, 1, x), got(6, 2, x, 5, s(5, 1))],
    ?assertEqual(At(0, Base), At(9, Base)),
    [
        ?assertNotEqual(At(0, Base), At(0, Other))
     || Other <- [
            [hd(Base)],
            Base ++ [got(7, 1, x, 5, s(5, 1))],
            Base ++ [put(7, 1, y)],
            Base ++ [{7, 2, crashed}]
        ]
    ].

others_test() ->
    ?assertEqual([registers, robot], lists:sort(starl_registers_monitor:interests())),
    Start = starl_registers_monitor:init(#{robots => [1, 2], owners => #{mine => 1}}),
    [
        ?assertEqual({ok, Start}, starl_registers_monitor:step({1, 2, Machine, Event}, Start))
     || {Machine, Event} <- [
            {robot, {put, mine, 1, s(1, 2)}}, {mutex, {got, x, 1, s(1, 2)}}, {registers, listening}
        ]
    ].

%% -- the clock -----------------------------------------------------------------------------

%% What is earlier is no news; of the same time the higher counter counts; a new clock takes any.
observe_test() ->
    Next = fun(Seen, Clock) ->
        element(
            1,
            starl_hlc:stamp(
                0, lists:foldl(fun(S, C) -> starl_hlc:observe(S, 0, C) end, Clock, Seen)
            )
        )
    end,
    New = starl_hlc:new(1, 1000),
    ?assertEqual(beginning, starl_hlc:now(New)),
    ?assertEqual(
        {-5, 3, 1}, element(1, starl_hlc:stamp(-6, starl_hlc:observe({-5, 2, 2}, -6, New)))
    ),
    ?assertEqual({500, 8, 1}, Next([{500, 7, 2}], New)),
    [
        ?assertEqual({500, 8, 1}, Next(Seen, New))
     || Seen <- [
            [{500, 7, 2}, {500, 3, 3}],
            [{500, 3, 3}, {500, 7, 2}],
            [{500, 7, 2}, {499, 9, 3}],
            [{499, 9, 3}, {500, 7, 2}]
        ]
    ],
    ?assertEqual(500, starl_hlc:now(starl_hlc:observe({500, 7, 2}, 0, New))).

%% After a restart it is beyond all that it gave by no more than that needs: a robot whose clock is
%% right takes its stamps a moment later, as it starts where no stamp is admitted yet.
restart_no_later_test() ->
    {Stamp, _} = starl_hlc:stamp(100, starl_hlc:after_restart(1, 1000, 100, 2)),
    Other = starl_hlc:new(2, 1000),
    ?assertEqual([false, true], [starl_hlc:admits(Stamp, Now, Other) || Now <- [100, 101]]).

%% Two starts within one microsecond are apart by more stamps than there will be in it: 32 bits.
starts_test() ->
    [{{_, First, _}, _}, {{_, Second, _}, _}] =
        [starl_hlc:stamp(100, starl_hlc:after_restart(1, 1000, 100, Start)) || Start <- [2, 3]],
    ?assertEqual(1 bsl 32, Second - First).
