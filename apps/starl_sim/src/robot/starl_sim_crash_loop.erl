%% @doc Detects that it is hopeless to restart the application of a robot. The application is given
%% up after twenty equal crashes in a row. Three are enough if its step goes on for ever without
%% letting time pass.
%%
%% Crashes are equal if they have the same cause and nothing has changed: the robot has moved less
%% than 100 mm and the application has stored nothing new. In addition, either no time has passed
%% between the crashes, or each run of the application completed the same number of steps.
%%
%% An application that crashes now and then, even always from the same cause, is not hopeless,
%% because its runs differ.
-module(starl_sim_crash_loop).

-export([new/0, crashed/2]).

-export_type([t/0, crash/0]).

%% A crash of the application by itself. `steps': completed in this life.
-type crash() :: #{
    cause := starl_crash:cause(),
    %% did a step go on and on without letting time pass?
    endless := boolean(),
    steps := non_neg_integer() | unknown,
    at_us := starl_sim_queue:time(),
    pose := starl:pose(),
    stored := starl_machine:stored()
}.

%% The first crash of a row, the time of the last one, and their number.
-opaque t() :: none | {crash(), LastUs :: starl_sim_queue:time(), N :: pos_integer()}.

-define(MOST, 20).
%% A step without an end costs much real time each time.
-define(MOST_ENDLESS, 3).
%% A robot that stands may be pushed a little by its next command to go where it is.
-define(MOVED_MM, 100.0).

%% @doc No crash yet.
-spec new() -> t().
new() -> none.

%% @doc The application has crashed once more.
-spec crashed(crash(), t()) -> {goes_on | hopeless, t()}.
crashed(#{at_us := Now} = Crash, {First, Last, N}) ->
    case is_like(First, Crash) andalso (Now =:= Last orelse has_same_steps(First, Crash)) of
        true when N + 1 >= ?MOST; N + 1 >= ?MOST_ENDLESS, map_get(endless, Crash) ->
            {hopeless, {First, Now, N + 1}};
        true ->
            {goes_on, {First, Now, N + 1}};
        false ->
            crashed(Crash, none)
    end;
crashed(#{at_us := Now} = Crash, none) ->
    {goes_on, {Crash, Now, 1}}.

is_like(#{cause := Cause, stored := Stored} = First, #{cause := Cause, stored := Stored} = Crash) ->
    #{pose := {X0, Y0, _}} = First,
    #{pose := {X1, Y1, _}} = Crash,
    starl_geometry:distance({X0, Y0}, {X1, Y1}) < ?MOVED_MM;
is_like(_, _) ->
    false.

has_same_steps(#{steps := Steps}, #{steps := Steps}) -> is_integer(Steps);
has_same_steps(_, _) -> false.
