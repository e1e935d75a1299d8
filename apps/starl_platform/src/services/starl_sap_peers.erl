%% @doc Keeps what a robot knows of the sources of messages: the incarnation of each, and which of
%% its numbers have been taken. Pure. The guarantee "at most once" of {@link starl_sap} rests on
%% this part.
%%
%% Numbers are taken from a floor on, within a window. Each number below the floor has been taken,
%% or the source has stopped waiting for it. The floor rises when numbers are taken in sequence. A
%% lost message leaves a gap; the floor rises over it when the source allows that. So a packet, with
%% any numbers, uses up one number at most and cannot make the floor jump.
%%
%% An incarnation a little later than the known one is believed at once. If it is far later, or
%% earlier, it or the known one may be false. Then the robot itself is asked, and its answer
%% replaces the earlier belief. The answer carries the nonce of the question, so it is newer than
%% that belief.
%%
%% Only a life that a robot has answered itself is certain. A robot that answers with a lower number
%% than that has forgotten a life. It is not believed before it knows of that life.
-module(starl_sap_peers).

-export([new/0, incarnation/2, is_known/2, lives/2, later/2, heard/3, take/4, ask/3, told/5]).

-export_type([t/0]).

%% The number of a robot's starts that may have gone unheard.
-define(LEAP, 16).

%% The numbers taken from a floor on; all numbers below it count as taken.
-record(taken, {
    floor = 1 :: starl_packet:seq(),
    above = starl_sap_numbers:new() :: starl_sap_numbers:t()
}).

-record(peer, {
    incarnation = 1 :: starl_packet:incarnation(),
    ones = #taken{} :: #taken{},
    casts = #taken{} :: #taken{},
    %% the lives that the robot itself has told
    lives = {0, 0} :: starl_packet:lives(),
    %% the nonce of the open question to this robot
    nonce = none :: pos_integer() | none
}).

-opaque t() :: #{starl:robot_id() => #peer{}}.

%% @doc No robot has been heard yet.
-spec new() -> t().
new() -> #{}.

%% @doc The latest known incarnation of a robot; 1 if none has been heard.
-spec incarnation(starl:robot_id(), t()) -> starl_packet:incarnation().
incarnation(Robot, Peers) ->
    case Peers of
        #{Robot := #peer{incarnation = Incarnation}} -> Incarnation;
        #{} -> 1
    end.

%% @doc Has the robot been heard before?
-spec is_known(starl:robot_id(), t()) -> boolean().
is_known(Robot, Peers) -> is_map_key(Robot, Peers).

%% @doc The last two lives of a robot that it has reported itself; 0: none.
-spec lives(starl:robot_id(), t()) -> starl_packet:lives().
lives(Robot, Peers) ->
    case Peers of
        #{Robot := #peer{lives = Lives}} -> Lives;
        #{} -> {0, 0}
    end.

%% @doc The incarnations of those robots that have restarted.
-spec later([starl:robot_id()], t()) -> #{starl:robot_id() => starl_packet:incarnation()}.
later([Robot], Peers) ->
    case Peers of
        #{Robot := #peer{incarnation = Incarnation}} when Incarnation > 1 ->
            #{Robot => Incarnation};
        #{} ->
            #{}
    end;
later(Robots, Peers) ->
    maps:from_list([
        {Robot, Incarnation}
     || Robot <- Robots, Incarnation <- [incarnation(Robot, Peers)], Incarnation > 1
    ]).

%% @doc Learns a robot's incarnation from a packet: `present': it is the one that is known now;
%% `earlier': an earlier one; `far': far beyond it. A new incarnation makes the numbers taken of
%% the earlier one obsolete.
-spec heard(starl:robot_id(), starl_packet:incarnation(), t()) -> {present | earlier | far, t()}.
heard(Robot, Incarnation, Peers) ->
    case incarnation(Robot, Peers) of
        Incarnation ->
            {present, Peers};
        Later when Incarnation < Later -> {earlier, Peers};
        Known when Incarnation =< Known + ?LEAP ->
            {present, Peers#{
                Robot => #peer{incarnation = Incarnation, lives = lives(Robot, Peers)}
            }};
        _ ->
            {far, Peers}
    end.

%% @doc Takes a message of the source's present incarnation, unless it has been taken before or
%% lies `Window' or more above the floor. `wide': gaps use up half of the window.
-spec take(starl:robot_id(), starl_packet:numbering(), Window :: pos_integer(), t()) ->
    {new | wide, t()} | seen | far.
take(Source, {all, Number}, Window, Peers) ->
    #peer{casts = Taken} = Peer = maps:get(Source, Peers, #peer{}),
    case take(Number, Window, Taken) of
        {How, More} -> {How, Peers#{Source => Peer#peer{casts = More}}};
        No -> No
    end;
take(Source, Number, Window, Peers) ->
    #peer{ones = Taken} = Peer = maps:get(Source, Peers, #peer{}),
    case take(Number, Window, Taken) of
        {How, More} -> {How, Peers#{Source => Peer#peer{ones = More}}};
        No -> No
    end.

take(Number, _Window, #taken{floor = Floor}) when Number < Floor -> seen;
take(Number, Window, #taken{floor = Floor}) when Number - Floor >= Window -> far;
take(Number, Window, #taken{floor = Floor, above = Above} = Taken) ->
    case Number =:= Floor andalso starl_sap_numbers:is_empty(Above) of
        true -> {new, Taken#taken{floor = Floor + 1}};
        false -> take_above(Number, Window, Taken)
    end.

take_above(Number, Window, #taken{floor = Floor, above = Above}) ->
    case starl_sap_numbers:add(Number, Above) of
        member ->
            seen;
        More ->
            {Risen, Left} = starl_sap_numbers:rise(Floor, More),
            {width(Number - Risen, Window), #taken{floor = Risen, above = Left}}
    end.

width(Width, Window) when 2 * Width >= Window -> wide;
width(_Width, _Window) -> new.

%% @doc Prepares a question to a robot: with this nonce, or with that of a question still open.
-spec ask(starl:robot_id(), Nonce :: pos_integer(), t()) -> {pos_integer(), t()}.
ask(Robot, Nonce, Peers) ->
    case maps:get(Robot, Peers, #peer{}) of
        #peer{nonce = none} = Peer -> {Nonce, Peers#{Robot => Peer#peer{nonce = Nonce}}};
        #peer{nonce = Asked} -> {Asked, Peers}
    end.

%% @doc A robot answers with its incarnation, and with the lowest numbers that it still waits for.
%% `outlived': it has had a later life.
-spec told(
    starl:robot_id(), starl_packet:incarnation(), Nonce :: pos_integer(), starl_packet:lows(), t()
) -> {ok | outlived, t()} | not_asked.
told(Robot, Incarnation, Nonce, {Low, Casts}, Peers) ->
    case Peers of
        #{Robot := #peer{nonce = Nonce, lives = {_, Last}} = Peer} when Incarnation < Last ->
            {outlived, Peers#{Robot := Peer#peer{nonce = none}}};
        #{Robot := #peer{nonce = Nonce} = Peer} ->
            #peer{ones = Ones, casts = All} = Now = present(Incarnation, Peer),
            {ok, Peers#{
                Robot => Now#peer{
                    ones = rise(Low, Ones),
                    casts = rise(Casts, All),
                    lives = lived(Incarnation, Now#peer.lives),
                    nonce = none
                }
            }};
        #{} ->
            not_asked
    end.

present(Incarnation, #peer{incarnation = Incarnation} = Peer) -> Peer;
present(Incarnation, #peer{lives = Lives}) -> #peer{incarnation = Incarnation, lives = Lives}.

lived(Last, {Earlier, Last}) -> {Earlier, Last};
lived(Incarnation, {_Earlier, Last}) -> {Last, Incarnation}.

rise(Low, #taken{floor = Floor} = Taken) when Low =< Floor -> Taken;
rise(Low, #taken{above = Above}) ->
    {Floor, Left} = starl_sap_numbers:rise(Low, Above),
    #taken{floor = Floor, above = Left}.
