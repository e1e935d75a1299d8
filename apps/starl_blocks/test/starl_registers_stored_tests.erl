%% What a machine of the registers stores before it gives a stamp, how it begins with that after a
%% reboot, and what it does when it is full.
-module(starl_registers_stored_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1000000).

new(Now, More) -> new(2, Now, More).

new(Robot, Now, More) ->
    Base = #{
        robot => Robot,
        participants => [1, 2],
        name => registers,
        incarnation => 1,
        now => Now,
        random => rand:seed_s(exsss, 1),
        stored => none
    },
    {_, Machine} = starl_machine:new(
        starl_registers_lww,
        maps:merge(#{limit => 2}, maps:with([owners], More)),
        maps:merge(Base, maps:without([owners], More))
    ),
    Machine.

at(Now, Type, Content, Machine) ->
    starl_machine:step(Type, Content, #{now => Now, robot => 2}, Machine).

put(Now, Name, Machine) -> at(Now, {call, {app, Now}}, {put, Name, value}, Machine).

stamp(Actions) -> hd([Stamp || {trace, {put, _, _, Stamp}} <- Actions]).

stored(Actions) -> [Term || {store, Term} <- Actions].

got(Name, Now, Machine) ->
    {Actions, _} = at(Now, {call, {app, 0}}, {get, Name}, Machine),
    hd([Answer || {reply, _, Answer} <- Actions]).

%% A time beyond the stamp is stored before anybody hears of the stamp, but rarely.
stored_first_test() ->
    {Actions, Machine} = put(5 * ?S, a, new(0, #{})),
    ?assertMatch([{store, _}, {trace, {put, _, _, _}} | _], Actions),
    [Reserved] = stored(Actions),
    ?assert({Reserved, 0, 0} > stamp(Actions)),
    {Soon, Next} = put(Reserved - 1, a, Machine),
    ?assertEqual([], stored(Soon)),
    {Later, _} = put(Reserved, a, Next),
    ?assertMatch([_], stored(Later)).

%% Whatever the clock shows after a reboot, and after another one, stamps go on growing: those of a
%% clock that was set back by an hour, too.
reboot_test() ->
    {First, Machine} = put(3600 * ?S, a, new(0, #{})),
    {Second, _} = put(3600 * ?S, a, Machine),
    {Third, Again} = reboot(2, 10, First ++ Second, #{}),
    {Fourth, _} = put(11, a, Again),
    {Fifth, _} = reboot(3, 0, Third ++ Fourth, #{}),
    {Sixth, _} = reboot(4, 7200 * ?S, Fifth, #{}),
    Stamps = [stamp(Actions) || Actions <- [First, Second, Third, Fourth, Fifth, Sixth]],
    ?assertEqual(lists:usort(Stamps), Stamps).

%% With a damaged store, as long as the clock does not run backwards.
damaged_test() ->
    {First, _} = put(20 * ?S, a, new(0, #{})),
    {Second, _} = reboot(2, 21 * ?S, First, #{stored => damaged}),
    {Third, _} = reboot(3, 21 * ?S, Second, #{stored => damaged}),
    ?assert(stamp(First) < stamp(Second)),
    ?assert(stamp(Second) < stamp(Third)).

%% A store that is older than the robot's last life gives back the time at which that life began to
%% give stamps. If the clock has been set back, too, both lives begin there, and their stamps differ.
%% Holds: An old store gives nothing away again: rounds …: stamps of registers
%% Red: e467d0b, run
an_old_store_repeats_no_stamp_test() ->
    Ahead = {stored, 100 * ?S},
    [Second, Third] = [
        stamp(element(1, write_of(Life, Ahead)))
     || Life <- [{1, 1 bsl 57}, {1, 1 bsl 57 + 9}]
    ],
    ?assert(Second < Third).

write_of({_, Start} = Life, Stored) ->
    Config = #{incarnation => Start, life => Life, stored => Stored},
    {_, Ready} = at(0, {timeout, recover}, recover, new(0, Config)),
    put(0, a, Ready).

%% A robot whose store was set back goes on from an earlier stamp of its own that another one holds.
%% It gives none that its last life gave after that one.
%% Holds: An old store gives nothing away again: rounds …: also if it sees an earlier one of its
%% own elsewhere
%% Red: d863b95, run: `never written`
own_earlier_stamp_seen_elsewhere_test() ->
    {First, Machine} = put(5 * ?S, a, new(0, #{})),
    {Second, _} = put(5 * ?S, a, Machine),
    Life = {1, 1 bsl 57},
    Later = new(5 * ?S, #{incarnation => 1 bsl 57, life => Life, stored => {stored, 1}}),
    {_, Ready} = at(5 * ?S, cast, told([{a, value, stamp(First)}]), Later),
    {Third, _} = put(5 * ?S, a, Ready),
    ?assert(stamp(Third) > stamp(First)),
    ?assertNotEqual(stamp(Second), stamp(Third)).

told(Entries) -> {message, 1, registers, {entries, Entries}}.

%% The first write after a reboot with what was stored last.
reboot(Incarnation, Now, Before, More) ->
    Kept = maps:merge(#{incarnation => Incarnation, stored => kept(Before)}, More),
    {_, Ready} = at(Now, {timeout, recover}, recover, new(Now, Kept)),
    put(Now, a, Ready).

kept(Before) -> {stored, lists:last(stored(Before))}.

%% A full machine adds nothing, and takes what another one has added: of robots that are full of
%% different registers all would keep their own for ever.
full_test() ->
    {_, One} = put(1, a, new(0, #{})),
    {_, Two} = put(2, b, One),
    {Refused, Full} = put(3, c, Two),
    ?assertMatch([{reply, _, {error, full}}], Refused),
    {_, Again} = put(4, a, Full),
    ?assertEqual({ok, value}, got(a, 5, Again)),
    {_, Taken} = at(6, cast, {message, 1, registers, {write, d, theirs, {6, 0, 1}}}, Again),
    ?assertEqual({ok, theirs}, got(d, 7, Taken)),
    {More, _} = put(8, d, Taken),
    ?assertMatch([{reply, _, ok}], [R || {reply, _, _} = R <- More]).

%% Only the owner writes, whoever else says that it has.
owner_test() ->
    Base = #{owners => #{mine => 1}},
    {Refused, Machine} = put(1, mine, new(0, Base)),
    ?assertMatch([{reply, _, {error, not_owner}}], Refused),
    {_, Same} = at(2, cast, {message, 1, registers, {write, mine, false, {2, 0, 2}}}, Machine),
    ?assertEqual({error, unset}, got(mine, 3, Same)),
    {_, Taken} = at(4, cast, {message, 1, registers, {write, mine, true, {2, 0, 1}}}, Same),
    ?assertEqual({ok, true}, got(mine, 5, Taken)).
