%% What a simulated disk keeps when its power goes.
-module(starl_virtual_disk_tests).
-include_lib("eunit/include/eunit.hrl").

-define(DISK, "disk").
-define(SEEDS, lists:seq(1, 200)).

what_was_synced_is_kept_test() ->
    Keep = fun() ->
        ok = written("disk/a", <<"new">>, sync),
        ok = synced("disk")
    end,
    ?assertEqual([{ok, <<"new">>}], outcomes(Keep)).

a_file_that_was_not_synced_is_whole_torn_empty_or_gone_test() ->
    Keep = fun() -> ok = written("disk/a", <<"new">>, no_sync) end,
    ?assertEqual(
        [{error, enoent}, {ok, <<>>}, {ok, <<"n">>}, {ok, <<"ne">>}, {ok, <<"new">>}],
        outcomes(Keep)
    ).

a_name_that_was_not_synced_may_be_undone_test() ->
    Keep = fun() ->
        ok = written("disk/a", <<"old">>, sync),
        ok = synced("disk"),
        ok = written("disk/b", <<"new">>, sync),
        ok = starl_virtual_disk:rename("disk/b", "disk/a")
    end,
    ?assertEqual([{ok, <<"new">>}, {ok, <<"old">>}], outcomes(Keep)).

the_power_goes_in_mid_operation_test() ->
    ok = starl_virtual_disk:new(?DISK, 1),
    ok = starl_virtual_disk:cut_after(?DISK, 2, any),
    ?assertThrow({starl_power_cut, ?DISK}, written("disk/a", <<"new">>, sync)),
    ?assertEqual(2, starl_virtual_disk:operations(?DISK)).

the_power_does_not_go_between_a_new_name_and_its_sync_test() ->
    ok = starl_virtual_disk:new(?DISK, 1),
    ok = written("disk/b", <<"new">>, sync),
    ok = starl_virtual_disk:cut_after(?DISK, 1, between),
    ok = starl_virtual_disk:rename("disk/b", "disk/a"),
    ok = synced("disk"),
    ?assertThrow({starl_power_cut, ?DISK}, starl_virtual_disk:read_file("disk/a")).

a_full_disk_takes_nothing_test() ->
    ok = starl_virtual_disk:new(?DISK, 1),
    ok = starl_virtual_disk:suffer(?DISK, full),
    ?assertEqual({error, enospc}, written("disk/a", <<"new">>, sync)).

an_erased_disk_has_no_files_test() ->
    ok = starl_virtual_disk:new(?DISK, 1),
    ok = written("disk/a", <<"new">>, sync),
    ok = starl_virtual_disk:erase(?DISK),
    ?assertEqual({error, enoent}, starl_virtual_disk:read_file("disk/a")),
    ok = written("disk/a", <<"newer">>, sync),
    ?assertEqual({ok, <<"newer">>}, starl_virtual_disk:read_file("disk/a")).

a_disk_that_is_set_back_has_the_files_of_its_image_test() ->
    ok = starl_virtual_disk:new(?DISK, 1),
    ?assertEqual(none, starl_virtual_disk:set_back(image, ?DISK)),
    ok = written("disk/a", <<"old">>, sync),
    ok = synced("disk"),
    ok = starl_virtual_disk:save(image, ?DISK),
    ok = written("disk/a", <<"new">>, sync),
    ok = written("disk/b", <<"new">>, sync),
    ok = starl_virtual_disk:set_back(image, ?DISK),
    ok = starl_virtual_disk:cut_power(?DISK),
    ?assertEqual({ok, <<"old">>}, starl_virtual_disk:read_file("disk/a")),
    ?assertEqual({error, enoent}, starl_virtual_disk:read_file("disk/b")).

%% What is found in the file, over all seeds.
outcomes(Keep) -> lists:usort([outcome(Seed, Keep) || Seed <- ?SEEDS]).

outcome(Seed, Keep) ->
    ok = starl_virtual_disk:new(?DISK, Seed),
    Keep(),
    ok = starl_virtual_disk:cut_power(?DISK),
    starl_virtual_disk:read_file("disk/a").

written(File, Bytes, Sync) ->
    {ok, Device} = starl_virtual_disk:open(File, [write, raw, binary]),
    case starl_virtual_disk:write(Device, Bytes) of
        ok when Sync =:= sync -> starl_virtual_disk:sync(Device);
        Written -> Written
    end.

synced(Dir) ->
    {ok, Device} = starl_virtual_disk:open(Dir, [raw, read, directory]),
    starl_virtual_disk:sync(Device).
