"""Messages and files as data frames of pandas.

Columns of an axis are named as in the files of `hydraxis simulate --trajectory`: boom.position, boom.command. A frame
of messages has the columns of the header first: sequence, number, acquired_ns, sent_ns.
"""

import ctypes
from dataclasses import dataclass

from .errors import HydraxisError, MissingPackage
from .messages import MAX_AXES


def pandas():
    """The package pandas; it is imported only by what needs it."""
    try:
        import pandas as found
    except ImportError:
        raise MissingPackage("pandas") from None
    return found


def _fields(value):
    return [name for name, *_ in value._fields_] if isinstance(value, ctypes.Structure) else value.__slots__


def _flatten(value, name, row):
    """Numbers of a value, by names with dots."""
    if isinstance(value, (int, float)):
        row[name] = value
    elif isinstance(value, ctypes.Structure) or hasattr(value, "__slots__") and not hasattr(value, "__len__"):
        for field in _fields(value):
            if field not in ("reserved", "name"):
                _flatten(getattr(value, field), f"{name}.{field}" if name else field, row)
    else:
        for i, item in enumerate(value):
            _flatten(item, f"{name}.{i}", row)


def _row(message, axes):
    header = message.header
    row = {name: getattr(header, name) for name in ("sequence", "number", "acquired_ns", "sent_ns", "session")}
    for field in _fields(message):
        value = getattr(message, field)
        if field in ("axes", "encoders", "positions"):
            # The decoder of MCAP has one array in place of an array of arrays.
            width = len(value) // MAX_AXES
            for i, axis in enumerate(axes):
                part = value[i] if width == 1 else value[i * width:(i + 1) * width]
                _flatten(part, f"{axis}.position" if field == "positions" else axis, row)
        elif field not in ("header", "reserved"):
            _flatten(value, field, row)
    return row


def frame(messages, axes):
    """Messages of one channel as a data frame: one row per message; `axes` are the names of the axes."""
    return pandas().DataFrame([_row(message, axes) for message in messages])


def read_csv(path):
    """A recording or a trajectory as a data frame, with the time t (s) as its index where there is a column t."""
    data = pandas().read_csv(path)
    return data.set_index("t") if "t" in data.columns else data


@dataclass(frozen=True)
class BlackBox:
    """What a group has kept of the seconds around a fault."""

    facts: dict  # cause, group, machine, axes, lost messages by channel
    axes: tuple  # names of the axes
    channels: dict  # data frame of every channel, with the time t (s) since the cause as its index

    @property
    def cause(self):
        """What failed."""
        return self.facts["cause"]


def read_black_box(path):
    """The file that a group writes when a fault latches an axis or a stage dies (MCAP)."""
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise MissingPackage("mcap mcap-ros2-support") from None
    found = {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        facts = {record.name: dict(record.metadata) for record in reader.iter_metadata()}.get("hydraxis")
        if facts is None:
            raise HydraxisError(f"{path}: found a file without the metadata hydraxis; allowed: a black box of Hydraxis")
        for _, channel, _, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append(message)
    axes, cause_ns = tuple(facts["axes"].split()), int(facts["cause_monotonic_ns"])
    channels = {}
    for name, messages in found.items():
        data = frame(messages, axes)
        data.index = (data["sent_ns"].astype("int64") - cause_ns) * 1e-9
        data.index.name = "t"
        channels[name] = data
    return BlackBox(facts, axes, channels)


