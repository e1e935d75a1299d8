%% @doc Planted bugs of the program that ships on robots: each is a module of it with some words changed,
%% to show that `./starl soak live' finds it. The module is compiled anew and loaded in the place of the
%% sound one while its bug is looked for.
-module(starl_live_planted).

-export([bugs/0, caught/2, with/2, sound/2]).

-export_type([bug/0]).

%% Name, what is run, from which seed on if not from 1, module, the changes of its source, and the
%% pitfall.
-type bug() :: {
    atom(), part(), module(), [{Old :: string(), New :: string()}, ...], string()
}.
-type part() :: starl_lab_soak_live:part() | {starl_lab_soak_live:part(), From :: pos_integer()}.

-type caught() ::
    {caught, Seed :: pos_integer(), starl_monitor:violation()}
    | {crashed, Seed :: pos_integer(), term()}
    | {not_caught, Seeds :: pos_integer()}.

%% @doc All of them.
-spec bugs() -> [bug()].
bugs() -> store() ++ radio() ++ robot() ++ reload().

store() ->
    [
        {store_unsynced, store, starl_live_store,
            [
                {"fun() -> starl_live_disk:sync(Device) end),\n    first_error(",
                    "fun() -> ok end),\n    first_error("}
            ],
            "a term is not synced before it takes the place of its predecessor"},
        {store_directory_unsynced, store, starl_live_store,
            [{"fun() -> synced(starl_live_disk:dirname(To)) end", "fun() -> ok end"}],
            "the new name of a file is not synced"},
        {store_in_place, store, starl_live_store,
            [
                {"New = starl_live_disk:suffixed(File, \".new\")", "New = File"},
                {"    renamed(New, File);", "    ok = element(1, {ok, New, File, fun renamed/2});"}
            ],
            "a term is written over its predecessor"},
        {store_one_copy, store, starl_live_store,
            [
                {"        ok,\n        ?COPIES\n    ),",
                    "        ok,\n        [hd(?COPIES)]\n    ),"}
            ],
            "the second copy of the numbers of starts is not written"},
        {store_unchecked, store, starl_live_store,
            [
                {"        Sum -> {ok, binary_to_term(Content)};\n        _ -> damaged",
                    "        _ when Sum >= 0 -> {ok, binary_to_term(Content)}"}
            ],
            "the checksum of a file is not looked at"},
        {store_silent, store, starl_live_store, [{"            full\n", "            ok\n"}],
            "a term that could not be stored counts as stored"}
    ].

radio() ->
    [
        {replay_half, radio, starl_live_replay,
            [
                {"is_map_key(Id, Young) orelse is_map_key(Id, Old).",
                    "is_map_key(Id, Young) orelse is_map_key(Id, Old) andalso Old =:= Young."}
            ],
            "the older half of the replay window is forgotten"},
        {replay_short, radio, starl_live_seal,
            [{"starl_live_replay:new(2 * Fresh, Now)", "starl_live_replay:new(Fresh div 3, Now)"}],
            "the replay window is shorter than datagrams are fresh"},
        {codec_unchecked, radio, starl_live_codec,
            [
                {"        {error, _} -> {error, term}",
                    "        {error, _} -> known(From, term(Bytes))"}
            ],
            "what a packet holds is not looked at"},
        {seal_stale, radio, starl_live_seal,
            [
                {"ok when abs(Now - Time) > Fresh -> {clock,",
                    "ok when Time - Now > Fresh -> {clock,"}
            ],
            "old datagrams are taken"},
        {seal_slewed, radio, starl_live_udp,
            [
                {"starl_live_clock:time_of_day(millisecond, Clock).",
                    "starl_live_clock:system_time(millisecond, Clock)."}
            ],
            "datagrams are fresh by a clock that does not follow the computer's"},
        {seal_address, radio, starl_live_seal,
            [{"ok when To =/= 0, To =/= Robot -> address;", "ok when To < 0 -> address;"}],
            "datagrams for others are taken"},
        {fragments_mixed, radio, starl_live_fragment,
            [
                {"true -> add({From, Digest}, Count,", "true -> add({From, <<Count:64>>}, Count,"},
                {"    case digest(Message) of\n        Digest -> {whole, Message, Left};\n        _ -> {error, digest, Left}",
                    "    case Digest of\n        <<>> -> {error, digest, Left};\n        _ -> {whole, Message, Left}"}
            ],
            "fragments of two messages are put together"},
        {fragments_kept, radio, starl_live_fragment,
            [
                {"Room = make_room(From, Now, Unfinished),",
                    "Room = maps:merge(Unfinished, make_room(From, Now, #{})),"}
            ],
            "unfinished messages are kept for ever"}
    ].

robot() ->
    [
        {starts_unstored, sap, starl_live_link,
            [
                {"    case starl_live_store:started(starl_robot_machines:starts(Machines), Store) of\n        ok -> {ok, started(",
                    "    case element(1, {ok, starl_robot_machines:starts(Machines)}) of\n        ok -> {ok, started("},
                {"        {error, Why} -> {stop, failure(store, Why)}\n    end.\n\ninline(",
                    "        Why -> {stop, failure(store, Why)}\n    end.\n\ninline("}
            ],
            "a robot's start is not stored before its machines run"},
        {store_lost_unnoticed, sap, starl_live_store,
            [
                {"        {lost, none} -> lost(Dir);",
                    "        {lost, none} ->\n            _ = fun lost/1,\n            {ok, #store{dir = Dir, life = first, outdated = false, outlived = 0}};"}
            ],
            "a robot whose store was lost takes itself for one that has never run"},
        {store_outdated_unheeded, barrier, starl_live_store,
            [
                {"        none when Outdated -> damaged;",
                    "        none when Outdated =:= damaged -> damaged;"}
            ],
            "machines of a robot whose store was lost find no term, and not a damaged one"},
        %% rare: within 3,000 seeds at 1,246 only
        {link_late_answer, {mutex, 1201}, starl_live_link,
            [
                {"{ok, Link#link{robot = Robot, beside = maps:remove(Gone, Beside)}};",
                    "{ok, Link#link{robot = Robot, beside = (fun(_) -> Beside end)(Gone)}};"},
                {"    case {Beside, starl_robot_machines:name_of(Pid, machines(Link))} of",
                    "    _ = fun starl_robot_machines:name_of/2,\n    case {Beside, {ok, app}} of"}
            ],
            "the answer of a dead process is taken for its successor's"},
        {timers_early, mutex, starl_live_driver,
            [
                {"starl_live_clock:monotonic_ms(Now + Us, Clock)",
                    "starl_live_clock:monotonic_ms(Now + Us div 3, Clock)"}
            ],
            "timers fire early"}
    ].

reload() ->
    [
        {reload_to_unproven, sap, starl_lineage,
            [
                {"    {[Present | Unproven], Lineage#lineage{versions = Left}}.",
                    "    _ = {Unproven, Left},\n    {[Present], Lineage#lineage{versions = Older}}."}
            ],
            "back is the version before, whose trial has not ended"},
        {reload_untried, election, starl_lineage,
            [
                {"until_us := Until} | _]}) -> Now < Until;",
                    "until_us := Until} | _]}) -> Now > 2 * Until;"}
            ],
            "a crash within the trial time ends the application"},
        {reload_not_taken_back, mutex, starl_live_link,
            [
                {"    {Commands, Next} = starl_live_driver:take_back(N, Failed, Driver),\n    command(Commands, Next, Now);",
                    "    {_, Next} = starl_live_driver:take_back(N, Failed, Driver),\n    command([], Next, Now);"}
            ],
            "a robot does not leave code that has failed on another"},
        {reload_unheeded, mutex, starl_live_driver,
            [
                {"{Results, Begun} = starl_reload:started(Name, Now, Codes),",
                    "{Results, Begun} = {[], maps:map(fun(_, {L, _}) -> {L, []} end, Codes)},"}
            ],
            "a process that starts anew forgets the words that its predecessor has not heeded"}
    ].

%% @doc Looks for a bug with the seeds from 1 on.
-spec caught(bug(), Seeds :: pos_integer()) -> caught().
caught({_Name, Part, _Module, _Changes, _Doc} = Bug, Seeds) ->
    with(Bug, fun() -> searched(Part, Seeds) end).

%% @doc Calls a function while a bug is in the program.
-spec with(bug(), fun(() -> Result)) -> Result.
with({_Name, _Part, Module, Changes, _Doc}, Fun) ->
    ok = planted(Module, Changes),
    try
        Fun()
    after
        restored(Module)
    end.

%% From the first seed on, or from a later one.
searched({Part, From}, Seeds) -> search(Part, From, From + Seeds - 1);
searched(Part, Seeds) -> search(Part, 1, Seeds).

search(_Part, Seed, Seeds) when Seed > Seeds -> {not_caught, Seeds};
search(Part, Seed, Seeds) ->
    case violations(Part, Seed) of
        {ok, []} -> search(Part, Seed + 1, Seeds);
        {ok, [Violation | _]} -> {caught, Seed, Violation};
        {crashed, Why} -> {crashed, Seed, Why}
    end.

%% @doc The same run with the sound program.
-spec sound(starl_lab_soak_live:part(), Seed :: pos_integer()) -> [starl_monitor:violation()].
sound(Part, Seed) ->
    {ok, Violations} = violations(Part, Seed),
    Violations.

violations(Part, Seed) ->
    Given = starl_lab_soak_live:scenario(Part, none, Seed),
    try starl_lab_soak_live:played(Part, Seed, Given) of
        #{violations := Violations} -> {ok, Violations}
    catch
        error:Why -> {crashed, Why}
    end.

planted(Module, Changes) ->
    Source = proplists:get_value(source, Module:module_info(compile)),
    {ok, Text} = file:read_file(Source),
    Changed = lists:foldl(fun changed/2, unicode:characters_to_list(Text), Changes),
    %% the preprocessor reads files
    Dir = filename:join(filename:basedir(user_cache, "starl"), "planted-" ++ os:getpid()),
    File = filename:join(Dir, filename:basename(Source)),
    ok = filelib:ensure_dir(File),
    ok = file:write_file(File, unicode:characters_to_binary(Changed)),
    {ok, Module, Beam} = compile:file(File, [binary, debug_info, {i, filename:dirname(Source)}]),
    ok = file:del_dir_r(Dir),
    _ = code:purge(Module),
    {module, Module} = code:load_binary(Module, File, Beam),
    ok.

changed({Old, New}, Text) ->
    case string:split(Text, Old) of
        [Before, After] -> Before ++ New ++ After;
        [_] -> error({not_in_source, Old})
    end.

restored(Module) ->
    _ = code:purge(Module),
    _ = code:delete(Module),
    _ = code:purge(Module),
    {module, Module} = code:load_file(Module),
    ok.
