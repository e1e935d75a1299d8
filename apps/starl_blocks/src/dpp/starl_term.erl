%% @doc Decides how far a robot believes the term numbers that others send.
%%
%% A robot's term number only grows, and a robot that knows a higher number refuses all lower ones.
%% So if others believed the largest possible number, the robot that sends it would stop the team
%% for good. Three rules always leave room for higher numbers:
%% <ul>
%% <li>Robots count terms by one. Only a robot whose store was lost leaps: it guesses a number above
%% all that it can have known ({@link guess/1}). All guesses are at most 2^90, and any number up to
%% there is believed.</li>
%% <li>Above 2^90, and above what the robot knows, numbers up to 2^32 higher are believed. Fewer
%% terms than that are counted while it is away.</li>
%% <li>A higher number is not believed, but each message with one brings the robot 2^32 nearer to it
%% ({@link toward/2}). So a robot that comes back after others were raised step by step reaches them
%% in as many messages. In a hundred years nobody sends enough messages to reach 2^128.</li>
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
