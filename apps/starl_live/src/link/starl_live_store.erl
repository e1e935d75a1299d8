%% @doc The durable store of a live robot: a directory with one file for each term that a machine
%% keeps, and the numbers of starts of all machines, twice.
%%
%% A file is written beside its predecessor and then takes its name, so a robot that loses its power
%% finds the old term or the new one. Each file carries a checksum. If both copies of the numbers are
%% unreadable, the robot goes on with numbers that no robot has reached: the seconds since 1970. So
%% its peers never take it for an earlier incarnation of itself.
-module(starl_live_store).

-export([open/1, keep/3, kept/2, starts/1, started/2]).

-export_type([t/0]).

-record(store, {dir :: starl_live_disk:place()}).

-opaque t() :: #store{}.

-define(MAGIC, "starl-1 ").
-define(SUFFIX, ".kept").
-define(COPIES, ["starts-a", "starts-b"]).

%% @doc Opens the store in this directory, which is made if there is none.
-spec open(starl_live_disk:place()) -> {ok, t()} | {error, unicode:chardata()}.
open(Dir) ->
    case starl_live_disk:ensure_path(Dir) of
        ok -> {ok, #store{dir = Dir}};
        {error, Posix} -> {error, [starl_live_disk:name(Dir), ": ", file:format_error(Posix)]}
    end.

%% @doc Keeps a term for a machine in place of its earlier term; `full': nothing is written.
-spec keep(starl_machine:name(), term(), t()) -> ok | full.
keep(Name, Term, #store{dir = Dir}) ->
    case write(file(Name, Dir), Term) of
        ok ->
            ok;
        {error, Why} ->
            logger:error(#{what => store_failed, machine => Name, why => Why}),
            full
    end.

%% @doc The stored term for a machine that starts now.
-spec kept(starl_machine:name(), t()) -> starl_machine:stored().
kept(Name, #store{dir = Dir}) ->
    case read(file(Name, Dir)) of
        {ok, Term} -> {stored, Term};
        none -> none;
        damaged -> damaged
    end.

%% @doc The number of starts of each machine so far.
-spec starts(t()) -> #{starl_machine:name() => pos_integer()}.
starts(#store{dir = Dir}) ->
    Copies = [read(starl_live_disk:place(Dir, Copy)) || Copy <- ?COPIES],
    case {[Starts || {ok, Starts} <- Copies], lists:member(damaged, Copies)} of
        {[], false} -> #{};
        {[], true} -> unheard_of(Dir);
        {Readable, _} -> lists:foldl(fun later/2, #{}, Readable)
    end.

later(Some, Others) -> maps:merge_with(fun(_, A, B) -> max(A, B) end, Some, Others).

unheard_of(Dir) ->
    logger:error(#{what => starts_damaged, dir => starl_live_disk:name(Dir)}),
    Names = [list_to_existing_atom(unquoted(File)) || File <- starl_live_disk:list(Dir, ?SUFFIX)],
    maps:from_list([{Name, erlang:system_time(second)} || Name <- [sap | Names]]).

%% @doc Makes the numbers of starts durable.
-spec started(#{starl_machine:name() => pos_integer()}, t()) -> ok | {error, unicode:chardata()}.
started(Starts, #store{dir = Dir}) ->
    Written = [write(starl_live_disk:place(Dir, Copy), Starts) || Copy <- ?COPIES],
    case lists:usort(Written) of
        [ok] -> ok;
        [{error, Why} | _] -> {error, [starl_live_disk:name(Dir), ": ", file:format_error(Why)]};
        [ok, {error, Why} | _] -> {error, [starl_live_disk:name(Dir), ": ", file:format_error(Why)]}
    end.

%% -- files ----------------------------------------------------------------------------------

file(Name, Dir) ->
    starl_live_disk:place(Dir, uri_string:quote(atom_to_list(Name)) ++ ?SUFFIX).

unquoted(File) -> uri_string:unquote(filename:basename(File, ?SUFFIX)).

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
