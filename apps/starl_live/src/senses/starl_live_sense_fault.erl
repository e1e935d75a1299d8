%% @doc Injects faults into the senses of a live robot, manually or by chaos. They are the same as
%% those of a scenario (`sense_gone', `sense_frozen', `sense_noisy', `sense_wrong'). They act on the
%% answers, so they hit any sense, of the chassis or of its own driver. A pure module.
%% ```
%%   Faults = starl_live_sense_fault:set(#{camera => frozen}, starl_live_sense_fault:new(1)),
%%   {Felt, Next} = starl_live_sense_fault:felt(camera, {ok, Blobs}, Faults).
%% '''
-module(starl_live_sense_fault).

-export([new/1, set/2, felt/3, of_kind/2, known/0]).

-export_type([t/0, fault/0, faults/0]).

%% `{noisy, Times}': the sense errs so many times as much more.
-type fault() :: gone | frozen | wrong | {noisy, Times :: number()}.
%% A fault of one sense has priority over that of all.
-type faults() :: #{starl_sense:kind() | all => fault()}.

-record(senses, {
    robot :: starl:robot_id(),
    faults = #{} :: faults(),
    %% what each has said last
    last = #{} :: #{starl_sense:kind() => term()},
    %% the answers so far: each has draws of its own
    count = 0 :: non_neg_integer()
}).

-opaque t() :: #senses{}.

-define(DRAWS, (1 bsl 27)).
%% As many times the usual errors, where hands and chaos say only that a sense is noisy.
-define(TIMES, 10).

%% @doc All senses of a robot are sound.
-spec new(starl:robot_id()) -> t().
new(Robot) -> #senses{robot = Robot}.

%% @doc From now on its senses have these faults, and no others.
-spec set(faults(), t()) -> t().
set(Faults, Senses) -> Senses#senses{faults = Faults}.

%% @doc The answer of a sense that the robot gets. An unknown sense stays unknown, and a silent
%% sense stays silent.
-spec felt(starl_sense:kind(), starl_live_sense:felt(), t()) -> {starl_live_sense:felt(), t()}.
felt(Kind, {ok, Reading}, #senses{faults = Faults, last = Last, count = N} = Senses) ->
    Fault = maps:get(Kind, Faults, maps:get(all, Faults, none)),
    Said = said(Fault, Kind, Reading, Senses),
    Kept = [{Kind, What} || {ok, What} <- [Said]],
    {Said, Senses#senses{last = maps:merge(Last, maps:from_list(Kept)), count = N + 1}};
felt(_Kind, Silent, Senses) ->
    {Silent, Senses}.

said(none, _Kind, Reading, _Senses) ->
    {ok, Reading};
said(gone, _Kind, _Reading, _Senses) ->
    none;
said(frozen, Kind, Reading, #senses{last = Last}) ->
    {ok, maps:get(Kind, Last, Reading)};
said(wrong, Kind, _Reading, Senses) ->
    {ok, starl_sense:guess(Kind, draw(Kind, Senses), profiles())};
said({noisy, Times}, Kind, Reading, Senses) ->
    Noisy = starl_sense:noisy(Kind, Times, profiles()),
    {ok, starl_sense:blurred(Kind, Reading, draw(Kind, Senses), Noisy)}.

profiles() ->
    {ok, Profiles} = starl_sense:profiles(#{}),
    Profiles.

draw(Kind, #senses{robot = Robot, count = N}) ->
    fun(Purpose) -> erlang:phash2({Robot, N, Kind, Purpose}, ?DRAWS) / ?DRAWS end.

%% -- words ----------------------------------------------------------------------------------------

%% @doc The kinds of faults in a scenario by their names in commands, with their parameters besides
%% the sense.
-spec known() -> [{string(), atom(), map()}].
known() ->
    [
        {"gone", sense_gone, #{}},
        {"frozen", sense_frozen, #{}},
        {"noisy", sense_noisy, #{times => ?TIMES}},
        {"wrong", sense_wrong, #{}}
    ].

%% @doc The fault that is of this kind in a scenario.
-spec of_kind(sense_gone | sense_frozen | sense_noisy | sense_wrong, map()) -> fault().
of_kind(sense_gone, _Params) -> gone;
of_kind(sense_frozen, _Params) -> frozen;
of_kind(sense_noisy, #{times := Times}) -> {noisy, Times};
of_kind(sense_wrong, _Params) -> wrong.
