%% @doc Checks whether a predicate was true at some moment of a recording, if the robots' clocks
%% agree to within a bound. The verdict is never, possibly or certainly.
%% ```
%%   {ok, Recording} = starl_debug_recording:read(["run.mcap"], #{}),
%%   {ok, Formula} = starl_debug:predicate("dist(r1.pos, r2.pos) < 400 mm"),
%%   #{verdict := never} = starl_debug_check:run(Formula, Recording, #{sigma => 50000}, Look)
%% '''
%% An `or' is decided part by part. Parts of the same two robots form one part, because together
%% they may be certain although none of them is. Time is cut into slices, so that clocks need not
%% agree for longer than a slice, and the finished slices are known when the user stops the check. A
%% part that is possible in one slice with some clocks and in another slice with other clocks is
%% possible. It is certain only if a single slice makes it so.
-module(starl_debug_check).

-export([run/4]).

-export_type([options/0, answer/0, found/0, look/0]).

%% `sigma': how far two clocks differ at most (us), or the bounds that messages give; `drift_ppm':
%% by how much a clock's rate differs from 1; `from' and `until': the times that are looked at (us
%% of the recording); `solver': asked what the search leaves open of three robots and more.
-type options() :: #{
    sigma := non_neg_integer() | starl_debug_clocks:bounds(),
    drift_ppm => non_neg_integer(),
    from => integer(),
    until => integer(),
    solver => starl_debug_cases:solver()
}.

%% What was found in one slice of one part.
-type found() :: #{
    formula := starl_debug_ground:t(),
    slice := starl_debug_set:interval(),
    outcome := starl_debug_search:outcome()
}.

%% `best': the slice that gives the verdict; `times': when it may be true, by slices; `parts' of the
%% predicate in slices, those of them that were decided without a doubt, and the time until which
%% all was looked at; and the time until which the recordings tell all, if that is within the times
%% that were to be looked at. What lies behind it is never certain.
-type answer() :: #{
    verdict := starl_debug_search:verdict(),
    best := none | found(),
    times := starl_debug_set:t(),
    parts := non_neg_integer(),
    open := [found()],
    until := integer(),
    is_whole := boolean(),
    known_until := integer() | infinity
}.

%% Asked after each slice, with the part that is done; `stop' ends the check.
-type look() :: fun((Done :: float()) -> continue | stop).

-define(SLICE_US, 1000000).
-define(DRIFT_PPM, 100).
%% A window is halved down to this part of it.
-define(PARTS, 128).
-define(FINEST_US, 50).
-define(LOOKS_PAIR, 300).
-define(LOOKS_TEAM, 64).

-record(check, {
    facts :: starl_debug_eval:facts(),
    options :: options(),
    answer :: answer()
}).

%% @doc Checks a predicate.
-spec run(starl_debug_ground:t(), starl_debug_recording:t(), options(), look()) -> answer().
run(Formula, Recording, Options, Look) ->
    #{states := States, tracks := Tracks} = Recording,
    Groups = groups(Formula),
    Ppm = maps:get(drift_ppm, Options, ?DRIFT_PPM),
    Facts = #{states => States, tracks => Tracks, drift_ppm => Ppm, locals => #{}},
    {From, Until} = range(Recording, Options),
    Check = #check{
        facts = Facts#{locals := locals(Groups, Facts)},
        options = Options,
        answer = #{
            verdict => never,
            best => none,
            times => [],
            parts => 0,
            open => [],
            until => From,
            is_whole => From > Until,
            known_until => known_until(Formula, Recording, Options, Until)
        }
    },
    #check{answer = Answer} = slices(From, {From, Until}, Groups, Look, Check),
    Answer.

known_until(Formula, #{holes := Holes}, #{sigma := Sigma}, Until) ->
    Robots = starl_debug_ground:robots(Formula),
    case starl_debug_hole:known_until(Robots, Holes) of
        Known when Known =< Until -> Known - min(?SLICE_US, starl_debug_clocks:widest(Sigma));
        _ -> infinity
    end.

%% The common time of the line may be outside of all recordings by the error of the clocks.
range(#{extent := {First, Last}}, #{sigma := Sigma} = Options) ->
    Off = min(?SLICE_US, starl_debug_clocks:widest(Sigma)),
    {
        max(First - Off, maps:get(from, Options, First - Off)),
        min(Last + Off, maps:get(until, Options, Last + Off))
    }.

%% The alternatives of a formula, those of the same one or two robots together.
-spec groups(starl_debug_ground:t()) -> [starl_debug_ground:t()].
groups({'or', Parts}) ->
    Robots = [{starl_debug_ground:robots(Part), Part} || Part <- Parts],
    {Few, Many} = lists:partition(fun({Rs, _}) -> length(Rs) =< 2 end, Robots),
    Add = fun({Rs, Part}, Acc) -> maps:update_with(Rs, fun(Ps) -> [Part | Ps] end, [Part], Acc) end,
    Joined = lists:sort(maps:to_list(lists:foldl(Add, #{}, Few))),
    [joined(lists:reverse(Ps)) || {_, Ps} <- Joined] ++ [Part || {_, Part} <- Many];
groups(false) ->
    [];
groups(Formula) ->
    [Formula].

joined([Part]) -> Part;
joined(Parts) -> {'or', Parts}.

%% What one robot knows of itself is computed once.
locals(Groups, Facts) ->
    Wanted = lists:usort(lists:flatmap(fun parts/1, Groups)),
    maps:from_list([
        {Formula, starl_debug_eval:local(R, Local, Facts)}
     || {local, R, Local} = Formula <- Wanted
    ]).

parts({local, _, _} = Formula) ->
    [Formula];
parts({Operator, Parts}) when Operator =:= 'and'; Operator =:= 'or' ->
    lists:flatmap(fun parts/1, Parts);
parts({at_least, _, Parts}) ->
    lists:flatmap(fun parts/1, Parts);
parts({How, _Us, A}) when How =:= held; How =:= once; How =:= ago -> parts(A);
parts(_Other) ->
    [].

%% -- slices ---------------------------------------------------------------------------------

slices(From, {_, Until}, _Groups, _Look, Check) when From > Until ->
    ended(true, Check);
slices(From, {First, Until} = Range, Groups, Look, #check{answer = Answer} = Check) ->
    To = min(Until, From + ?SLICE_US - 1),
    Done = (From - First) / max(1, Until - First),
    case {Answer, Look(Done)} of
        {#{verdict := certainly}, _} ->
            ended(false, Check);
        {_, stop} ->
            ended(false, Check);
        {_, continue} ->
            Next = slice({From, To}, Groups, near(From, To, Groups, Check)),
            slices(To + 1, Range, Groups, Look, Next)
    end.

ended(IsWhole, #check{answer = #{open := Open, times := Times} = Answer} = Check) ->
    Check#check{
        answer = Answer#{
            is_whole := IsWhole,
            open := lists:reverse(Open),
            times := starl_debug_set:union(lists:reverse(Times))
        }
    }.

slice({_, To} = Slice, Groups, #check{facts = Facts} = Check) ->
    Cut = Check#check{facts = Facts#{locals := cut(To, Check)}},
    #check{answer = Answer} = lists:foldl(fun(G, C) -> group(G, Slice, C) end, Cut, Groups),
    Check#check{answer = Answer#{until := To}}.

%% The sets are sorted, and slices come in order: what is over is dropped for good, what is still
%% far is left out, so that a long recording costs no more a second than a short one.
near(From, _To, Groups, #check{facts = #{locals := Locals} = Facts} = Check) ->
    Before = From - margin(Groups, Check),
    Drop = fun(Set) -> lists:dropwhile(fun({_, B}) -> B < Before end, Set) end,
    Check#check{
        facts = Facts#{
            locals := maps:map(fun(_, {May, Must}) -> {Drop(May), Drop(Must)} end, Locals)
        }
    }.

cut(To, #check{facts = #{locals := Locals}} = Check) ->
    After = To + widest(Check),
    Take = fun(Set) -> lists:takewhile(fun({A, _}) -> A =< After end, Set) end,
    maps:map(fun(_, {May, Must}) -> {Take(May), Take(Must)} end, Locals).

margin(Groups, #check{facts = Facts} = Check) ->
    widest(Check) + lists:max([0 | [look_back_us(G, Facts) || G <- Groups]]).

widest(#check{options = #{sigma := Sigma}}) ->
    starl_debug_clocks:widest(Sigma) + 2 * ?SLICE_US.

%% As far back as the truth in a slice depends on.
look_back_us(Formula, Facts) ->
    Us = starl_debug_ground:look_back_us(Formula),
    Us + starl_debug_eval:slack_us(Us, Facts).

group(Formula, {From, To} = Slice, #check{options = Options, facts = Facts} = Check) ->
    #{sigma := Sigma} = Options,
    Robots = starl_debug_ground:robots(Formula),
    LookBack = look_back_us(Formula, Facts),
    Windows = starl_debug_clocks:windows(Robots, {From - LookBack, To}, Sigma),
    Width = lists:max([0 | [Hi - Lo || {Lo, Hi} <- maps:values(Windows)]]),
    Limits = #{
        drift => drift(To - From + LookBack, Facts),
        fine => max(?FINEST_US, Width div ?PARTS),
        looks => looks(Robots)
    },
    Searched = starl_debug_search:decide(Formula, {Slice, Windows}, Facts, Limits),
    Settled = settled(Searched, Formula, {Slice, Windows}, Facts, Limits, Options),
    Outcome = as_known(Settled, To, Check#check.answer),
    Found = #{formula => Formula, slice => Slice, outcome => Outcome},
    Check#check{answer = better(Found, Check#check.answer)}.

%% What is possible and may be certain is a question of cases.
settled(#{is_open := true, is_shown := true} = Outcome, Formula, When, Facts, Limits, #{
    solver := Solver
}) ->
    case starl_debug_cases:decide(Formula, When, Facts, Limits, Solver) of
        certainly -> Outcome#{verdict := certainly, is_open := false};
        not_certainly -> Outcome#{is_open := false};
        undecided -> Outcome
    end;
settled(Outcome, _Formula, _When, _Facts, _Limits, _Options) ->
    Outcome.

%% What was in a hole may have ended what was true before it.
as_known(#{verdict := certainly} = Outcome, To, #{known_until := Known}) when To >= Known ->
    Outcome#{verdict := possibly, is_open := true};
as_known(Outcome, _To, _Answer) ->
    Outcome.

looks(Robots) when length(Robots) =< 2 -> ?LOOKS_PAIR;
looks(_Robots) -> ?LOOKS_TEAM.

%% Two clocks run apart twice as fast as one from the true time.
drift(Us, Facts) -> 2 * starl_debug_eval:slack_us(Us, Facts) + 1.

better(#{outcome := Outcome} = Found, #{parts := Parts, open := Open, times := Times} = Answer) ->
    #{verdict := Verdict, is_open := IsOpen, times := May} = Outcome,
    %% of a part that is never true nothing is kept: in a large team they are millions
    Next = Answer#{
        parts := Parts + 1,
        open := [Found || IsOpen] ++ Open,
        times := [May || May =/= []] ++ Times
    },
    case rank(Found) > rank(maps:get(best, Answer)) of
        true -> Next#{verdict := Verdict, best := Found};
        false -> Next
    end.

rank(none) -> 0;
rank(#{outcome := #{verdict := never}}) -> 0;
rank(#{outcome := #{verdict := possibly, is_shown := false}}) -> 1;
rank(#{outcome := #{verdict := possibly}}) -> 2;
rank(#{outcome := #{verdict := certainly}}) -> 3.
