%% @doc Follow the leader: one robot drives round a course, the others follow it in a column, each at its own
%% distance. When nothing has been heard of the leader for a while, those that are left elect another
%% one by the bully algorithm, in the next term; who hears of a later term follows its leader.
%% ```
%%   leader                                followers
%%      |--- beat Term, {X, Y}, Goal ------->|   each half second; they drive along its trail
%%      (dies)                               |   three seconds without a beat
%%                                           |--- elect {lead, Term + 1}: the highest alive leads
%% '''
%% Measure: `error_mm', the distance of a follower from its place in the column. Trace: {@link event()}
%% (see {@link starl_follow_monitor}).
-module(starl_follow).
-behaviour(starl_app).

-export([init/2, step/2]).
-export([options/0, blocks/0, monitors/1, guarantees/0, measures/0, report/2]).

-export_type([event/0]).

%% It leads in this term, told with every beat; it follows that robot from now on.
-type event() :: {leads, term_no()} | {follows, term_no(), Leader :: starl:robot_id()}.

-type term_no() :: non_neg_integer().

%% `trail': where the leader was, the latest first, to where the robot was when it began to follow.
-type state() :: #{
    role := elect | lead | follow,
    term := term_no(),
    until := integer(),
    gap := number(),
    goals => [starl_geometry:point(), ...],
    leader => starl:robot_id(),
    %% to which corner the leader drives
    goal => starl_geometry:point(),
    trail => [starl_geometry:point(), ...]
}.

-define(BEAT_MS, 500).
-define(SILENCE_MS, 3000).
-define(PATIENCE_MS, 5000).
-define(SPEED, 200).
-define(FASTEST, 350).
%% A corner of the course is passed at this distance (mm).
-define(NEAR_MM, 200).
%% From where a robot avoids another (mm).
-define(SHY_MM, 700).

-spec options() -> [starl_options:option()].
options() ->
    [
        {gap, {number, 400, 5000}, 700,
            "the distance of one robot from the next along the trail, mm"},
        {duration, {integer, 1, 86400}, 60, "how long they drive, s"}
    ].

-spec blocks() -> [starl_block:entry()].
blocks() -> [starl_bully].

-spec monitors(starl_scene:context()) -> [{module(), map()}].
monitors(#{robots := Ids}) -> [{starl_follow_monitor, #{robots => Ids}}].

-spec measures() -> [{atom(), string()}].
measures() -> [{error_mm, "distance from the place in the column, mm"}].

%% @doc What a team that follows may rely on.
-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {onwards, safety, "a robot never turns from a later term to an earlier one in one life",
            []},
        {led, progress, "while robots live one of them leads: at most a minute without a leader", [
            delivery, quick
        ]}
    ].

-spec init(starl:robot(), map()) -> state().
init(Robot, #{gap := Gap, duration := Seconds}) ->
    ok = starl:listen(Robot, beat),
    #{role => elect, term => 0, gap => Gap, until => starl:now(Robot) + 1000 * Seconds}.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, term_no()}.
step(Robot, #{role := Role, until := Until, term := Term} = State) ->
    case starl:now(Robot) >= Until of
        true ->
            _ = starl:stop(Robot),
            {done, Term};
        false ->
            {continue, act(Role, Robot, State)}
    end.

act(elect, Robot, #{term := Before} = State) ->
    {Me, Term} = {starl:id(Robot), Before + 1},
    case starl_election:elect(Robot, {lead, Term}, ?PATIENCE_MS) of
        {ok, Me} ->
            maps:remove(leader, State#{role := lead, term := Term, goals => course(Robot, State)});
        {ok, Leader} ->
            follow(Robot, Term, Leader, State);
        {error, _} ->
            State#{term := Term}
    end;
act(lead, Robot, #{term := Term, goals := [Goal | Goals]} = State) ->
    Next =
        case starl:position(Robot) of
            {ok, {X, Y, _}} ->
                ok = starl:trace(Robot, {leads, Term}),
                ok = beat(Robot, Term, {X, Y}, Goal),
                _ = drive(Robot, Goal, ?SPEED, State),
                case starl_geometry:distance({X, Y}, Goal) < ?NEAR_MM of
                    true -> State#{goals := Goals ++ [Goal]};
                    false -> State
                end;
            {error, _} ->
                State
        end,
    rivals(Robot, starl:now(Robot) + ?BEAT_MS, Next);
act(follow, Robot, State) ->
    case starl:await(Robot, beat, ?SILENCE_MS) of
        timeout -> State#{role := elect};
        Beat -> heard(Beat, Robot, State)
    end.

%% -- beats ----------------------------------------------------------------------------------

beat(Robot, Term, {X, Y}, Goal) ->
    Others = lists:delete(starl:id(Robot), starl:participants(Robot)),
    _ = [ok = starl:post(Robot, Other, beat, {Term, {X, Y}, Goal}) || Other <- Others],
    Text = io_lib:format("leads, term ~b", [Term]),
    starl:draw(Robot, #{key => role, text => Text, at => {X + 250, Y + 250}, seconds => 1}).

%% Until its next beat a leader listens to others. An answer to each at once would be a storm.
rivals(Robot, Until, #{role := lead} = State) ->
    case Until - starl:now(Robot) of
        Ms when Ms > 0 ->
            case starl:await(Robot, beat, Ms) of
                timeout -> State;
                Beat -> rivals(Robot, Until, heard(Beat, Robot, State))
            end;
        _ ->
            State
    end;
rivals(_Robot, _Until, State) ->
    State.

%% Of two leaders of one term, whom lost messages can make, the one with the higher number leads.
heard({ok, From, {Term, At, Goal}}, Robot, #{term := Term, leader := From} = State) ->
    behind(Robot, At, State#{goal => Goal});
heard({ok, From, {Term, At, Goal}}, Robot, #{term := Known} = State) ->
    Rival = maps:get(leader, State, starl:id(Robot)),
    case Term > Known orelse (Term =:= Known andalso From > Rival) of
        true -> behind(Robot, At, follow(Robot, Term, From, State#{goal => Goal}));
        false -> State
    end.

follow(Robot, Term, Leader, State) ->
    ok = starl:trace(Robot, {follows, Term, Leader}),
    maps:remove(trail, State#{role := follow, term := Term, leader => Leader}).

%% Drives to the place on the trail that is as far behind the leader as the robot's rank says: the
%% highest number comes first, who would lead next.
behind(Robot, At, #{gap := Gap, leader := Leader} = State) ->
    case starl:position(Robot) of
        {ok, {X, Y, _}} ->
            Trail = [At | maps:get(trail, State, [{X, Y}])],
            Ahead = [Id || Id <- starl:participants(Robot), Id > starl:id(Robot), Id =/= Leader],
            {Place, Kept} = starl_follow_course:back(Trail, Gap * (1 + length(Ahead))),
            ok = starl:measure(Robot, error_mm, starl_geometry:distance({X, Y}, Place)),
            ok = starl:draw(Robot, #{key => way, line => [{X, Y}, Place], seconds => 1}),
            _ = drive(Robot, Place, ?FASTEST, State),
            State#{trail => Kept};
        {error, _} ->
            State
    end.

drive(Robot, Goal, Speed, #{gap := Gap}) ->
    Shy = min(?SHY_MM, 0.8 * Gap),
    starl_avoidance:drive(Robot, Goal, #{speed => Speed, shy_mm => Shy, ms => 3 * ?BEAT_MS}).

%% It goes on with the corner to which the leader before drove, or begins at the nearest.
course(Robot, State) ->
    case {starl:floor(Robot), starl:position(Robot)} of
        {{ok, #{size := Size}}, {ok, {X, Y, _}}} ->
            Corners = starl_follow_course:corners(Size),
            Shape = #{key => course, line => Corners ++ [hd(Corners)], colour => grey},
            ok = starl:draw(Robot, Shape),
            starl_follow_course:from(maps:get(goal, State, {X, Y}), Corners);
        _ ->
            ok = starl:sleep(Robot, ?BEAT_MS),
            course(Robot, State)
    end.

%% -- the report -----------------------------------------------------------------------------

%% @doc How many robots have led, and the longest time without a leader.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(_Scene, #{monitors := #{starl_follow_monitor := #{leaders := N, longest_us := Us}}}) ->
    Label = "longest time without a leader, s",
    #{
        figures => [{leaders, N}, {leaderless_s, Us / 1.0e6}],
        formats => #{leaderless_s => #{decimals => 1, label => Label, plotted => true}},
        done => io_lib:format("leaders: ~b, at most ~.1f s without one", [N, Us / 1.0e6])
    }.
