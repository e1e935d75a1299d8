%% @doc A robot's digest chain: each event is hashed onto those before it, so two runs with the
%% same final number have had the same events. The ledger keeps checkpoints and recorded events
%% ({@link starl_sim_ledger}); it sees only the few events that it has asked for.
-module(starl_sim_chain).

-export([new/1, counted/2, add/5, value/1, events/1, ledger/1]).

-export_type([t/0]).

-record(chain, {
    value = 0 :: non_neg_integer(),
    events = 0 :: non_neg_integer(),
    %% the number of the next event that the ledger is to note
    mark :: pos_integer(),
    ledger :: starl_sim_ledger:t()
}).

-opaque t() :: #chain{}.

-define(VALUES, 4294967296).

%% @doc The chain before the first event; its ledger records the events of this range.
-spec new(starl_sim_ledger:range() | none) -> t().
new(Range) ->
    {Mark, Ledger} = starl_sim_ledger:new(Range),
    #chain{mark = Mark, ledger = Ledger}.

%% @doc What counts of a local event. Of an answer of the positioning system or a sense only what is seen
%% or felt counts: the tag and the ages are the driver's own. The names of versions depend on the
%% compiler's release.
-spec counted(starl_machine:event_type(), term()) -> term().
counted(info, {located, _Tag, Seen}) -> {located, [{Robot, Pose} || {Robot, Pose, _Age} <- Seen]};
counted(info, {felt, _Tag, Felt}) -> {felt, Felt};
counted(code, {take, #{number := N}}) -> {take, N};
counted(_Type, Content) -> Content.

%% @doc The chain with one more event, of this time (us).
-spec add(
    starl_sim_queue:time(), starl_machine:name(), starl_machine:event_type() | boot, term(), t()
) -> t().
add(Now, Machine, Type, Content, #chain{value = Before, events = Events, mark = Mark} = Chain) ->
    Value = erlang:phash2({Before, Now, Machine, Type, Content}, ?VALUES),
    case Events + 1 of
        %% few events are noted, so all others cost one comparison
        N when N < Mark ->
            Chain#chain{value = Value, events = N};
        N ->
            Event = #{n => N, at_us => Now, machine => Machine, type => Type, content => Content},
            note(Now, Event#{chain => Value}, Chain#chain{value = Value, events = N})
    end.

note(Now, Event, #chain{ledger = Ledger} = Chain) ->
    {Mark, Noted} = starl_sim_ledger:note(Now, Event, Ledger),
    Chain#chain{mark = Mark, ledger = Noted}.

%% @doc The hash of all events so far.
-spec value(t()) -> non_neg_integer().
value(#chain{value = Value}) -> Value.

%% @doc The number of events so far.
-spec events(t()) -> non_neg_integer().
events(#chain{events = Events}) -> Events.

%% @doc The ledger's checkpoints and recorded events.
-spec ledger(t()) -> starl_sim_ledger:t().
ledger(#chain{ledger = Ledger}) -> Ledger.
