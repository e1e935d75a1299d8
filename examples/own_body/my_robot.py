#!/usr/bin/env python3
"""A robot with two wheels and a pen, in plain Python: it moves in this program only.

StarL speaks to it by lines of JSON, see doc/chassis.md. To drive a real robot, set its wheels in
roll() and read its sensors in say_pose(). Try it:

    ./starl chassis check exec:examples/own_body/my_robot.py
    ./starl run painting --robots 2 --speed 300 --live --chassis exec:examples/own_body/my_robot.py
"""

import json
import math
import os
import select
import sys
import time

POSE_S = 0.04  # the time between two poses
VMAX, WMAX = 500, 4.0  # mm/s, rad/s

x = y = th = 0.0  # where it is, from where it started: mm, rad
legs = []  # what is left to drive: [v, w, seconds]
job = None  # the id of the present drive
then = time.monotonic()  # up to when it has moved


def say(op, **more):
    sys.stdout.write(json.dumps({"op": op, **more}) + "\n")
    sys.stdout.flush()


def us(t):
    return int(t * 1e6)


def say_pose():
    say("pose", t=us(then), x=x, y=y, th=th)


def roll(seconds):
    """Moves on; a leg ends exactly when its time is over, however late this is called."""
    global x, y, th, then
    while seconds > 0:
        v, w, left = legs[0] if legs else (0.0, 0.0, seconds)
        dt = min(seconds, left)
        half = w * dt / 2
        way = v * dt * (math.sin(half) / half if half else 1.0)
        x, y, th = x + way * math.cos(th + half), y + way * math.sin(th + half), th + w * dt
        then += dt
        seconds -= dt
        if legs:
            legs[0][2] -= dt
            if legs[0][2] <= 0:
                legs.pop(0)
                say_pose()
                if not legs:
                    arrived()


def arrived():
    global job
    if job is not None:
        say("done", id=job)
        job = None


def obey(m):
    global legs, job
    op = m.get("op")
    if op == "drive":  # in place of the one before
        say("ack", id=m["id"], t=us(then))
        say_pose()
        job = m["id"]
        legs = [[leg["v"], leg["w"], leg["ms"] / 1000] for leg in m["legs"]]
        if not legs:
            arrived()
    elif op == "stop":
        legs, job = [], None
        say_pose()
    elif op == "set" and m["device"] == "pen":
        say("done", id=m["id"])
    elif op == "set":
        say("refuse", id=m["id"], why="I have no " + m["device"])
    elif op == "ping":
        say_pose()
        say("pong", n=m["n"])


def main():
    say("hello", protocol=1, name="my robot", chassis="differential", frame="start",
        vmax=VMAX, wmax=WMAX, devices=["pen"])
    say_pose()
    due, text = then, b""
    while True:
        leg_ends = then + legs[0][2] if legs else due
        wait = min(due, leg_ends) - time.monotonic()
        ready, _, _ = select.select([0], [], [], max(0.0, wait))
        roll(time.monotonic() - then)
        if then >= due:
            say_pose()
            due = then + POSE_S
        if ready:
            some = os.read(0, 65536)
            if not some:  # StarL has gone: stand still
                break
            text += some
            while b"\n" in text:
                line, text = text.split(b"\n", 1)
                try:
                    obey(json.loads(line))
                except (ValueError, KeyError, TypeError) as wrong:
                    say("log", text="not understood: %s" % wrong)


try:
    main()
except BrokenPipeError:
    pass
