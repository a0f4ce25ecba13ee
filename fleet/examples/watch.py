#!/usr/bin/env python3
"""Watch the machines of a site over the network: position, command and age of each axis, once a second.

Needs Python 3.9 or newer, the package hydraxis and the binding of Zenoh:

    pip install ./python eclipse-zenoh==1.10.2

    python3 fleet/examples/watch.py --router tls/router.quarry:7447 --site quarry \\
        --ca ca.pem --certificate viewer.pem --key viewer.key

A message is shown with its age, and as STALE when it is older than a second. A message of another layout is refused
and counted: the bridge is of another version than the package.
"""

import argparse
import json
import struct
import time

import zenoh
from hydraxis import MESSAGES, text_of

FRESH_S = 1.0
ENCAPSULATION = bytes([0, 1, 0, 0])  # CDR, little-endian
STAMP = struct.Struct("<QQqQ")  # run, number, time since 1970 in ns, error of the clock in ns


class Machines:
    """The newest message of each channel of each machine, with its stamp."""

    def __init__(self):
        self.newest, self.lost, self.refused = {}, {}, {}

    def take(self, sample):
        machine, channel = str(sample.key_expr).split("/")[3], str(sample.key_expr).split("/")[5]
        kind, encoding = MESSAGES.get(channel), str(sample.encoding)
        payload = bytes(sample.payload)
        # The encoding ends with the fingerprint of the fields. With another one the bytes could mean something else.
        if not (kind and encoding == f"application/cdr;hydraxis/msg/{kind.__name__}:{kind.LAYOUT}"
                and sample.attachment and payload.startswith(ENCAPSULATION)):
            self.refused[machine] = self.refused.get(machine, 0) + 1
            return
        run, number, utc_ns, _ = STAMP.unpack(bytes(sample.attachment))
        before = self.newest.get((machine, channel))
        if before and before[0] == run:
            if number <= before[1]:
                return
            self.lost[machine] = self.lost.get(machine, 0) + number - before[1] - 1
        # All fields of a message have fixed places, which are those of the struct in memory.
        message = kind.from_buffer_copy(payload[len(ENCAPSULATION):])
        self.newest[machine, channel] = (run, number, utc_ns, message)

    def show(self):
        for machine, channel in sorted(self.newest):
            if channel != "encoder-sample":
                continue
            _, _, utc_ns, sample = self.newest[machine, channel]
            state, command = self.message(machine, "machine-state"), self.message(machine, "valve-command")
            age = time.time() - utc_ns * 1e-9
            fresh = "live " if -0.1 <= age <= FRESH_S else "STALE"
            print(f"{machine}  {fresh}  {age:.2f} s  lost {self.lost.get(machine, 0)}"
                  f"  refused {self.refused.get(machine, 0)}")
            for i in range(sample.header.axis_count):
                name = text_of(state.axes[i].name) if state else str(i)
                u = f"{command.axes[i].command:+.4f}" if command else "-"
                print(f"    {name:12} {sample.axes[i].position:8.4f} m  {u}")

    def message(self, machine, channel):
        return self.newest[machine, channel][3] if (machine, channel) in self.newest else None


def configuration(arguments):
    config = {
        "mode": "client",
        "connect": {"endpoints": [arguments.router]},
        "scouting": {"multicast": {"enabled": False}},
    }
    if arguments.certificate:
        config["transport"] = {"link": {"tls": {
            "enable_mtls": True, "root_ca_certificate": arguments.ca,
            "connect_certificate": arguments.certificate, "connect_private_key": arguments.key,
        }}}
    return zenoh.Config.from_json5(json.dumps(config))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--router", required=True)
    parser.add_argument("--site", required=True)
    parser.add_argument("--ca")
    parser.add_argument("--certificate")
    parser.add_argument("--key")
    parser.add_argument("--seconds", type=float, default=float("inf"))
    arguments = parser.parse_args()
    machines, until = Machines(), time.monotonic() + arguments.seconds
    with zenoh.open(configuration(arguments)) as session:
        session.declare_subscriber(f"hydraxis/v1/{arguments.site}/*/telemetry/*", machines.take)
        while time.monotonic() < until:
            time.sleep(1)
            machines.show()


if __name__ == "__main__":
    main()
