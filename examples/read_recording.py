#!/usr/bin/env python3
"""Read a recording or a black box, whole or damaged, and print what each axis did.

Needs Python 3.9 or newer:

    pip install mcap mcap-ros2-support

    hydraxis run --record demo.mcap
    python3 examples/read_recording.py demo.mcap

A file without an end, as a kill or a full disk leaves it, is read up to there.
"""

import argparse
import sys

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.records import Metadata
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory


def facts(file):
    """What the recording says about itself: version, group, machine, axes, period."""
    found = {}
    with open(file, "rb") as opened:
        try:
            for record in StreamReader(opened).records:
                if isinstance(record, Metadata) and record.name.startswith("hydraxis"):
                    found.update(record.metadata)
        except McapError:
            pass
    return found


def messages(file, topics):
    """Time in ns since 1970, channel and message, one after the other, as far as the file goes."""
    with open(file, "rb") as opened:
        # Messages are in the order in which they were read. Sorted by time they would all have to be in memory.
        reader = NonSeekingReader(opened, decoder_factories=[DecoderFactory()])
        try:
            for _, channel, record, message in reader.iter_decoded_messages(topics=topics, log_time_order=False):
                yield record.log_time, channel.topic, message
        except McapError as error:
            print(f"warning: read as far as it goes: {type(error).__name__} {error}", file=sys.stderr)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("file", help="a recording, or a black box")
    file = parser.parse_args().file

    axes = facts(file)["axes"].split()
    count, squares, largest = [0] * len(axes), [0.0] * len(axes), [0.0] * len(axes)
    begin = end = None
    for time, topic, message in messages(file, ["valve-command"]):
        begin, end = begin or time, time
        for i, axis in enumerate(message.axes[:len(axes)]):
            # 0: nobody commands the axis, its valve is neutral.
            if axis.mode != 0:
                count[i] += 1
                squares[i] += axis.error ** 2
                largest[i] = max(largest[i], abs(axis.error))
    if begin is None:
        sys.exit(f"{file}: no command in it")
    print(f"{(end - begin) * 1e-9:.1f} s")
    for i, name in enumerate(axes):
        rms = (squares[i] / count[i]) ** 0.5 if count[i] else 0.0
        print(f"{name:12} {count[i]:7} commands, following error {1e3 * rms:8.3f} mm rms, "
              f"{1e3 * largest[i]:8.3f} mm at most")


if __name__ == "__main__":
    main()
