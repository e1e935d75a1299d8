%% @doc Keeps the frames of a run for its pages, by number, up to a limit of bytes. The oldest are
%% dropped. A pure module.
-module(starl_view_frames).

-export([new/1, add/2, clear/1, last/1, later/2]).

-export_type([t/0]).

%% A page gets about this much at once.
-define(ANSWER_BYTES, 512 * 1024).

-record(frames, {
    most_bytes :: pos_integer(),
    kept = #{} :: #{pos_integer() => binary()},
    first = 1 :: pos_integer(),
    last = 0 :: non_neg_integer(),
    bytes = 0 :: non_neg_integer()
}).

-opaque t() :: #frames{}.

%% @doc No frames yet; at most these bytes are kept, but always the last frame.
-spec new(MostBytes :: pos_integer()) -> t().
new(Most) -> #frames{most_bytes = Most}.

%% @doc One frame more.
-spec add(binary(), t()) -> t().
add(Frame, #frames{kept = Kept, last = Last, bytes = Bytes} = Frames) ->
    trimmed(Frames#frames{
        kept = Kept#{Last + 1 => Frame}, last = Last + 1, bytes = Bytes + byte_size(Frame)
    }).

trimmed(#frames{bytes = Bytes, most_bytes = Most, first = First, last = Last} = Frames) when
    Bytes > Most, First < Last
->
    {Frame, Kept} = maps:take(First, Frames#frames.kept),
    trimmed(Frames#frames{kept = Kept, first = First + 1, bytes = Bytes - byte_size(Frame)});
trimmed(Frames) ->
    Frames.

%% @doc Forgets all frames; the numbers go on.
-spec clear(t()) -> t().
clear(#frames{last = Last} = Frames) -> Frames#frames{kept = #{}, first = Last + 1, bytes = 0}.

%% @doc The number of the last frame.
-spec last(t()) -> non_neg_integer().
last(#frames{last = Last}) -> Last.

%% @doc The frames after this one, not too many at once, and the number of the last of them; `missed':
%% some are forgotten.
-spec later(Number :: non_neg_integer(), t()) -> {[binary()], Upto :: non_neg_integer()} | missed.
later(Number, #frames{first = First}) when Number + 1 < First -> missed;
later(Number, #frames{last = Last, kept = Kept}) -> some(Number + 1, Last, Kept, [], 0).

some(N, Last, _Kept, Parts, Bytes) when N > Last; Bytes > ?ANSWER_BYTES ->
    {lists:reverse(Parts), N - 1};
some(N, Last, Kept, Parts, Bytes) ->
    #{N := Frame} = Kept,
    some(N + 1, Last, Kept, [Frame | Parts], Bytes + byte_size(Frame)).
