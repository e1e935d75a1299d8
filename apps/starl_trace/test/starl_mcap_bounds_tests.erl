%% A small file does not become a large one in memory.
%%
%% Holds: A small recording does not become a large one in memory; a storage leads nowhere and
%% sends no more than it says
%% Red: 961f67c9: 29 million records, a run named `..`
-module(starl_mcap_bounds_tests).
-include_lib("eunit/include/eunit.hrl").

%% Empty records take nine bytes each, and next to nothing where they are packed.
more_records_than_are_read_at_once_test_() ->
    {timeout, 60, fun() ->
        Empty = <<200, 0:64>>,
        ?assertEqual({error, {too_many, 1000000}}, records(binary:copy(Empty, 1000001))),
        {ok, Records} = records(binary:copy(Empty, 1000)),
        ?assertEqual(1000, length(Records))
    end}.

records(Bytes) -> starl_mcap_chunk:records({chunk, 0, 0, byte_size(Bytes), 0, <<>>, Bytes}).
