%% @doc The messages that coordinators and participants of path planning send each other over the
%% radio.
%%
%% To the coordinator: `dpp_request {Term, Id, At, Painted, Stamp}'. It has one more element, the
%% end of the line, if an obstacle stopped the robot's last drive. Also `dpp_passed {Term, Id, N}',
%% `dpp_state {Term, Id, Place, Painted, Ballot}' and `dpp_here {Term, Ballot}', with Ballot = {Seq,
%% Stamp, Vote}. `dpp_refused Term' carries the term that is known, or `{doubted, Term}' a term that
%% is not believed yet; last, `dpp_prevoted Term'. From the coordinator: `dpp_answer {Term, Id,
%% Answer, News}', `dpp_recover {Term, Seq, Leads}', `dpp_beat {Term, Seq, Stamps}', and
%% `dpp_prevote N'.
-module(starl_dpp_message).

-export([accepts/2]).

%% @doc Is this term the body of a message of this type?
-spec accepts(starl_packet:type(), Body :: term()) -> boolean().
accepts(dpp_request, Body) -> starl_shape:is({either, [request(), request() ++ [point]]}, Body);
accepts(dpp_passed, Body) -> starl_shape:is([term(), id(), natural], Body);
accepts(dpp_state, Body) -> starl_shape:is([term(), id(), place(), edges(), ballot()], Body);
accepts(dpp_here, Body) -> starl_shape:is([term(), ballot()], Body);
accepts(dpp_refused, Body) -> starl_shape:is({either, [term(), [{is, doubted}, term()]]}, Body);
accepts(dpp_prevote, Body) -> starl_shape:is(number(), Body);
accepts(dpp_prevoted, Body) -> starl_shape:is(term(), Body);
accepts(dpp_answer, Body) -> starl_shape:is([term(), id(), answer(), edges()], Body);
accepts(dpp_recover, Body) -> starl_shape:is([term(), integer, boolean], Body);
accepts(dpp_beat, Body) -> starl_shape:is([term(), integer, {list, [count, integer]}], Body);
accepts(_Type, _Body) -> false.

request() -> [term(), id(), point, edges(), integer].

term() -> [number(), natural, natural].

number() -> {either, [{is, 0}, serial]}.

id() -> [count, number()].

edges() -> {list, count}.

ballot() -> [integer, integer, boolean].

place() ->
    {either, [[{is, standing}, point], [{is, moving}, natural, point, {list, waypoint()}]]}.

waypoint() -> [point, {either, [{is, up}, [{is, down}, count]]}].

answer() ->
    Assign = [{is, assign}, point, {list, waypoint()}],
    Above = [{is, above}, id()],
    {either, [Assign, Above, {is, again}, {is, complete}, {is, incomplete}]}.
