#!/usr/bin/env python3
"""Reads the samples of a group at 1 kHz and writes references of four axes 100 times a second, and counts the losses.

usage: rate.py SECONDS
"""

import json
import math
import os
import sys
import time

from support import CHANNEL_REFERENCES, EXAMPLES, Running, hydraxis

TICK_S, RATE = 0.001, 100
AMPLITUDE_M, PERIOD_S = 0.02, 10.0


def percentiles(values):
    values = sorted(values)
    at = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
    return {name: round(values[min(int(part * len(values)), len(values) - 1)] * 1e-6, 3) for name, part in at.items()}


def references(begins, since):
    """The coming positions of all axes from a tick on."""
    def position(tick):
        return AMPLITUDE_M * (1 - math.cos(2 * math.pi * tick * TICK_S / PERIOD_S)) / 2

    coming = [position(since + i) for i in range(hydraxis.MAX_PREVIEW)]
    return {axis: [begin + at for at in coming] for axis, begin in begins.items()}


def exchange(group, seconds):
    """Reads and writes; returns the figures. Times are in ms."""
    samples, commands, health = group.samples(), group.commands(), group.health()
    writer = group.reference()
    first = samples.next()
    begins = {axis: first.axes[i].position for i, axis in enumerate(group.axes)}
    ages, delays, refused, commanded, read = [], [], 0, 0, []
    start = due = time.monotonic()
    while time.monotonic() - start < seconds:
        sample = samples.next()
        ages.append(time.monotonic_ns() - sample.header.sent_ns)
        for command in commands.all():
            commanded += 1
            flags = [axis.flags & hydraxis.ControlFlag.REFERENCE for axis in command.axes[:len(group.axes)]]
            refused += any(flags) and writer.sent > 0
        if time.monotonic() >= due:
            sample = samples.newest() or sample
            writer.send(sample, references(begins, sample.header.sequence - first.header.sequence))
            delays.append(time.monotonic_ns() - sample.header.acquired_ns)
            # A reference that is late is not made up for: two at once tell the controller nothing.
            due = max(due + 1 / RATE, time.monotonic() + 0.5 / RATE)
        read += [beat for beat in health.all() if hydraxis.STAGES[beat.stage] == "control-proc"]
    time.sleep(0.5)
    read += [beat for beat in health.all() if hydraxis.STAGES[beat.stage] == "control-proc"]
    place = list(hydraxis.MESSAGES).index("reference")
    channel = [entry for entry in read[-1].channels[:read[-1].channel_count] if entry.channel == place][0]
    return {
        "seconds": seconds, "ticks": samples.last.header.sequence - first.header.sequence + 1,
        "samples": samples.received, "samples_lost": samples.lost, "commands": commanded,
        "commands_lost": commands.lost, "references_sent": writer.sent, "references_received": channel.received,
        "references_lost": channel.lost, "commands_with_refused_reference": refused,
        "load_average": os.getloadavg(),
        "ms_from_sent_sample_to_python": percentiles(ages),
        "ms_from_acquired_sample_to_sent_reference": percentiles(delays),
    }


def run(seconds, *settings):
    """The figures of a new group."""
    arguments = ["--set", "timing.period=1ms", *CHANNEL_REFERENCES, *settings]
    with Running(*arguments, machine=EXAMPLES / "four-axes.toml") as running, running.group() as group:
        return exchange(group, seconds)


if __name__ == "__main__":
    print(json.dumps(run(float(sys.argv[1])), indent=1))
