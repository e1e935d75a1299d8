"""Reads small results written by hand, and those of the directory STARL_RESULTS, where it is set, which has
a run with its recording in `run` and a sweep in `sweep`."""

import contextlib
import io
import json
import os
import pathlib
import struct
import tempfile
import unittest

import starl_runs
from starl_runs.__main__ import main
from starl_runs.tables import number_or_text


def text(s):
    return struct.pack("<I", len(s)) + s.encode()


def record(kind, body):
    return struct.pack("<BQ", kind, len(body)) + body


def message(channel, ns, data):
    return record(5, struct.pack("<HIQQ", channel, 0, ns, ns) + json.dumps(data).encode())


CHANNEL = record(4, struct.pack("<HH", 1, 0) + text("/poses") + text("json") + struct.pack("<I", 0))
TWO = message(1, 2_000_000_000, {"n": 2}) + message(1, 1_000_000_000, {"n": 1})
CHUNK = record(
    6,
    struct.pack("<QQQI", 0, 0, len(CHANNEL + TWO), 0)
    + text("")
    + struct.pack("<Q", len(CHANNEL + TWO))
    + CHANNEL
    + TWO,
)
END = record(15, struct.pack("<I", 0))
MAGIC = b"\x89MCAP0\r\n"


class Written(unittest.TestCase):
    def setUp(self):
        self.holder = tempfile.TemporaryDirectory()
        self.dir = pathlib.Path(self.holder.name)

    def tearDown(self):
        self.holder.cleanup()

    def write(self, name, content):
        path = self.dir / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    def test_run(self):
        report = {"app": "x", "robots": 2, "virtual_s": 1.5, "ending": "time", "violations": [{"text": "t"}]}
        self.write("run/report.json", json.dumps(report))
        self.write("run/trajectories.csv", "time_s,robot,x_mm\n0.0,1,2.5\n")
        run = starl_runs.read(self.dir / "run")
        self.assertFalse(run.complete)
        self.assertEqual([{"text": "t"}], run.violations)
        self.assertEqual([{"time_s": 0.0, "robot": 1, "x_mm": 2.5}], run.trajectories)
        with self.assertRaisesRegex(starl_runs.NotFromStarl, "run it with --record"):
            run.recording
        with self.assertRaisesRegex(ValueError, "there are trajectories"):
            run.frame("ways")

    def test_sweep(self):
        self.write("sweep/runs.csv", "app,robots,status,digest,nothing\npainting,2,complete,0123,\n")
        (row,) = starl_runs.read(self.dir / "sweep").runs
        wanted = {"app": "painting", "robots": 2, "status": "complete", "digest": "0123", "nothing": None}
        self.assertEqual(wanted, row)
        with self.assertRaisesRegex(starl_runs.NotFromStarl, "declares no measures"):
            starl_runs.read(self.dir / "sweep").curves
        self.write("sweep/curves.csv", "app,measure,time_s,runs,median,least,most\nx,mm,0.8,4,1.5,1,2\n")
        (moment,) = starl_runs.read(self.dir / "sweep").curves
        self.assertEqual(("mm", 0.8, 1.5), (moment["measure"], moment["time_s"], moment["median"]))

    def test_cells(self):
        cells = ["", "1", "-2.5", "1.0e3", "house", "nan?"]
        self.assertEqual([None, 1, -2.5, 1000.0, "house", "nan?"], [number_or_text(c) for c in cells])

    def test_recording_in_the_order_of_time(self):
        for content in (MAGIC + CHANNEL + TWO + END, MAGIC + CHUNK + END):
            recording = starl_runs.read(self.write("a.mcap", content))
            self.assertEqual({"/poses": 2}, recording.topics)
            self.assertFalse(recording.cut_off)
            self.assertEqual([1, 2], [m.data["n"] for m in recording.messages("/poses")])
            self.assertEqual([], recording.messages("/other"))

    def test_recording_that_is_cut_off(self):
        whole = MAGIC + CHANNEL + TWO + END
        for length in range(len(MAGIC), len(whole) - len(END)):
            recording = starl_runs.read(self.write("a.mcap", whole[:length]))
            found = recording.messages()
            self.assertTrue(recording.cut_off)
            self.assertLess(len(found), 3)

    def test_mistakes_are_one_line(self):
        self.write("none/x", "")
        self.write("broken/report.json", "{")
        self.write("no.mcap", "x")
        for name in ("none", "missing", "broken", "no.mcap"):
            said = io.StringIO()
            with contextlib.redirect_stderr(said):
                self.assertEqual(2, main([str(self.dir / name)]))
            self.assertEqual(1, said.getvalue().count("\n"), said.getvalue())


@unittest.skipUnless("STARL_RESULTS" in os.environ, "no results of StarL are given")
class Results(unittest.TestCase):
    def setUp(self):
        self.dir = pathlib.Path(os.environ["STARL_RESULTS"])

    def test_run(self):
        run = starl_runs.read(self.dir / "run")
        self.assertTrue(run.complete)
        self.assertEqual([], run.violations)
        robots = {row["robot"] for row in run.trajectories}
        self.assertEqual(set(range(1, run.report["robots"] + 1)), robots)

    def test_recording(self):
        recording = starl_runs.read(self.dir / "run").recording
        times = [message.time_s for message in recording.messages()]
        self.assertFalse(recording.cut_off)
        self.assertEqual(sorted(times), times)
        self.assertEqual(sum(recording.topics.values()), len(times))

    def test_sweep(self):
        sweep = starl_runs.read(self.dir / "sweep")
        self.assertEqual({"complete"}, {run["status"] for run in sweep.runs})
        self.assertEqual(len({run["robots"] for run in sweep.runs}), len(sweep.summary))
        self.assertTrue(all(len(run["digest"]) == 32 for run in sweep.runs))

    def test_the_command(self):
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            self.assertEqual(0, main([str(self.dir / "run"), str(self.dir / "sweep")]))
        self.assertIn("complete", said.getvalue())


if __name__ == "__main__":
    unittest.main()
