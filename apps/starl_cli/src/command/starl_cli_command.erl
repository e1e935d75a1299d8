%% @doc The behaviour of a command of `./starl'.
%%
%% A command declares its name, its arguments and its purpose. This declaration determines the
%% dispatch and the parser of arguments (`starl_cli_dispatch'), both help texts (`starl_cli_usage')
%% and the words for completion. An OTP application lists its commands in its `.app' file
%% ({@link starl_catalogue}).
-module(starl_cli_command).

-export([all/0, find/1]).
-export([argument/1, flags/2, statuses/1, words/2]).

-export_type([argument/0, choices/0, subject/0, paragraph/0, group/0, call/0, answer/0]).

%% The first word of a command, if it takes one: a choice from a list of names with explanations, or
%% a free word that the command itself understands, with an example.
-type argument() ::
    none
    | {required | optional, Placeholder :: string(), choices() | {example, string()}}.

-type choices() :: [{Name :: atom(), Doc :: unicode:chardata()}].

%% The meaning of the word: a choice, or the result of `subject/2'; `none' without a word.
-type subject() :: none | term().

%% A paragraph of a help text: prose, which is wrapped to the width of the terminal; lines that are
%% printed unchanged; or names with explanations.
-type paragraph() ::
    unicode:chardata()
    | {lines, unicode:chardata()}
    | {list, Title :: unicode:chardata(), [{Name :: unicode:chardata(), unicode:chardata()}]}.

%% Flags under a title; flags that are accepted but explained elsewhere; and flags that are only
%% shown because they belong to another subject.
-type group() ::
    {Title :: unicode:chardata(), [starl_cli_flags:flag()]}
    | {hidden, [starl_cli_flags:flag()]}
    | {shown, Title :: unicode:chardata(), [starl_cli_flags:flag()]}.

%% A parsed command line: the subject, the flags given, these flags together with the defaults of
%% all others, and the arguments as typed.
-type call() :: #{
    subject := subject(),
    given := #{atom() => term()},
    values := #{atom() => term()},
    args := [string()]
}.

%% An exit status, or the problems of the input, one line each.
-type answer() :: starl_cli_terminal:status() | {error, [unicode:chardata(), ...]}.

-callback name() -> string().
%% The purpose of the command, in one line.
-callback synopsis() -> string().
-callback argument() -> argument().
%% The help text above the flags.
-callback about(subject()) -> [paragraph()].
%% The flags, without --help, which every command has.
-callback flags(subject()) -> [group()].
%% The meanings of the exit statuses, without 2 (bad usage or input).
-callback statuses() -> [{starl_cli_terminal:status(), unicode:chardata()}].
%% Resolves a word that is not a choice from a list, and passes on the other arguments. For a
%% command with choices the word is a file, FILE.erl.
-callback subject(Word :: string(), Args :: [string()]) ->
    {ok, subject(), [string()]} | {error, [unicode:chardata(), ...]}.
-callback run(call()) -> answer().

%% The words that a flag may take, for completion, where its type does not say.
-callback words(Flag :: atom()) -> [unicode:chardata()].

-optional_callbacks([argument/0, flags/1, statuses/0, subject/2, words/1]).

%% @doc All commands under their titles, which applications may share.
-spec all() -> [{Title :: string(), [module(), ...]}].
all() ->
    Groups = lists:foldl(fun under/2, [], starl_catalogue:listed(starl_commands)),
    [Group || {_, [_ | _]} = Group <- Groups].

under({Title, Commands}, Groups) ->
    case lists:keyfind(Title, 1, Groups) of
        {Title, Earlier} -> lists:keyreplace(Title, 1, Groups, {Title, Earlier ++ Commands});
        false -> Groups ++ [{Title, Commands}]
    end.

%% @doc Finds a command by its name; otherwise gives similar names. Modules that bear the name are asked first:
%% each that is asked is loaded.
-spec find(string()) -> {ok, module()} | {error, Near :: [string()]}.
find(Name) ->
    Modules = [Module || {_, Some} <- all(), Module <- Some],
    {Likely, Others} = lists:partition(fun(Module) -> bears(Name, Module) end, Modules),
    case lists:search(fun(Module) -> Module:name() =:= Name end, Likely ++ Others) of
        {value, Module} -> {ok, Module};
        false -> {error, starl_cli_flags:nearest(Name, [Module:name() || Module <- Modules])}
    end.

bears(Name, Module) -> string:find(atom_to_list(Module), Name) =/= nomatch.

%% -- optional callbacks ---------------------------------------------------------------------

%% @doc The first word that a command takes.
-spec argument(module()) -> argument().
argument(Command) -> optional(Command, argument, [], none).

%% @doc All flags of a command for a subject; the last visible group contains --help.
-spec flags(module(), subject()) -> [group()].
flags(Command, Subject) ->
    Help = {help, switch, false, "this help"},
    Groups = optional(Command, flags, [Subject], []),
    {Own, Hidden} = lists:partition(fun(Group) -> element(1, Group) =/= hidden end, Groups),
    case lists:reverse(Own) of
        [{Title, Flags} | Others] -> lists:reverse(Others, [{Title, Flags ++ [Help]} | Hidden]);
        _ -> Own ++ [{"Flags", [Help]} | Hidden]
    end.

%% @doc The meanings of a command's exit statuses, in ascending order; empty if the command has only
%% the usual ones.
-spec statuses(module()) -> [{starl_cli_terminal:status(), unicode:chardata()}].
statuses(Command) ->
    case optional(Command, statuses, [], []) of
        [] -> [];
        Own -> lists:ukeysort(1, Own ++ [{2, "bad usage or input"}])
    end.

%% @doc The words that a command knows for a flag.
-spec words(module(), Flag :: atom()) -> [unicode:chardata()].
words(Command, Flag) -> optional(Command, words, [Flag], []).

optional(Command, Callback, Args, Otherwise) ->
    {module, Command} = code:ensure_loaded(Command),
    case erlang:function_exported(Command, Callback, length(Args)) of
        true -> apply(Command, Callback, Args);
        false -> Otherwise
    end.
