%% @doc Gives scripts to the port, one in place of the other, and reports when they are over. It is
%% the part of {@link starl_create_driver} that moves the robot. A pure module.
%% ```
%%     drive ---> {drive_script, ...}     sent: the time that the answer bears
%%                                        ended, and the wheels stand: {driven, At}
%%                                        a wheel stalls: the wheels are stopped; {stalled, Told}
%% '''
%% The wheels stand when a frame says so that came after the robot was seen to move, or else 50 ms
%% after the last bytes. An earlier frame may be from before the script.
%%
%% <em>Lateness.</em> The port reports when bytes left. A script that lasted longer than it should
%% shows a busy computer, so the next scripts are driven more carefully, as on a line with that
%% jitter. The port cuts a script short if a step would begin too late, or if the VM gives no sign
%% of life. Such a script is answered at the time at which it should have ended: the robot then
%% looks where it is, and goes on from there.
-module(starl_create_drive).

-export([new/1, drive/3, stop/2, forget/1, hear/3, due/2, watch/2]).

-export_type([t/0, action/0]).

-type action() ::
    {port, starl_create_word:command()}
    | {timer, rest, Ms :: non_neg_integer()}
    | {answer, Mark :: term(), starl_live_chassis:answer()}
    | {say, warning, starl_create_advice:t()}.

-record(leg, {
    mark :: term(),
    steps :: [starl_create_script:step()],
    heard = none :: integer() | none,
    %% has the robot been seen to move, has the port written the last bytes, has there been the time
    %% to come to rest?
    has_moved = false :: boolean(),
    has_ended = false :: boolean(),
    may_rest = false :: boolean(),
    %% has it ended before its time?
    is_cut = false :: boolean()
}).

-record(drive, {
    options :: starl_create_options:t(),
    %% the number of the last script
    ref = 0 :: non_neg_integer(),
    leg = none :: none | #leg{},
    %% has it answered that it stands, and has not been moved since?
    stands = false :: boolean(),
    %% how late bytes may be
    jitter_us :: pos_integer()
}).

-opaque t() :: #drive{}.

%% The time that a robot takes to come to rest.
-define(REST_MS, 50).
%% That of an adapter on a busy bus; the longest that is worth care; what is left of it after a script
%% in time; the difference that is none.
-define(JITTER_MS, 20).
-define(MOST_US, 40000).
-define(CALMER, 0.9).
-define(FINE_US, 2000).

%% @doc For a robot with the driver's options.
-spec new(starl_create_options:t()) -> t().
new(Options) -> #drive{options = Options, jitter_us = jitter_us(Options)}.

jitter_us(Options) -> 1000 * maps:get(jitter_ms, Options, ?JITTER_MS).

%% @doc A script in place of the present one.
-spec drive(starl_chassis_differential:commands(), Mark :: term(), t()) -> {[action()], t()}.
drive(Commands, Mark, #drive{stands = Stands} = Drive) ->
    Steps = starl_create_script:steps(Commands, way(Drive), factors(Drive)),
    Written = [{Bytes, Us} || {_, Bytes, Us} <- Steps],
    {Words, Next} = script(Written, starl_create_script:rest(), Drive),
    Leg = #leg{mark = Mark, steps = Steps, may_rest = Stands andalso Steps =:= []},
    {Words, Next#drive{leg = Leg}}.

way(#drive{options = Options, jitter_us = Jitter} = Drive) ->
    case starl_create_instructions:is_on_robot(Options) of
        true -> {on_robot, starl_create_options:waits(Options), from(Drive)};
        false -> {by_port, Jitter}
    end.

from(#drive{leg = #leg{has_ended = false, steps = [_ | _]}}) -> slice;
from(_Drive) -> rest.

factors(#drive{options = Options}) -> starl_create_options:drive(Options).

%% A Create 1 reads nothing before its slice is over. What is sent meanwhile would pile up, slice after
%% slice; so the next script begins when the next slice of this one is due.
script(Steps, End, #drive{ref = Ref, options = Options} = Drive) ->
    Next = Drive#drive{ref = Ref + 1, leg = none, stands = false},
    Word =
        case {starl_create_instructions:is_on_robot(Options), Steps} of
            {false, _} -> {drive_script, Ref + 1, Steps, End};
            {true, [_ | _]} -> {join_script, Ref + 1, Steps, End};
            {true, []} -> {join_script, Ref + 1, rested(Options), End}
        end,
    {[{port, Word}], Next}.

rested(Options) -> starl_create_script:rested(starl_create_options:waits(Options)).

%% @doc Everything comes to rest, with the pen like this.
-spec stop(starl_create_instructions:position(), t()) -> {[action()], t()}.
stop(Pen, #drive{options = Options} = Drive) ->
    case starl_create_instructions:is_on_robot(Options) of
        false ->
            script([], starl_create_instructions:resting(Pen, Options), Drive);
        true ->
            %% its wheels may be told later; a pen that is set meanwhile must not be set back then
            {Words, Next} = script([], starl_create_script:rest(), Drive),
            {[{port, {send, starl_create_instructions:pen(Pen, Options)}} | Words], Next}
    end.

%% @doc The script is void: nobody answers it.
-spec forget(t()) -> t().
forget(Drive) -> Drive#drive{leg = none, stands = false}.

%% @doc The port says what has become of a script. What comes of an older one is not heard.
-spec hear(starl_create_word:message(), starl_create_senses:t(), t()) -> {[action()], t()}.
hear({sent, Ref, At}, _Senses, #drive{ref = Ref, leg = #leg{} = Leg} = Drive) ->
    {[], Drive#drive{leg = sent(At, Leg)}};
hear({ended, Ref, At}, Senses, #drive{ref = Ref, leg = #leg{} = Leg} = Drive) ->
    ended(At, Senses, Drive#drive{leg = (sent(At, Leg))#leg{has_ended = true}});
hear({stopped, _Why, At}, Senses, #drive{leg = #leg{} = Leg} = Drive) ->
    ended(At, Senses, Drive#drive{leg = (sent(At, Leg))#leg{has_ended = true}});
hear(_Older, _Senses, Drive) ->
    {[], Drive}.

%% How much longer than planned did it last?
ended(At, Senses, #drive{leg = #leg{steps = Steps, heard = Heard} = Leg} = Drive) ->
    case At - Heard - starl_create_script:lasts_us(Steps) of
        Late when Late < -?FINE_US ->
            Cut = Drive#drive{leg = Leg#leg{is_cut = true}},
            {[{timer, rest, ?REST_MS - Late div 1000}], Cut};
        Late ->
            {Said, Warned} = careful(Late, Drive),
            {Answer, Next} = over(Senses, Warned),
            {Said ++ [{timer, rest, ?REST_MS} || Answer =:= []] ++ Answer, Next}
    end.

careful(Late, #drive{jitter_us = Jitter, options = Options} = Drive) ->
    Least = jitter_us(Options),
    Calmer = max(Least, round(?CALMER * Jitter)),
    Careful = Drive#drive{jitter_us = max(Calmer, min(?MOST_US, Late))},
    {[{say, warning, {late, Late}} || Late > Least], Careful}.

sent(At, #leg{heard = none} = Leg) -> Leg#leg{heard = At};
sent(_At, Leg) -> Leg.

%% @doc The time to come to rest is over.
-spec due(starl_create_senses:t(), t()) -> {[action()], t()}.
due(Senses, #drive{leg = #leg{has_ended = true} = Leg} = Drive) ->
    over(Senses, Drive#drive{leg = Leg#leg{may_rest = true}});
due(_Senses, Drive) ->
    {[], Drive}.

%% @doc A frame of the stream has come.
-spec watch(starl_create_senses:t(), t()) -> {[action()], t()}.
watch(_Senses, #drive{leg = none} = Drive) ->
    {[], Drive};
watch(Senses, #drive{leg = #leg{has_ended = true}} = Drive) ->
    over(Senses, Drive);
watch(Senses, #drive{options = Options, leg = Leg} = Drive) ->
    case starl_create_senses:is_stalled(maps:get(stops_at_bumps, Options, true), Senses) of
        true -> stalled(Senses, Drive);
        false -> {[], Drive#drive{leg = seen(Senses, Leg)}}
    end.

seen(Senses, #leg{heard = Heard, has_moved = Moved} = Leg) when is_integer(Heard) ->
    Leg#leg{has_moved = Moved orelse not starl_create_senses:is_at_rest(Senses)};
seen(_Senses, Leg) ->
    Leg.

%% A script is over when the robot says that it stands: the line may be slow.
over(Senses, #drive{leg = #leg{mark = Mark, heard = Heard} = Leg} = Drive) ->
    case may_be_over(Leg) andalso starl_create_senses:is_at_rest(Senses) of
        true -> {[{answer, Mark, {driven, Heard}}], (forget(Drive))#drive{stands = true}};
        false -> {[], Drive#drive{leg = seen(Senses, Leg)}}
    end.

may_be_over(#leg{has_moved = Moved, is_cut = Cut, may_rest = MayRest}) ->
    MayRest orelse (Moved andalso not Cut).

%% The pen stays as it is.
stalled(Senses, #drive{leg = #leg{mark = Mark} = Leg} = Drive) ->
    Told = told(starl_create_senses:readings(Senses), Leg),
    {Stop, Stopped} = script([], starl_create_script:rest(), Drive),
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
