%% @doc Prepares the drivers of the user's own chassis, named `FILE.erl' or `exec:PROGRAM' in a
%% choice, before a run starts. Sources are compiled and checked. Programs are started once and must
%% send their hello.
-module(starl_world_drivers).

-export([resolve/3, lines/3]).

-export_type([t/0]).

%% The drivers by their names, and the modules that were compiled for them.
-type t() :: #{
    drivers := #{starl_chassis_choice:name() => starl_live_link:adapter()},
    code := [starl_version:code()]
}.

%% @doc The user's own chassis of a choice, with the profiles that the robots will have.
-spec resolve(starl_chassis_choice:t(), starl_chassis:profiles(), starl_live_own:compile()) ->
    {ok, t()} | {error, [unicode:chardata(), ...]}.
resolve(Choice, Profiles, Compile) ->
    Names = lists:zip(starl_chassis_choice:in_turn(Choice), Profiles),
    Own = lists:usort([{N, P} || {N, P} <- Names, starl_chassis_choice:own(N) =/= none]),
    All = [{Name, resolved(Name, Profile, Compile)} || {Name, Profile} <- Own],
    case [["--chassis: ", Why] || {_, {error, Lines}} <- All, Why <- Lines] of
        [] ->
            {ok, #{
                drivers => maps:from_list([{Name, Driver} || {Name, {ok, Driver, _}} <- All]),
                code => lists:append([Code || {_, {ok, _, Code}} <- All])
            }};
        Problems ->
            {error, Problems}
    end.

resolved(Name, Profile, Compile) ->
    case starl_live_own:driver(Name, Compile) of
        {ok, {starl_live_exec, _} = Driver, Code} -> tried(Driver, Code, Profile);
        Answer -> Answer
    end.

%% Is it there, and can it do what the robots are to do?
tried({Module, Own} = Driver, Code, Profile) ->
    _ = process_flag(trap_exit, true),
    Clock = starl_live_clock:new(erlang:system_time(microsecond), 1),
    case Module:open(Own#{robot => 1, clock => Clock, profile => Profile}) of
        {ok, State} ->
            ok = Module:close(Module:stop(State)),
            {ok, Driver, Code};
        {error, Why} ->
            {error, [Why]}
    end.

%% @doc The chassis of each robot of a run: of the user's own, or else that of these lines, or one of the
%% world.
-spec lines(starl_chassis_choice:t(), t(), starl_world_chassis:lines() | undefined) ->
    starl_world_chassis:lines() | undefined.
lines(_Choice, #{drivers := None}, Others) when map_size(None) =:= 0 ->
    Others;
lines(Choice, #{drivers := Drivers}, Others) ->
    fun(Robot, World) ->
        case maps:find(starl_chassis_choice:of_robot(Robot, Choice), Drivers) of
            {ok, Driver} -> {starl_world_own, #{world => World, own => Driver}};
            error when Others =:= undefined -> {starl_world_chassis, #{world => World}};
            error -> Others(Robot, World)
        end
    end.
