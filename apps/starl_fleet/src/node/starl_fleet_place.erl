%% @doc Locates a robot's node on its computer, from the environment that `bin/robot' of the release
%% sets. The node's working directory is the robot's directory.
%% ```
%%     HOME/FLEET/robot-1/releases/VERSION/   a release: erts, lib, bin/robot, fleet.term
%%                        current, previous   links to releases
%%                        keys/               the fleet's key, the robot's certificate
%%                        state/              the store of the robot, which outlives all releases
%% '''
-module(starl_fleet_place).

-export([here/0, read/1, run/1]).

-export_type([t/0]).

%% `release': the directory of the release; `version': its name.
-type t() :: #{
    robot := starl:robot_id(),
    release := file:filename(),
    version := string(),
    keys := file:filename(),
    state := file:filename()
}.

%% @doc The place of this VM, if it is a robot's node.
-spec here() -> t() | none.
here() ->
    case os:getenv("STARL_ROBOT", "") of
        "" ->
            none;
        Number ->
            Release = os:getenv("STARL_RELEASE"),
            #{
                robot => list_to_integer(Number),
                release => Release,
                version => filename:basename(Release),
                keys => "keys",
                state => "state"
            }
    end.

%% @doc The fleet file of the release.
-spec read(t()) -> {ok, starl_fleet_file:t()} | {error, [unicode:chardata(), ...]}.
read(#{release := Release, robot := Robot}) ->
    File = filename:join(Release, "fleet.term"),
    case starl_fleet_file:read(File) of
        {ok, #{app := App} = Given} -> known(Robot, starl_fleet_file:check(File, Given, App));
        {ok, _} -> {error, [[File, ": the key app is missing"]]};
        {error, _} = Error -> Error
    end.

known(Robot, {ok, #{robots := Robots}}) when not is_map_key(Robot, Robots) ->
    {error, [io_lib:format("the fleet file knows no robot ~b", [Robot])]};
known(_Robot, Checked) ->
    Checked.

%% @doc The run of the team. Robots of another release are not heard, since their packets may mean
%% something else; a release whose code was loaded into a running team goes on with the team's run.
-spec run(t()) -> non_neg_integer().
run(#{release := Release, version := Version}) ->
    case file:read_file(filename:join(Release, "run")) of
        {ok, Digits} ->
            binary_to_integer(string:trim(Digits));
        {error, _} ->
            <<Run:64, _/binary>> = crypto:hash(sha256, Version),
            Run
    end.
