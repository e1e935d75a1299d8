%% @doc Flow control and tolerance of mistakes for one WebSocket client. Its socket asks for more
%% one question at a time, and only while the client has handled almost all that it was sent, so a
%% client that reads nothing gets nothing more. A client that keeps making mistakes is disconnected,
%% and so is a client that sends too many commands. A pure module.
-module(starl_view_credit).

-export([new/1, may_ask/1, answered/1, handled/1, mistake/1, command/2]).

-export_type([t/0]).

-define(MOST_MISTAKES, 20).
%% Commands within a second.
-define(MOST_COMMANDS, 100).

-record(credit, {
    most :: pos_integer() | unlimited,
    %% the messages that the client has not handled yet
    sent = 0 :: non_neg_integer(),
    asks = false :: boolean(),
    mistakes = 0 :: non_neg_integer(),
    commands = {0, 0} :: {Second :: integer(), non_neg_integer()}
}).

-opaque t() :: #credit{}.

%% @doc A client with this limit of unhandled messages. `unlimited': a client that does not report
%% what it has handled, so only its connection limits what is sent.
-spec new(pos_integer() | unlimited) -> t().
new(Most) -> #credit{most = Most}.

%% @doc May the socket ask for more? If so, it does.
-spec may_ask(t()) -> {boolean(), t()}.
may_ask(#credit{asks = false, sent = Sent, most = Most} = Credit) when Sent < Most ->
    %% an atom is above all numbers
    {true, Credit#credit{asks = true}};
may_ask(Credit) ->
    {false, Credit}.

%% @doc The question has been answered, and the answer goes to the client.
-spec answered(t()) -> t().
answered(#credit{sent = Sent} = Credit) -> Credit#credit{asks = false, sent = Sent + 1}.

%% @doc The client has handled a message.
-spec handled(t()) -> t().
handled(#credit{sent = Sent} = Credit) -> Credit#credit{sent = max(0, Sent - 1)}.

%% @doc The client has made a mistake.
-spec mistake(t()) -> {ok, t()} | shut_out.
mistake(#credit{mistakes = N}) when N >= ?MOST_MISTAKES -> shut_out;
mistake(#credit{mistakes = N} = Credit) -> {ok, Credit#credit{mistakes = N + 1}}.

%% @doc The client gives a command, at this second.
-spec command(Second :: integer(), t()) -> {ok, t()} | too_many.
command(Second, #credit{commands = {Second, N}}) when N >= ?MOST_COMMANDS -> too_many;
command(Second, #credit{commands = {Second, N}} = Credit) ->
    {ok, Credit#credit{commands = {Second, N + 1}}};
command(Second, Credit) ->
    {ok, Credit#credit{commands = {Second, 1}}}.
