"""References from a program: where the axes should be at this tick and the coming ones."""

import math

from .messages import MAX_PREVIEW, Reference


def as_list(positions):
    """Positions of one axis; a number is that position for as long as a message can."""
    try:
        return [float(positions)] * MAX_PREVIEW
    except TypeError:
        return [float(position) for position in positions]


class ReferenceWriter:
    """Writes references.

        writer.send(sample, {"boom": 0.7})                      stays at 0.7 m for as long as a message counts
        writer.send(sample, {"boom": [0.700, 0.701, 0.703]})    of the sample's tick and of the two after it

    A message counts for as many ticks as it has positions, at most MAX_PREVIEW = 32. An axis that a message does not
    name is held where it is. The controller refuses a reference that is outside the soft limits, jumps, or begins more
    than 10 mm from where the axis stands; it then sets the bit REFERENCE in the flags of the axis. One that is already
    moving is followed from a stand, and fully after a second or more: the axis has the bit SLOWED until then.
    """

    def __init__(self, publisher, machine):
        self._publisher, self.machine = publisher, machine
        self._newest = -1

    @property
    def sent(self):
        """Number of messages sent."""
        return self._publisher.sent

    def send(self, sample, positions):
        """Sends the positions (m) of axes from the tick of `sample` on; a message of a group, or a tick as number.

        Raises ValueError for what the controller would refuse whatever the axis does.
        """
        tick = sample if isinstance(sample, int) else sample.header.sequence
        if tick < self._newest:
            raise ValueError(f"tick: found {tick} after {self._newest}; allowed: ticks that do not go back")
        if not positions:
            raise ValueError("positions: found none; allowed: at least those of one axis")
        lists = {axis: as_list(at) for axis, at in positions.items()}
        lengths = {len(at) for at in lists.values()}
        if len(lengths) != 1 or not 1 <= min(lengths) <= MAX_PREVIEW:
            raise ValueError(f"positions: found {sorted(lengths)} per axis; allowed: equally many of every axis, "
                             f"1 to {MAX_PREVIEW}")
        message = Reference()
        message.preview = lengths.pop()
        message.header.sequence = tick
        message.header.axis_count = len(self.machine.axes)
        for row in message.positions:
            row[:] = [math.nan] * MAX_PREVIEW
        for axis, at in lists.items():
            if not all(math.isfinite(position) for position in at):
                raise ValueError(f"positions of {axis}: found one that is not finite; allowed: numbers, m")
            message.positions[self.machine.index(axis)][:len(at)] = at
        if not isinstance(sample, int):
            message.header.acquired_ns = sample.header.acquired_ns
        self._publisher.send(message)
        self._newest = tick
