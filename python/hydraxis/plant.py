"""A plant in the place of plant-sim: valve commands in, readings of the sensors out.

    class Machine(hydraxis.Plant):
        def __init__(self, machine):                # the machine file as a dict
            ...
        def advance(self, commands, seconds):       # moves on by so many seconds; one command per axis, in [-1, 1]
            ...
        def read(self):                             # counts of the encoders, one per axis
            return [...]

    Machine.main()

The supervisor starts such a program, in real time or in lock-step, or you start it by hand beside a group whose machine
file has source.kind = "external":

    hydraxis run machine.toml --set stage.plant-sim.command='["python3","my_plant.py"]'
    python3 my_plant.py machine.toml --prefix NAME

A program that is started by hand waits for its group and may be started before it.
In real time the commands go to neutral when they have stopped for `timing.drive_timeout`, as a valve's drive does it.
"""

import argparse
import json
import math
import numbers
import os
import re
import select
import shlex
import signal
import stat
import sys
import time

from .channels import Membership, Publisher, Reader
from .command import run
from .errors import GroupEnded, HydraxisError, NoPlace
from .group import is_running
from .messages import CoefficientSnapshot, EncoderReading, EncoderValue, ValveCommand

POLL_S = 50e-6  # between two looks at the channels in lock-step
GROUP_POLL_S = 0.1  # between two looks whether the group runs


class Plant:
    """Base of a plant; a program makes a class of it with `__init__`, `advance` and `read`, and calls `main`."""

    reading_period = 0.002  # s, between two readings in real time
    built_in = None  # machine file where the supervisor names none
    emergency_stop = False  # whether the emergency stop of the machine is pressed

    def advance(self, commands, seconds):
        """Moves on under these commands, one per axis in [-1, 1]; all 0 while the pilot pressure is cut off.

        The last call has commands of 0 and 0 seconds, whatever ends the program but a kill and a loss of power. A
        second program in a plant's place is refused without this call: the valves are those of the first one. Let the
        output of a real valve have a time-out of its own as well.
        """
        raise NotImplementedError

    def read(self):
        """Counts of the encoders, one per axis; an EncoderValue in place of a number has pressures or an error."""
        raise NotImplementedError

    @classmethod
    def main(cls):
        """Runs the plant as the supervisor asks for it, until it is to end."""
        arguments = _arguments()
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # leave the group in order, as at Ctrl-C
        try:
            machine = load_machine(arguments.machine or cls.built_in, arguments.set)
            plant, has_place = cls(machine), True
            try:
                if await_group(arguments):
                    _Process(plant, machine, arguments).run()
            except NoPlace:
                has_place = False
                raise
            finally:
                # Whatever has ended the program: a valve that keeps its last command would stay open.
                if has_place:
                    plant.advance([0.0] * len(machine["axis"]), 0.0)
        except KeyboardInterrupt:
            pass
        except (HydraxisError, OSError, KeyError, ValueError) as error:
            sys.exit(f"{type(error).__name__}: {error}")


class _Process:
    """The channels of a plant, and its two clocks."""

    def __init__(self, plant, machine, arguments):
        self.plant, self.arguments = plant, arguments
        self.axes = len(machine["axis"])
        self.period = seconds(machine["timing"]["period"])
        timeout = machine["timing"].get("drive_timeout")
        self.drive_timeout = seconds(timeout) if timeout else max(0.05, 3 * self.period)
        self.neutral = [0.0] * self.axes
        self.membership = Membership(arguments.prefix, "plant")
        self.readings = Publisher(self.membership, EncoderReading)
        self.commands = Reader(self.membership, ValveCommand)
        self.snapshots = Reader(self.membership, CoefficientSnapshot) if arguments.lockstep else None

    def run(self):
        try:
            self.lock_step() if self.arguments.lockstep else self.real_time()
        finally:
            self.membership.close()

    def is_last(self, tick):
        return self.arguments.ticks is not None and tick + 1 >= self.arguments.ticks

    def send(self, sequence):
        reading = EncoderReading()
        # Before the sensors are read: a program that loses its core meanwhile must not make them newer than they are.
        acquired_ns = time.monotonic_ns()
        values = self.plant.read()
        if not hasattr(values, "__len__") or len(values) != self.axes:
            raise ValueError(f"read(): found {values!r}; allowed: a list with one value for each axis, {self.axes}")
        for axis, value in zip(range(self.axes), values):
            is_whole = isinstance(value, EncoderValue)
            reading.encoders[axis] = value if is_whole else EncoderValue(counts=counts(value, axis))
        reading.emergency_stop = int(self.plant.emergency_stop)
        reading.header.axis_count, reading.header.sequence = self.axes, sequence
        reading.header.acquired_ns = acquired_ns
        self.readings.send(reading)

    def valves(self):
        """The commands of the newest message, neutral where the pilot pressure is cut off."""
        last = self.commands.last
        if last is None or last.cut_off:
            return self.neutral
        return [last.axes[i].command for i in range(self.axes)]

    def real_time(self):
        sequence, release, heard, valves = 0, time.monotonic(), time.monotonic(), self.neutral
        while not is_orphan():
            if self.commands.newest() is not None:
                heard, valves = time.monotonic(), self.valves()
                if self.is_last(self.commands.last.header.sequence):
                    return
            elif time.monotonic() - heard > self.drive_timeout:
                valves = self.neutral
                # No command may also mean that there is no group any more.
                if self.membership.is_removed():
                    raise GroupEnded(f'group "{self.arguments.prefix}" has ended; start this program again after the '
                                     "next `hydraxis run`")
            self.send(sequence)
            self.readings.greet()
            sequence += 1
            release += self.plant.reading_period
            time.sleep(max(0.0, release - time.monotonic()))
            self.plant.advance(valves, self.plant.reading_period)

    def lock_step(self):
        """Sends the next reading when command and snapshot of the last one have come."""
        tick = 0
        while True:
            self.send(tick)
            answers = (self.commands, self.snapshots)
            while not all(answer.last and answer.last.header.sequence >= tick for answer in answers):
                if is_orphan():
                    return
                self.readings.greet()
                time.sleep(POLL_S)
                self.commands.newest()
                self.snapshots.newest()
            if self.is_last(tick):
                return
            self.plant.advance(self.valves(), self.period)
            tick += 1


def await_group(arguments):
    """Waits until the group runs. False when the supervisor that has started this program is gone."""
    is_told = False
    while not is_running(arguments.prefix):
        if is_orphan():
            return False
        if not is_told:
            is_told = True
            # As it is to be typed, also where a path has spaces.
            words = [arguments.machine, *(word for setting in arguments.set for word in ("--set", setting))]
            typed = shlex.join(str(word) for word in words if word)
            print(f'waits for group "{arguments.prefix}"; start it in another terminal with: '
                  f"hydraxis run {typed} --prefix {arguments.prefix}", file=sys.stderr, flush=True)
        time.sleep(GROUP_POLL_S)
    return True


def _arguments():
    parser = argparse.ArgumentParser(description="A plant in the place of plant-sim, started by `hydraxis run`.")
    parser.add_argument("machine", nargs="?", help="machine file")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--prefix", required=True, help="name of the group")
    parser.add_argument("--lockstep", action="store_true")
    parser.add_argument("--ticks", type=int, help="end after so many ticks")
    return parser.parse_known_args()[0]


def counts(value, axis):
    """What a sensor has read, as a whole number."""
    if not isinstance(value, numbers.Real) or not math.isfinite(value):
        raise ValueError(f"read(): found {value!r} for axis {axis}, counted from 0; allowed: counts, or "
                         "EncoderValue(error=1) where the sensor gives none")
    if abs(value) >= 2 ** 63:
        raise ValueError(f"read(): found {value!r} for axis {axis}, counted from 0; allowed: counts of 64 bits")
    return round(value)


def seconds(text):
    """A duration of the machine file, such as "10ms", in s."""
    found = re.fullmatch(r"([\d.]+) ?(us|ms|s)", text)
    if not found:
        raise ValueError(f'found "{text}"; allowed: a duration such as "10ms"')
    return float(found[1]) * {"us": 1e-6, "ms": 1e-3, "s": 1.0}[found[2]]


def load_machine(path, settings=()):
    """The machine file with settings KEY=VALUE as a dict of tables: every effective value, in SI units, as
    `hydraxis check --explain` shows them. Durations are texts, such as "10ms"."""
    try:
        import tomllib
    except ImportError:
        import tomli as tomllib  # Python 3.10 and older
    if path is None:
        raise ValueError("the plant needs a machine file: hydraxis run MACHINE.toml ..")
    options = [word for setting in settings for word in ("--set", setting)]
    _, text, _ = run("check", path, *options, "--explain", "--json", "-")
    machine = {}
    for value in json.loads(text):
        if value["value"] is None or "[" in value["key"]:
            continue  # without a value, or in a list of tables
        *tables, last = value["key"].split(".")
        table = machine
        for name in tables:
            table = table.setdefault(name, {})
        table[last] = tomllib.loads(f"value = {value['value']}")["value"]
    return machine


def is_orphan():
    """Whether the supervisor is gone: it holds the other end of standard input."""
    is_pipe = stat.S_ISFIFO(os.fstat(sys.stdin.fileno()).st_mode)
    return is_pipe and bool(select.select([sys.stdin], [], [], 0)[0]) and not os.read(sys.stdin.fileno(), 1)
