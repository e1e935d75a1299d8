%% @doc Finds the error of the clocks at which an answer changes. It also says what would decide the
%% answer: better clocks, or more samples of the places.
%%
%% The larger the error, the more is possible and the less is certain, so the error is found by
%% halving.
-module(starl_debug_sigma).

-export([explain/4]).

-export_type([explained/0, change/0]).

%% The answer is another one from that error on (us), or not until there.
-type change() ::
    {from, starl_debug_search:verdict(), Us :: pos_integer()} | {not_until, Us :: pos_integer()}.

%% `now': the answer for perfect clocks, and with places that are known between the samples;
%% `change': smaller and greater errors.
-type explained() :: #{
    perfect_clocks := starl_debug_search:verdict(),
    known_places := starl_debug_search:verdict(),
    both := starl_debug_search:verdict(),
    smaller := none | {until, starl_debug_search:verdict(), Us :: non_neg_integer()},
    greater := none | change()
}.

-define(MOST_US, 2000000).
-define(FIRST_US, 1000).
-define(FINE_US, 50).

%% @doc Explains the answer for a sigma.
-spec explain(
    starl_debug_ground:t(),
    starl_debug_recording:t(),
    starl_debug_check:options(),
    starl_debug_search:verdict()
) -> explained().
explain(Formula, Recording, #{sigma := Sigma} = Options, Verdict) ->
    Sharp = sharp(Recording),
    At = fun(Us) -> verdict(Formula, Recording, Options, Us) end,
    Perfect = At(0),
    #{
        perfect_clocks => Perfect,
        known_places => verdict(Formula, Sharp, Options, Sigma),
        both => verdict(Formula, Sharp, Options, 0),
        smaller => smaller(Perfect, Verdict, Sigma, At),
        greater => greater(Verdict, max(Sigma, ?FIRST_US), Sigma, At)
    }.

verdict(Formula, Recording, Options, Sigma) ->
    Go = fun(_Done) -> continue end,
    #{verdict := Verdict} = starl_debug_check:run(Formula, Recording, Options#{sigma := Sigma}, Go),
    Verdict.

sharp(#{tracks := Tracks} = Recording) ->
    Recording#{tracks := maps:map(fun(_R, Track) -> starl_debug_track:sharp(Track) end, Tracks)}.

%% The answer of perfect clocks holds until there.
smaller(Verdict, Verdict, _Sigma, _At) ->
    none;
smaller(Perfect, _Verdict, Sigma, At) when is_integer(Sigma) ->
    {Last, _} = halved(0, Sigma, fun(Us) -> At(Us) =:= Perfect end),
    {until, Perfect, Last};
smaller(_Perfect, _Verdict, _Bounds, _At) ->
    none.

greater(possibly, _Us, _Sigma, _At) ->
    none;
greater(_Verdict, _Us, Sigma, _At) when not is_integer(Sigma) ->
    none;
greater(_Verdict, Us, _Sigma, _At) when Us >= ?MOST_US ->
    {not_until, ?MOST_US};
greater(Verdict, Us, Sigma, At) ->
    Wider = min(?MOST_US, 2 * Us),
    case At(Wider) of
        Verdict ->
            greater(Verdict, Wider, Sigma, At);
        _Other ->
            {_, First} = halved(max(Sigma, Us div 2), Wider, fun(X) -> At(X) =:= Verdict end),
            {from, At(First), First}
    end.

%% The last error at which it holds and the first at which it does not, a two-hundredth apart.
halved(Low, High, _Holds) when High - Low =< ?FINE_US; High - Low =< High div 200 ->
    {Low, High};
halved(Low, High, Holds) ->
    Middle = (Low + High) div 2,
    case Holds(Middle) of
        true -> halved(Middle, High, Holds);
        false -> halved(Low, Middle, Holds)
    end.
