%% @doc Finds the events that a robot's recording lost when its node was killed. They are the events
%% in the record of the robot's facts that come after the last events of the recording. A pure
%% module.
-module(starl_trace_lost_facts).

-export([lost/2]).

-export_type([traced/0]).

%% A trace event of the recording.
-type traced() :: {starl_machine:name(), Event :: term()}.

%% So many events in a row are the same only where they are the same events.
-define(ENOUGH, 100).

%% @doc The facts that are not recorded. `Recorded': the last events of the recording, in their
%% order. Times are not compared, because the recording may have moved them a little.
-spec lost(Recorded :: [traced()], [starl_monitor:trace_event()]) ->
    [starl_monitor:trace_event()].
lost(Recorded, Facts) ->
    %% what comes after the last end of the robot is of the same start as the facts
    Own = own(lists:reverse(Recorded), []),
    after_last(lists:nthtail(max(0, length(Own) - ?ENOUGH), Own), Facts).

own([], Own) -> Own;
own([{robot, down} | _], Own) -> lists:dropwhile(fun({_, Event}) -> Event =:= crashed end, Own);
own([Event | Recorded], Own) -> own(Recorded, [Event | Own]).

after_last([], Facts) -> Facts;
after_last(Recorded, Facts) -> before(lists:reverse(Recorded), lists:reverse(Facts), []).

%% Both with the latest first.
before(_Recorded, [], Later) ->
    Later;
before(Recorded, [Fact | Earlier] = Facts, Later) ->
    case ends_with(Recorded, Facts) of
        true -> Later;
        false -> before(Recorded, Earlier, [Fact | Later])
    end.

ends_with([], _Facts) -> true;
ends_with(_Recorded, []) -> true;
ends_with([{M, E} | Recorded], [{_, _, M, E} | Facts]) -> ends_with(Recorded, Facts);
ends_with(_, _) -> false.
