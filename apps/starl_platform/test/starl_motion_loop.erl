%% The pure motion machine in a closed loop with a chassis and a positioning system whose errors are
%% bounded as the profile says. Time goes on from event to event.
-module(starl_motion_loop).

-export([fresh/0, new/2, uniform/1]).
-export([drive/2, goto/3, event/3, wheels/3, fire/1, until/2, finish/1]).

-include("starl_motion_loop.hrl").

fresh() -> new(uniform(7), starl_chassis:profile(starl_chassis_differential, #{})).

uniform(Seed) -> fun(Key) -> 2.0 * erlang:phash2({Seed, Key}, 1 bsl 27) / (1 bsl 27) - 1.0 end.

new(Noise, Profile) ->
    {Actions, Machine} = starl_machine:new(starl_motion, #{profiles => [Profile]}, #{
        robot => 1,
        participants => [1],
        name => motion,
        incarnation => 1,
        random => rand:seed_s(exsss, 1),
        now => 0
    }),
    perform(Actions, #loop{
        profile = Profile,
        noise = Noise,
        machine = Machine,
        corners = [{0.0, 0.0}],
        piece = starl_trajectory:standing(0, {0.0, 0.0}, 0.3)
    }).

drive(Goal, Loop) -> finish(goto(Goal, 1, Loop)).

goto(Goal, Tag, Loop) -> event({call, {app, Tag}}, {go_to, Goal}, Loop).

%% Until the machine rests; ten hours are too long.
finish(#loop{timer = none, chassis = none} = Loop) -> Loop;
finish(#loop{now = Now} = Loop) when Now < 36000000000 -> finish(fire(Loop)).

until(T, Loop) ->
    case due(Loop) =< T of
        true -> until(T, fire(Loop));
        false -> Loop#loop{now = T}
    end.

%% An atom is more than every number.
due(#loop{timer = Timer, chassis = Chassis}) -> min(at(Timer), at(Chassis)).

at(none) -> never;
at(Due) -> element(1, Due).

%% What comes first: the chassis goes on, or the timer expires.
fire(#loop{chassis = {Due, Script, Mark}, timer = Timer} = Loop) when
    Timer =:= none; Due =< element(1, Timer)
->
    go_on(Script, Mark, Loop#loop{now = Due, chassis = none});
fire(#loop{timer = {Due, Content}} = Loop) ->
    event(state_timeout, Content, Loop#loop{now = Due, timer = none}).

go_on([], Mark, #loop{heard = Heard} = Loop) ->
    event(info, {driven, Mark, Heard}, wheels(0.0, 0.0, Loop));
go_on(Script, Mark, Loop) ->
    turn(Script, Mark, Loop).

turn([{Left, Right, Us} | Rest], Mark, #loop{now = Now} = Loop) ->
    (wheels((Left + Right) / 2, Right - Left, Loop))#loop{chassis = {Now + Us, Rest, Mark}}.

event(Type, Content, #loop{machine = Machine, now = Now} = Loop) ->
    {Actions, Next} = starl_machine:step(Type, Content, #{now => Now, robot => 1}, Machine),
    perform(Actions, Loop#loop{machine = Next}).

perform(Actions, Loop) ->
    case lists:foldl(fun act/2, Loop, Actions) of
        #loop{local = []} = Done ->
            Done;
        #loop{local = Local} = Next ->
            lists:foldr(
                fun({Type, Content}, L) -> event(Type, Content, L) end, Next#loop{local = []}, Local
            )
    end.

act({drive, {_, Script}, Mark}, #loop{commands = Commands, ears = Ears} = Loop) ->
    Told = Loop#loop{commands = [{Mark, Script} | Commands]},
    case Ears(length(Commands)) of
        lost -> Told;
        heard -> obey(Script, Mark, Told#loop{heard = Told#loop.now})
    end;
act({trace, _}, Loop) ->
    Loop;
act({state_timeout, cancel}, Loop) ->
    Loop#loop{timer = none};
act({state_timeout, Us, Content}, #loop{now = Now} = Loop) ->
    Loop#loop{timer = {Now + Us, Content}};
act({reply, {app, _}, Answer}, #loop{now = Now, replies = Replies} = Loop) ->
    Loop#loop{replies = [{Now, Answer} | Replies]};
act({call, location, {pose, 1}, Tag}, #loop{asked = N, eyes = Eyes} = Loop) ->
    Asked = Loop#loop{asked = N + 1},
    case Eyes(N) of
        seen -> answer(Tag, {ok, blurred(Asked)}, Asked);
        unknown -> answer(Tag, {error, unknown}, Asked);
        lost -> Asked
    end.

obey([], Mark, #loop{local = Local, now = Now} = Loop) ->
    Stopped = wheels(0.0, 0.0, Loop),
    Stopped#loop{chassis = none, local = [{info, {driven, Mark, Now}} | Local]};
obey(Script, Mark, Loop) ->
    turn(Script, Mark, Loop).

answer(Tag, Answer, #loop{local = Local} = Loop) ->
    Loop#loop{local = [{{reply, Tag}, Answer} | Local]}.

%% The errors are shared out as the profile's bounds allow: the heading's between the drive and
%% the look at it.
wheels(Speed, Difference, #loop{now = Now, piece = Old, profile = Profile, noise = Noise} = Loop) ->
    {X, Y, Heading} = starl_trajectory:pose(Now, Old),
    #{heading_error := Turn, distance_error := Part, axle_mm := Axle} = Profile,
    Driving = Speed /= 0,
    Skew =
        case Driving of
            true -> 0.75 * Turn * Noise({skew, Now});
            false -> 0.0
        end,
    Slip = 1.0 + Part * Noise({slip, Now}),
    Piece = starl_trajectory:piece(Now, {X, Y}, Heading + Skew, Speed * Slip, Difference / Axle),
    Loop#loop{piece = Piece, corners = [{X, Y} | Loop#loop.corners]}.

blurred(#loop{now = Now, asked = N, piece = Piece, profile = Profile, noise = Noise}) ->
    {X, Y, Heading} = starl_trajectory:pose(Now, Piece),
    #{heading_error := Turn, position_error_mm := Error} = Profile,
    Angle = math:pi() * Noise({angle, N}),
    Radius = Error * abs(Noise({radius, N})),
    {
        X + Radius * math:cos(Angle),
        Y + Radius * math:sin(Angle),
        Heading + 0.25 * Turn * Noise({heading, N})
    }.
