"""Recordings: MCAP files (https://mcap.dev/spec) with messages in JSON."""

import io
import json
import pathlib
import shutil
import struct
import subprocess
from typing import Any, NamedTuple

MAGIC = b"\x89MCAP0\r\n"
HEADER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 1, 3, 4, 5, 6, 15


class Message(NamedTuple):
    """A message: its topic, its time in seconds (of a simulation: since its begin; else since 1970), its
    content."""

    topic: str
    time_s: float
    data: Any


class Recording:
    """A recording. One that is cut off is read as far as it goes; then `cut_off` is true."""

    def __init__(self, path):
        self.path = pathlib.Path(path)
        self.cut_off = False
        with open(self.path, "rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                from .runs import NotFromStarl

                raise NotFromStarl(f"{self.path}: this is no recording (MCAP)")

    @property
    def topics(self):
        """The topics, each with the number of its messages."""
        counts = {}
        for message in self._unordered():
            counts[message.topic] = counts.get(message.topic, 0) + 1
        return counts

    def messages(self, *topics):
        """The messages of these topics, or all, in the order of time."""
        chosen = [m for m in self._unordered() if not topics or m.topic in topics]
        return sorted(chosen, key=lambda message: message.time_s)

    def _unordered(self):
        channels = {}
        with open(self.path, "rb") as file:
            file.read(len(MAGIC))
            for kind, body in self._records(file):
                if kind == DATA_END:
                    return
                if kind == CHUNK:
                    for inner, content in self._records(io.BytesIO(_chunk(body))):
                        yield from _message(inner, content, channels)
                else:
                    yield from _message(kind, body, channels)
        self.cut_off = True

    def _records(self, file):
        while head := file.read(9):
            if len(head) < 9:
                self.cut_off = True
                return
            kind, size = struct.unpack("<BQ", head)
            body = file.read(size)
            if len(body) < size:
                self.cut_off = True
                return
            yield kind, body


def _message(kind, body, channels):
    if kind == CHANNEL:
        number, _schema = struct.unpack_from("<HH", body)
        topic, end = _text(body, 4)
        encoding, _end = _text(body, end)
        channels[number] = topic, encoding
    elif kind == MESSAGE:
        number, _sequence, log_time, _publish_time = struct.unpack_from("<HIQQ", body)
        topic, encoding = channels[number]
        data = body[22:]
        yield Message(topic, log_time / 1e9, json.loads(data) if encoding == "json" else data)


def _text(body, at):
    (size,) = struct.unpack_from("<I", body, at)
    return body[at + 4 : at + 4 + size].decode(), at + 4 + size


def _chunk(body):
    compression, at = _text(body, 28)
    (size,) = struct.unpack_from("<Q", body, at)
    records = body[at + 8 : at + 8 + size]
    if compression == "":
        return records
    if compression == "zstd":
        return _unpacked(records)
    raise ValueError(f"a chunk is packed by {compression!r}; StarL packs by zstd")


def _unpacked(records):
    try:
        from compression import zstd  # Python 3.14

        return zstd.decompress(records)
    except ImportError:
        pass
    try:
        import zstandard

        return zstandard.ZstdDecompressor().decompressobj().decompress(records)
    except ImportError:
        pass
    if shutil.which("zstd") is None:
        raise ImportError(
            "a packed recording needs Python 3.14, the package zstandard, or the program zstd"
        )
    return subprocess.run(
        ["zstd", "-dcq"], input=records, stdout=subprocess.PIPE, check=True
    ).stdout
