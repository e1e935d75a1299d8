%% @doc The channels of a recording, each with its JSON schema. Some are those of Foxglove and
%% similar viewers (`foxglove.FrameTransforms', `foxglove.SceneUpdate', `foxglove.Log'), the others
%% are our own. The schemas of Foxglove are written anew here, with the fields that its
%% documentation requires.
-module(starl_trace_schema).

-export([channels/0, id/1]).

-export_type([channel/0]).

%% `terms' holds every message of a run exactly; the others are for people and their viewers.
-type channel() ::
    terms
    | scenario
    | tf
    | scene
    | log
    | trace
    | packets
    | faults
    | verdicts
    | metrics
    | measures
    | drawings.

%% @doc The schemas and channels of a recording.
-spec channels() -> starl_mcap_writer:channels().
channels() ->
    Numbered = numbered(),
    Schemas = [
        {schema, Id, Name, "jsonschema", starl_json:encode(titled(Name, Schema))}
     || {Id, _, _, Name, Schema} <- Numbered
    ],
    Schemas ++
        [
            {channel, Id, Id, Topic, "json", [{"callerid", "starl"}]}
         || {Id, _, Topic, _, _} <- Numbered
        ].

numbered() ->
    All = all(),
    [{Id, C, T, N, S} || {Id, {C, T, N, S}} <- lists:zip(lists:seq(1, length(All)), All)].

%% @doc The number of a channel.
-spec id(channel()) -> starl_mcap_record:id().
id(terms) -> 1;
id(scenario) -> 2;
id(tf) -> 3;
id(scene) -> 4;
id(log) -> 5;
id(trace) -> 6;
id(packets) -> 7;
id(faults) -> 8;
id(verdicts) -> 9;
id(metrics) -> 10;
id(measures) -> 11;
id(drawings) -> 12.

all() ->
    [
        {terms, "/starl", "starl.Messages", object([{terms, base64()}])},
        {scenario, "/scenario", "starl.Scenario", scenario()},
        {tf, "/tf", "foxglove.FrameTransforms", object([{transforms, list(transform())}])},
        {scene, "/scene", "foxglove.SceneUpdate", scene()},
        {log, "/log", "foxglove.Log", log()},
        {trace, "/trace", "starl.Trace", trace()},
        {packets, "/packets", "starl.Packets", packets()},
        {faults, "/faults", "starl.Fault", fault()},
        {verdicts, "/verdicts", "starl.Verdict", object([{what, string()}, {text, string()}])},
        {metrics, "/metrics", "starl.Metrics", metrics()},
        {measures, "/measures", "starl.Measures", measure()},
        {drawings, "/drawings", "foxglove.SceneUpdate", scene()}
    ].

scenario() ->
    object([
        {kind, string()},
        {application, string()},
        {robots, integer()},
        {seed, integer()},
        {values, list(object([{key, string()}, {value, string()}]))}
    ]).

log() ->
    object([
        {timestamp, timestamp()},
        {level, integer()},
        {message, string()},
        {name, string()},
        {file, string()},
        {line, integer()}
    ]).

trace() ->
    object([{robot, integer()}, {machine, string()}, {event, string()}, {details, string()}]).

packets() -> object([{since, timestamp()}, {lost, integer()}, {packets, list(string())}]).

fault() -> object([{what, string()}, {fault, string()}, {kind, string()}, {target, string()}]).

metrics() ->
    object([
        {events, integer()}, {packets, integer()}, {lost, integer()}, {violations, integer()}
    ]).

measure() ->
    object([{robot, integer()}, {key, string()}, {value, number()}, {series, object([])}]).

scene() -> object([{deletions, list(deletion())}, {entities, list(entity())}]).

titled(Name, {Pairs}) -> {[{title, list_to_binary(Name)} | Pairs]}.

object(Fields) ->
    {[
        {type, <<"object">>},
        {properties, {Fields}},
        {required, [atom_to_binary(Key) || {Key, _} <- Fields]}
    ]}.

list(Of) -> {[{type, <<"array">>}, {items, Of}]}.

string() -> {[{type, <<"string">>}]}.

integer() -> {[{type, <<"integer">>}]}.

number() -> {[{type, <<"number">>}]}.

boolean() -> {[{type, <<"boolean">>}]}.

base64() -> {[{type, <<"string">>}, {contentEncoding, <<"base64">>}]}.

numbers(Keys) -> object([{Key, number()} || Key <- Keys]).

timestamp() -> titled("time", object([{sec, integer()}, {nsec, integer()}])).

duration() -> titled("duration", object([{sec, integer()}, {nsec, integer()}])).

vector() -> numbers([x, y, z]).

rotation() -> numbers([x, y, z, w]).

colour() -> numbers([r, g, b, a]).

pose() -> object([{position, vector()}, {orientation, rotation()}]).

transform() ->
    object([
        {timestamp, timestamp()},
        {parent_frame_id, string()},
        {child_frame_id, string()},
        {translation, vector()},
        {rotation, rotation()}
    ]).

deletion() -> object([{timestamp, timestamp()}, {type, integer()}, {id, string()}]).

entity() ->
    object([
        {timestamp, timestamp()},
        {frame_id, string()},
        {id, string()},
        {lifetime, duration()},
        {frame_locked, boolean()},
        {metadata, list(object([{key, string()}, {value, string()}]))},
        {arrows, list(arrow())},
        {cubes, list(solid([]))},
        {spheres, list(solid([]))},
        {cylinders, list(solid([{bottom_scale, number()}, {top_scale, number()}]))},
        {lines, list(line())},
        {triangles, list(triangles())},
        {texts, list(text())},
        {models, list(model())}
    ]).

arrow() ->
    object([
        {pose, pose()},
        {shaft_length, number()},
        {shaft_diameter, number()},
        {head_length, number()},
        {head_diameter, number()},
        {color, colour()}
    ]).

solid(More) -> object([{pose, pose()}, {size, vector()}] ++ More ++ [{color, colour()}]).

line() ->
    object([
        {type, integer()},
        {pose, pose()},
        {thickness, number()},
        {scale_invariant, boolean()},
        {points, list(vector())},
        {color, colour()},
        {colors, list(colour())},
        {indices, list(integer())}
    ]).

triangles() ->
    object([
        {pose, pose()},
        {points, list(vector())},
        {color, colour()},
        {colors, list(colour())},
        {indices, list(integer())}
    ]).

text() ->
    object([
        {pose, pose()},
        {billboard, boolean()},
        {font_size, number()},
        {scale_invariant, boolean()},
        {color, colour()},
        {text, string()}
    ]).

model() ->
    object([
        {pose, pose()},
        {scale, vector()},
        {color, colour()},
        {override_color, boolean()},
        {url, string()},
        {media_type, string()},
        {data, base64()}
    ]).
