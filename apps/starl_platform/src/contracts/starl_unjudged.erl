%% @doc A part of a run without a verdict: its contract is neither kept nor broken. It says which
%% monitor does not judge, from when to when, and why.
-module(starl_unjudged).

-export([mistake/3, since/3, is_why/1, format/1, format_why/1]).
-export([unhealed/3, excused/4, lossy/2, too_few/2, too_short/3, with/2, format_clause/2]).

-export_type([t/0, why/0, clause/0]).

%% Monitors by the names of reports.
-type t() :: #{
    monitors := [Name :: string(), ...] | all,
    from_us := integer(),
    to_us := integer() | the_end,
    why := why()
}.

%% A monitor has a mistake, which the line describes; a recording has a hole until that time, or lacks
%% so many events, or is cut off or damaged, so that its end is not known; facts came later than the judge
%% waits for them, since the computer, or that of a node, stood still; the clocks of two computers are apart
%% by so much; of one robot, it is so far ahead of the judge's, or behind; a robot's computer lost its power
%% before it had written what the robot did last.
-type why() ::
    {mistake, Line :: binary()}
    | {hole, ToUs :: integer()}
    | {missing, Events :: pos_integer()}
    | no_end
    | {stood_still, FromUs :: integer(), ToUs :: integer()}
    | {clocks, starl:robot_id(), starl:robot_id(), Us :: integer()}
    | {lost_power, starl:robot_id()}.

%% A clause of a contract that a monitor cannot judge in this run, and why not. It stands in the monitor's results
%% under `unjudged'. The run has a verdict all the same: the other clauses.
-type clause() :: {Clause :: unicode:chardata(), Why :: unicode:chardata()}.

%% @doc The clause is not judged if the faults that can hold it up last until the end of the run.
-spec unhealed(Clause :: unicode:chardata(), HealedUs :: integer() | never, EndUs :: integer()) ->
    [clause()].
unhealed(Clause, never, _EndUs) ->
    [{Clause, "range, walls or shadows may take any packet"}];
unhealed(Clause, HealedUs, EndUs) ->
    [{Clause, "a fault lasts until the end"} || HealedUs >= EndUs, HealedUs > 0].

%% @doc The clause, whose bound begins anew after each of these faults, is not judged if they leave no time that is
%% as long as the bound.
-spec excused(
    Clause :: unicode:chardata(),
    BoundUs :: non_neg_integer(),
    EndUs :: integer(),
    Faults :: starl_assumption:t()
) -> [clause()].
excused(Clause, BoundUs, EndUs, Faults) ->
    case starl_assumption:calm_us(0, BoundUs, Faults) of
        Due when Due > EndUs, Due > BoundUs -> [{Clause, "faults leave no time for it"}];
        _Due -> []
    end.

%% @doc The clause is not judged, since the radio loses too many packets.
-spec lossy(Clause :: unicode:chardata(), Loss :: number()) -> [clause()].
lossy(Clause, Loss) ->
    [{Clause, io_lib:format("the radio loses ~s %", [percent(100.0 * Loss)])}].

%% @doc The clause is not judged, since chance may explain all that so few messages suffered.
-spec too_few(Clause :: unicode:chardata(), Loss :: number()) -> [clause()].
too_few(Clause, Loss) ->
    [
        {Clause,
            io_lib:format("too few messages for a radio that loses ~s %", [percent(100.0 * Loss)])}
    ].

%% @doc The clause is not judged, since what is open lasts shorter than its bound.
-spec too_short(Clause :: unicode:chardata(), BoundUs :: integer(), What :: string()) ->
    [clause()].
too_short(Clause, BoundUs, What) ->
    [{Clause, io_lib:format("~ts, for less than the bound of ~.1f s", [What, BoundUs / 1.0e6])}].

percent(Part) -> float_to_list(Part, [{decimals, 1}, compact]).

%% @doc A monitor's results, with the clauses that it has not judged, if there are any.
-spec with([clause()], map()) -> map().
with([], Results) -> Results;
with(Clauses, Results) -> Results#{unjudged => Clauses}.

%% @doc One line on a clause that a monitor has not judged.
-spec format_clause(Monitor :: string(), clause()) -> unicode:chardata().
format_clause(Monitor, {Clause, Why}) -> ["not judged: ", Monitor, ", ", Clause, ": ", Why].

%% @doc A monitor has made a mistake: from this time on it does not judge.
-spec mistake(Monitor :: string(), AtUs :: integer(), Line :: unicode:chardata()) -> t().
mistake(Monitor, AtUs, Line) ->
    #{
        monitors => [Monitor],
        from_us => AtUs,
        to_us => the_end,
        why => {mistake, unicode:characters_to_binary(Line)}
    }.

%% @doc These monitors judge no further from this time on.
-spec since(AtUs :: integer(), Monitors :: [string(), ...], why()) -> t().
since(AtUs, Monitors, Why) ->
    #{monitors => Monitors, from_us => AtUs, to_us => the_end, why => Why}.

%% @doc One line: which contracts are not judged, from when to when (s), and why.
-spec format(t()) -> unicode:chardata().
format(#{monitors := Monitors, from_us := From, to_us := To, why := Why}) ->
    ["not judged", who(Monitors), when_(From, To), ": ", why(Why)].

who(all) -> "";
who(Monitors) -> [": ", lists:join(", ", Monitors)].

when_(From, the_end) -> io_lib:format(" from ~.6f s on", [From / 1.0e6]);
when_(From, To) -> io_lib:format(" from ~.6f to ~.6f s", [From / 1.0e6, To / 1.0e6]).

why({mistake, Line}) ->
    Line;
why({hole, To}) ->
    io_lib:format("the recording has a hole there, until ~.6f s", [To / 1.0e6]);
why({missing, Events}) ->
    io_lib:format("~b events are missing in the recording there", [Events]);
why(no_end) ->
    "the recording ends there, and the run did not";
why({stood_still, From, To}) ->
    io_lib:format("the computer stood still from ~.3f to ~.3f s", [From / 1.0e6, To / 1.0e6]);
why({clocks, A, A, Us}) when Us < 0 ->
    io_lib:format("the clock of robot ~b is ~.1f ms behind", [A, -Us / 1000]);
why({clocks, A, A, Us}) ->
    io_lib:format("the clock of robot ~b is ~.1f ms ahead", [A, Us / 1000]);
why({clocks, A, B, Us}) ->
    io_lib:format("the clocks of robots ~b and ~b are ~.1f ms apart", [A, B, Us / 1000]);
why({lost_power, Robot}) ->
    io_lib:format(
        "robot ~b lost its power there, and what it did last is not recorded, though others heard it",
        [
            Robot
        ]
    ).

%% @doc One line on why something is not judged.
-spec format_why(why()) -> unicode:chardata().
format_why(Why) -> ["not judged any further: ", why(Why)].

%% @doc Is this a reason why a recording is not judged further? Asked of what comes from a file.
-spec is_why(term()) -> boolean().
is_why({hole, To}) -> is_integer(To);
is_why(no_end) -> true;
is_why({stood_still, From, To}) -> is_integer(From) andalso is_integer(To);
is_why({clocks, A, B, Us}) -> is_integer(A) andalso is_integer(B) andalso is_integer(Us);
is_why({lost_power, Robot}) -> is_integer(Robot);
is_why(_) -> false.
