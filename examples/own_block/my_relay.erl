%% A building block of a user's own: a robot greets all others. With the greeting `twice' every
%% greeting is counted twice, which its monitor finds.
-module(my_relay).
-behaviour(starl_block).
-behaviour(starl_machine).
-behaviour(starl_block_exercise).

-export([greet/1]).
-export([options/0, machines/1, monitors/2, contract/0, exercise/0, models/0, history/0]).
-export([init/1, handle_event/5]).
-export([flags/0, block_options/1, draw/1, work/3, final/3, promise/3]).

greet(Robot) -> starl:call(Robot, my_relay, greet, infinity).

%% -- the block ------------------------------------------------------------------------------

options() -> [{greeting, {one_of, [hello, twice]}, hello, "what is said"}].

machines(Options) -> [{my_relay, ?MODULE, Options}].

monitors(_Options, #{robots := Robots}) -> [{my_relay_monitor, #{robots => Robots}}].

contract() -> "no more greetings are heard than were said".

exercise() -> ?MODULE.

history() -> my_relay_history.

models() -> [{my_relay, "greetings, heard and said", fun model/1}].

model(#{robots := Ids}) ->
    #{
        blocks => machines(#{greeting => hello}),
        script => fun(_) -> [{'try', my_relay, greet}] end,
        monitor => {my_relay_monitor, #{robots => Ids}}
    }.

%% -- the machine ----------------------------------------------------------------------------

init(#{greeting := Greeting}) -> {ready, Greeting, [starl_sap:listen(greeting, my_relay)]}.

handle_event({call, From}, greet, ready, Greeting, _Meta) ->
    Said = {cast, sap, {broadcast, greeting, Greeting}},
    {keep_state_and_data, [{trace, said}, Said, {reply, From, Greeting}]};
handle_event(cast, {message, From, greeting, hello}, ready, _Greeting, _Meta) ->
    {keep_state_and_data, [{trace, {heard, From}}]};
handle_event(cast, {message, From, greeting, twice}, ready, _Greeting, _Meta) ->
    {keep_state_and_data, [{trace, {heard, From}}, {trace, {heard, From}}]};
handle_event(info, {restarted, sap}, ready, _Greeting, _Meta) ->
    {keep_state_and_data, [starl_sap:listen(greeting, my_relay)]};
handle_event(info, {restarted, _}, ready, _Greeting, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

%% -- the exercise ---------------------------------------------------------------------------

flags() -> [{politeness, {integer, 1, 9}, 1, "greetings in a turn"}].

block_options(_Use) -> #{}.

draw(Draw) -> #{politeness => Draw(politeness, [1, 2])}.

work(Robot, _Turn, #{politeness := N}) -> [call(Robot) || _ <- lists:seq(1, N)].

final(Robot, _N, _Use) -> call(Robot).

call(Robot) -> starl_block_exercise:call(Robot, greet, fun() -> greet(Robot) end).

promise(Call, Team, none) -> starl_promise:soon(Call, fun starl_promise:is_some/1, Team).
