%% @doc Has scripts carried out by the port, one in place of the other, and says when they are over:
%% the part of {@link starl_create_driver} that moves the robot. A pure module.
%% ```
%%     drive ---> {drive_script, ...}     sent: the time that the answer bears
%%                                        ended, 50 ms later, and the wheels stand: {driven, At}
%%                                        a wheel stalls: the wheels are stopped; {stalled, Told}
%% '''
-module(starl_create_drive).

-export([new/1, drive/3, stop/1, forget/1, hear/2, due/2, watch/2]).

-export_type([t/0, action/0]).

-type action() ::
    {port, {drive_script, Ref :: pos_integer(), [{binary(), Us :: pos_integer()}], binary()}}
    | {timer, rest, Ms :: non_neg_integer()}
    | {answer, Mark :: term(), starl_live_chassis:answer()}.

-record(leg, {
    mark :: term(),
    steps :: [starl_create_script:step()],
    heard = none :: integer() | none,
    %% has the port written the last bytes, and has the robot had time to come to rest?
    has_ended = false :: boolean(),
    may_rest = false :: boolean()
}).

-record(drive, {
    options :: starl_create_order:options(),
    %% the number of the last script
    ref = 0 :: non_neg_integer(),
    leg = none :: none | #leg{}
}).

-opaque t() :: #drive{}.

%% The time that a robot takes to come to rest.
-define(REST_MS, 50).

%% @doc For a robot with the driver's options.
-spec new(starl_create_order:options()) -> t().
new(Options) -> #drive{options = Options}.

%% @doc A script in place of the present one.
-spec drive(starl_chassis_differential:commands(), Mark :: term(), t()) -> {[action()], t()}.
drive(Commands, Mark, #drive{options = Options} = Drive) ->
    Steps = starl_create_script:steps(Commands, starl_create_order:way(Options)),
    Written = [{Bytes, Us} || {_, Bytes, Us} <- Steps],
    {Words, Next} = script(Written, starl_create_order:rest(Options), Drive),
    {Words, Next#drive{leg = #leg{mark = Mark, steps = Steps}}}.

script(Steps, End, #drive{ref = Ref} = Drive) ->
    {[{port, {drive_script, Ref + 1, Steps, End}}], Drive#drive{ref = Ref + 1, leg = none}}.

%% @doc Everything comes to rest, the pen too.
-spec stop(t()) -> {[action()], t()}.
stop(#drive{options = Options} = Drive) ->
    script([], starl_create_order:resting(Options), Drive).

%% @doc The script is void: nobody answers it.
-spec forget(t()) -> t().
forget(Drive) -> Drive#drive{leg = none}.

%% @doc The port says what has become of a script. What comes of an older one is not heard.
-spec hear(starl_create_word:message(), t()) -> {[action()], t()}.
hear({sent, Ref, At}, #drive{ref = Ref, leg = #leg{} = Leg} = Drive) ->
    {[], Drive#drive{leg = sent(At, Leg)}};
hear({ended, Ref, At}, #drive{ref = Ref, leg = #leg{} = Leg} = Drive) ->
    Ended = (sent(At, Leg))#leg{has_ended = true},
    {[{timer, rest, ?REST_MS}], Drive#drive{leg = Ended}};
hear({stopped, _Why, _At}, Drive) ->
    {[], forget(Drive)};
hear(_Older, Drive) ->
    {[], Drive}.

sent(At, #leg{heard = none} = Leg) -> Leg#leg{heard = At};
sent(_At, Leg) -> Leg.

%% @doc The time to come to rest is over.
-spec due(starl_create_senses:t(), t()) -> {[action()], t()}.
due(Senses, #drive{leg = #leg{has_ended = true} = Leg} = Drive) ->
    rested(Senses, Drive#drive{leg = Leg#leg{may_rest = true}});
due(_Senses, Drive) ->
    {[], Drive}.

%% A script is over when the robot says that it stands: the line may be slow.
rested(Senses, #drive{leg = #leg{mark = Mark, heard = Heard}} = Drive) ->
    case starl_create_senses:is_at_rest(Senses) of
        true -> {[{answer, Mark, {driven, Heard}}], forget(Drive)};
        false -> {[], Drive}
    end.

%% @doc A frame of the stream has come.
-spec watch(starl_create_senses:t(), t()) -> {[action()], t()}.
watch(_Senses, #drive{leg = none} = Drive) ->
    {[], Drive};
watch(Senses, #drive{leg = #leg{may_rest = true}} = Drive) ->
    rested(Senses, Drive);
watch(Senses, #drive{options = Options} = Drive) ->
    case starl_create_senses:is_stalled(maps:get(stops_at_bumps, Options, true), Senses) of
        true -> stalled(Senses, Drive);
        false -> {[], Drive}
    end.

%% The pen stays as it is.
stalled(Senses, #drive{leg = #leg{mark = Mark} = Leg, options = Options} = Drive) ->
    Told = told(starl_create_senses:readings(Senses), Leg),
    {Stop, Stopped} = script([], starl_create_order:rest(Options), Drive),
    {Stop ++ [{answer, Mark, {stalled, Told}}], Stopped}.

%% The command that the robot was carrying out: its speeds tell.
told(_Readings, #leg{steps = []}) ->
    {0.0, 0.0};
told(#{left_velocity := L, right_velocity := R}, #leg{steps = Steps}) ->
    Same = [Told || {{TL, TR} = Told, _, _} <- Steps, sign(TL) =:= sign(L), sign(TR) =:= sign(R)],
    case Same of
        [First | _] -> First;
        [] -> element(1, hd(Steps))
    end.

sign(X) when X > 0 -> 1;
sign(X) when X < 0 -> -1;
sign(_) -> 0.
