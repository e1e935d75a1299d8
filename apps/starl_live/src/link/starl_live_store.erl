%% @doc The durable store of a live robot. It is a directory with one file for each term that a
%% machine keeps, and two copies of the numbers of starts of all machines.
%%
%% A new file is written beside its predecessor and then takes its name, and both are synced. So a
%% robot that loses its power finds the old term or the new term, and never an older one. Each file
%% carries a checksum.
%%
%% <em>The first life.</em> A new team's store is commissioned for each robot, with a mark. Only a
%% robot that finds that mark and nothing else has never run. A robot that finds nothing at all has
%% lost its store: it may have kept any term. A robot that finds terms but no starts has lost its
%% store, too. The mark goes with the first start.
%%
%% <em>An outdated store.</em> A store is marked as outdated if it was lost, or if the robot's peers
%% know that it is older than the robot's last life. Then each term counts as damaged until its
%% machine has written a new one.
-module(starl_live_store).

-export([commission/1, is_mark/1, open/1, life/1, keep/3, kept/2, starts/1, started/2, outdate/2]).

-export_type([t/0]).

-record(store, {
    dir :: starl_live_disk:place(),
    life :: first | later,
    outdated :: boolean(),
    %% the number of a life that an outdated store does not know of
    outlived :: non_neg_integer()
}).

-opaque t() :: #store{}.

-define(MAGIC, "starl-1 ").
-define(SUFFIX, ".kept").
-define(COPIES, ["starts-a", "starts-b"]).
%% Marks: the robot has never run; its terms are to be removed; they have been.
-define(COMMISSIONED, "commissioned").
-define(OUTDATING, "outdating").
-define(OUTDATED, "outdated").

%% @doc Marks a robot's store as that of a robot that has never run, when a team begins. The
%% directory is made if there is none.
-spec commission(starl_live_disk:place()) -> ok | {error, unicode:chardata()}.
commission(Dir) ->
    Written = first_error(starl_live_disk:ensure_path(Dir), fun() ->
        write(starl_live_disk:place(Dir, ?COMMISSIONED), true)
    end),
    explained(Written, Dir).

%% @doc Is this the file of that mark?
-spec is_mark(string()) -> boolean().
is_mark(Name) -> Name =:= ?COMMISSIONED.

%% @doc Opens the store in this directory, which is made if there is none.
-spec open(starl_live_disk:place()) -> {ok, t()} | {error, unicode:chardata()}.
open(Dir) ->
    case first_error(starl_live_disk:ensure_path(Dir), fun() -> emptied(Dir) end) of
        ok -> opened(Dir);
        {error, Posix} -> failure(Posix, Dir)
    end.

opened(Dir) ->
    case {life(copies(Dir), Dir), read(starl_live_disk:place(Dir, ?OUTDATED))} of
        {lost, none} -> lost(Dir);
        {first, none} -> {ok, #store{dir = Dir, life = first, outdated = false, outlived = 0}};
        {_, none} -> {ok, #store{dir = Dir, life = later, outdated = false, outlived = 0}};
        {_, {ok, N}} -> {ok, #store{dir = Dir, life = later, outdated = true, outlived = N}};
        {_, damaged} -> {ok, #store{dir = Dir, life = later, outdated = true, outlived = 0}}
    end.

life([none, none], Dir) ->
    IsNew = starl_live_disk:list(Dir, ?SUFFIX) =:= [],
    case starl_live_disk:is_file(starl_live_disk:place(Dir, ?COMMISSIONED)) of
        true when IsNew -> first;
        _ -> lost
    end;
life([_, _], _Dir) ->
    later.

lost(Dir) ->
    logger:error(#{what => store_lost, dir => starl_live_disk:name(Dir)}),
    case first_error(write(starl_live_disk:place(Dir, ?OUTDATING), 0), fun() -> emptied(Dir) end) of
        ok -> opened(Dir);
        {error, Posix} -> failure(Posix, Dir)
    end.

%% Removes the terms of an outdated store. Its mark is there before and after.
emptied(Dir) ->
    Outdating = starl_live_disk:place(Dir, ?OUTDATING),
    case starl_live_disk:is_file(Outdating) of
        false ->
            ok;
        true ->
            Terms = [
                starl_live_disk:place(Dir, File)
             || File <- starl_live_disk:list(Dir, ?SUFFIX)
            ],
            Removed = lists:foldl(
                fun(File, So) -> first_error(So, fun() -> starl_live_disk:delete(File) end) end,
                ok,
                Terms
            ),
            first_error(Removed, fun() ->
                renamed(Outdating, starl_live_disk:place(Dir, ?OUTDATED))
            end)
    end.

%% @doc The robot's peers know a later life of it than its store does, with this number: when the
%% store is opened the next time, all terms count as damaged.
-spec outdate(Number :: pos_integer(), t()) -> ok | {error, unicode:chardata()}.
outdate(Number, #store{dir = Dir}) ->
    explained(write(starl_live_disk:place(Dir, ?OUTDATING), Number), Dir).

%% @doc Has the robot ever run before?
-spec life(t()) -> first | later.
life(#store{life = Life}) -> Life.

%% @doc Keeps a term for a machine in place of its earlier term; `full': nothing is written.
-spec keep(starl_machine:name(), term(), t()) -> ok | full.
keep(Name, Term, #store{dir = Dir}) ->
    case write(file(Name, Dir), Term) of
        ok ->
            ok;
        {error, Why} ->
            Report = #{what => store_failed, machine => Name, why => Why},
            logger:error(Report, #{report_cb => fun failed/1}),
            full
    end.

failed(#{machine := Name, why := Why}) ->
    {"what ~ts wanted to store was not stored: ~ts", [Name, file:format_error(Why)]}.

%% @doc The stored term for a machine that starts now.
-spec kept(starl_machine:name(), t()) -> starl_machine:stored().
kept(Name, #store{dir = Dir, outdated = Outdated}) ->
    case read(file(Name, Dir)) of
        {ok, Term} -> {stored, Term};
        none when Outdated -> damaged;
        none -> none;
        damaged -> damaged
    end.

%% @doc The number of starts of each machine so far, as far as it is known.
-spec starts(t()) -> #{starl_machine:name() => pos_integer()}.
starts(#store{dir = Dir, outlived = N}) ->
    Readable = [Starts || {ok, Starts} <- copies(Dir)],
    maps:map(fun(_, Start) -> max(N, Start) end, lists:foldl(fun later/2, #{}, Readable)).

copies(Dir) -> [read(starl_live_disk:place(Dir, Copy)) || Copy <- ?COPIES].

later(Some, Others) -> maps:merge_with(fun(_, A, B) -> max(A, B) end, Some, Others).

%% @doc Makes the numbers of starts durable: the robot has run.
-spec started(#{starl_machine:name() => pos_integer()}, t()) -> ok | {error, unicode:chardata()}.
started(Starts, #store{dir = Dir}) ->
    Written = lists:foldl(
        fun(Copy, So) ->
            first_error(So, fun() -> write(starl_live_disk:place(Dir, Copy), Starts) end)
        end,
        ok,
        ?COPIES
    ),
    explained(
        first_error(Written, fun() -> removed(starl_live_disk:place(Dir, ?COMMISSIONED)) end), Dir
    ).

removed(File) ->
    case starl_live_disk:delete(File) of
        ok -> synced(starl_live_disk:dirname(File));
        {error, enoent} -> ok;
        {error, _} = Error -> Error
    end.

explained(ok, _Dir) ->
    ok;
explained({error, Posix}, Dir) ->
    failure(Posix, Dir).

failure(Posix, Dir) -> {error, [starl_live_disk:name(Dir), ": ", file:format_error(Posix)]}.

%% -- files ----------------------------------------------------------------------------------

file(Name, Dir) -> starl_live_disk:place(Dir, uri_string:quote(atom_to_list(Name)) ++ ?SUFFIX).

write(File, Term) ->
    Content = term_to_binary(Term),
    New = starl_live_disk:suffixed(File, ".new"),
    case starl_live_disk:open(New, [write, raw, binary]) of
        {ok, Device} -> named(filled(Device, Content), New, File);
        {error, _} = Error -> Error
    end.

filled(Device, Content) ->
    Written = starl_live_disk:write(Device, [?MAGIC, <<(erlang:crc32(Content)):32>>, Content]),
    Synced = first_error(Written, fun() -> starl_live_disk:sync(Device) end),
    first_error(Synced, fun() -> starl_live_disk:close(Device) end).

named(ok, New, File) ->
    renamed(New, File);
named({error, _} = Error, New, _File) ->
    _ = starl_live_disk:delete(New),
    Error.

renamed(From, To) ->
    first_error(starl_live_disk:rename(From, To), fun() -> synced(starl_live_disk:dirname(To)) end).

%% A new name outlives a power cut only when its directory has been synced.
synced(Dir) ->
    case starl_live_disk:open(Dir, [raw, read, directory]) of
        {ok, Device} ->
            Synced = starl_live_disk:sync(Device),
            first_error(Synced, fun() -> starl_live_disk:close(Device) end);
        {error, _} = Error ->
            Error
    end.

first_error(ok, Next) -> Next();
first_error({error, _} = Error, _Next) -> Error.

read(File) ->
    case starl_live_disk:read_file(File) of
        {ok, <<?MAGIC, Sum:32, Content/binary>>} -> checked(Sum, Content);
        {ok, _} -> damaged;
        {error, enoent} -> none;
        {error, _} -> damaged
    end.

%% The robot's own file: its atoms may be new to this VM.
checked(Sum, Content) ->
    case erlang:crc32(Content) of
        Sum -> {ok, binary_to_term(Content)};
        _ -> damaged
    end.
