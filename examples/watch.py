#!/usr/bin/env python3
"""Watch a running group of Hydraxis: samples, commands and models, twice a second.

Needs Python 3.9 or newer and one package:

    pip install iceoryx2==0.10.0

Start a group, then watch it from another terminal, as the same user:

    hydraxis run --prefix demo
    python3 watch.py --prefix demo

Without --prefix the one group that is running is taken. Ctrl-C ends watching, and so does the end of the group.
Watching takes nothing from the group: each channel has places for clients, its writer waits for no reader, and a
reader that is slow loses its oldest messages, which are counted here.

Messages and channels are in hydraxis.py, beside this file.
"""

import argparse
import os
import re
import signal
import sys
import time

from hydraxis import (MODES, TRAINING, Channel, CoefficientSnapshot, EncoderSample, Group, Trouble, ValveCommand,
                      iox2, is_running, running_groups)

POLL_S = 0.005  # a coefficient channel holds 16 messages: enough for 3000 ticks per second
PRINT_S = 0.5
FIRST_PATIENCE_S = 10.0  # for the first message of a group
END_PATIENCE_S = 2.0  # without any message after that, the group has ended


def choose(prefix):
    """The group to watch."""
    if prefix is not None:
        if not re.fullmatch(r"[\w-]{1,32}", prefix, re.ASCII):
            raise Trouble(f'--prefix: found "{prefix}"; allowed: 1 to 32 letters, digits, - and _')
        if not is_running(prefix):
            raise Trouble(f'no group "{prefix}" is running; start one with: hydraxis run --prefix {prefix}')
        return prefix
    found = running_groups()
    if not found:
        raise Trouble("no group is running; start one with: hydraxis run --prefix demo")
    if len(found) > 1:
        raise Trouble("several groups are running; choose one with:"
                      + "".join(f"\n  {sys.argv[0]} --prefix {name}" for name in found))
    return found[0]


HEADING = ("    tick axis  position  piston    rod   command reference     error mode        forget innovation  a | b\n"
           "                   mm     MPa    MPa                  mm        mm                       mm")


def print_axes(samples, commands, snapshots):
    """One line per axis, of the newest tick that has a command."""
    newest = (commands if commands.recent else samples).recent
    tick = newest[-1].header.sequence
    sample, command, snapshot = samples.at(tick), commands.at(tick), snapshots.at(tick)
    if snapshot is None and snapshots.recent:
        snapshot = snapshots.recent[-1]  # the identifier is behind, or has ended
    for axis in range(newest[-1].header.axis_count):
        columns = [f"{tick:8} {axis + 1:4}"]
        columns.append(f"{sample.axes[axis].position * 1e3:9.2f}" if sample else f"{'-':>9}")
        if sample and sample.axes[axis].has_pressures:
            a = sample.axes[axis]
            columns.append(f"{a.piston_pressure / 1e6:7.2f} {a.rod_pressure / 1e6:6.2f}")
        else:
            columns.append(f"{'-':>7} {'-':>6}")
        if command:
            c = command.axes[axis]
            mode = MODES[c.mode] if c.mode < len(MODES) else "unknown"
            columns.append(f"{c.command:+9.4f} {c.reference * 1e3:9.2f} {c.error * 1e3:+9.3f} {mode:10}")
        else:
            columns.append(f"{'-':>9} {'-':>9} {'-':>9} {'-':10}")
        if snapshot is None:
            columns.append("no snapshot")
        elif snapshot.axes[axis].faults & TRAINING:
            columns.append("still training")
        else:
            s = snapshot.axes[axis]
            a, b = s.adaptive.a[: s.adaptive.na], s.adaptive.b[: s.adaptive.nb + 1]
            columns.append(f"{s.forgetting_factor:7.5f} {s.innovation * 1e3:+10.4f}  "
                           + " ".join(f"{v:+.4f}" for v in a) + " | " + " ".join(f"{v:+.3e}" for v in b))
        print(" ".join(columns), flush=True)


def watch(group, count, seconds):
    """Reads and prints until a limit or the end of the group; returns why it ended."""
    samples = Channel(group, "encoder-sample", EncoderSample, 256)
    commands = Channel(group, "valve-command", ValveCommand, 256)
    snapshots = Channel(group, "coefficient-snapshot", CoefficientSnapshot, 16)
    channels = [samples, commands, snapshots]
    started = last_data = last_print = time.monotonic()
    fresh, printed, lost = False, 0, 0
    print(HEADING, flush=True)
    try:
        while True:
            now = time.monotonic()
            if any([channel.read() for channel in channels]):
                fresh, last_data = True, now
            received = any(channel.received for channel in channels)
            if fresh and now - last_print >= PRINT_S and (samples.recent or commands.recent):
                print_axes(samples, commands, snapshots)
                fresh, last_print, printed = False, now, printed + 1
                if sum(channel.lost for channel in channels) > lost:
                    lost = sum(channel.lost for channel in channels)
                    print(f"{lost} messages lost so far: this program is too slow for them", file=sys.stderr)
            if group.is_removed() or received and now - last_data > END_PATIENCE_S:
                return "the group has ended"
            if not received and now - started > FIRST_PATIENCE_S:
                raise Trouble(f'group "{group.prefix}" runs but sends nothing')
            if count is not None and printed >= count or seconds is not None and now - started >= seconds:
                return "done"
            time.sleep(POLL_S)
    except KeyboardInterrupt:
        return "stopped; the group runs on"
    finally:
        for channel in channels:
            print(f"{channel.name}: {channel.received} messages received, {channel.lost} lost on the way to here; "
                  f"{channel.skipped} ticks nobody worked", file=sys.stderr)


def main():
    parser = argparse.ArgumentParser(description="Print samples, commands and models of a running group.")
    parser.add_argument("--prefix", metavar="NAME", help="name of the group; without it the one that is running")
    parser.add_argument("--count", metavar="N", type=int, help="end after N printed ticks")
    parser.add_argument("--seconds", metavar="S", type=float, help="end after S seconds")
    arguments = parser.parse_args()
    iox2.set_log_level(iox2.LogLevel.Fatal)  # errors come as exceptions
    os.nice(10)  # where cores are shared, the stages come first
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # leave the group in order, as at Ctrl-C
    group, status = None, 0
    try:
        group = Group(choose(arguments.prefix), "watch")
        print(f'group "{group.prefix}", Ctrl-C ends watching', file=sys.stderr)
        print(watch(group, arguments.count, arguments.seconds), file=sys.stderr)
    except KeyboardInterrupt:
        pass
    except BrokenPipeError:  # as with "| head"
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (Trouble, FileNotFoundError, iox2.NodeListFailure, iox2.NodeCreationFailure, iox2.SubscriberCreateError,
            iox2.ReceiveError) as error:
        reason = str(error) if isinstance(error, Trouble) else f"{type(error).__name__}: {error}"
        print(f"error: {reason}", file=sys.stderr)
        status = 1
    sys.stdout.flush()
    if group is not None and group.is_removed():
        os._exit(status)  # nothing is left to clean up, and the names may already belong to a new run
    return status


if __name__ == "__main__":
    sys.exit(main())
