%% @doc Several calls of a block's machine that belong together, where what is called next rests on
%% what was answered: a step of the script of a model that is checked
%% ({@link starl_block}, `{talk, Module, Args}'). It stands for what the block's interface does.
-module(starl_block_talk).

-export_type([call/0, next/0]).

%% The machine, the request, and a mark that comes with the answer.
-type call() :: {starl_machine:name(), Request :: term(), Mark :: term()}.

%% Another call; the step is over; or it begins again, later.
-type next() :: {call, call()} | over | again.

-callback first(Args :: term()) -> call().
-callback answered(Mark :: term(), Answer :: term(), Args :: term()) -> next().
%% The machine has restarted before it answered.
-callback restarted(Mark :: term(), Args :: term()) -> next().
