%% @doc Keeps what a robot knows of the owners of tokens. It also keeps the requests that arrived
%% before the token that they look for. Pure; a part of {@link starl_mutex_tokens}.
-module(starl_mutex_owners).

-export([new/0, newest/2, announced/4, refute/3, handed/4, wait/4, take_early/2]).

-export_type([t/0]).

-type token() :: starl_mutex:token().
-type fence() :: starl_mutex:fence().
-type request() :: starl_mutex_home:request().

-record(owners, {
    newest = #{} :: #{token() => {fence(), starl:robot_id()}},
    early = #{} :: #{token() => [early()]}
}).

-opaque t() :: #owners{}.

%% The most tokens that a robot is known to own, and the most for which requests wait here. Beyond
%% that a request finds its token later: a robot that waits asks the home again.
-define(TOKENS, 4096).

%% A request, and the number of the owner that its sender knew of.
-type early() :: {request(), Known :: fence()}.

%% @doc Nothing has been heard yet.
-spec new() -> t().
new() -> #owners{}.

%% @doc The newest owner known; the number is 0 if none is.
-spec newest(token(), t()) -> {fence() | 0, starl:robot_id() | none}.
newest(Token, #owners{newest = Newest}) -> maps:get(Token, Newest, {0, none}).

%% @doc An owner has announced itself. Returns whether it is newer than the known one, and if so the
%% requests that waited here, so that they can look for the token again.
-spec announced(token(), fence(), starl:robot_id(), t()) -> {newer, [early()], t()} | known.
announced(Token, Fence, Owner, #owners{early = Early} = Owners) ->
    case newest(Token, Owners) of
        {Known, _} when Known >= Fence ->
            known;
        {Known, _} ->
            case Known > 0 orelse owned(Owner, Owners) < ?TOKENS of
                true ->
                    Left = Owners#owners{early = maps:remove(Token, Early)},
                    {newer, maps:get(Token, Early, []), handed(Token, Fence, Owner, Left)};
                false ->
                    known
            end
    end.

owned(Owner, #owners{newest = Newest}) when map_size(Newest) >= ?TOKENS ->
    length([By || {_, By} <- maps:values(Newest), By =:= Owner]);
owned(_Owner, #owners{newest = Newest}) ->
    map_size(Newest).

%% @doc The home has confirmed this hand-over: a later one has not been, whoever said so.
-spec refute(token(), fence(), t()) -> t().
refute(Token, Fence, #owners{newest = Newest} = Owners) ->
    case Newest of
        #{Token := {Known, _}} when Known > Fence ->
            Owners#owners{newest = maps:remove(Token, Newest)};
        #{} ->
            Owners
    end.

%% @doc This robot has handed the token over.
-spec handed(token(), fence(), starl:robot_id(), t()) -> t().
handed(Token, Fence, To, #owners{newest = Newest} = Owners) ->
    Owners#owners{newest = Newest#{Token => {Fence, To}}}.

%% @doc A request waits for the token to come; the number of waiting requests is bounded.
-spec wait(token(), early(), Most :: pos_integer(), t()) -> t().
wait(Token, _Early, _Most, #owners{early = Early} = Owners) when
    not is_map_key(Token, Early), map_size(Early) >= ?TOKENS
->
    Owners;
wait(Token, {Request, Known}, Most, #owners{early = Early} = Owners) ->
    Before = maps:get(Token, Early, []),
    Waiting =
        case lists:keyfind(Request, 1, Before) of
            {_, Older} -> lists:keyreplace(Request, 1, Before, {Request, max(Known, Older)});
            false -> Before ++ [{Request, Known}]
        end,
    Owners#owners{early = Early#{Token => lists:sublist(Waiting, Most)}}.

%% @doc The requests that came before the token, which has come now.
-spec take_early(token(), t()) -> {[request()], t()}.
take_early(Token, #owners{early = Early} = Owners) ->
    Requests = [Request || {Request, _} <- maps:get(Token, Early, [])],
    {Requests, Owners#owners{early = maps:remove(Token, Early)}}.
