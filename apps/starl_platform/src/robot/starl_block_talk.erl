%% @doc The behaviour of a talk: a sequence of calls to a block's machine, each of which depends on
%% the answer before. A talk is one step of a checked model's script ({@link starl_block}, `{talk,
%% Module, Args}'). It stands for the code of the block's interface.
-module(starl_block_talk).

-export_type([call/0, next/0]).

%% The machine, the request, and a mark that returns with the answer.
-type call() :: {starl_machine:name(), Request :: term(), Mark :: term()}.

%% Another call; the step is over; or the step begins again, later.
-type next() :: {call, call()} | over | again.

-callback first(Args :: term()) -> call().
-callback answered(Mark :: term(), Answer :: term(), Args :: term()) -> next().
%% The machine has restarted before it answered.
-callback restarted(Mark :: term(), Args :: term()) -> next().
