%% @doc Checks whether a term from the radio has the expected shape of a message.
%%
%% A packet that claims to come from another robot's machine may come from anywhere and hold any
%% term. So a machine declares the messages that it accepts ({@link starl_machine}, `accepts/2'),
%% and gets no others.
-module(starl_shape).

-export([is/2]).

-export_type([t/0]).

%% `integer', `natural' (from 0) and `count' (from 1) have at most 59 bits; `serial' (from 1), a number
%% that begins with an incarnation, has at most 128; `mm' is a float of a
%% possible length, `point' a pair of them; `label' and `content' are plain data within bounds ({@link
%% starl_payload}); a list stands for a tuple with elements of these shapes, `{list, Shape}' for a proper list.
-type t() ::
    any
    | atom
    | boolean
    | integer
    | natural
    | count
    | serial
    | mm
    | point
    | label
    | content
    | {is, Value :: term()}
    | {either, [t()]}
    | {list, t()}
    | [t()].

-define(MOST, 16#7FFFFFFFFFFFFFF).
-define(MOST_SERIAL, 16#FFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFF).
-define(MOST_MM, 1.0e9).

%% @doc Has the term this shape?
-spec is(t(), term()) -> boolean().
is(any, _Term) -> true;
is(atom, Term) -> is_atom(Term);
is(boolean, Term) -> is_boolean(Term);
is(integer, Term) -> is_integer(Term) andalso abs(Term) =< ?MOST;
is(natural, Term) -> is_integer(Term) andalso Term >= 0 andalso Term =< ?MOST;
is(count, Term) -> is_integer(Term) andalso Term > 0 andalso Term =< ?MOST;
is(serial, Term) -> is_integer(Term) andalso Term > 0 andalso Term =< ?MOST_SERIAL;
is(mm, Term) -> is_float(Term) andalso abs(Term) =< ?MOST_MM;
is(point, {X, Y}) -> is(mm, X) andalso is(mm, Y);
is(point, _Term) -> false;
is(label, Term) -> starl_payload:check(label, Term) =:= ok;
is(content, Term) -> starl_payload:check(content, Term) =:= ok;
is({is, Value}, Term) -> Term =:= Value;
is({either, Shapes}, Term) -> lists:any(fun(Shape) -> is(Shape, Term) end, Shapes);
is({list, Shape}, Term) -> is_list_of(Shape, Term);
is(Shapes, Term) -> is_tuple(Term) andalso are(Shapes, tuple_to_list(Term)).

is_list_of(_Shape, []) -> true;
is_list_of(Shape, [Term | Terms]) -> is(Shape, Term) andalso is_list_of(Shape, Terms);
is_list_of(_Shape, _Improper) -> false.

are([Shape | Shapes], [Term | Terms]) -> is(Shape, Term) andalso are(Shapes, Terms);
are(Shapes, Terms) -> Shapes =:= [] andalso Terms =:= [].
