"""Reads what runs, sweeps and recordings of StarL leave behind."""

from .mcap import Message, Recording
from .runs import NotFromStarl, Run, Sweep, read

__all__ = ["Message", "NotFromStarl", "Recording", "Run", "Sweep", "read"]
