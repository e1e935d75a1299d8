%% @doc Formats as text what a robot knows of the others ({@link starl_live_peers}). It writes a
%% line of news, and the problem with a robot as this robot hears it.
-module(starl_live_hearing).

-export([complaint/1, format_news/1, log/1]).

%% @doc What is wrong with a robot in our ears, as the rest of a sentence about us; `none': nothing.
-spec complaint(starl_live_peers:peer()) -> unicode:chardata() | none.
complaint(#{robot := Robot, heard_ms := never, why := Why}) ->
    ["has not heard robot ", integer_to_list(Robot), because(Why)];
complaint(#{robot := Robot, is_silent := true, heard_ms := Ms, why := Why}) ->
    Line = "has not heard robot ~b for ~b s~ts",
    io_lib:format(Line, [Robot, Ms div 1000, because(Why)]);
complaint(#{robot := Robot, twin := Twin, life := Life, address := Address}) ->
    both(Robot, {Life, Address}, Twin);
complaint(#{}) ->
    none.

because(none) -> "";
because(Why) -> [": ", explained(Why)].

both(Robot, Heard, Refused) ->
    Line = "hears two robots that speak as robot ~b: ~ts is taken, ~ts is refused",
    io_lib:format(Line, [Robot, life(Heard), life(Refused)]).

life({Life, Address}) -> io_lib:format("~ts (life ~.16b)", [at(Address), Life]).

at({Ip, Port}) -> io_lib:format("~ts port ~b", [inet:ntoa(Ip), Port]);
at(none) -> "an unknown address".

explained({clock, Ms}) when Ms >= 0 ->
    io_lib:format("its clock is ~.1f s ahead of ours", [Ms / 1000]);
explained({clock, Ms}) ->
    io_lib:format("its clock is ~.1f s behind ours", [-Ms / 1000]);
explained({unsent, Why}) ->
    ["nothing can be sent to it: ", inet:format_error(Why)];
explained({unnamed, Why}) ->
    ["its name is not found: ", inet:format_error(Why)];
explained(stranger) ->
    "it is no robot of the team";
explained(not_connected) ->
    "its node is not connected";
explained(clone) ->
    "another robot of its number is heard";
explained(Reason) ->
    of_datagrams(Reason).

of_datagrams(seal) -> "its datagrams are sealed with another key";
of_datagrams(fleet) -> "its datagrams are another fleet's";
of_datagrams(run) -> "its datagrams are of another run; does it run the same release?";
of_datagrams(version) -> "its datagrams have another format; does it run another StarL?";
of_datagrams(length) -> "its datagrams have a wrong length";
of_datagrams(Reason) -> ["its packets are malformed (", atom_to_list(Reason), ")"].

%% @doc One line of news.
-spec format_news(starl_live_peers:news()) -> unicode:chardata().
format_news({silent, _Robot, Peer}) ->
    ["the robot ", complaint(Peer)];
format_news({back, Robot, never}) ->
    io_lib:format("robot ~b is heard", [Robot]);
format_news({back, Robot, Ms}) ->
    io_lib:format("robot ~b is heard again, after ~.1f s", [Robot, Ms / 1000]);
format_news({refused, Robot, Reason}) when is_integer(Robot) ->
    io_lib:format("datagrams of robot ~b are refused: ~ts", [Robot, explained(Reason)]);
format_news({refused, Address, Reason}) ->
    io_lib:format("datagrams from ~ts are refused: ~ts", [at(Address), explained(Reason)]);
format_news({moved, Robot, Address}) ->
    io_lib:format("robot ~b is at ~ts now", [Robot, at(Address)]);
format_news({twice, Robot, Heard, Refused}) ->
    ["the robot ", both(Robot, Heard, Refused)];
format_news({once, Robot}) ->
    io_lib:format("one robot speaks as robot ~b again", [Robot]);
format_news({unnamed, Robot, Host, Why}) ->
    Line = "robot ~b: the name ~tp is not found: ~ts; it is looked up again",
    io_lib:format(Line, [Robot, Host, inet:format_error(Why)]).

%% @doc Writes news into the log.
-spec log([starl_live_peers:news()]) -> ok.
log(News) -> lists:foreach(fun log_one/1, News).

log_one(News) ->
    logger:log(level(News), #{
        what => element(1, News), why => unicode:characters_to_binary(format_news(News))
    }).

level({What, _, _}) when What =:= back; What =:= moved -> notice;
level({once, _}) -> notice;
level(_News) -> warning.
