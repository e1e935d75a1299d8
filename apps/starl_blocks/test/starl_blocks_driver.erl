%% An application's function, played through by hand: for the tests of the blocks' interfaces.
-module(starl_blocks_driver).

-export([play/2]).
-export([init/2, step/2]).

%% `at': the robot's clock is there when the answer comes, us.
-type answer() :: {answer, term()} | timeout | restarted | {at, Us :: integer(), answer()}.

%% The application: its state is the function.
init(_Robot, Fun) -> Fun.

step(Robot, Fun) -> {done, Fun(Robot)}.

%% What the function calls, with which patience (us), when it is answered like this, and what it
%% comes to.
-spec play(fun((starl:robot()) -> Result), [answer()]) ->
    {[{starl_machine:name(), Request :: term(), pos_integer() | infinity}], Result}.
play(Fun, Answers) ->
    {ok, Pid} = starl_app_proc:start_link(#{
        robot => 1,
        handle => starl:robot(1, [1, 2, 3]),
        module => ?MODULE,
        args => Fun,
        driver => self()
    }),
    ok =
        receive
            {starl_attach, 1, app, Pid} -> ok
        end,
    Random = rand:seed_s(exsss, 1),
    Pid ! {starl_boot, #{now => 0, random => Random, incarnation => 1, stored => none}},
    Played = go_on(Pid, done(), Answers, []),
    unlink(Pid),
    exit(Pid, kill),
    Played.

go_on(Pid, Actions, Answers, Calls) ->
    case {[Result || {done, Result} <- Actions], Answers} of
        {[Result], []} ->
            {lists:reverse(Calls), Result};
        {[], [Answer | Rest]} ->
            [{Name, Request, Tag}] = [{N, R, T} || {call, N, R, T} <- Actions],
            Us = hd([U || {{timeout, T}, U, call} <- Actions, T =:= Tag] ++ [infinity]),
            {Now, Told} = timed(Answer),
            {Type, Content} = answered(Told, Name, Tag),
            Next = awake(Pid, event(Pid, Type, Content, Now)),
            go_on(Pid, Next, Rest, [{Name, Request, Us} | Calls])
    end.

%% A caller sleeps for a while when the machine that it called has crashed.
awake(Pid, Actions) ->
    Calls = [call || {call, _, _, _} <- Actions],
    case {Calls, [Timer || {{timeout, Timer}, Us, call} <- Actions, is_integer(Us)]} of
        {[], [Timer]} -> awake(Pid, event(Pid, {timeout, Timer}, call, 0));
        {_, _} -> Actions
    end.

timed({at, Now, Answer}) -> {Now, Answer};
timed(Answer) -> {0, Answer}.

event(Pid, Type, Content, Now) ->
    Pid ! {starl_step, Type, Content, #{now => Now, robot => 1}},
    done().

answered({answer, Answer}, _Name, Tag) -> {{reply, Tag}, Answer};
answered(timeout, _Name, Tag) -> {{timeout, Tag}, call};
answered(restarted, Name, _Tag) -> {info, {restarted, Name}}.

done() ->
    receive
        {starl_done, 1, _Pid, Actions} -> Actions
    end.
