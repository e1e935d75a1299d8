%% @doc Several emulated Creates in one room ({@link starl_create_room}), each behind a pty of its own.
-module(starl_create_on_ptys).

-export([start_link/1, format_error/1]).

-export_type([options/0, reason/0]).

%% The options of each robot are those of {@link starl_create_emulated}. `link': links to the devices,
%% with `%d' for the number of the robot. One robot without walls stands in no room.
-type options() :: #{
    model := starl_create_packet:model(),
    robots := pos_integer(),
    arena := starl_world_floor:arena(),
    link := none | string(),
    atom() => term()
}.

-type reason() :: too_small | no_number | starl_create_pty:reason().

%% @doc Starts them. Gives the room, and each robot with the process and the name of its device. The
%% caller must trap exits if one that cannot start is not to end it.
-spec start_link(options()) ->
    {ok, none | pid(), [{Create :: pid(), OnPty :: pid(), Device :: string()}]} | {error, reason()}.
start_link(#{robots := N, link := Link, arena := Arena} = Options) ->
    case {N > 1 andalso Link =/= none andalso not is_numbered(Link), in_room(Options)} of
        {true, _} -> {error, no_number};
        {false, false} -> with_ptys(none, [1], Options);
        {false, true} -> roomed(starl_create_room:poses(N, Arena), Options)
    end.

in_room(#{robots := N, arena := Arena}) -> N > 1 orelse Arena =/= none.

is_numbered(Link) -> string:find(Link, "%d") =/= nomatch.

roomed(too_small, _Options) ->
    {error, too_small};
roomed({ok, Poses}, #{model := Model, arena := Arena} = Options) ->
    {ok, Room} = starl_create_room:start_link(Poses, {Model, Arena}),
    with_ptys(Room, [Id || {Id, _} <- Poses], Options).

with_ptys(Room, Ids, Options) ->
    Started = [robot(Id, Room, Options) || Id <- Ids],
    case [Reason || {error, Reason} <- Started] of
        [] -> {ok, Room, Started};
        [Reason | _] -> {error, Reason}
    end.

robot(Id, Room, #{link := Link, model := Model} = Options) ->
    Own = maps:without([robots, arena, link], Options),
    {ok, Create} = starl_create_emulated:start_link(Own#{model => Model, body => body(Room, Id)}),
    case starl_create_on_pty:start_link(Create, numbered(Link, Id)) of
        {ok, OnPty} -> {Create, OnPty, starl_create_on_pty:name(OnPty)};
        {error, {shutdown, Reason}} -> {error, Reason}
    end.

body(none, _Id) -> none;
body(Room, Id) -> {starl_world, Room, Id}.

numbered(none, _Id) -> none;
numbered(Link, Id) -> lists:flatten(string:replace(Link, "%d", integer_to_list(Id), all)).

%% @doc What is wrong, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error(too_small) ->
    "the arena is too small for its robots: each needs 500 mm by 500 mm";
format_error(no_number) ->
    "several robots need a link each: write %d for the number, as in /tmp/robot-%d";
format_error({link, Text}) ->
    Text;
format_error({program, Status}) ->
    io_lib:format("the port program has ended with status ~b", [Status]);
format_error(Reason) when Reason =:= no_program; Reason =:= other_processor ->
    starl_create_program:format_error(Reason).
