%% @doc Runs a command of `./starl' ({@link starl_cli_command}): reads the first word and the flags,
%% answers `--help', and reports all problems of the input at once.
-module(starl_cli_dispatch).

-export([run/2, read/2]).

-type subject() :: starl_cli_command:subject().

%% @doc Runs a command with its arguments; gives the exit status. Every command takes `--trust' ({@link
%% starl_cli_made_here}).
-spec run(starl_cli_command:command(), [string()]) -> starl_cli_terminal:status().
run(Command, Args) ->
    case lists:member("--trust", Args) of
        true -> starl_cli_made_here:trusting(fun() -> run_one(Command, Args -- ["--trust"]) end);
        false -> run_one(Command, Args)
    end.

run_one(#{run := Run} = Command, Args) ->
    try read(Command, Args) of
        {ok, Call} -> answered(Run(Call), Command);
        {help, Word, Subject} -> show(starl_cli_usage:command(Command, Word, Subject));
        {error, _} = Error -> answered(Error, Command)
    after
        starl_cli_made_here:forget()
    end.

answered({error, Problems}, #{name := Name}) ->
    starl_cli_terminal:bad_input([[Name, ": ", Problem] || Problem <- Problems]);
answered(Status, _Command) ->
    Status.

show(Text) ->
    starl_cli_terminal:help(Text),
    0.

%% @doc Reads the arguments of a command and reports all problems at once.
-spec read(starl_cli_command:command(), [string()]) ->
    {ok, starl_cli_command:call()}
    | {help, Word :: string() | none, subject()}
    | {error, [unicode:chardata(), ...]}.
read(Command, Args) ->
    Argument = starl_cli_command:argument(Command),
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
    {error, [["name ", one(word(Placeholder)), " first, ", hint(Known, Command)]]};
without_word(_Argument, Command, Args) ->
    parsed(Command, none, Args, Args).

word(Placeholder) -> string:trim(string:lowercase(Placeholder), trailing, ".").

one("files") ->
    "files";
one([First | _] = Word) ->
    case lists:member(First, "aeiou") of
        true -> ["an ", Word];
        false -> ["a ", Word]
    end.

hint({example, Word}, #{name := Name}) ->
    ["as in ./starl ", Name, " ", Word, "; ./starl ", Name, " --help tells more"];
hint(Choices, _Command) ->
    ["one of ", lists:join(", ", names(Choices))].

with_word({_, Placeholder, Known}, Command, {Word, Others, Args}, Help) ->
    case {subject(Known, Placeholder, Command, Word, Others), Help} of
        {{ok, Subject, _}, true} -> {help, Word, Subject};
        {{ok, Subject, Rest}, false} -> parsed(Command, Subject, Rest, Args);
        {{error, _} = Error, _} -> Error
    end.

subject({example, _}, _Placeholder, #{subject := Subject}, Word, Args) ->
    Subject(Word, Args);
subject(Choices, Placeholder, Command, Word, Args) ->
    case [Name || {Name, _} <- Choices, atom_to_list(Name) =:= Word] of
        [Name] -> {ok, Name, Args};
        [] -> other(Choices, Placeholder, Command, {Word, Args})
    end.

%% A file of the user's own may stand for one of the choices.
other(Choices, Placeholder, Command, {Word, Args}) ->
    case {Command, filename:extension(Word)} of
        {#{subject := Subject}, ".erl"} -> Subject(Word, Args);
        _ -> {error, [unknown(Word, string:lowercase(Placeholder), names(Choices))]}
    end.

unknown(Word, What, Names) ->
    All = ["; there are ", lists:join(", ", Names)],
    ["there is no ", What, " ", Word, starl_similar:meant(starl_similar:words(Word, Names), All)].

names(Choices) -> [atom_to_list(Name) || {Name, _} <- Choices].

parsed(Command, Subject, Rest, Args) ->
    Flags = lists:append([Some || {_, Some} <- starl_cli_command:flags(Command, Subject)]),
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
    {Problems, _} = starl_cli_target:scenario(Target, Given),
    Problems;
in_file(_Subject) ->
    [].
