#!/usr/bin/env python3
"""A reference generator: lets every axis follow a slow sine about where it stands.

    y_r(t) = y_0 + A (1 - cos(2 pi t / T)) / 2

    y_0  position at the start, m        A  --amplitude, m, towards the middle        T  --period, s

Needs Python 3.9 or newer and the package hydraxis:

    pip install ./python

The axes need references from a channel. A machine that has others gets them by settings:

    hydraxis run examples/four-axes.toml --prefix demo --set axis.boom.reference.kind=channel
    python3 examples/reference.py --prefix demo --axis boom

A message carries the positions of the present tick and of 31 more. So the generator writes a few times within that
span, and a message that comes late changes nothing.
"""

import argparse
import math
import signal
import sys
import time

import hydraxis


def sine(begin, amplitude, period_s, time_s):
    """The reference of an axis, m."""
    return begin + amplitude * (1 - math.cos(2 * math.pi * max(time_s, 0.0) / period_s)) / 2


def tick_of(samples):
    """Length of a tick, s: from the times of two samples."""
    first = samples.next()
    last = first
    while last.header.sequence < first.header.sequence + 20:
        last = samples.next()
    return (last.header.acquired_ns - first.header.acquired_ns) * 1e-9 / (last.header.sequence - first.header.sequence)


def follow(group, axes, amplitude, period_s, seconds, rate):
    """Writes references until the time is over or the group has ended; returns the number of messages."""
    samples = group.samples()
    tick_s = tick_of(samples)
    first = samples.last
    begins = {axis: first.axes[group.machine.index(axis)].position for axis in axes}
    writer = group.reference()
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        try:
            sample = samples.newest() or samples.next()
        except hydraxis.GroupEnded:
            break
        since = sample.header.sequence - first.header.sequence
        times = [(since + i) * tick_s for i in range(hydraxis.MAX_PREVIEW)]
        writer.send(sample, {axis: [sine(begins[axis], amplitude, period_s, t) for t in times] for axis in axes})
        time.sleep(1 / rate)
    return writer.sent


def main():
    parser = argparse.ArgumentParser(description="Write references of a slow sine.")
    parser.add_argument("--prefix", metavar="NAME", help="name of the group; without it the one that is running")
    parser.add_argument("--axis", action="append", metavar="NAME", help="an axis; without it all of them")
    parser.add_argument("--amplitude", type=float, default=0.05, metavar="M")
    parser.add_argument("--period", type=float, default=10.0, metavar="S")
    parser.add_argument("--seconds", type=float, default=math.inf, metavar="S", help="end after S seconds")
    parser.add_argument("--rate", type=float, default=100.0, metavar="HZ", help="messages per second")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # leave the group in order, as at Ctrl-C
    try:
        with hydraxis.Group(arguments.prefix, "reference") as group:
            axes = group.machine.choose(arguments.axis)
            sent = follow(group, axes, arguments.amplitude, arguments.period, arguments.seconds, arguments.rate)
            print(f"{sent} references sent", file=sys.stderr)
    except KeyboardInterrupt:
        pass
    except (hydraxis.HydraxisError, KeyError) as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
