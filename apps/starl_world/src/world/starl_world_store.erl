%% @doc Loses or sets back the store of a live robot on the disk. Losing stands for a replaced card,
%% setting back for a restored image. The record of the robot's facts lies in the same directory and
%% stays: it is not part of the robot, but a witness.
%%
%% The store is copied before each start of a robot. A store that is set back becomes that copy, so
%% the last start and everything since are undone. Before the first start there was no store: then
%% it is lost. (The mark that the store was commissioned is written once, and is not copied.)
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
