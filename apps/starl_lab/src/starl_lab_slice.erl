%% @doc One slice of an experiment's runs: the K-th of N parts, each for a computer or a job of its
%% own. Its runs follow from K, N and the experiment alone: run number I, counted from 0, belongs to
%% slice 1 + I rem N. So slices take equally long if runs grow with a setting.
-module(starl_lab_slice).

-export([flag/0, read/1, part/2, text/1]).

-export_type([t/0]).

-type t() :: whole | {K :: pos_integer(), N :: pos_integer()}.

%% @doc The flag of a command that can do a slice.
-spec flag() -> starl_cli_flags:flag().
flag() -> {slice, string, none, "K/N: only the K-th of N parts of the runs, as 3/8"}.

%% @doc Reads the value of the flag.
-spec read(none | string()) -> {ok, t()} | {error, unicode:chardata()}.
read(none) ->
    {ok, whole};
read(Text) ->
    case [string:to_integer(Part) || Part <- string:split(Text, "/")] of
        [{K, ""}, {N, ""}] when 1 =< K, K =< N -> {ok, {K, N}};
        _ -> {error, [Text, ": a slice is K/N, the K-th of N parts, with K from 1 to N, as 3/8"]}
    end.

%% @doc The runs of a slice, in their order.
-spec part(t(), [Run]) -> [Run].
part(whole, Runs) -> Runs;
part(Slice, Runs) -> [Run || {I, Run} <- lists:enumerate(0, Runs), of_index(Slice, I)].

%% Does the run of this number, from 0 on, belong to the slice?
-spec of_index(t(), non_neg_integer()) -> boolean().
of_index(whole, _I) -> true;
of_index({K, N}, I) -> I rem N =:= K - 1.

%% @doc A slice as it is written on the command line.
-spec text({pos_integer(), pos_integer()}) -> string().
text({K, N}) -> lists:concat([K, "/", N]).
