#!/usr/bin/env python3
"""Log samples and commands of a running group to a CSV file, which `hydraxis identify` reads.

Needs Python 3.9 or newer and the package hydraxis:

    pip install ./python

    hydraxis run --prefix demo
    python3 examples/logger.py --prefix demo --seconds 10 log.csv
    hydraxis identify log.csv --input boom.command --output boom.position

A row has the position of a tick, and the command that was made from it and applied from then on. A tick without a
sample or without a command is left out, and told at the end.
"""

import argparse
import csv
import signal
import sys
import time

import hydraxis

COLUMNS = ("command", "position", "reference")  # of every axis


def log(group, file, seconds):
    """Writes rows until the time is over or the group has ended; returns the numbers of rows and of lost messages."""
    samples, commands = group.samples(), group.commands()
    writer = csv.writer(file)
    writer.writerow(["t"] + [f"{axis}.{column}" for axis in group.axes for column in COLUMNS])
    waiting, first_ns, rows = {}, None, 0
    until = time.monotonic() + seconds
    try:
        for command in commands:
            waiting.update({sample.header.sequence: sample for sample in samples.all()})
            sample = waiting.pop(command.header.sequence, None)
            if sample is not None:
                first_ns = sample.header.acquired_ns if first_ns is None else first_ns
                row = [(sample.header.acquired_ns - first_ns) * 1e-9]
                for i in range(len(group.axes)):
                    row += [command.axes[i].command, sample.axes[i].position, command.axes[i].reference]
                writer.writerow(row)
                rows += 1
            # Samples that are older than the command get none any more.
            waiting = {tick: sample for tick, sample in waiting.items() if tick > command.header.sequence}
            if time.monotonic() > until:
                break
    except KeyboardInterrupt:
        pass
    return rows, samples.lost + commands.lost


def main():
    parser = argparse.ArgumentParser(description="Log samples and commands of a running group as CSV.")
    parser.add_argument("file", metavar="FILE.csv")
    parser.add_argument("--prefix", metavar="NAME", help="name of the group; without it the one that is running")
    parser.add_argument("--seconds", type=float, default=float("inf"), metavar="S", help="end after S seconds")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # leave the group in order, as at Ctrl-C
    try:
        with hydraxis.Group(arguments.prefix, "logger") as group, open(arguments.file, "w", newline="") as file:
            rows, lost = log(group, file, arguments.seconds)
            print(f"{rows} rows, {lost} messages lost on the way to here", file=sys.stderr)
    except (hydraxis.HydraxisError, OSError) as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
