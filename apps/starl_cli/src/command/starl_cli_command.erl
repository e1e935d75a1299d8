%% @doc The behaviour of a command of `./starl', and the code that all commands share: it reads the
%% first word and the flags, answers `--help', and reports bad input.
%%
%% A command declares its name, its arguments and its purpose. The dispatch, both help texts
%% ({@link starl_cli_usage}), the argument parser and the words for completion all follow from this
%% declaration. The parser reports all problems at once. An OTP application lists its commands in
%% its `.app' file ({@link starl_cli_catalogue}).
-module(starl_cli_command).

-export([all/0, find/1, run/2, read/2]).
-export([argument/1, flags/2, statuses/1]).

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

-optional_callbacks([argument/0, flags/1, statuses/0, subject/2]).

%% @doc All commands, by the application that offers them.
-spec all() -> [{Title :: string(), [module(), ...]}].
all() -> starl_cli_catalogue:commands().

%% @doc Finds a command by its name; otherwise gives similar names.
-spec find(string()) -> {ok, module()} | {error, Near :: [string()]}.
find(Name) ->
    Named = [{Module:name(), Module} || {_, Modules} <- all(), Module <- Modules],
    case lists:keyfind(Name, 1, Named) of
        {_, Module} -> {ok, Module};
        false -> {error, starl_cli_flags:nearest(Name, [Known || {Known, _} <- Named])}
    end.

%% @doc Runs a command with its arguments; gives the exit status.
-spec run(module(), [string()]) -> starl_cli_terminal:status().
run(Command, Args) ->
    case read(Command, Args) of
        {ok, Call} -> answered(Command:run(Call), Command);
        {help, Word, Subject} -> show(starl_cli_usage:command(Command, Word, Subject));
        {error, _} = Error -> answered(Error, Command)
    end.

answered({error, Problems}, Command) ->
    starl_cli_terminal:bad_input([[Command:name(), ": ", Problem] || Problem <- Problems]);
answered(Status, _Command) ->
    Status.

show(Text) ->
    starl_cli_terminal:out(Text),
    0.

%% @doc Reads the arguments of a command and reports all problems at once.
-spec read(module(), [string()]) ->
    {ok, call()}
    | {help, Word :: string() | none, subject()}
    | {error, [unicode:chardata(), ...]}.
read(Command, Args) ->
    Argument = argument(Command),
    case {take(Argument, Args), is_help_wanted(Args)} of
        {none, true} -> {help, none, none};
        {none, false} -> without_word(Argument, Command, Args);
        {{Word, Others}, Help} -> with_word(Argument, Command, {Word, Others, Args}, Help)
    end.

%% The word comes first. After flags it is recognized if it names something known.
take(none, _Args) ->
    none;
take(_Argument, [[C | _] = Word | Others]) when C =/= $- ->
    {Word, Others};
take({_, _, Known}, Args) ->
    case lists:splitwith(fun(Arg) -> not is_subject(Known, Arg) end, Args) of
        {Before, [Word | After]} -> {Word, Before ++ After};
        {_, []} -> none
    end.

is_subject({example, _}, Word) -> starl_cli_target:looks_like_one(Word);
is_subject(Choices, Word) -> lists:member(Word, names(Choices)).

is_help_wanted(Args) -> lists:member("--help", Args) orelse lists:member("-h", Args).

without_word({required, Placeholder, Known}, Command, _Args) ->
    {error, [["name a ", string:lowercase(Placeholder), " first, ", hint(Known, Command)]]};
without_word(_Argument, Command, Args) ->
    parsed(Command, none, Args, Args).

hint({example, Word}, Command) ->
    Name = Command:name(),
    ["as in ./starl ", Name, " ", Word, "; ./starl ", Name, " --help tells more"];
hint(Choices, _Command) ->
    ["one of ", lists:join(", ", names(Choices))].

with_word({_, Placeholder, Known}, Command, {Word, Others, Args}, Help) ->
    case {subject(Known, Placeholder, Command, Word, Others), Help} of
        {{ok, Subject, _}, true} -> {help, Word, Subject};
        {{ok, Subject, Rest}, false} -> parsed(Command, Subject, Rest, Args);
        {{error, _} = Error, _} -> Error
    end.

subject({example, _}, _Placeholder, Command, Word, Args) ->
    Command:subject(Word, Args);
subject(Choices, Placeholder, Command, Word, Args) ->
    case [Name || {Name, _} <- Choices, atom_to_list(Name) =:= Word] of
        [Name] -> {ok, Name, Args};
        [] -> other(Choices, Placeholder, Command, {Word, Args})
    end.

%% A file of the user's own may stand for one of the choices.
other(Choices, Placeholder, Command, {Word, Args}) ->
    Takes = erlang:function_exported(Command, subject, 2) andalso filename:extension(Word) =:= ".erl",
    case Takes of
        true -> Command:subject(Word, Args);
        false -> {error, [unknown(Word, string:lowercase(Placeholder), names(Choices))]}
    end.

unknown(Word, What, Names) ->
    case starl_cli_flags:nearest(Word, Names) of
        [Near | _] -> ["there is no ", What, " ", Word, " (did you mean ", Near, "?)"];
        [] -> ["there is no ", What, " ", Word, "; there are ", lists:join(", ", Names)]
    end.

names(Choices) -> [atom_to_list(Name) || {Name, _} <- Choices].

parsed(Command, Subject, Rest, Args) ->
    Flags = lists:append([Some || {_, Some} <- flags(Command, Subject)]),
    case starl_cli_flags:parse(Rest, Flags) of
        {ok, Given} ->
            {ok, #{
                subject => Subject,
                given => Given,
                values => maps:merge(starl_cli_flags:defaults(Flags), Given),
                args => Args
            }};
        {error, Problems} ->
            Lines = [starl_cli_flags:format_problem(Problem) || Problem <- Problems],
            {error, Lines ++ in_file(Subject)}
    end.

%% Problems of a scenario file are reported together with the others.
in_file(#{app := _, given := Given} = Target) ->
    {Problems, _} = starl_cli_setup:scenario(Target, Given),
    Problems;
in_file(_Subject) ->
    [].

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

optional(Command, Callback, Args, Otherwise) ->
    {module, Command} = code:ensure_loaded(Command),
    case erlang:function_exported(Command, Callback, length(Args)) of
        true -> apply(Command, Callback, Args);
        false -> Otherwise
    end.
