%% @doc A hook of Common Test: notifies a process of the cases of a suite that failed or were
%% skipped. It also keeps the name of the case that began last in a file.
-module(starl_test_hook).

-export([init/2, pre_init_per_testcase/4, on_tc_fail/4, on_tc_skip/4]).

%% `to': the process, as text, because Common Test writes the options of a hook into a file.
-type options() :: #{to := string(), file := file:filename()}.
-type test() :: atom() | {atom(), term()}.

%% @private
-spec init(reference(), options()) -> {ok, options()}.
init(_Id, Options) -> {ok, Options}.

%% @private
-spec pre_init_per_testcase(module(), atom(), Config, options()) -> {Config, options()}.
pre_init_per_testcase(Suite, Case, Config, #{file := File} = Options) ->
    ok = file:write_file(File, lists:concat([Suite, ":", Case])),
    {Config, Options}.

%% @private
-spec on_tc_fail(module(), test(), term(), options()) -> options().
on_tc_fail(Suite, Case, Reason, Options) -> tell(failed, Suite, Case, Reason, Options).

%% @private
-spec on_tc_skip(module(), test(), {tc_auto_skip | tc_user_skip, term()}, options()) -> options().
on_tc_skip(Suite, Case, {tc_user_skip, Reason}, Options) ->
    tell(skipped, Suite, Case, Reason, Options);
on_tc_skip(Suite, Case, {tc_auto_skip, Reason}, Options) ->
    tell(unprepared, Suite, Case, Reason, Options).

tell(Kind, Suite, Case, Reason, #{to := To} = Options) ->
    list_to_pid(To) ! {?MODULE, Kind, Suite, Case, Reason},
    Options.
