%% A small module for the tests of mutation testing. What starl_mutate_fixture_tests asks of it is
%% meant to have gaps.
-module(starl_mutate_fixture).

-export([larger/2, count/1, seen/2, unused/0]).

%% The neighbour of this comparison makes no other program.
larger(A, B) when A > B -> A;
larger(_, B) -> B.

count([]) -> 0;
count([_ | Tail]) -> 1 + count(Tail).

%% Nobody looks at the value.
seen(What, Seen) -> Seen#{What => true}.

unused() -> 1.
