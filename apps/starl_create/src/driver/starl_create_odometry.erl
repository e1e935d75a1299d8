%% @doc The odometry of a Create: the distance and the turn that its sensors have counted.
%%
%% The encoders of a Create 2 come with each frame, and wrap at 65536. A Create 1 is asked for its
%% distance and angle, in whole millimetres and degrees, and rarely, because each answer loses the
%% fractions.
-module(starl_create_odometry).

-export([new/1, total/1, count/3, counts/3, ask/1, answer/2, forget/1]).

-export_type([t/0]).

-record(odometry, {
    way_mm = 0.0 :: float(),
    turn = 0.0 :: float(),
    %% the true way and turn by what is counted
    factors :: starl_create_options:factors(),
    %% has a Create 1 been asked?
    is_asked = false :: boolean()
}).

-opaque t() :: #odometry{}.

-define(PI, 3.141592653589793).

%% @doc Nothing has been counted yet.
-spec new(starl_create_options:t()) -> t().
new(Options) -> #odometry{factors = starl_create_options:odometry(Options)}.

%% @doc The whole way (mm) and turn (rad).
-spec total(t()) -> {Mm :: float(), Radians :: float()}.
total(#odometry{way_mm = Way, turn = Turn}) -> {Way, Turn}.

%% @doc Counts what the encoders have turned between two frames.
-spec count(Before :: Readings, Now :: Readings, t()) -> t() when
    Readings :: starl_create_packet:readings().
count(Before, #{left_encoder := _} = Now, Odometry) ->
    Mm = starl_create_wheels:mm_per_count(),
    Left = Mm * counts(left_encoder, Before, Now),
    Right = Mm * counts(right_encoder, Before, Now),
    grown((Left + Right) / 2, (Right - Left) / starl_create_wheels:axle_mm(2), Odometry);
count(_Before, _Now, Odometry) ->
    Odometry.

grown(Mm, Radians, #odometry{way_mm = Way, turn = Turn, factors = {OfWay, OfTurn}} = Odometry) ->
    Odometry#odometry{way_mm = Way + OfWay * Mm, turn = Turn + OfTurn * Radians}.

%% @doc The counts of an encoder between two frames, forwards or backwards.
-spec counts(left_encoder | right_encoder, Before :: Readings, Now :: Readings) -> integer() when
    Readings :: starl_create_packet:readings().
counts(Name, Before, Now) ->
    case {Before, Now} of
        {#{Name := Old}, #{Name := New}} -> ((New - Old + 32768) band 16#FFFF) - 32768;
        _ -> 0
    end.

%% @doc The question to a Create 1 for its distance and angle.
-spec ask(t()) -> {binary(), t()}.
ask(Odometry) ->
    {starl_create_command:encode({query, [19, 20]}, 1), Odometry#odometry{is_asked = true}}.

%% @doc Bytes that are no frame: the answer, if it was asked.
-spec answer(binary(), t()) -> t().
answer(<<Mm:16/signed, Degrees:16/signed>>, #odometry{is_asked = true} = Odometry) ->
    grown(Mm, Degrees * ?PI / 180, Odometry#odometry{is_asked = false});
answer(_Bytes, Odometry) ->
    Odometry.

%% @doc An answer is not to be expected any more.
-spec forget(t()) -> t().
forget(Odometry) -> Odometry#odometry{is_asked = false}.
