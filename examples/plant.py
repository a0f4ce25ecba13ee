#!/usr/bin/env python3
"""A plant in Python, in the place of plant-sim: valve commands in, encoder readings out.

Needs Python 3.11 or newer and one package:

    pip install iceoryx2==0.10.0

Let the supervisor start it, in real time or in lock-step:

    hydraxis run examples/four-axes.toml --set stage.plant-sim.command='["python3","examples/plant.py"]'
    hydraxis run examples/four-axes.toml --set stage.plant-sim.command='["python3","examples/plant.py"]' --lockstep

Every axis is a dead time, a lag of first order, a dead band and an integrator:

    tau dx/dt + x = u(t - t_d)        dy/dt = K sign(x) max(0, |x| - d) / (1 - d)

    u    valve command, -1 to 1               t_d  dead time, s: dead_time
    x    spool position, -1 to 1              tau  lag, s: valve_time_constant
    y    piston position, m, 0 to stroke      d    dead band: dead_band_extend or dead_band_retract
    K    speed at full opening, m/s

t_d, tau and d are those of [axis.NAME.plant] in the machine file. Nothing else of that table is used. The sensors are
at the cylinders, and there are no pressure transducers.

Messages and channels are in hydraxis.py, beside this file.
"""

import argparse
import os
import re
import select
import signal
import stat
import sys
import time
import tomllib
from collections import deque
from pathlib import Path

from hydraxis import Channel, CoefficientSnapshot, EncoderReading, Group, Publisher, Trouble, ValveCommand, iox2

BUILT_IN = Path(__file__).parent / "excavator.toml"  # what `hydraxis run` uses without a machine file
STEP_S = 0.001  # of the integration
READING_STEPS = 2  # steps between two readings in real time
FULL_SPEED = 0.6  # K, m/s
POLL_S = 50e-6  # between two looks at the channels in lock-step


class Axis:
    """One axis, moved on in steps of STEP_S."""

    def __init__(self, table):
        plant = table["plant"]
        self.stroke = table["stroke"]
        if table["encoder"].get("kind", "cylinder") != "cylinder":
            raise Trouble("this plant has sensors at its cylinders only: axis.NAME.encoder.kind = \"cylinder\"")
        self.resolution = table["encoder"]["resolution"]
        self.position = plant["initial_position"]
        self.time_constant = plant["valve_time_constant"]
        self.dead_bands = (plant["dead_band_retract"], plant["dead_band_extend"])
        self.spool = 0.0
        steps = round(plant["dead_time"] / STEP_S) + 1
        self.delayed = deque([0.0] * steps, maxlen=steps)  # commands of the last steps, oldest first

    def step(self, command):
        self.delayed.append(command)
        self.spool += (self.delayed[0] - self.spool) * STEP_S / self.time_constant
        dead_band = self.dead_bands[self.spool > 0]
        opening = max(0.0, abs(self.spool) - dead_band) / (1 - dead_band)
        speed = FULL_SPEED * (opening if self.spool > 0 else -opening)
        self.position = min(max(self.position + speed * STEP_S, 0.0), self.stroke)


class Plant:
    """All axes of the machine, and the next reading."""

    def __init__(self, tables):
        self.axes = [Axis(table) for table in tables]
        self.commands = [0.0] * len(self.axes)
        self.reading = EncoderReading()
        self.reading.header.axis_count = len(self.axes)

    def take(self, message):
        """Holds the commands of a message, neutral where the pilot pressure is cut off."""
        self.commands = [0.0 if message.cut_off else message.axes[i].command for i in range(len(self.axes))]

    def advance(self, steps):
        for axis, command in zip(self.axes, self.commands):
            for _ in range(steps):
                axis.step(command)

    def read(self, sequence):
        """What the encoders read now."""
        for encoder, axis in zip(self.reading.encoders, self.axes):
            encoder.counts = round(axis.position / axis.resolution)
        self.reading.header.sequence = sequence
        self.reading.header.acquired_ns = self.reading.header.sent_ns = time.monotonic_ns()
        return self.reading


def seconds(text):
    """A duration of the machine file, such as "10ms"."""
    number, unit = re.fullmatch(r"([\d.]+) ?(us|ms|s)", text).groups()
    return float(number) * {"us": 1e-6, "ms": 1e-3, "s": 1.0}[unit]


def load(path, settings):
    """The machine file with the settings of the command line."""
    machine = tomllib.loads(Path(path or BUILT_IN).read_text())
    for setting in settings:
        key, _, text = setting.partition("=")
        *tables, last = key.split(".")
        table = machine
        for name in tables:
            table = table.setdefault(name, {})
        try:
            table[last] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            table[last] = text  # a text may stand without quotation marks
    return machine


def is_orphan():
    """Whether the supervisor is gone: it holds the other end of standard input."""
    is_pipe = stat.S_ISFIFO(os.fstat(sys.stdin.fileno()).st_mode)
    return is_pipe and bool(select.select([sys.stdin], [], [], 0)[0]) and not os.read(sys.stdin.fileno(), 1)


def real_time(plant, readings, commands, ticks, drive_timeout_s):
    """Sends a reading every few milliseconds; neutral when commands stop, as a valve's drive does it."""
    sequence, release, last_command = 0, time.monotonic(), time.monotonic()
    while not is_orphan():
        if commands.read():
            last_command = time.monotonic()
            plant.take(commands.recent[-1])
            if ticks is not None and commands.recent[-1].header.sequence + 1 >= ticks:
                return
        elif time.monotonic() - last_command > drive_timeout_s:
            plant.commands = [0.0] * len(plant.axes)
        readings.send(plant.read(sequence))
        readings.greet()
        sequence += 1
        release += READING_STEPS * STEP_S
        time.sleep(max(0.0, release - time.monotonic()))
        plant.advance(READING_STEPS)


def lock_step(plant, readings, commands, snapshots, ticks, period_s):
    """Sends the next reading when command and snapshot of the last one have come."""
    tick = 0
    while True:
        readings.send(plant.read(tick))
        answers = (commands, snapshots)
        while not all(answer.recent and answer.recent[-1].header.sequence >= tick for answer in answers):
            if is_orphan():
                return
            readings.greet()
            time.sleep(POLL_S)
            commands.read()
            snapshots.read()
        if ticks is not None and tick + 1 >= ticks:
            return
        plant.take(commands.recent[-1])
        plant.advance(round(period_s / STEP_S))
        tick += 1


def main():
    parser = argparse.ArgumentParser(description="A plant in the place of plant-sim, started by `hydraxis run`.")
    parser.add_argument("machine", nargs="?", help="machine file; without it the built-in one")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--prefix", required=True, help="name of the group")
    parser.add_argument("--lockstep", action="store_true")
    parser.add_argument("--ticks", type=int, help="end after so many ticks")
    parser.add_argument("--seed", help="has no use here: these encoders have no noise")
    arguments, _ = parser.parse_known_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # leave the group in order, as at Ctrl-C
    iox2.set_log_level(iox2.LogLevel.Fatal)  # errors come as exceptions
    try:
        machine = load(arguments.machine, arguments.set)
        plant = Plant(machine["axis"].values())
        group = Group(arguments.prefix, "plant-sim")
        readings = Publisher(group, "encoder-reading", EncoderReading)
        commands = Channel(group, "valve-command", ValveCommand, 16)
        if arguments.lockstep:
            snapshots = Channel(group, "coefficient-snapshot", CoefficientSnapshot, 16)
            lock_step(plant, readings, commands, snapshots, arguments.ticks, seconds(machine["timing"]["period"]))
        else:
            drive_timeout_s = seconds(machine["timing"].get("drive_timeout", "50ms"))
            real_time(plant, readings, commands, arguments.ticks, drive_timeout_s)
    except KeyboardInterrupt:
        pass
    except (Trouble, OSError, KeyError, tomllib.TOMLDecodeError) as error:
        sys.exit(f"{type(error).__name__}: {error}")


if __name__ == "__main__":
    main()
