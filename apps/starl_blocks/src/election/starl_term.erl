%% @doc The numbers of terms, and how far a robot follows those that others say.
%%
%% A number only grows, and who knows a higher one refuses all lower ones. So a robot that says the largest
%% number that there is room for would end a team for good, were it believed. Three rules keep room for ever:
%% <ul>
%% <li>Robots count terms by one. Only a robot whose store was lost leaps: it guesses a number above all that it
%% can have known ({@link guess/1}). All guesses lie up to 2^90, and any number up to there is believed.</li>
%% <li>Above that, and above what the robot knows, 2^32 more are believed: fewer are counted while it is away.</li>
%% <li>A number beyond is not believed, but each that is said brings the robot 2^32 nearer to it ({@link
%% toward/2}). So a robot that comes back, after others were raised step by step, finds to them in as many
%% messages; and in a hundred years nobody sends enough of them to come to 2^128.</li>
%% </ul>
-module(starl_term).

-export([guess/1, toward/2, is_counted/1]).

%% A robot claims fewer than 2^32 terms in its life, even in 100 years; an incarnation has 58 bits.
-define(LIFE_BITS, 32).
-define(GUESSES, (1 bsl (58 + ?LIFE_BITS))).
-define(STEP, (1 bsl ?LIFE_BITS)).
%% More than 2^32 steps: 50 days of a thousand messages a second.
-define(STEPPED, (1 bsl 64)).

%% @doc A number higher than any that is reached by counting, for a robot in this incarnation that has lost its
%% store.
-spec guess(starl_packet:incarnation()) -> pos_integer().
guess(Incarnation) -> min(Incarnation bsl ?LIFE_BITS, ?GUESSES).

%% @doc How near to a number another robot's message brings a robot that knows another one: it is believed if this
%% is the number itself.
-spec toward(non_neg_integer(), Known :: non_neg_integer()) -> non_neg_integer().
toward(N, Known) -> min(N, max(Known, ?GUESSES) + ?STEP).

%% @doc Can a stored number come from guesses, counting, and steps? An earlier version has believed, and stored, any.
-spec is_counted(term()) -> boolean().
is_counted(N) -> is_integer(N) andalso N >= 0 andalso N =< ?GUESSES + ?STEPPED.
