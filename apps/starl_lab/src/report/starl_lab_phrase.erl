%% @doc Phrases that several commands print alike.
-module(starl_lab_phrase).

-export([robots/1, crash/1, waits/1]).

%% @doc Robots by their numbers, neighbours together: `robots 1-4, 7'.
-spec robots([starl:robot_id(), ...]) -> unicode:chardata().
robots([Id]) -> ["robot ", integer_to_list(Id)];
robots(Ids) -> ["robots ", lists:join(", ", [range(R) || R <- ranges(lists:sort(Ids))])].

ranges([]) -> [];
ranges([Id | Ids]) -> ranges(Id, Id, Ids).

ranges(First, Last, [Next | Ids]) when Next =:= Last + 1 -> ranges(First, Next, Ids);
ranges(First, Last, Ids) -> [{First, Last} | ranges(Ids)].

range({Id, Id}) -> integer_to_list(Id);
range({First, Last}) when Last =:= First + 1 -> io_lib:format("~b, ~b", [First, Last]);
range({First, Last}) -> io_lib:format("~b-~b", [First, Last]).

%% @doc A crash of an application: its place, its reason, then the robot.
-spec crash(starl_crash_monitor:excused()) -> unicode:chardata().
crash({AtUs, Robot, _Machine, {Reason, Stack}}) ->
    [
        place(starl_crash:place(Stack), Stack),
        Reason,
        io_lib:format(" (robot ~b, ~.6f s)", [
            Robot, AtUs / 1.0e6
        ])
    ].

place({Module, Function, Arity, File, Line}, _Stack) ->
    io_lib:format("~ts:~b: ~tp:~tp/~b: ", [File, Line, Module, Function, Arity]);
place(none, [Frame | _]) ->
    [starl_crash:format_frame(Frame), ": "];
place(none, []) ->
    "".

%% @doc The call in which an application waits, and its place; `none': it waits for nothing.
-spec waits(starl_robot_tree:waiting()) -> unicode:chardata() | none.
waits(none) ->
    none;
waits({nothing, _}) ->
    none;
waits({Waits, Frames}) ->
    IsLibrary = fun({Module, _, _, _, _}) -> starl_code:is_library(Module) end,
    {Library, Own} = lists:splitwith(IsLibrary, Frames),
    [call(Waits, lists:reverse(Library)), at(starl_crash:place(Own ++ Library))].

%% The library's function that the application itself has called is the outermost.
call({message, Types}, _) -> ["starl:await(", lists:join(", ", types(Types)), ")"];
call(time, []) -> "starl:sleep";
call({answer, Name}, []) -> io_lib:format("an answer of its machine ~tp", [Name]);
call(_, [{Module, Function, _, _, _} | _]) -> io_lib:format("~tp:~tp", [Module, Function]).

types(Types) -> lists:usort([io_lib:format("~tp", [plain(Type)]) || Type <- Types]).

plain({app, Type}) -> Type;
plain(Type) -> Type.

at(none) -> "";
at({_, _, _, File, Line}) -> io_lib:format(", ~ts:~b", [File, Line]).
