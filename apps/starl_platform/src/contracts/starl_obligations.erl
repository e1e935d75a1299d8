%% @doc What robots still owe by a contract, and what is overdue. A monitor says what is owed from when on
%% and for how long, and what is paid. The table says what was not paid in time. A pure module.
%% ```
%%   init(_) -> starl_obligations:new({delayed, 2}).
%%
%%   step({T, Robot, door, asked}, Owed) ->
%%       {ok, starl_obligations:owe({answer, Robot}, Robot, T, 1000000, Owed)};
%%   step({_, Robot, door, answered}, Owed) ->
%%       {ok, starl_obligations:paid({answer, Robot}, Owed)}.
%%
%%        asked                    due        latest
%%          |----------1 s----------|---excused--|----overdue---->
%% '''
%% What is paid exactly when it is due is paid in time. What a broken assumption excuses is computed
%% when something seems overdue, so windows that become known later excuse, too.
%%
%% The earliest time at which anything may be overdue is kept, so most questions cost one comparison.
-module(starl_obligations).

-export([new/1, owe/5, owe_once/5, paid/2, dropped/2, since/2, overdue/3, sinces/1]).

-export_type([t/0, t/1]).

%% How a broken assumption excuses a delay. `exact': not at all. `anew': the time begins anew at the end of
%% each window that it meets ({@link starl_assumption:calm_us/3}). `{delayed, Steps}': by what the robot's own
%% clock, pauses and slowness explain, in so many steps ({@link starl_assumption:delayed_us/5}).
-type rule() :: exact | anew | {delayed, Steps :: non_neg_integer()}.

%% Who owes: with `anew', only windows that this robot meets excuse, or those of any robot.
-type debtor() :: starl:robot_id() | team.

-type us() :: integer().

-record(obligations, {
    rule :: rule(),
    open = #{} :: #{Key :: term() => {debtor(), SinceUs :: us(), WithinUs :: us()}},
    %% nothing is overdue up to this time
    first = infinity :: us() | infinity
}).

-opaque t(Key) :: #obligations{open :: #{Key => {debtor(), us(), us()}}}.

-type t() :: t(term()).

%% @doc Nothing is owed.
-spec new(rule()) -> t().
new(Rule) -> #obligations{rule = Rule}.

%% @doc This is owed from `SinceUs' on for so long, instead of what was owed by this key before.
-spec owe(Key, debtor(), SinceUs :: us(), WithinUs :: us(), t(Key)) -> t(Key).
owe(Key, Who, Since, Within, #obligations{open = Open, first = First} = Owed) ->
    Owed#obligations{open = Open#{Key => {Who, Since, Within}}, first = min(First, Since + Within)}.

%% @doc The same, unless it is owed already: then it stays owed from before.
-spec owe_once(Key, debtor(), SinceUs :: us(), WithinUs :: us(), t(Key)) -> t(Key).
owe_once(Key, _Who, _Since, _Within, #obligations{open = Open} = Owed) when is_map_key(Key, Open) ->
    Owed;
owe_once(Key, Who, Since, Within, Owed) ->
    owe(Key, Who, Since, Within, Owed).

%% @doc This is owed no longer, if it was.
-spec paid(Key, t(Key)) -> t(Key).
paid(Key, #obligations{open = Open} = Owed) when is_map_key(Key, Open) ->
    Owed#obligations{open = maps:remove(Key, Open)};
paid(_Key, Owed) ->
    Owed.

%% @doc The obligations by keys of this kind end.
-spec dropped(fun((Key) -> boolean()), t(Key)) -> t(Key).
dropped(Is, #obligations{open = Open} = Owed) ->
    Owed#obligations{open = maps:filter(fun(Key, _) -> not Is(Key) end, Open)}.

%% @doc The time from which on this is owed; `none' if it is not owed.
-spec since(Key, t(Key)) -> us() | none.
since(Key, #obligations{open = Open}) ->
    case Open of
        #{Key := {_, Since, _}} -> Since;
        #{} -> none
    end.

%% @doc All that is owed, with the times from which on.
-spec sinces(t(Key)) -> #{Key => us()}.
sinces(#obligations{open = Open}) -> maps:map(fun(_, {_, Since, _}) -> Since end, Open).

%% @doc What was not paid before this time, though it was due then at the latest; ordered by that time. It is not
%% owed any longer. `none': nothing can be overdue yet.
-spec overdue(TimeUs :: us(), starl_assumption:t(), t(Key)) ->
    none | {[{LatestUs :: us(), Key}], t(Key)}.
overdue(T, _Assumption, #obligations{first = First}) when T =< First ->
    %% an atom is greater than every number
    none;
overdue(T, Assumption, #obligations{rule = Rule, open = Open} = Owed) ->
    Latest = [
        {latest_us(Rule, Who, Since, Within, Assumption), Key}
     || {Key, {Who, Since, Within}} <- maps:to_list(Open)
    ],
    {Late, Left} = lists:partition(fun({Due, _}) -> Due < T end, Latest),
    {lists:sort(Late), Owed#obligations{
        open = maps:without([Key || {_, Key} <- Late], Open),
        first = lists:min([infinity | [Due || {Due, _} <- Left]])
    }}.

latest_us(exact, _Who, Since, Within, _Assumption) ->
    Since + Within;
latest_us(anew, team, Since, Within, Assumption) ->
    starl_assumption:calm_us(Since, Within, Assumption);
latest_us(anew, Robot, Since, Within, Assumption) ->
    starl_assumption:calm_us(Robot, Since, Within, Assumption);
latest_us({delayed, Steps}, Robot, Since, Within, Assumption) ->
    starl_assumption:delayed_us(Robot, Since, Since + Within, Steps, Assumption).
