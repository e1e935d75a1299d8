%% @doc Looks of the positioning system that wait for hardware. What hardware did is heard late on a busy
%% computer, so a picture taken at once would show a body where it is not any more, as of now. So
%% hardware is asked first to tell everything up to the moment of the look, and the picture is of that
%% moment:
%% ```
%%     robot -- look --> world -- {starl_settle, World, N} --> hardware
%%     robot <- picture - world <-- {starl_settled, Robot, N} -- hardware     after all that it has told
%% '''
%% A pure module. Hardware that has ended does not answer, and a look that is not answered is forgotten.
-module(starl_world_looks).

-export([new/0, begun/4, settled/3]).

-export_type([t/0, look/0]).

%% Who looks, and at whom.
-type look() :: {By :: {starl:robot_id(), Sight :: pid()} | all, [starl:robot_id()]}.

-record(looks, {
    next = 1 :: pos_integer(),
    waiting = #{} :: #{pos_integer() => {look(), AtUs :: integer(), [starl:robot_id(), ...]}}
}).

-opaque t() :: #looks{}.

%% A picture that is older is of no use to a robot.
-define(FORGOTTEN_US, 1000000).

%% @doc Nobody looks.
-spec new() -> t().
new() -> #looks{}.

%% @doc Somebody looks now, at bodies with this hardware among others. Is the picture taken at once
%% (`taken'), or which words are to be sent to the hardware first?
-spec begun(look(), NowUs :: integer(), [{starl:robot_id(), Hardware :: pid()}], t()) ->
    taken | {[{pid(), N :: pos_integer()}, ...], t()}.
begun(_Look, _Now, [], _Looks) ->
    taken;
begun(Look, Now, Hardware, #looks{next = N, waiting = Waiting} = Looks) ->
    Young = maps:filter(fun(_, {_, At, _}) -> Now - At =< ?FORGOTTEN_US end, Waiting),
    {[{Pid, N} || {_, Pid} <- Hardware], Looks#looks{
        next = N + 1, waiting = Young#{N => {Look, Now, [Id || {Id, _} <- Hardware]}}
    }}.

%% @doc The hardware of a robot has told everything up to the N-th look: the look and its time, if it was
%% the last one that was waited for.
-spec settled(starl:robot_id(), N :: pos_integer(), t()) ->
    {taken, look(), AtUs :: integer(), t()} | {waits, t()}.
settled(Id, N, #looks{waiting = Waiting} = Looks) ->
    case Waiting of
        #{N := {Look, At, [Id]}} ->
            {taken, Look, At, Looks#looks{waiting = maps:remove(N, Waiting)}};
        #{N := {Look, At, Ids}} ->
            {waits, Looks#looks{waiting = Waiting#{N := {Look, At, lists:delete(Id, Ids)}}}};
        #{} ->
            {waits, Looks}
    end.
