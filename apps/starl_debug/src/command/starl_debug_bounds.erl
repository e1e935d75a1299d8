%% @doc Reads the flags `--sigma' and `--drift', which bound how far the robots' clocks may differ.
-module(starl_debug_bounds).

-export([flag/1, drift/0, read/1, bounds/3, words/1, offsets/2, ms/1]).

%% What nothing was said of.
-define(SIGMA_US, 10000).
-define(MOST_S, 60).
-define(MOST_ROBOTS, 8).

%% @doc The flag, with its default in words.
-spec flag(string()) -> starl_cli_flags:flag().
flag(Default) ->
    {sigma, string, none,
        "how far two clocks differ at most, such as 50ms; auto: as the messages bound it" ++
            Default}.

%% @doc The flag for the rates of clocks.
-spec drift() -> starl_cli_flags:flag().
drift() -> {drift, {number, 0, 10000}, 100, "by how much the rate of a clock is off at most, ppm"}.

%% @doc Reads a value of the flag (us).
-spec read(string() | none) -> {ok, auto | non_neg_integer()} | {error, unicode:chardata()}.
read(none) ->
    {ok, ?SIGMA_US};
read("auto") ->
    {ok, auto};
read("0") ->
    {ok, 0};
read(Text) ->
    case starl_debug_lexer:tokens(Text) of
        {ok, [{number, _, Number}, {name, _, Unit}]} -> us(Number, Unit, Text);
        _ -> bad(Text)
    end.

us(Number, <<"us">>, _Text) when Number =< 1000000 * ?MOST_S -> {ok, round(Number)};
us(Number, <<"ms">>, _Text) when Number =< 1000 * ?MOST_S -> {ok, round(1000 * Number)};
us(Number, <<"s">>, _Text) when Number =< ?MOST_S -> {ok, round(1000000 * Number)};
us(_Number, _Unit, Text) -> bad(Text).

bad(Text) ->
    Line = "--sigma: a duration of at most ~b s, such as 50ms, or auto expected, not \"~ts\"",
    {error, io_lib:format(Line, [?MOST_S, Text])}.

%% @doc What is known of the clocks of a recording, for {@link starl_debug_check:options()}.
-spec bounds(auto | non_neg_integer(), starl_debug_recording:t(), DriftPpm :: number()) ->
    {ok, non_neg_integer() | starl_debug_clocks:bounds()} | {error, unicode:chardata()}.
bounds(auto, Recording, Drift) ->
    case starl_debug_envelope:from_packets(Recording, Drift) of
        {ok, _} = Bounds -> Bounds;
        {error, Line} -> {error, ["--sigma auto: ", Line]}
    end;
bounds(Sigma, #{how := told, packets := [_ | _]} = Recording, Drift) ->
    case starl_debug_envelope:from_packets(Recording, Drift) of
        {ok, Bounds} -> within(Sigma, starl_debug_envelope:least(Bounds));
        {error, _} -> {ok, Sigma}
    end;
bounds(Sigma, _Recording, _Drift) ->
    {ok, Sigma}.

%% No clocks within a sigma that the packets refute can be looked at.
within(Sigma, {Us, R, Q}) when Us > Sigma ->
    [A, B] = lists:sort([R, Q]),
    Line =
        "--sigma ~ts: by the packets the clocks of r~b and r~b differ by ~ts at least; "
        "give more, or auto",
    {error, io_lib:format(Line, [ms(Sigma), A, B, ms(Us)])};
within(Sigma, _Possible) ->
    {ok, Sigma}.

%% @doc The same for people.
-spec words(non_neg_integer() | starl_debug_clocks:bounds()) -> unicode:chardata().
words(Sigma) when is_integer(Sigma) -> ["any two clocks within ", ms(Sigma)];
words(Bounds) ->
    ["clocks as messages bound them, at worst within ", ms(starl_debug_clocks:widest(Bounds))].

%% @doc What the messages say of each clock, beside that of the first robot, over the whole recording.
-spec offsets(non_neg_integer() | starl_debug_clocks:bounds(), starl_debug_recording:t()) ->
    unicode:chardata().
offsets(Sigma, _Recording) when is_integer(Sigma) ->
    "";
offsets(Bounds, #{robots := [First | Others], extent := Extent}) ->
    [
        [
            io_lib:format("the clock of r~b, less that of r~b: ", [R, First]),
            offset(starl_debug_envelope:offset(First, R, Extent, Bounds)),
            "\n"
        ]
     || R <- lists:sublist(Others, ?MOST_ROBOTS)
    ] ++
        [
            io_lib:format("and ~b robots more\n", [length(Others) - ?MOST_ROBOTS])
         || length(Others) > ?MOST_ROBOTS
        ].

offset({Least, Most}) when Most - Least >= 2 * 1000000 * ?MOST_S ->
    "not bounded by packets of both";
offset({Least, Most}) ->
    [ms(Least), " .. ", ms(Most)].

%% @doc Microseconds as milliseconds.
-spec ms(integer()) -> unicode:chardata().
ms(Us) -> io_lib:format("~.1f ms", [Us / 1000]).
