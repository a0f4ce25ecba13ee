#!/usr/bin/env python3
"""Watch a running group of Hydraxis: samples, commands and models, twice a second.

Needs Python 3.9 or newer and the package hydraxis:

    pip install ./python

Start a group, then watch it from another terminal, as the same user:

    hydraxis run --prefix demo
    python3 examples/watch.py --prefix demo

Without --prefix the one group that is running is taken. Ctrl-C ends watching, and so does the end of the group.
Watching takes nothing from the group: each channel has places for clients, its writer waits for no reader, and a
reader that is slow loses its oldest messages, which are counted here.
"""

import argparse
import os
import signal
import sys
import time
from collections import deque

import hydraxis
from hydraxis import ControlMode, ModelFault

POLL_S = 0.005  # a coefficient channel holds 16 messages: enough for 3000 ticks per second
PRINT_S = 0.5
END_PATIENCE_S = 2.0  # without any message after that, the group has ended
FIRST_PATIENCE_S = 10.0  # for the first message of a group
MODES = {mode.value: mode.name.lower() for mode in ControlMode}

HEADING = ("    tick axis  position  piston    rod   command reference     error mode        forget innovation  a | b\n"
           "                   mm     MPa    MPa                  mm        mm                       mm")


class Recent:
    """The last messages of a reader, to find those of one tick."""

    def __init__(self, reader, length):
        self.reader, self.messages = reader, deque(maxlen=length)

    def read(self):
        found = self.reader.all()
        self.messages.extend(found)
        return bool(found)

    def at(self, tick):
        return next((m for m in reversed(self.messages) if m.header.sequence == tick), None)

    @property
    def last(self):
        return self.messages[-1] if self.messages else None


def print_axes(names, samples, commands, snapshots):
    """One line per axis, of the newest tick that has a command."""
    newest = commands.last or samples.last
    tick = newest.header.sequence
    # Without a snapshot of the tick the identifier is behind, or has ended.
    sample, command, snapshot = samples.at(tick), commands.at(tick), snapshots.at(tick) or snapshots.last
    for i in range(len(names)):
        columns = [f"{tick:8} {i + 1:4}"]
        columns.append(f"{sample.axes[i].position * 1e3:9.2f}" if sample else f"{'-':>9}")
        if sample and sample.axes[i].has_pressures:
            axis = sample.axes[i]
            columns.append(f"{axis.piston_pressure / 1e6:7.2f} {axis.rod_pressure / 1e6:6.2f}")
        else:
            columns.append(f"{'-':>7} {'-':>6}")
        if command:
            c = command.axes[i]
            mode = MODES.get(c.mode, "unknown")
            columns.append(f"{c.command:+9.4f} {c.reference * 1e3:9.2f} {c.error * 1e3:+9.3f} {mode:10}")
        else:
            columns.append(f"{'-':>9} {'-':>9} {'-':>9} {'-':10}")
        if snapshot is None:
            columns.append("no snapshot")
        elif snapshot.axes[i].faults & ModelFault.TRAINING:
            columns.append("still training")
        else:
            s = snapshot.axes[i]
            a, b = s.adaptive.a[: s.adaptive.na], s.adaptive.b[: s.adaptive.nb + 1]
            columns.append(f"{s.forgetting_factor:7.5f} {s.innovation * 1e3:+10.4f}  "
                           + " ".join(f"{v:+.4f}" for v in a) + " | " + " ".join(f"{v:+.3e}" for v in b))
        print(" ".join(columns), flush=True)


def watch(group, count, seconds):
    """Reads and prints until a limit or the end of the group; returns why it ended."""
    readers = [group.samples(), group.commands(), group.snapshots()]
    channels = [Recent(reader, 256) for reader in readers]
    started = last_data = last_print = time.monotonic()
    fresh, printed, lost = False, 0, 0
    print(HEADING, flush=True)
    try:
        while True:
            now = time.monotonic()
            if any([channel.read() for channel in channels]):
                fresh, last_data = True, now
            received = any(reader.received for reader in readers)
            if fresh and now - last_print >= PRINT_S and (channels[0].last or channels[1].last):
                print_axes(group.axes, *channels)
                fresh, last_print, printed = False, now, printed + 1
                if sum(reader.lost for reader in readers) > lost:
                    lost = sum(reader.lost for reader in readers)
                    print(f"{lost} messages lost so far: this program is too slow for them", file=sys.stderr)
            if group.has_ended or received and now - last_data > END_PATIENCE_S:
                return "the group has ended"
            if not received and now - started > FIRST_PATIENCE_S:
                raise hydraxis.Timeout(f'group "{group.prefix}" runs but sends nothing')
            if count is not None and printed >= count or seconds is not None and now - started >= seconds:
                return "done"
            time.sleep(POLL_S)
    except KeyboardInterrupt:
        return "stopped; the group runs on"
    finally:
        for reader in readers:
            print(f"{reader.channel}: {reader.received} messages received, {reader.lost} lost on the way to here",
                  file=sys.stderr)


def main():
    parser = argparse.ArgumentParser(description="Print samples, commands and models of a running group.")
    parser.add_argument("--prefix", metavar="NAME", help="name of the group; without it the one that is running")
    parser.add_argument("--count", metavar="N", type=int, help="end after N printed ticks")
    parser.add_argument("--seconds", metavar="S", type=float, help="end after S seconds")
    arguments = parser.parse_args()
    os.nice(10)  # where cores are shared, the stages come first
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # leave the group in order, as at Ctrl-C
    try:
        with hydraxis.Group(arguments.prefix, "watch") as group:
            print(f'group "{group.prefix}", Ctrl-C ends watching', file=sys.stderr)
            print(watch(group, arguments.count, arguments.seconds), file=sys.stderr)
    except KeyboardInterrupt:
        pass
    except BrokenPipeError:  # as with "| head"
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except hydraxis.HydraxisError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
