"""Messages and channels of Hydraxis for Python programs, see watch.py and plant.py.

Needs Python 3.9 or newer and one package:

    pip install iceoryx2==0.10.0

The structures mirror pipeline/src/message/ field by field, names included: the fingerprint of the layout is made of
them, and a group of another version is refused by it.

Trap: times are of CLOCK_MONOTONIC, which is time.monotonic_ns() in Python.
"""

import ctypes
import os
import re
import sys
import time
from collections import deque
from ctypes import c_double as f64, c_int64 as i64, c_uint32 as u32, c_uint64 as u64
from pathlib import Path

try:
    import iceoryx2 as iox2
except ImportError:
    sys.exit("the package iceoryx2 is missing: pip install iceoryx2==0.10.0")

OPEN_PATIENCE_S = 10.0  # for the channels of a group that is just starting
MAX_AXES = 8
MODES = ["neutral", "fallback", "model", "replay", "manual", "commission"]
TRAINING = 1  # bit of AxisSnapshot.faults: there are no coefficients yet


# ------------------------------------------------------------------------------------------------ messages
# Positions are metres when the machine is simulated or real. A replayed recording keeps its own unit.


class Header(ctypes.Structure):
    _fields_ = [
        ("sequence", u64),  # index of the tick whose sample caused the message; a gap is a tick nobody worked
        ("number", u64),  # of this message on its channel; a gap is a lost message
        ("acquired_ns", u64),  # ns of CLOCK_MONOTONIC
        ("sent_ns", u64),  # ns of CLOCK_MONOTONIC
        ("session", u64),  # of the writer; another one is a start
        ("axis_count", u32),  # axes in use; the rest of the arrays is zero
        ("machine", u32),  # the machine that the message is about, in all messages of a group; 0 does not say which
    ]


class EncoderValue(ctypes.Structure):
    _fields_ = [
        ("counts", i64),  # position = counts * resolution
        ("piston_pressure", f64),  # Pa above the atmosphere
        ("rod_pressure", f64),  # Pa above the atmosphere
        ("error", u32),  # 0 when the encoder reports no error
        ("has_pressures", u32),  # 1 where both pressures are measured
    ]


class EncoderReading(ctypes.Structure):
    _fields_ = [
        ("header", Header),
        ("encoders", EncoderValue * MAX_AXES),
        ("emergency_stop", u32),  # 0 while released
        ("reserved", u32),
    ]

    @staticmethod
    def type_name():
        return "hydraxis.EncoderReading/4"


class ErrorStatistics(ctypes.Structure):
    _fields_ = [
        ("count", u64),  # values
        ("mean", f64),  # in the unit of the values
        ("m2", f64),  # sum of squared deviations from the mean, unit squared
        ("max", f64),  # largest magnitude, in the unit of the values
    ]


class AxisSample(ctypes.Structure):
    _fields_ = [
        ("position", f64),  # m
        ("velocity", f64),  # m/s, backward difference
        ("faults", u32),  # bits; 0 is healthy
        ("unchanged", u32),  # ticks since the raw value last changed
        ("piston_pressure", f64),  # Pa above the atmosphere; NaN while has_pressures is 0
        ("rod_pressure", f64),  # Pa above the atmosphere; NaN while has_pressures is 0
        ("has_pressures", u32),  # 1 while both pressures are usable
        ("reserved", u32),
    ]


class EncoderSample(ctypes.Structure):
    _fields_ = [
        ("header", Header),
        ("axes", AxisSample * MAX_AXES),
        ("emergency_stop", u32),  # 0 while released
        ("reserved", u32),
    ]

    @staticmethod
    def type_name():
        return "hydraxis.EncoderSample/4"


class AxisCommand(ctypes.Structure):
    _fields_ = [
        ("command", f64),  # valve command, -1 to 1, positive extends
        ("reference", f64),  # m
        ("error", f64),  # m, reference - position
        ("mode", u32),  # index in MODES
        ("flags", u32),  # bits; 0 is healthy
        ("operation", u32),  # 1 off, 2 manual, 3 hold, 4 track, 5 commission; 0 where nobody controls
        ("refused_requests", u32),  # requests refused so far
        ("taken_requests", u64),  # requests taken so far
        # refused so far: not finite, structure, unstable, direction, reach, speed, worse
        ("rejected_snapshots", u64 * 7),
        ("unsolved_plans", u64),  # plans without the solver so far
        ("tracking", ErrorStatistics),  # m
        ("model_tracking", ErrorStatistics),  # m, over the ticks of the model-based controller
        ("latches", u64),  # times that a fault latched the axis so far
        ("latched_at", u64),  # tick of the last latch
        ("latched_by", u32),  # bits of the last latch; they stay when the axis is released
        ("slowed_ticks", u32),  # ticks with a slowed reference so far
    ]


class ValveCommand(ctypes.Structure):
    _fields_ = [
        ("header", Header),
        ("axes", AxisCommand * MAX_AXES),
        ("cut_off", u32),  # 1 asks for the pilot pressure to be cut off
        ("reserved", u32),
        ("operator", u64),  # session of the program that operates, or did last; 0 before the first
    ]

    @staticmethod
    def type_name():
        return "hydraxis.ValveCommand/7"


class Coefficients(ctypes.Structure):
    _fields_ = [
        ("na", u32),  # order of A
        ("nb", u32),  # order of B
        ("nk", u32),  # delay, samples
        ("order", u32),  # coefficients of the nonlinearity for each sign of the command
        ("basis", u32),  # what they multiply: 0 powers, 1 hinges
        ("has_drift", u32),  # 1 with a drift
        ("a", f64 * 7),  # a_1 to a_na, no unit
        ("b", f64 * 5),  # b_0 to b_nb, m
        ("f", f64 * 5),  # for commands >= 0, no unit, f_1 = 1
        ("g", f64 * 5),  # for commands < 0, no unit
        ("drift", f64),  # m per sample
        ("dead_band", f64 * 2),  # commands that open nothing, below zero and above, as magnitudes
        ("knots", f64 * 5),  # where the hinges begin, of the command beyond the dead band
    ]


class ModelErrors(ctypes.Structure):
    _fields_ = [
        ("one_step", ErrorStatistics),  # m
        ("h_step", ErrorStatistics),  # m
        ("free_run", ErrorStatistics),  # m
    ]


class AxisSnapshot(ctypes.Structure):
    _fields_ = [
        ("adaptive", Coefficients),
        ("classical", Coefficients),  # identified offline, held since
        # Errors, output and innovation are in m/s instead where the velocity is what is identified.
        ("adaptive_errors", ModelErrors),  # m
        ("classical_errors", ModelErrors),  # m
        ("separated_h_step", ErrorStatistics),  # m, of the adaptive model as it is published
        ("output", ErrorStatistics),  # m, the output itself
        ("persistence", ErrorStatistics),  # m, change of the output over the horizon
        ("forgetting", ErrorStatistics),  # 1 - forgetting factor
        ("forgetting_factor", f64),  # of the last update
        ("innovation", f64),  # m, output minus one-step prediction at the last update
        ("innovation_ratio", f64),  # innovation over its usual size
        ("pole_radius", f64),  # largest magnitude of a pole of the adaptive model
        ("gain_ratio", f64 * 2),  # travel after a step, adaptive over classical: positive, negative command
        ("excitation", f64 * 2),  # part of the recent samples with a positive, a negative command
        ("covariance_trace", f64),
        ("split_residual", f64),  # 0 to 1
        ("command_low", f64),  # lowest valve command learned from
        ("command_high", f64),  # highest valve command learned from
        ("updates", u64),  # recursive updates
        ("skipped", u64),  # samples that could not be used
        ("outliers", u64),  # samples too far from every prediction to be used
        ("since_update", u64),  # samples since the last one learned from
        ("horizon", u32),  # samples
        ("faults", u32),  # bits; 0 is healthy
    ]


class CoefficientSnapshot(ctypes.Structure):
    _fields_ = [("header", Header), ("axes", AxisSnapshot * MAX_AXES)]

    @staticmethod
    def type_name():
        return "hydraxis.CoefficientSnapshot/4"


def fingerprint(kind):
    """FNV-1a over name, type and offset of every field, as pipeline/src/layout.rs makes it."""

    def fold(data, value=0xCBF29CE484222325):
        for byte in data:
            value = (value ^ byte) * 0x100000001B3 % 2**64
        return value

    def number(n):
        return n.to_bytes(8, "little")

    if issubclass(kind, ctypes.Array):
        return fold(b"array" + number(kind._length_), fingerprint(kind._type_))
    if not issubclass(kind, ctypes.Structure):
        return fold({f64: b"f64", u32: b"u32", u64: b"u64", i64: b"i64"}[kind])
    value = fold(kind.__name__.encode())
    for name, field in kind._fields_:
        value = fold(name.encode() + number(fingerprint(field)) + number(getattr(kind, name).offset), value)
    return value


# ------------------------------------------------------------------------------------------------- channels


OTHER_VERSION = "use the hydraxis.py that came with this version of Hydraxis"


class Trouble(Exception):
    """The group cannot be used; the text says why and what to do."""


class Group:
    """The channels of one run, apart from those of any other."""

    def __init__(self, prefix, name):
        self.prefix = prefix
        self.folder = folder_of(prefix)
        self._opened_folder = os.open(self.folder, os.O_RDONLY)
        config = config_of(prefix)
        self.node = iox2.NodeBuilder.new().name(iox2.NodeName.new(name))
        self.node = self.node.config(config).signal_handling_mode(iox2.SignalHandlingMode.Disabled)
        self.node = self.node.create(iox2.ServiceType.Ipc)

    def is_removed(self):
        """Whether the run has ended and removed its files, or a new run of the same name has replaced them."""
        try:
            return not os.path.samestat(os.fstat(self._opened_folder), os.stat(self.folder))
        except FileNotFoundError:
            return True


def open_channel(group, name, message):
    """The service of a channel, once a stage has created it."""
    until = time.monotonic() + OPEN_PATIENCE_S
    while True:
        try:
            builder = group.node.service_builder(iox2.ServiceName.new(f"hydraxis/{name}"))
            service = builder.publish_subscribe(message).open()
            break
        except iox2.PublishSubscribeOpenError as error:
            if "Incompatible" in str(error):
                raise Trouble(f'channel "{name}" carries other messages ({error}): {OTHER_VERSION}') from None
            if time.monotonic() > until or group.is_removed():
                raise Trouble(f'group "{group.prefix}" has no channel "{name}" ({error}): '
                              "it has ended, or no stage uses this channel") from None
            time.sleep(0.05)
    # Opening has compared the type's name, size and alignment; the fingerprint tells swapped fields apart.
    found = service.attributes.key_values(iox2.AttributeKey.new("hydraxis.layout"))
    if [value.to_string() for value in found] != [f"{fingerprint(message):016x}"]:
        raise Trouble(f'channel "{name}" carries messages of another layout: {OTHER_VERSION}')
    return service


class Publisher:
    """Writes one kind of message."""

    def __init__(self, group, name, message):
        self.port = open_channel(group, name, message).publisher_builder().create()
        self.number = 0
        self.session = time.monotonic_ns()

    def send(self, message):
        """Sends a message whose header is filled in but for its number and session."""
        message.header.number = self.number
        message.header.session = self.session
        self.number += 1
        self.port.loan_uninit().write_payload(message).send()

    def greet(self):
        """Hands the last message to readers that have come since."""
        self.port.update_connections()


class Channel:
    """Reads one kind of message and counts the ones it missed, by their numbers."""

    def __init__(self, group, name, message, buffer):
        self.name, self.message = name, message
        self.recent = deque(maxlen=buffer)  # newest last
        self.received = self.lost = self.skipped = 0
        service = open_channel(group, name, message)
        buffer = min(buffer, service.static_config.subscriber_max_buffer_size)
        self.port = service.subscriber_builder().buffer_size(buffer).create()

    def read(self):
        """Takes in all that is new; returns whether there was any."""
        before = self.received
        while (sample := self.port.receive()) is not None:
            message = self.message.from_buffer_copy(sample.payload().contents)
            sample.delete()  # the channel lends one message at a time
            if self.recent:
                messages = message.header.number - self.recent[-1].header.number
                ticks = message.header.sequence - self.recent[-1].header.sequence
                if messages <= 0:  # the writer started again
                    self.recent.clear()
                else:
                    self.lost += messages - 1
                    self.skipped += max(ticks - messages, 0)
            self.received += 1
            self.recent.append(message)
        return self.received > before

    def at(self, tick):
        """The message of a tick, if it is still known."""
        return next((m for m in reversed(self.recent) if m.header.sequence == tick), None)


def config_of(prefix):
    """The library's settings that a group of this name uses."""
    config = iox2.config.default()
    glob = config.global_cfg
    glob.prefix = iox2.FileName.new(prefix + ".")
    glob.root_path = iox2.Path.new(str(folder_of(prefix)))
    # Cleaning up after the dead is the supervisor's work.
    glob.node.cleanup_dead_nodes_on_creation = False
    glob.node.cleanup_dead_nodes_on_destruction = False
    glob.service.cleanup_dead_nodes_on_open = False
    return config


def folder_of(prefix):
    return Path(os.environ.get("TMPDIR", "/tmp")) / f"hydraxis.{prefix}"


def is_running(prefix):
    """Whether a process of the group is alive; a killed group leaves its folder behind."""
    if not folder_of(prefix).is_dir():
        return False
    nodes = iox2.Node.list(iox2.ServiceType.Ipc, config_of(prefix))
    return any(isinstance(node, iox2.NodeState.Alive) for node in nodes)


def running_groups():
    names = (folder.name.partition(".")[2] for folder in folder_of("").parent.glob("hydraxis.*"))
    return sorted(name for name in names if re.fullmatch(r"[\w-]{1,32}", name, re.ASCII) and is_running(name))
