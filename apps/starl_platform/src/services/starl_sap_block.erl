%% @doc Declares reliable messages as a block. Every robot has the service SAP, and its contract
%% judges every run. So no application lists this block. It is exercised and checked like the
%% others.
-module(starl_sap_block).
-behaviour(starl_block).
-behaviour(starl_block_exercise).

-export([
    options/0, machines/1, monitors/2, everywhere/0, guarantees/0, contract/0, exercise/0, models/0
]).
-export([prepare/2, work/3, final/3, watches/0, seen/1, noted/2, promise/3]).

-type pair() :: {starl:robot_id(), starl:robot_id()}.

%% The longest time that an acknowledgement is under way: it may be older than a restart.
-define(UNDER_WAY_US, 5000000).

-record(seen, {
    %% the last restart of each robot's SAP; the last time at which a robot knew the incarnation of
    %% another; the restarts that its present call has found
    restarted = #{} :: #{starl:robot_id() => integer()},
    contact = #{} :: #{pair() => integer()},
    found = #{} :: #{starl:robot_id() => #{pair() => integer()}},
    %% the end of the last time that a robot was down; `still': it is
    away = #{} :: #{starl:robot_id() => integer() | still}
}).

-spec options() -> [starl_options:option()].
options() -> [].

-spec machines(starl_block:options()) -> [].
machines(_Options) -> [].

-spec monitors(starl_block:options(), starl_block:context()) -> [].
monitors(_Options, _Context) -> [].

-spec everywhere() -> [module()].
everywhere() -> [starl_sap_monitor].

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {once, safety,
            "delivered at most once per receiver, never changed, never to the wrong type of listener",
            []},
        {told, safety,
            "a lost report after the last retransmission (a message reported lost may have been "
            "delivered all the same)", []},
        {read, safety, "an application can read every acknowledged message", [no_restart]},
        {others, safety, "a dead robot delays no other; memory is bounded", []},
        {outcome, progress, "delivered, or reported lost, in bounded time", [clock_rate, prompt]},
        {delivered, progress, "delivered, where packets get through", [delivery]}
    ].

-spec contract() -> string().
contract() ->
    "a message is delivered at most once, as it was sent, or reported lost; judged in every run".

-spec exercise() -> module().
exercise() -> ?MODULE.

-spec models() -> [starl_block:model_entry()].
models() -> [{sap, "reliable messages, packet by packet", fun model/1}].

%% The first robot sends to the second, the second to all; one retransmission.
model(#{robots := Ids}) ->
    #{
        sap => real,
        blocks => [{sap, starl_sap, #{limit => 1}}],
        script => fun(Place) -> script(Place, Ids) end,
        monitor => {starl_sap_monitor, #{bound_us => 1}},
        fixed => lists:seq(1, length(Ids))
    }.

script(1, [_, To | _]) ->
    [{listen, note}, {'try', sap, {send, To, note, a}}, {'try', sap, {send, To, note, b}}];
script(2, _Ids) ->
    [{listen, note}, {'try', sap, {broadcast, note, c}}];
script(_, _Ids) ->
    [{listen, note}].

%% -- the exercise --------------------------------------------------------------------------

%% The exercise of SAP: messages to one robot, now and then to all.
%%
%% The promise: a message is acknowledged unless a receiver has died, or was down during the call. The
%% first call after a restart of either SAP may return `restarted' instead.

-spec prepare(starl:robot(), starl_block_exercise:use()) -> ok.
prepare(Robot, _Use) -> starl:listen(Robot, word).

-spec work(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
work(Robot, Turn, _Use) ->
    _ = send(Robot, other(Robot), Turn),
    _ = [broadcast(Robot, {all, Turn}) || Turn rem 4 =:= 0],
    starl:await(Robot, word, 50).

-spec final(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
final(Robot, N, _Use) ->
    _ = [send(Robot, To, {final, N}) || To <- starl:participants(Robot)],
    broadcast(Robot, {final, N}).

send(Robot, To, Body) ->
    Send = fun() -> starl:send(Robot, To, word, Body) end,
    starl_block_exercise:call(Robot, {send, To}, Send).

broadcast(Robot, Body) ->
    starl_block_exercise:call(Robot, broadcast, fun() -> starl:broadcast(Robot, word, Body) end).

other(Robot) ->
    case lists:delete(starl:id(Robot), starl:participants(Robot)) of
        [] -> starl:id(Robot);
        [_ | _] = Others -> lists:nth(starl_block_exercise:pick(Robot, length(Others)), Others)
    end.

-spec watches() -> [starl_machine:name()].
watches() -> [sap].

-spec seen([starl:robot_id()]) -> #seen{}.
seen(_Robots) -> #seen{}.

-spec noted(starl_monitor:trace_event(), #seen{}) -> #seen{}.
noted({_T, Robot, robot, down}, #seen{away = Away} = Seen) ->
    Seen#seen{away = Away#{Robot => still}};
noted({T, Robot, sap, {started, N}}, #seen{restarted = Restarted} = Seen) when N > 1 ->
    back(T, Robot, Seen#seen{restarted = Restarted#{Robot => T}});
noted({T, Robot, sap, {outcome, _Id, To, acknowledged}}, #seen{contact = Contact} = Seen) ->
    Seen#seen{contact = Contact#{{Robot, To} => T}};
noted({T, Robot, sap, {outcome, _Id, To, restarted}}, #seen{found = Found} = Seen) ->
    New = maps:get(Robot, Found, #{}),
    Seen#seen{found = Found#{Robot => New#{{Robot, To} => T}}};
noted({_, Robot, app, {answered, _, _}}, #seen{contact = Contact, found = Found} = Seen) ->
    Seen#seen{
        contact = maps:merge(Contact, maps:get(Robot, Found, #{})),
        found = maps:remove(Robot, Found)
    };
noted(_Event, Seen) ->
    Seen.

back(T, Robot, #seen{away = Away} = Seen) ->
    case Away of
        #{Robot := still} -> Seen#seen{away = Away#{Robot := T}};
        #{} -> Seen
    end.

-spec promise(starl_promise:call(), starl_promise:team(), #seen{}) -> starl_promise:t().
promise(#{what := {send, To}, robot := Robot} = Call, Team, Seen) ->
    Is = fun(Outcome) ->
        Outcome =:= ok orelse (Outcome =:= {error, restarted} andalso is_news(Robot, To, Seen)) orelse
            (Outcome =:= {error, lost} andalso was_away(To, Call, Seen))
    end,
    case starl_promise:has_died([To], Team) of
        true -> none;
        false -> starl_promise:soon(Call, Is, Team)
    end;
promise(#{what := broadcast} = Call, #{died := []} = Team, Seen) ->
    starl_promise:soon(Call, fun(Outcome) -> is_sent(Outcome, Call, Seen) end, Team);
promise(_Call, _Team, _Seen) ->
    none.

is_sent({error, {lost, Lost}}, #{robot := Robot} = Call, Seen) ->
    Is = fun(To) -> is_news(Robot, To, Seen) orelse was_away(To, Call, Seen) end,
    lists:all(Is, Lost);
is_sent(Outcome, _Call, _Seen) ->
    Outcome =:= ok.

%% Was it down during this call, which ends now?
was_away(Robot, #{since_us := Since}, #seen{away = Away}) ->
    case Away of
        %% an atom is larger than any number
        #{Robot := Until} -> Until >= Since;
        #{} -> false
    end.

%% Has one of the two restarted since their last contact?
is_news(Robot, To, #seen{restarted = Restarted, contact = Contact}) ->
    Latest = lists:max([maps:get(R, Restarted, -1) || R <- [Robot, To]]),
    Latest >= 0 andalso Latest > maps:get({Robot, To}, Contact, 0) - ?UNDER_WAY_US.
