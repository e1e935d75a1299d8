%% @doc The behaviour of a command of `./starl'.
%%
%% A command declares itself by one map: its name, what it does, its arguments, flags and exit
%% statuses, and the function that carries it out. The parser of arguments (`starl_cli_dispatch'),
%% the help (`starl_cli_usage'), the manual page (`starl_cli_man') and the completion
%% (`starl_cli_completion') all read this map. For example:
%%
%% ```
%% command() ->
%%     #{
%%         name => "scenarios",
%%         synopsis => "list the scenarios",
%%         about => ["Lists the scenarios that ship; ./starl run NAME runs one."],
%%         run => fun run/1
%%     }.
%% '''
%%
%% An OTP application lists its commands in its `.app' file ({@link starl_catalogue}).
-module(starl_cli_command).

-export([all/0, names/0, find/1]).
-export([argument/1, about/2, flags/2, statuses/1, words/2]).

-export_type([
    command/0, argument/0, choices/0, subject/0, paragraph/0, group/0, statuses/0, call/0, answer/0
]).

%% The help text and the flags may depend on the subject. A value is a function, too, if other
%% modules must be asked for it, since each look at the list of commands reads all maps.
%%
%% `about' is the help text above the flags; `flags' lacks --help, which every command has;
%% `statuses' lacks 2 (bad usage or input). `subject' resolves a word that is not a choice from a
%% list, and passes on the other arguments; for a command with choices the word is a file, FILE.erl.
%% `words' are the values of a flag, for completion, where its type does not say.
-type command() :: #{
    name := string(),
    synopsis := string(),
    argument => argument() | fun(() -> argument()),
    subject => fun(
        (Word :: string(), Args :: [string()]) ->
            {ok, subject(), [string()]} | {error, [unicode:chardata(), ...]}
    ),
    about := [paragraph()] | fun((subject()) -> [paragraph()]),
    flags => [group()] | fun((subject()) -> [group()]),
    words => fun((Flag :: atom()) -> [unicode:chardata()]),
    statuses => statuses(),
    run := fun((call()) -> answer())
}.

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

%% The meanings of exit statuses.
-type statuses() :: [{starl_cli_terminal:status(), unicode:chardata()}].

-callback command() -> command().

%% @doc All commands under their titles, which applications may share.
-spec all() -> [{Title :: string(), [command(), ...]}].
all() -> [{Title, [Module:command() || Module <- Modules]} || {Title, Modules} <- listed()].

%% @doc The names of all commands.
-spec names() -> [string()].
names() -> [Name || {_, Commands} <- all(), #{name := Name} <- Commands].

listed() ->
    Groups = lists:foldl(fun under/2, [], starl_catalogue:listed(starl_commands)),
    [Group || {_, [_ | _]} = Group <- Groups].

under({Title, Commands}, Groups) ->
    case lists:keyfind(Title, 1, Groups) of
        {Title, Earlier} -> lists:keyreplace(Title, 1, Groups, {Title, Earlier ++ Commands});
        false -> Groups ++ [{Title, Commands}]
    end.

%% @doc Finds a command by its name; otherwise gives similar names. Modules that bear the name are
%% asked first, since a module is loaded when it is asked.
-spec find(string()) -> {ok, command()} | {error, Near :: [string()]}.
find(Name) ->
    Modules = lists:append([Some || {_, Some} <- listed()]),
    {Likely, Others} = lists:partition(fun(Module) -> bears(Name, Module) end, Modules),
    first(Name, Likely ++ Others).

bears(Name, Module) -> string:find(atom_to_list(Module), Name) =/= nomatch.

first(Name, []) ->
    {error, starl_similar:words(Name, names())};
first(Name, [Module | Modules]) ->
    case Module:command() of
        #{name := Name} = Command -> {ok, Command};
        #{} -> first(Name, Modules)
    end.

%% @doc The first word that a command takes.
-spec argument(command()) -> argument().
argument(Command) ->
    case maps:get(argument, Command, none) of
        Argument when is_function(Argument) -> Argument();
        Argument -> Argument
    end.

%% @doc The help text of a command for a subject.
-spec about(command(), subject()) -> [paragraph()].
about(#{about := About}, Subject) -> of_subject(About, Subject).

%% @doc All flags of a command for a subject; the last visible group contains --help.
-spec flags(command(), subject()) -> [group()].
flags(Command, Subject) ->
    Help = {help, switch, false, "this help"},
    Groups = of_subject(maps:get(flags, Command, []), Subject),
    {Own, Hidden} = lists:partition(fun(Group) -> element(1, Group) =/= hidden end, Groups),
    case lists:reverse(Own) of
        [{Title, Flags} | Others] -> lists:reverse(Others, [{Title, Flags ++ [Help]} | Hidden]);
        _ -> Own ++ [{"Flags", [Help]} | Hidden]
    end.

of_subject(Value, Subject) when is_function(Value) -> Value(Subject);
of_subject(Value, _Subject) -> Value.

%% @doc The meanings of a command's exit statuses, in ascending order; empty if the command has only
%% the usual ones.
-spec statuses(command()) -> statuses().
statuses(#{statuses := Own}) -> lists:ukeysort(1, Own ++ [{2, "bad usage or input"}]);
statuses(#{}) -> [].

%% @doc The words that a command knows for a flag.
-spec words(command(), Flag :: atom()) -> [unicode:chardata()].
words(#{words := Words}, Flag) -> Words(Flag);
words(#{}, _Flag) -> [].
