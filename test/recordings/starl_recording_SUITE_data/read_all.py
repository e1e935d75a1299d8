# Reads a recording with the package mcap, checks all checksums, and counts the messages of each topic.
import collections
import json
import sys

from mcap.reader import NonSeekingReader, make_reader


def counts(reader):
    seen = collections.Counter()
    last = 0
    for schema, channel, message in reader.iter_messages():
        json.loads(message.data)
        json.loads(schema.data)
        assert channel.message_encoding == "json" and schema.encoding == "jsonschema"
        seen[f"{channel.topic} {schema.name}"] += 1
        last = max(last, message.log_time)
    return seen, last


with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True)
    by_index = counts(reader)
    statistics = reader.get_summary().statistics
with open(sys.argv[1], "rb") as file:
    one_by_one = counts(NonSeekingReader(file, validate_crcs=True))
with open(sys.argv[1], "rb") as file:
    messages = NonSeekingReader(file).iter_messages(log_time_order=False)
    times = [message.log_time for _, _, message in messages]
    assert times == sorted(times), "the messages are not in the order of time"

assert by_index == one_by_one, "the index and the data disagree"
assert statistics.message_count == sum(by_index[0].values())
assert statistics.message_end_time == by_index[1]
for topic in sorted(by_index[0]):
    print(topic, by_index[0][topic])
print("end", by_index[1])
