%% SAP with a planted bug, chosen by the key `variant' of the configuration:
%% restarts: a restarted SAP counts from 1 again and takes itself for the first;
%% forgets: what was taken of a source is forgotten at its next packet;
%% claims: a message that nobody acknowledged is reported as acknowledged;
%% tireless: after the last retransmission it says nothing;
%% leaves_out: the answer to a broadcast leaves out the robots that refused it;
%% late: what an acknowledgement says is reported when the next retransmission is due.
-module(starl_sap_planted).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

%% Where starl_sap keeps what it knows of its peers.
-define(PEERS, 7).

init(#{variant := restarts} = Config) -> start(Config#{incarnation := 1});
init(Config) -> start(Config).

start(#{variant := late} = Config) ->
    {ready, Data, Actions} = starl_sap:init(Config),
    {ready, {{late, #{}}, Data}, Actions};
start(#{variant := leaves_out} = Config) ->
    {ready, Data, Actions} = starl_sap:init(Config),
    {ready, {{leaves_out, []}, Data}, Actions};
start(#{variant := Variant} = Config) ->
    {ready, Data, Actions} = starl_sap:init(Config),
    {ready, {Variant, Data}, Actions}.

handle_event(packet, Packet, ready, {forgets, Data}, Meta) ->
    forward(packet, Packet, {forgets, setelement(?PEERS, Data, starl_sap_peers:new())}, Meta);
handle_event(packet, {starl, 1, ack, _, _, _, Seq} = Ack, ready, {{late, Held}, Data}, Meta) ->
    case starl_sap:handle_event(packet, Ack, ready, Data, Meta) of
        {keep_state, Next, Actions} ->
            Later = maps:get(Seq, Held, []) ++ [A || A <- Actions, not is_cancel(A)],
            {keep_state, {{late, Held#{Seq => Later}}, Next}};
        {keep_state, Next} ->
            {keep_state, {{late, Held}, Next}}
    end;
handle_event({timeout, {retransmit, Seq}} = Type, Content, ready, {{late, Held}, Data}, Meta) ->
    Left = {late, maps:remove(Seq, Held)},
    Due = maps:get(Seq, Held, []),
    case forward(Type, Content, {Left, Data}, Meta) of
        {keep_state, Next, Actions} -> {keep_state, Next, Due ++ Actions};
        keep_state_and_data -> {keep_state, {Left, Data}, Due}
    end;
handle_event(Type, Content, ready, {{leaves_out, Refused}, Data}, Meta) ->
    case forward(Type, Content, {leaves_out, Data}, Meta) of
        {keep_state, {_, Next}, Actions} ->
            More = [{Id, By} || {trace, {outcome, Id, By, restarted}} <- Actions] ++ Refused,
            {keep_state, {{leaves_out, More}, Next}, left_out(More, Actions)};
        {keep_state, {_, Next}} ->
            {keep_state, {{leaves_out, Refused}, Next}};
        Other ->
            Other
    end;
handle_event(Type, Content, ready, Planted, Meta) ->
    forward(Type, Content, Planted, Meta).

%% What is told of and what is told are the same.
left_out(Refused, [{trace, {answered, Id, {error, {lost, Lost}}}}, {reply, From, _} | Actions]) ->
    Answer =
        case Lost -- [By || {I, By} <- Refused, I =:= Id] of
            [] -> ok;
            Left -> {error, {lost, Left}}
        end,
    [{trace, {answered, Id, Answer}}, {reply, From, Answer} | left_out(Refused, Actions)];
left_out(Refused, [Action | Actions]) ->
    [Action | left_out(Refused, Actions)];
left_out(_Refused, []) ->
    [].

forward(Type, Content, {Variant, Data}, Meta) ->
    case starl_sap:handle_event(Type, Content, ready, Data, Meta) of
        {keep_state, Next, Actions} -> {keep_state, {Variant, Next}, twisted(Variant, Actions)};
        {keep_state, Next} -> {keep_state, {Variant, Next}};
        {keep_state_and_data, Actions} -> {keep_state_and_data, twisted(Variant, Actions)};
        Other -> Other
    end.

twisted(claims, Actions) -> [claimed(Action) || Action <- Actions];
twisted(tireless, Actions) -> [A || A <- Actions, not is_lost(A)];
twisted(_Variant, Actions) -> Actions.

claimed({trace, {outcome, Id, Dest, lost}}) -> {trace, {outcome, Id, Dest, acknowledged}};
claimed(Action) -> Action.

is_lost({trace, {outcome, _, _, lost}}) -> true;
is_lost(_) -> false.

is_cancel({{timeout, _}, cancel}) -> true;
is_cancel(_) -> false.
