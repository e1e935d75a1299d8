"""Directories of runs and of sweeps."""

import functools
import json
import pathlib

from . import tables
from .mcap import Recording


class NotFromStarl(ValueError):
    """What was given is nothing that StarL has written; the message says what was looked for."""


# A digest may consist of digits alone.
TEXTS = ("digest",)


def read(path):
    """A Run, a Sweep or a Recording, by what lies at the path."""
    path = pathlib.Path(path)
    if path.is_file():
        return Recording(path)
    if (path / "report.json").is_file():
        return Run(path)
    if (path / "runs.csv").is_file():
        return Sweep(path)
    if not path.exists():
        raise NotFromStarl(f"{path}: there is no such file or directory")
    raise NotFromStarl(
        f"{path}: neither report.json (of a run) nor runs.csv (of a sweep) is here"
    )


class Run:
    """The results of one run. `report`: the figures, as in report.json."""

    def __init__(self, path):
        self.path = pathlib.Path(path)
        try:
            self.report = json.loads((self.path / "report.json").read_text(encoding="utf-8"))
        except json.JSONDecodeError as error:
            raise NotFromStarl(f"{self.path / 'report.json'}: {error}") from error

    @property
    def violations(self):
        """Each broken contract: a dict with contract, what, at_s, robots and text."""
        return self.report["violations"]

    @property
    def complete(self):
        """Are all applications done?"""
        return self.report["ending"] == "done"

    @functools.cached_property
    def trajectories(self):
        """The ways of the robots: dicts with time_s, robot, x_mm, y_mm and heading_rad."""
        return tables.rows(self.path / "trajectories.csv")

    @functools.cached_property
    def recording(self):
        """The recording of the run (run --record)."""
        path = self.path / "run.mcap"
        if not path.is_file():
            raise NotFromStarl(f"{path}: this run has no recording; run it with --record")
        return Recording(path)

    def frame(self, table="trajectories"):
        """A table as a data frame of pandas."""
        return tables.frame(_table(self, table, ("trajectories",)))


class Sweep:
    """The results of a sweep."""

    def __init__(self, path):
        self.path = pathlib.Path(path)

    @functools.cached_property
    def runs(self):
        """A dict for each run: the settings, seed, status and all figures."""
        return tables.rows(self.path / "runs.csv", TEXTS)

    @functools.cached_property
    def summary(self):
        """A dict for each combination of settings: median, least and most of each figure."""
        return tables.rows(self.path / "summary.csv")

    @functools.cached_property
    def curves(self):
        """What the application measures, over time: dicts with the settings, measure, time_s, runs, median,
        least and most."""
        path = self.path / "curves.csv"
        if not path.is_file():
            raise NotFromStarl(f"{path}: the application of this sweep declares no measures")
        return tables.rows(path)

    def frame(self, table="runs"):
        """A table as a data frame of pandas."""
        return tables.frame(_table(self, table, ("runs", "summary", "curves")))


def _table(of, name, known):
    if name not in known:
        raise ValueError(f"there is no table {name!r}; there are {', '.join(known)}")
    return getattr(of, name)
