%% @doc The shapes of messages: is a term that came over the radio what a machine expects?
%%
%% A packet that says that it comes from another robot's machine may come from anywhere, and hold
%% anything. A machine that says what it takes ({@link starl_machine}, `accepts/2') is given nothing
%% else.
-module(starl_shape).

-export([is/2]).

-export_type([t/0]).

%% `integer', `natural' (from 0) and `count' (from 1) are of at most 58 bits; `mm' is a float of a
%% length that is possible, `point' a pair of them; a list stands for a tuple with elements of
%% these shapes, `{list, Shape}' for a proper list.
-type t() ::
    any
    | atom
    | boolean
    | integer
    | natural
    | count
    | mm
    | point
    | {is, Value :: term()}
    | {either, [t()]}
    | {list, t()}
    | [t()].

-define(MOST, 16#3FFFFFFFFFFFFFF).
-define(MOST_MM, 1.0e9).

%% @doc Is the term of this shape?
-spec is(t(), term()) -> boolean().
is(any, _Term) -> true;
is(atom, Term) -> is_atom(Term);
is(boolean, Term) -> is_boolean(Term);
is(integer, Term) -> is_integer(Term) andalso abs(Term) =< ?MOST;
is(natural, Term) -> is_integer(Term) andalso Term >= 0 andalso Term =< ?MOST;
is(count, Term) -> is_integer(Term) andalso Term > 0 andalso Term =< ?MOST;
is(mm, Term) -> is_float(Term) andalso abs(Term) =< ?MOST_MM;
is(point, {X, Y}) -> is(mm, X) andalso is(mm, Y);
is(point, _Term) -> false;
is({is, Value}, Term) -> Term =:= Value;
is({either, Shapes}, Term) -> lists:any(fun(Shape) -> is(Shape, Term) end, Shapes);
is({list, Shape}, Term) -> is_list_of(Shape, Term);
is(Shapes, Term) -> is_tuple(Term) andalso are(Shapes, tuple_to_list(Term)).

is_list_of(_Shape, []) -> true;
is_list_of(Shape, [Term | Terms]) -> is(Shape, Term) andalso is_list_of(Shape, Terms);
is_list_of(_Shape, _Improper) -> false.

are([Shape | Shapes], [Term | Terms]) -> is(Shape, Term) andalso are(Shapes, Terms);
are(Shapes, Terms) -> Shapes =:= [] andalso Terms =:= [].
