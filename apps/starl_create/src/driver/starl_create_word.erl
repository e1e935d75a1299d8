%% @doc The messages between the driver of a Create ({@link starl_create_driver}) and its port:
%% those of erlang-serial, and more. {@link starl_create_port} and {@link starl_create_pipe} use
%% them.
-module(starl_create_word).

-export([is_message/1]).

-export_type([command/0, message/0, timer/0]).

%% What the port is told. A script replaces the one before it: at once, or when the next step of that
%% is due (`join_script').
-type command() ::
    {open, Device :: term(), Baud :: pos_integer()}
    | {send, binary()}
    | {drive_script, Ref :: pos_integer(), [{binary(), Us :: pos_integer()}], Stop :: binary()}
    | {join_script, Ref :: pos_integer(), [{binary(), Us :: pos_integer()}], Stop :: binary()}
    | {stop_bytes, binary()}
    | {pulse, dtr | rts, LowMs :: pos_integer(), Times :: pos_integer()}
    | close.

%% What the driver hears. Times are those at which bytes left, by the clock of the caller. A line that
%% has been closed is opened again by the port; `stopped': the port has stopped the wheels by itself.
-type message() ::
    {priority, starl_create_port:priority()}
    | {opened, Device :: term()}
    | {data, binary()}
    | {error, Reason :: term()}
    | {closed, Reason :: term()}
    | {sent, Ref :: pos_integer(), AtUs :: integer()}
    | {ended, Ref :: pos_integer(), AtUs :: integer()}
    | {stopped, Why :: atom(), AtUs :: integer()}
    | {timeout, timer()}
    | {behind, Us :: pos_integer()}.

%% What the driver's timers are for: the next step of its greeting, of taking control, or of opening
%% the line; no frames; the question for a Create 1's odometry; a robot that comes to rest.
-type timer() :: step | silence | odometry | rest.

%% @doc Is it a word of the port? `timed': with a time of the port's clock at its end.
-spec is_message(term()) -> plain | timed | false.
is_message({priority, _}) -> plain;
is_message({Word, _}) when Word =:= data; Word =:= opened; Word =:= closed; Word =:= error -> plain;
is_message({Word, _, _}) when Word =:= sent; Word =:= ended; Word =:= stopped -> timed;
is_message(_) -> false.
