%% @doc Checks the arguments that an application passes to `starl' and to the interfaces of the
%% blocks. An invalid argument is the caller's mistake: the call fails with an error that names
%% function, argument and application. Only the application's own process crashes.
-module(starl_caller).

-export([check/4, payload/4, mistake/4]).

-export_type([kind/0, mistake/0]).

%% The kind of an argument: milliseconds, from 0 or from 1; a number from 1; a robot; an atom; a
%% point of the floor; a velocity; a distance from 0; a sense; the name of a measure; a number; one from
%% 0; a list, and one with something in it.
-type kind() ::
    ms
    | positive_ms
    | ms_or_infinity
    | number
    | robot
    | name
    | point
    | velocity
    | distance
    | sense
    | key
    | value
    | deviation
    | list
    | items.

%% The reason of the error. `application' is `none' outside an application. A payload that may not
%% travel or be kept is not given, since it may be of any size; `why' says what is wrong with it.
-type mistake() ::
    {bad_argument, #{
        function := {module(), Name :: atom(), arity()},
        argument := Name :: atom(),
        given := term(),
        why => string(),
        expected := string(),
        application := module() | none
    }}.

%% The largest coordinate of a point, mm.
-define(FARTHEST, 1.0e9).
%% The largest value of a measure: whole numbers up to it are exact as a float.
-define(LARGEST, 1.0e15).

%% @doc Fails with a {@link mistake()} unless the argument is of its kind.
-spec check(mfa(), Argument :: atom(), kind(), Given :: term()) -> ok.
check(Function, Argument, Kind, Given) ->
    case is(Kind, Given) of
        true -> ok;
        false -> mistake(Function, Argument, Given, expected(Kind))
    end.

%% @doc Fails with a {@link mistake()} unless the argument is a payload of its kind.
-spec payload(mfa(), Argument :: atom(), starl_payload:kind(), Given :: term()) -> ok.
payload(Function, Argument, Kind, Given) ->
    case starl_payload:check(Kind, Given) of
        ok -> ok;
        {error, Reason} -> misused(Function, Argument, Kind, Reason)
    end.

-spec misused(mfa(), atom(), starl_payload:kind(), starl_payload:reason()) -> no_return().
misused(Function, Argument, Kind, Reason) ->
    Why = starl_payload:format_error(Kind, Reason),
    failed(Function, Argument, Reason, #{why => Why, expected => starl_payload:expected(Kind)}).

%% @doc Fails: the argument is invalid.
-spec mistake(mfa(), Argument :: atom(), Given :: term(), Expected :: string()) -> no_return().
mistake(Function, Argument, Given, Expected) ->
    failed(Function, Argument, Given, #{expected => Expected}).

-spec failed(mfa(), atom(), term(), map()) -> no_return().
failed(Function, Argument, Given, About) ->
    error(
        {bad_argument, About#{
            function => Function,
            argument => Argument,
            given => Given,
            application => starl_app_proc:application()
        }}
    ).

is(ms, Ms) -> is_integer(Ms) andalso Ms >= 0 andalso Ms =< longest_ms();
is(positive_ms, Ms) -> is(ms, Ms) andalso Ms > 0;
is(ms_or_infinity, Ms) -> Ms =:= infinity orelse is(positive_ms, Ms);
is(number, N) -> is_integer(N) andalso N > 0;
is(robot, Id) -> is_integer(Id) andalso Id > 0;
is(name, Name) -> is_atom(Name);
is(sense, Kind) -> starl_sense:is_kind(Kind);
is(key, Key) -> is_atom(Key) andalso is_key(atom_to_list(Key));
is(value, X) -> is_number(X) andalso X =< ?LARGEST andalso X >= -?LARGEST;
is(deviation, X) -> is(value, X) andalso X >= 0;
is(list, Items) -> length_of(Items) >= 0;
is(items, Items) -> length_of(Items) > 0;
is(distance, Mm) -> is_coordinate(Mm) andalso Mm >= 0;
is(velocity, Velocity) -> is(point, Velocity);
is(point, {X, Y}) -> is_coordinate(X) andalso is_coordinate(Y);
is(point, _) -> false.

is_coordinate(X) -> is_number(X) andalso X =< ?FARTHEST andalso X >= -?FARTHEST.

%% It becomes the name of a column.
is_key([First | Others]) when First >= $a, First =< $z -> lists:all(fun is_plain/1, Others);
is_key(_) -> false.

is_plain(C) -> (C >= $a andalso C =< $z) orelse (C >= $0 andalso C =< $9) orelse C =:= $_.

%% An improper list has none.
length_of(Items) ->
    try
        length(Items)
    catch
        error:badarg -> -1
    end.

longest_ms() -> starl_action:longest_us() div 1000.

expected(sense) ->
    lists:flatten(io_lib:format("one of ~0tp", [[K || {K, _} <- starl_sense:kinds()]]));
expected(Kind) ->
    maps:get(Kind, #{
        ms => "milliseconds: a whole number from 0",
        positive_ms => "milliseconds: a whole number from 1",
        ms_or_infinity => "milliseconds: a whole number from 1, or infinity",
        number => "a whole number from 1",
        robot => "a robot: a whole number from 1",
        name => "an atom",
        key => "an atom of small letters, digits and _",
        value => "a number within 1.0e15",
        deviation => "a number from 0 to 1.0e15",
        list => "a list",
        items => "a list that is not empty",
        distance => "a distance: a number from 0, mm",
        velocity => "a velocity {VX, VY}: two numbers, mm/s, within 1.0e9",
        point => "a point {X, Y}: two numbers, mm, within 1.0e9"
    }).
