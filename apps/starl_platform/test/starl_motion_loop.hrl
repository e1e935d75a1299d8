%% The motion machine, its chassis and its eyes in one closed loop (starl_motion_loop).
-record(loop, {
    profile :: map(),
    noise :: fun((term()) -> float()),
    machine :: term(),
    now = 0 :: integer(),
    timer = none :: none | {integer(), term()},
    piece :: term(),
    %% what the chassis still has to do: when, the rest of the script, its mark
    chassis = none :: none | {integer(), list(), term()},
    heard = 0 :: integer(),
    commands = [] :: list(),
    %% does the chassis hear the N-th command?
    ears = fun(_) -> heard end :: fun((integer()) -> heard | lost),
    %% positions at which a piece ended: between two of them the path is straight
    corners = [] :: list(),
    replies = [] :: list(),
    asked = 0 :: integer(),
    %% answers to the machine's own questions, for when its actions have been carried out
    local = [] :: list(),
    %% what becomes of the N-th question for the pose: seen, lost or unknown
    eyes = fun(_) -> seen end :: fun((integer()) -> atom())
}).
