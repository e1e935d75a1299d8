%% @doc A simulated disk for live robots ({@link starl_live_disk}). At a power cut, changes that
%% were not synced may be lost.
%%
%% Programs see all changes at once. A power cut leaves:
%% <ul>
%% <li>the content of a file as of its last sync; if the file was written since then: that content,
%%   nothing, the new content, or its beginning,</li>
%% <li>the names of a directory as of its last sync, and of the changes since then (new, renamed and
%%   deleted files) the first few, in their order: the journal of a file system.</li>
%% </ul>
%% The disk can be full, fail, and lose its power at its N-th operation: then the calling process
%% throws {@link power_cut()}. All draws come from a seed.
%%
%% The disks are in the dictionary of the process that runs the simulation: an operation of the
%% robot's program on a disk is an effect, as with a real disk.
-module(starl_virtual_disk).
-behaviour(starl_live_disk).

-export([new/2, cut_after/3, keep_power/1, cut_power/1, suffer/2, operations/1]).
-export([erase/1, save/2, set_back/2, name_of/1]).
-export([ensure_path/1, list/2, is_file/1]).
-export([open/2, write/2, sync/1, close/1, rename/2, delete/1, read_file/1]).

-export_type([name/0, power_cut/0, moment/0, trouble/0]).

%% The first part of the paths on the disk.
-type name() :: string().

%% Thrown when the power goes in the middle of an operation.
-type power_cut() :: {starl_power_cut, name()}.

%% When the power may go: before or after any operation; only before one that makes nothing durable, so
%% that a file is replaced or is not, and whoever has asked for it has been told.
-type moment() :: any | between.

%% Nothing; there is no room; this part of writes and syncs fails; this part of the reads finds damage.
-type trouble() :: none | full | {fails, Part :: float()} | {damaged, Suffix :: string()}.

-type inode() :: pos_integer().
-type change() :: {link, string(), inode()} | {unlink, string()} | {rename, string(), string()}.

-record(disk, {
    random :: rand:state(),
    trouble = none :: trouble(),
    %% the operations so far, and the one at which the power goes
    count = 0 :: non_neg_integer(),
    cut = none :: {pos_integer(), moment()} | none,
    %% what programs see, and what has been synced
    content = #{} :: #{inode() => binary()},
    synced = #{} :: #{inode() => binary()},
    names = #{} :: #{string() => inode()},
    synced_names = #{} :: #{string() => inode()},
    %% the changes of names since, newest first
    changes = [] :: [change()],
    images = #{} :: #{Image :: atom() => image()}
}).

%% The files of a disk without power.
-type image() :: {#{inode() => binary()}, #{string() => inode()}}.

%% @doc An empty disk in the place of one of this name.
-spec new(name(), Seed :: term()) -> ok.
new(Name, Seed) ->
    Random = rand:seed_s(exsss, erlang:phash2(Seed, 4294967296)),
    store(Name, #disk{random = Random}).

%% @doc The power goes at the N-th operation from now on, or at the first later one at which it may.
-spec cut_after(name(), pos_integer(), moment()) -> ok.
cut_after(Name, N, Moment) ->
    change(Name, fun(#disk{count = Count} = Disk) -> Disk#disk{cut = {Count + N, Moment}} end).

%% @doc The power does not go.
-spec keep_power(name()) -> ok.
keep_power(Name) -> change(Name, fun(Disk) -> Disk#disk{cut = none} end).

%% @doc The disk has this trouble from now on.
-spec suffer(name(), trouble()) -> ok.
suffer(Name, Trouble) -> change(Name, fun(Disk) -> Disk#disk{trouble = Trouble} end).

%% @doc The number of operations so far.
-spec operations(name()) -> non_neg_integer().
operations(Name) -> (fetch(Name))#disk.count.

%% @doc There is another disk in its place, an empty one.
-spec erase(name()) -> ok.
erase(Name) -> change(Name, fun(Disk) -> holding({#{}, #{}}, Disk) end).

%% @doc Takes an image of the disk, which is without power.
-spec save(Image :: atom(), name()) -> ok.
save(Image, Name) ->
    change(Name, fun(#disk{synced = Content, synced_names = Names, images = Images} = Disk) ->
        Disk#disk{images = Images#{Image => {Content, Names}}}
    end).

%% @doc The disk is as it was when that image was taken; without it, nothing changes.
-spec set_back(Image :: atom(), name()) -> ok | none.
set_back(Image, Name) ->
    case (fetch(Name))#disk.images of
        #{Image := Files} -> change(Name, fun(Disk) -> holding(Files, Disk) end);
        #{} -> none
    end.

holding({Content, Names}, Disk) ->
    Disk#disk{
        content = Content, synced = Content, names = Names, synced_names = Names, changes = []
    }.

%% @doc The power goes: what was not synced may be lost.
-spec cut_power(name()) -> ok.
cut_power(Name) -> change(Name, fun after_cut/1).

after_cut(#disk{changes = Changes, random = Random0} = Disk) ->
    {N, Random1} = rand:uniform_s(length(Changes) + 1, Random0),
    Kept = lists:sublist(lists:reverse(Changes), N - 1),
    Names = lists:foldl(fun changed/2, Disk#disk.synced_names, Kept),
    Inodes = lists:sort(maps:values(Names)),
    {Contents, Random} = lists:mapfoldl(
        fun(Inode, R) -> survives(Inode, Disk, R) end, Random1, Inodes
    ),
    holding({maps:from_list(Contents), Names}, Disk#disk{random = Random, cut = none}).

changed({link, Name, Inode}, Names) -> Names#{Name => Inode};
changed({unlink, Name}, Names) -> maps:remove(Name, Names);
changed({rename, From, To}, Names) -> renamed(From, To, Names).

%% One change: there is no moment at which the file has both names or none.
renamed(From, To, Names) ->
    {Inode, Left} = maps:take(From, Names),
    Left#{To => Inode}.

survives(Inode, #disk{content = Contents, synced = Synced}, Random0) ->
    Content = maps:get(Inode, Contents),
    case maps:get(Inode, Synced, <<>>) of
        Content ->
            {{Inode, Content}, Random0};
        Before ->
            {Fate, Random1} = rand:uniform_s(4, Random0),
            {Part, Random} = rand:uniform_s(byte_size(Content) + 1, Random1),
            Left =
                case Fate of
                    1 -> Before;
                    2 -> <<>>;
                    3 -> Content;
                    4 -> binary:part(Content, 0, Part - 1)
                end,
            {{Inode, Left}, Random}
    end.

%% -- the functions of files -----------------------------------------------------------------

-spec ensure_path(string()) -> ok | {error, file:posix()}.
ensure_path(Path) -> on(Path, fun(Disk) -> {ok, Disk} end).

-spec list(string(), string()) -> [string()].
list(Path, Suffix) ->
    #disk{names = Names} = fetch(name_of(Path)),
    lists:sort([
        filename:basename(File)
     || File <- maps:keys(Names), filename:dirname(File) =:= Path, lists:suffix(Suffix, File)
    ]).

-spec is_file(string()) -> boolean().
is_file(Path) -> is_map_key(Path, (fetch(name_of(Path)))#disk.names).

-spec open(string(), [term()]) -> {ok, {name(), inode() | directory}} | {error, file:posix()}.
open(Path, Modes) ->
    {_, _} = opening(Path, Modes).

opening(Path, Modes) ->
    case {lists:member(directory, Modes), lists:member(write, Modes)} of
        %% a directory is opened when one of its files has got a new name
        {true, _} -> on(Path, weighty, fun(D) -> {{ok, {name_of(Path), directory}}, D} end);
        {false, true} -> on(Path, fun(Disk) -> create(Path, Disk) end);
        {false, false} -> on(Path, fun(Disk) -> opened(Path, Disk) end)
    end.

opened(Path, #disk{names = Names} = Disk) ->
    case Names of
        #{Path := Inode} -> {{ok, {name_of(Path), Inode}}, Disk};
        #{} -> {{error, enoent}, Disk}
    end.

%% A file that exists is emptied, which is a change of its content, and not of its name.
create(Path, #disk{names = Names, content = Content} = Disk) ->
    case Names of
        #{Path := Inode} ->
            {{ok, {name_of(Path), Inode}}, Disk#disk{content = Content#{Inode := <<>>}}};
        #{} ->
            Inode = Disk#disk.count,
            Linked = linked(Path, Inode, Disk),
            {{ok, {name_of(Path), Inode}}, Linked#disk{content = Content#{Inode => <<>>}}}
    end.

linked(Path, Inode, #disk{names = Names, changes = Changes} = Disk) ->
    Disk#disk{names = Names#{Path => Inode}, changes = [{link, Path, Inode} | Changes]}.

unlinked(Path, #disk{names = Names, changes = Changes} = Disk) ->
    Disk#disk{names = maps:remove(Path, Names), changes = [{unlink, Path} | Changes]}.

-spec write({name(), inode()}, iodata()) -> ok | {error, file:posix()}.
write({Name, Inode}, Bytes) ->
    on(Name, fun(Disk) -> risky(Disk, fun(D) -> written(Inode, Bytes, D) end) end).

written(_Inode, _Bytes, #disk{trouble = full} = Disk) ->
    {{error, enospc}, Disk};
written(Inode, Bytes, #disk{content = Content} = Disk) ->
    Before = maps:get(Inode, Content),
    {ok, Disk#disk{content = Content#{Inode := iolist_to_binary([Before, Bytes])}}}.

%% A directory keeps its names, a file its content.
-spec sync({name(), inode() | directory}) -> ok | {error, file:posix()}.
sync({Name, What}) ->
    Weight =
        case What of
            directory -> weighty;
            _ -> slight
        end,
    on(Name, Weight, fun(Disk) -> risky(Disk, fun(D) -> synced(What, D) end) end).

synced(directory, #disk{names = Names} = Disk) ->
    {ok, Disk#disk{synced_names = Names, changes = []}};
synced(Inode, #disk{content = Content, synced = Synced} = Disk) ->
    {ok, Disk#disk{synced = Synced#{Inode => maps:get(Inode, Content)}}}.

-spec close({name(), inode() | directory}) -> ok.
close({_Name, _What}) -> ok.

-spec rename(string(), string()) -> ok | {error, file:posix()}.
rename(From, To) ->
    on(From, weighty, fun(Disk) -> risky(Disk, fun(D) -> moved(From, To, D) end) end).

moved(From, To, #disk{names = Names, changes = Changes} = Disk) ->
    case is_map_key(From, Names) of
        true ->
            Moved = renamed(From, To, Names),
            {ok, Disk#disk{names = Moved, changes = [{rename, From, To} | Changes]}};
        false ->
            {{error, enoent}, Disk}
    end.

-spec delete(string()) -> ok | {error, file:posix()}.
delete(Path) ->
    on(Path, fun(#disk{names = Names} = Disk) ->
        case is_map_key(Path, Names) of
            true -> {ok, unlinked(Path, Disk)};
            false -> {{error, enoent}, Disk}
        end
    end).

-spec read_file(string()) -> {ok, binary()} | {error, file:posix()}.
read_file(Path) ->
    {_, _} = on(Path, fun(#disk{names = Names, content = Content, trouble = Trouble} = Disk) ->
        case Names of
            #{Path := Inode} -> {{ok, shown(Path, Trouble, maps:get(Inode, Content))}, Disk};
            #{} -> {{error, enoent}, Disk}
        end
    end).

shown(Path, {damaged, Suffix}, <<Content/binary>>) ->
    case lists:suffix(Suffix, Path) of
        true -> flipped(Content);
        false -> Content
    end;
shown(_Path, _Trouble, Content) ->
    Content.

%% The last byte is another one.
flipped(<<>>) ->
    <<0>>;
flipped(Content) ->
    Size = byte_size(Content) - 1,
    <<Before:Size/binary, Last>> = Content,
    <<Before/binary, (Last bxor 1)>>.

%% -- the disks ------------------------------------------------------------------------------

on(Path, Operation) -> on(Path, slight, Operation).

%% Is this an operation that can make something durable?
on(Path, Weight, Operation) ->
    Name = name_of(Path),
    #disk{count = Count, cut = Cut} = Disk = fetch(Name),
    Next = Disk#disk{count = Count + 1},
    case Cut of
        {N, any} when Count >= N - 1 ->
            {Done, Random} = rand:uniform_s(2, Disk#disk.random),
            cut_at(Name, Done, Operation, Next#disk{random = Random});
        {N, between} when Count >= N - 1, Weight =:= slight ->
            cut_at(Name, 1, Operation, Next);
        _ ->
            {Answer, Changed} = Operation(Next),
            ok = store(Name, Changed),
            Answer
    end.

%% The power may go before an operation (1) or after it (2).
-spec cut_at(name(), 1 | 2, fun((#disk{}) -> {term(), #disk{}}), #disk{}) -> no_return().
cut_at(Name, 1, _Operation, Disk) ->
    ok = store(Name, Disk#disk{cut = none}),
    throw({starl_power_cut, Name});
cut_at(Name, 2, Operation, Disk) ->
    {_Answer, Last} = Operation(Disk),
    cut_at(Name, 1, Operation, Last).

risky(#disk{trouble = {fails, Part}, random = Random0} = Disk, Operation) ->
    {Drawn, Random} = rand:uniform_s(Random0),
    case Drawn < Part of
        true -> {{error, eio}, Disk#disk{random = Random}};
        false -> Operation(Disk#disk{random = Random})
    end;
risky(Disk, Operation) ->
    Operation(Disk).

%% @doc The disk of a path.
-spec name_of(string()) -> name().
name_of(Path) -> lists:takewhile(fun(C) -> C =/= $/ end, Path).

fetch(Name) -> get({?MODULE, Name}).

store(Name, Disk) ->
    _ = put({?MODULE, Name}, Disk),
    ok.

change(Name, Change) -> store(Name, Change(fetch(Name))).
