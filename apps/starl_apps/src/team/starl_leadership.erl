%% @doc Leadership with fail-over, for applications: one robot of a team leads, and sends some
%% content to the others with every heartbeat. When the others have heard nothing of the leader for
%% a while, they elect another leader by the bully algorithm, in the next term. A robot that hears
%% of a later term follows its leader.
%% ```
%%   leader                                followers
%%      |--- beat Term, Content ------------>|   each half second
%%      (dies)                               |   three seconds without a beat
%%                                           |--- elect {lead, Term + 1}: the highest alive leads
%% '''
%% An application takes a turn and does what its role asks for. A leader ends its turn with
%% listening:
%% ```
%%   case starl_leadership:turn(Robot, Team) of
%%       {elected, Next} -> ...
%%       {leads, Next} -> beat(Robot, Content, Next), ..., listen(Robot, Next)
%%       {heard, Content, Next} -> ...
%%       {nothing, Next} -> ...
%%   end
%% '''
%% A leader sends, and need not hear: a team goes on with a leader that has become deaf. A robot
%% that does not hear its leader takes the lead in a later term, if all others hear it. If a leader
%% is mute, the others elect another leader that hears, and is heard by, a majority
%% ({@link starl_election_bully}). An application whose leader needs answers must make sure of them
%% itself.
%%
%% If messages are lost, two robots may lead in one term, until one hears of the other. Then the
%% robot with the higher number goes on. The block is `starl_bully'. Trace: {@link event()}.
-module(starl_leadership).

-export([new/1, turn/2, listen/2, beat/3, draw/3, leader/1, beat_ms/0]).

-export_type([t/0, event/0, term_no/0, leader/0, outcome/0]).

%% It leads in this term, told with every beat; it follows that robot from now on; that robot's beat has no term, or
%% one that is not believed.
-type event() ::
    {leads, term_no()}
    | {follows, term_no(), Leader :: starl:robot_id()}
    | {doubted, starl:robot_id()}.

-type term_no() :: non_neg_integer().

%% Whom the robot follows, and in which term; `none': it leads itself, or nobody does.
-type leader() :: {term_no(), starl:robot_id() | none}.

-record(leadership, {
    role = elect :: elect | lead | follow,
    term = 0 :: term_no(),
    leader = none :: starl:robot_id() | none,
    %% how near beats have brought it to terms that were not believed
    reach = 0 :: term_no()
}).

-opaque t() :: #leadership{}.

%% The robot is elected; it is its turn to lead; its leader has told this; none of these.
-type outcome() :: {elected | leads | nothing, t()} | {heard, Content :: term(), t()}.

-define(BEAT_MS, 500).
-define(SILENCE_MS, 3000).
-define(PATIENCE_MS, 5000).

%% @doc Nobody leads yet.
-spec new(starl:robot()) -> t().
new(Robot) ->
    ok = starl:listen(Robot, beat),
    #leadership{}.

%% @doc The period of the beats, ms.
-spec beat_ms() -> pos_integer().
beat_ms() -> ?BEAT_MS.

-spec leader(t()) -> leader().
leader(#leadership{term = Term, leader = Leader}) -> {Term, Leader}.

%% @doc Elects, waits for a beat, or says that it is time to lead.
-spec turn(starl:robot(), t()) -> outcome().
turn(Robot, #leadership{role = elect, term = Before} = Team) ->
    {Me, Term} = {starl:id(Robot), Before + 1},
    case starl_election:elect(Robot, {lead, Term}, ?PATIENCE_MS) of
        {ok, Me} -> {elected, Team#leadership{role = lead, term = Term, leader = none}};
        {ok, Leader} -> {nothing, follow(Robot, Term, Leader)};
        {error, _} -> {nothing, Team#leadership{term = Term}}
    end;
turn(_Robot, #leadership{role = lead} = Team) ->
    {leads, Team};
turn(Robot, #leadership{role = follow} = Team) ->
    case starl:await(Robot, beat, ?SILENCE_MS) of
        timeout -> {nothing, Team#leadership{role = elect}};
        Beat -> heard(Beat, Robot, Team)
    end.

%% @doc Sends the leader's content to all others; it does not wait.
-spec beat(starl:robot(), Content :: term(), t()) -> ok.
beat(Robot, Content, #leadership{role = lead, term = Term}) ->
    ok = starl:trace(Robot, {leads, Term}),
    Others = lists:delete(starl:id(Robot), starl:participants(Robot)),
    lists:foreach(fun(To) -> ok = starl:post(Robot, To, beat, {Term, Content}) end, Others).

%% @doc A leader writes its term beside it, for a second.
-spec draw(starl:robot(), starl_geometry:point(), t()) -> ok.
draw(Robot, At, #leadership{role = lead, term = Term}) ->
    Text = io_lib:format("leads, term ~b", [Term]),
    starl:draw(Robot, #{key => role, text => Text, at => At, seconds => 1}).

%% @doc The leader listens until its next beat: a rival may lead from now on.
-spec listen(starl:robot(), t()) -> outcome().
listen(Robot, #leadership{role = lead} = Team) -> listen(Robot, starl:now(Robot) + ?BEAT_MS, Team).

%% An answer to each rival at once would be a storm.
listen(Robot, Until, Team) ->
    case Until - starl:now(Robot) of
        Ms when Ms > 0 ->
            case starl:await(Robot, beat, Ms) of
                timeout ->
                    {nothing, Team};
                Beat ->
                    case heard(Beat, Robot, Team) of
                        {nothing, Next} -> listen(Robot, Until, Next);
                        {heard, _, _} = Heard -> Heard
                    end
            end;
        _ ->
            {nothing, Team}
    end.

heard({ok, From, {Term, Content}}, Robot, Team) when is_integer(Term), Term >= 0 ->
    #leadership{term = Known, reach = Reach} = Team,
    case starl_term:toward(Term, max(Known, Reach)) of
        Term -> believed(From, Term, Content, Robot, Team);
        Nearer -> doubted(From, Robot, Team#leadership{reach = Nearer})
    end;
heard({ok, From, _NoBeat}, Robot, Team) ->
    doubted(From, Robot, Team).

doubted(From, Robot, Team) ->
    ok = starl:trace(Robot, {doubted, From}),
    {nothing, Team}.

believed(From, Term, Content, _Robot, #leadership{term = Term, leader = From} = Team) ->
    {heard, Content, Team};
believed(From, Term, Content, Robot, #leadership{term = Known, leader = Leader} = Team) ->
    Rival = hd([Id || Id <- [Leader, starl:id(Robot)], Id =/= none]),
    case Term > Known orelse (Term =:= Known andalso From > Rival) of
        true -> {heard, Content, follow(Robot, Term, From)};
        false -> {nothing, Team}
    end.

follow(Robot, Term, Leader) ->
    ok = starl:trace(Robot, {follows, Term, Leader}),
    #leadership{role = follow, term = Term, leader = Leader}.
