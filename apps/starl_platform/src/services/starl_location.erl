%% @doc Answers questions about the positions of all robots, the named waypoints, and the readings
%% of the senses.
%%
%% Only this service asks the positioning system (action `sense'); all other machines ask this
%% service. Calls: `{pose, Robot}' (answer `{ok, pose()}' or `{error, unknown}'); `poses' (all
%% robots seen); `{near, Mm}' (those that are seen within this distance, and perhaps others). For
%% waypoints: `{waypoint, Name}', `waypoints', and `{put_waypoint, Name, point()}' (durable). Also
%% `floor' (the floor plan) and `{sense, Kind}'. A cast `{subscribe, Kind, Us}' has a sense checked
%% with this period from now on. The application gets new readings as messages of type `sense'.
%% Configuration: `waypoints => #{Name => point()}', `floor => starl_floor:t()', `exact' (false),
%% `grid' (false), `oldest_us' (infinity).
%%
%% <em>The age of a picture.</em> A picture gives the age of each pose. Each picture shows the robot
%% itself, and answers a question only if that pose was taken after the question. So a robot that
%% stopped and asks for its place does not get a place from its drive. After an older picture the
%% question stays open, and the system is asked again after a moment. Other robots may be shown with
%% an age of up to `oldest_us'; a robot with an older pose counts as unseen.
%%
%% <em>A stuck positioning system</em> shows its last picture again and again as a new one. No live
%% system measures the same pose twice to the bit. So a picture is rejected if it answers a later
%% question than the picture before it, and shows the robot itself with exactly the same pose. One
%% picture may answer all questions that were open when it was taken. The first picture has no
%% predecessor, so it is taken twice. Only an `exact' system (without noise, or with rounded poses)
%% may repeat itself: there the age alone decides.
%%
%% If the system does not answer, all open questions are asked again after half a second. The number
%% of open questions is bounded, by the size of the team: beyond the bound the oldest question gets
%% the answer `{error, unknown}'.
-module(starl_location).
-behaviour(starl_machine).

-export([pose/2]).
-export([init/1, handle_event/5]).

-export_type([event/0]).

%% A sense has answered a question of the application's.
-type event() :: {felt, starl_sense:kind()}.

%% The time to wait for the positioning system before asking it again; and the time to wait after a
%% picture that was taken too early.
-define(PATIENCE_US, 500000).
-define(MOMENT_US, 20000).
%% The largest number of open questions: a constant, and more for each robot of the team.
-define(OPEN, 16).
-define(OPEN_A_ROBOT, 2).
%% The waypoints that an application may put.
-define(MOST_PUT, 1000).

-record(location, {
    self :: starl:robot_id(),
    participants :: starl_team:t(),
    waypoints :: #{atom() => starl_geometry:point()},
    floor :: starl_floor:t() | unknown,
    %% those that the application has put
    put = #{} :: #{atom() => starl_geometry:point()},
    %% the senses that are looked at: the period, and what each said last
    watched = #{} :: #{starl_sense:kind() => {Us :: pos_integer(), Said :: term()}},
    exact :: boolean(),
    %% does the positioning system know who is near?
    grid :: boolean(),
    oldest_us :: non_neg_integer() | infinity,
    %% the robot's own pose in the last picture, and the last question that this picture answers
    last = none :: {starl:pose(), seq()} | none,
    %% the number of the last question; no two incarnations of the machine have a number in common
    number :: seq(),
    %% the open questions, oldest first; the largest number of them
    asked = [] :: [asked()],
    most :: pos_integer()
}).

%% The number of a question.
-type seq() :: non_neg_integer().

-type question() :: {pose, starl:robot_id()} | poses | {near, Mm :: number()}.

%% A question: its number, its time, its caller, and its content.
-type asked() :: {seq(), AtUs :: integer(), starl_machine:from(), question()}.

%% A picture of the positioning system: poses, and the age of each.
-type seen() :: [{starl:robot_id(), starl:pose(), AgeUs :: non_neg_integer()}].

%% @doc The action that asks for a robot's pose; the answer is the event `{reply, Tag}'.
-spec pose(starl:robot_id(), starl_machine:tag()) -> starl_machine:action().
pose(Robot, Tag) -> {call, location, {pose, Robot}, Tag}.

-spec init(starl_machine:config()) -> {ready, #location{}, []}.
init(#{robot := Self, participants := Participants, incarnation := Incarnation} = Config) ->
    Location = #location{
        self = Self,
        participants = Participants,
        waypoints = maps:merge(maps:get(waypoints, Config, #{}), put_before(Config)),
        floor = maps:get(floor, Config, unknown),
        put = put_before(Config),
        exact = maps:get(exact, Config, false),
        grid = maps:get(grid, Config, false),
        oldest_us = maps:get(oldest_us, Config, infinity),
        number = Incarnation bsl 32,
        most = ?OPEN + ?OPEN_A_ROBOT * starl_team:count(Participants)
    },
    {ready, Location, []}.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #location{}, starl_machine:meta()
) -> starl_machine:result().
handle_event({call, From}, Question, ready, Location, #{now := Now}) ->
    asked(Question, From, Now, Location);
handle_event(info, {located, N, Seen}, ready, #location{asked = Asked} = Location, #{now := Now}) ->
    case lists:keytake(N, 1, Asked) of
        {value, Question, Rest} -> located(Seen, Question, Rest, Now, Location);
        false -> keep_state_and_data
    end;
handle_event(state_timeout, again, ready, #location{asked = Asked} = Location, _Meta) ->
    {keep_state_and_data, [sense(Question, Location) || Question <- Asked] ++ [patience()]};
handle_event({timeout, moment}, again, ready, #location{asked = Asked} = Location, _Meta) ->
    {keep_state_and_data, [sense(Question, Location) || Question <- Asked]};
handle_event(info, {felt, {asked, Kind, From}, Felt}, ready, _Location, _Meta) ->
    Traced = [{trace, {felt, Kind}} || {ok, _} <- [Felt]],
    {keep_state_and_data, Traced ++ [{reply, From, felt(Felt)}]};
handle_event(cast, {subscribe, Kind, Us}, ready, #location{watched = Watched} = Location, _Meta) ->
    Next = Location#location{watched = Watched#{Kind => {Us, nothing}}},
    {keep_state, Next, [{{timeout, {watch, Kind}}, Us, look}]};
handle_event({timeout, {watch, Kind}}, look, ready, #location{watched = Watched}, _Meta) ->
    #{Kind := {Us, _}} = Watched,
    {keep_state_and_data, [{feel, Kind, {watched, Kind}}, {{timeout, {watch, Kind}}, Us, look}]};
handle_event(info, {felt, {watched, Kind}, Felt}, ready, #location{} = Location, _Meta) ->
    told(Kind, Felt, Location);
handle_event(info, {restarted, _}, ready, _Location, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

asked({pose, _} = Question, From, Now, Location) ->
    ask(From, Question, Now, Location);
asked(poses, From, Now, Location) ->
    ask(From, poses, Now, Location);
asked({near, _} = Question, From, Now, Location) ->
    ask(From, Question, Now, Location);
asked({waypoint, Name}, From, _Now, #location{waypoints = Waypoints}) ->
    Answer =
        case Waypoints of
            #{Name := Point} -> {ok, Point};
            #{} -> {error, unknown}
        end,
    {keep_state_and_data, [{reply, From, Answer}]};
asked(waypoints, From, _Now, #location{waypoints = Waypoints}) ->
    {keep_state_and_data, [{reply, From, {ok, Waypoints}}]};
asked({put_waypoint, Name, Point}, From, _Now, Location) ->
    put_waypoint(From, Name, Point, Location);
asked({sense, Kind}, From, _Now, _Location) ->
    {keep_state_and_data, [{feel, Kind, {asked, Kind, From}}]};
asked(floor, From, _Now, #location{floor = unknown}) ->
    {keep_state_and_data, [{reply, From, {error, unknown}}]};
asked(floor, From, _Now, #location{floor = Floor}) ->
    {keep_state_and_data, [{reply, From, {ok, Floor}}]};
asked(_Question, _From, _Now, _Location) ->
    unknown_event.

%% -- waypoints ------------------------------------------------------------------------------

put_before(#{stored := {stored, #{waypoints := Put}}}) -> Put;
put_before(_Config) -> #{}.

%% Those that were put are kept over restarts and reboots.
put_waypoint(From, Name, Point, #location{waypoints = Waypoints, put = Put} = Location) ->
    case map_size(Put) < ?MOST_PUT orelse is_map_key(Name, Put) of
        true ->
            Kept = Put#{Name => Point},
            Next = Location#location{waypoints = Waypoints#{Name => Point}, put = Kept},
            {keep_state, Next, [{store, #{waypoints => Kept}}, {reply, From, ok}]};
        false ->
            {keep_state_and_data, [{reply, From, {error, full}}]}
    end.

%% -- senses ---------------------------------------------------------------------------------

felt({ok, _} = Reading) -> Reading;
felt(none) -> {error, gone};
felt(unknown) -> {error, unknown}.

%% The application hears what the sense has not said the last time.
told(Kind, {ok, Reading}, #location{self = Self, watched = Watched} = Location) ->
    case Watched of
        #{Kind := {_, Reading}} ->
            keep_state_and_data;
        #{Kind := {Us, _}} ->
            Next = Location#location{watched = Watched#{Kind := {Us, Reading}}},
            {keep_state, Next, [{cast, app, {message, Self, sense, {Kind, Reading}}}]};
        #{} ->
            keep_state_and_data
    end;
told(_Kind, _Nothing, _Location) ->
    keep_state_and_data.

%% -- questions ------------------------------------------------------------------------------

ask(From, Question, Now, #location{asked = Asked, most = Most, number = N} = Location) ->
    New = {N + 1, Now, From, Question},
    Numbered = Location#location{number = N + 1},
    Sense = sense(New, Location),
    case Asked of
        [] ->
            {keep_state, Numbered#location{asked = [New]}, [Sense, patience()]};
        [{_, _, Oldest, _} | Rest] when length(Asked) >= Most ->
            Unknown = {reply, Oldest, {error, unknown}},
            {keep_state, Numbered#location{asked = Rest ++ [New]}, [Unknown, Sense]};
        _ ->
            {keep_state, Numbered#location{asked = Asked ++ [New]}, [Sense]}
    end.

sense({N, _, _, Question}, Location) -> {sense, robots(Question, Location), N}.

robots({pose, Self}, #location{self = Self}) -> [Self];
robots({pose, Robot}, #location{self = Self}) -> [Self, Robot];
robots({near, _} = Near, #location{grid = true}) -> Near;
robots(_All, #location{participants = Participants}) -> starl_team:members(Participants).

patience() -> {state_timeout, ?PATIENCE_US, again}.

%% The next answer may take as long as this one.
waited({keep_state, #location{asked = []} = Location, Actions}) ->
    {keep_state, Location, Actions ++ [{state_timeout, cancel}]};
waited({keep_state, Location, Actions}) ->
    {keep_state, Location, Actions ++ [patience()]}.

%% -- answers --------------------------------------------------------------------------------

located(Seen, {_, At, _, _} = Question, Rest, Now, #location{self = Self} = Location) ->
    case lists:keyfind(Self, 1, Seen) of
        {_, _, Age} when Age > Now - At ->
            too_early(Question, Now, Location);
        {_, Pose, Age} ->
            Left = Location#location{asked = Rest},
            waited(shown(Pose, Now - Age, Now, Seen, Question, Left));
        false ->
            waited(answered(Seen, Question, Location#location{asked = Rest}))
    end.

%% A clock that was set back is behind the time of the question: the question counts from now on.
too_early({N, At, From, Question}, Now, #location{asked = Asked} = Location) when Now < At ->
    Anew = lists:keyreplace(N, 1, Asked, {N, Now, From, Question}),
    {keep_state, Location#location{asked = Anew}, [{{timeout, moment}, ?MOMENT_US, again}]};
too_early(_Question, _Now, _Location) ->
    {keep_state_and_data, [{{timeout, moment}, ?MOMENT_US, again}]}.

%% Does the picture, taken at this time, come from a live system?
shown(Pose, _Taken, Now, _Seen, {N, _, From, Question}, #location{exact = false, last = none} = L) ->
    ask(From, Question, Now, L#location{last = {Pose, N}});
shown(Pose, Taken, _Now, Seen, {N, _, _, _} = Question, #location{exact = Exact} = Location) ->
    case Location#location.last of
        {Pose, Upto} when not Exact, N > Upto -> answered([], Question, Location);
        _ -> answered(Seen, Question, Location#location{last = {Pose, upto(Taken, N, Location)}})
    end.

%% The last question that a picture taken at this time answers.
upto(Taken, N, #location{asked = Asked, last = Last}) ->
    Before = [Upto || {_, Upto} <- [Last]],
    lists:max([N | Before] ++ [Open || {Open, At, _, _} <- Asked, At =< Taken]).

answered(Seen, {_, _, From, Question}, #location{} = Location) ->
    {keep_state, Location, [{reply, From, answer(Question, recent(Seen, Location))}]}.

recent(Seen, #location{oldest_us = infinity}) -> Seen;
recent(Seen, #location{oldest_us = Us}) -> [One || {_, _, Age} = One <- Seen, Age =< Us].

-spec answer(question(), seen()) -> {ok, term()} | {error, unknown}.
answer({pose, Robot}, Seen) ->
    case lists:keyfind(Robot, 1, Seen) of
        {Robot, Pose, _} -> {ok, Pose};
        false -> {error, unknown}
    end;
answer(_PosesOrNear, Seen) ->
    {ok, maps:from_list([{Robot, Pose} || {Robot, Pose, _} <- Seen])}.
