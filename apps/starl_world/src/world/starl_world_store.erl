%% @doc The store of a live robot on the disk, as something that can be lost (a card is replaced)
%% or set back (an image is put back). The record of its facts lies in the same directory and stays:
%% it is no part of the robot, but a witness.
%%
%% Before each start of a robot the store is copied. A store that is set back becomes that copy: the
%% last start, and everything since, has not been. Before the first start there was none: then the
%% store is lost. (That it was commissioned is told once, and not copied.)
-module(starl_world_store).

-export([before_start/2]).

-define(COPY, ".earlier").

%% @doc The robot is about to start, and this has become of its store.
-spec before_start(starl_world_faults:fate(), #{dir := file:filename(), atom() => term()}) -> ok.
before_start(kept, #{dir := Dir}) ->
    ok = emptied(Dir ++ ?COPY),
    copied(Dir, Dir ++ ?COPY);
before_start(lost, #{dir := Dir}) ->
    ok = emptied(Dir),
    emptied(Dir ++ ?COPY);
before_start(set_back, #{dir := Dir}) ->
    ok = emptied(Dir),
    copied(Dir ++ ?COPY, Dir).

emptied(Dir) ->
    lists:foreach(fun(Name) -> ok = file:delete(filename:join(Dir, Name)) end, files(Dir)).

copied(From, To) ->
    ok = filelib:ensure_path(To),
    Copy = fun(Name) -> {ok, _} = file:copy(filename:join(From, Name), filename:join(To, Name)) end,
    lists:foreach(Copy, files(From)).

files(Dir) ->
    [
        Name
     || Name <- filelib:wildcard("*", Dir),
        filelib:is_regular(filename:join(Dir, Name)),
        not starl_live_record:is_record(Name),
        not starl_live_store:is_mark(Name)
    ].
