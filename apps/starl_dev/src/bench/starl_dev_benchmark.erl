%% @doc The behaviour of a benchmark of `./starl bench': its flags, what may be wrong with them, and
%% the measurement, which prints a line for each row of figures.
-module(starl_dev_benchmark).

-export([problems/2]).

-export_type([options/0, figures/0]).

%% The values of the benchmark's flags.
-type options() :: #{atom() => term()}.

%% A row, as it goes to the file. Where there is `checks', it says whether the run was as it must be.
-type figures() :: [{atom(), starl_cli_json:value()}].

-callback flags() -> [starl_cli_flags:flag()].
%% What cannot be measured, a line for each problem; known before the work is begun.
-callback problems(options()) -> [unicode:chardata()].
-callback run(options()) -> [figures()].

-optional_callbacks([problems/1]).

%% @doc What a benchmark finds wrong with its options.
-spec problems(module(), options()) -> [unicode:chardata()].
problems(Benchmark, Options) ->
    {module, Benchmark} = code:ensure_loaded(Benchmark),
    case erlang:function_exported(Benchmark, problems, 1) of
        true -> Benchmark:problems(Options);
        false -> []
    end.
