%% @doc The behaviour of a benchmark of `./starl bench'. A benchmark declares its flags, checks
%% their values, measures, and prints one line per row of figures.
-module(starl_dev_benchmark).

-export([problems/2]).

-export_type([options/0, figures/0]).

%% The values of the benchmark's flags.
-type options() :: #{atom() => term()}.

%% A row of the file. An optional `checks' tells whether the run passed its checks.
-type figures() :: [{atom(), starl_json:value()}].

-callback flags() -> [starl_cli_flags:flag()].
%% The problems that prevent the measurement, one line each; checked before it begins.
-callback problems(options()) -> [unicode:chardata()].
-callback run(options()) -> [figures()].

-optional_callbacks([problems/1]).

%% @doc The problems that a benchmark finds in its options.
-spec problems(module(), options()) -> [unicode:chardata()].
problems(Benchmark, Options) -> starl_callback:call(Benchmark, problems, [Options], []).
