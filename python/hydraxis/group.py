"""A running group: which machine it has, its channels, and its operation."""

import re
from dataclasses import dataclass

from . import messages as m
from .channels import Membership, Publisher, Reader, config_of, folder_of, library, text_of
from .errors import NoGroup, no_group
from .operate import Operator
from .reference import ReferenceWriter

PREFIX = re.compile(r"[A-Za-z0-9_-]{1,32}")
MACHINE_PATIENCE_S = 10.0  # for the first heartbeat of control-proc


@dataclass(frozen=True)
class Machine:
    """The machine of a group, as far as its messages tell it."""

    number: int  # in the headers of all messages
    axes: tuple  # names of the axes, in the order of the messages

    def index(self, axis):
        """Place of an axis in the messages."""
        if axis not in self.axes:
            raise KeyError(f'no axis "{axis}"; allowed: one of {", ".join(self.axes)}')
        return self.axes.index(axis)

    def choose(self, axes):
        """Names of axes: of one, of several, or of all where it is None."""
        chosen = self.axes if axes is None else (axes,) if isinstance(axes, str) else tuple(axes)
        for axis in chosen:
            self.index(axis)
        return chosen


def is_running(prefix):
    """Whether a process of the group is alive; a killed group leaves its folder behind."""
    if not folder_of(prefix).is_dir():
        return False
    iox2 = library()
    try:
        nodes = iox2.Node.list(iox2.ServiceType.Ipc, config_of(prefix))
    except iox2.NodeListFailure:
        return False
    return any(isinstance(node, iox2.NodeState.Alive) for node in nodes)


def running_groups():
    """Names of the groups of this user that run, sorted."""
    names = (folder.name.partition(".")[2] for folder in folder_of("").parent.glob("hydraxis.*"))
    return sorted(name for name in names if PREFIX.fullmatch(name) and is_running(name))


def choose(prefix):
    """The name of a group that runs; None is the only one that does."""
    if prefix is not None:
        if not PREFIX.fullmatch(prefix):
            raise NoGroup(f'prefix: found "{prefix}"; allowed: 1 to 32 letters, digits, - and _')
        if not is_running(prefix):
            raise no_group(prefix)
        return prefix
    found = running_groups()
    if not found:
        raise NoGroup("no group runs; start one with: hydraxis run MACHINE.toml --prefix demo")
    if len(found) > 1:
        raise NoGroup(f"several groups run; choose one by its prefix: {', '.join(found)}")
    return found[0]


class Group:
    """A running group. Without `prefix` the only one that runs.

    `name` is what `hydraxis status` shows of this program. Use it in a `with` statement, or call `close`.

        with hydraxis.Group("demo") as group:
            for sample in group.samples():
                print(sample.header.sequence, sample.axes[0].position)
    """

    def __init__(self, prefix=None, name="python"):
        self.prefix = choose(prefix)
        self._membership = Membership(self.prefix, name)
        self._machine = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Leaves the group. Its readers and writers end as well."""
        self._membership.close()

    @property
    def has_ended(self):
        """Whether the group has ended in order. A group that was killed has not; nothing comes from it any more."""
        return self._membership.is_removed()

    @property
    def machine(self):
        """The machine of the group: number and names of the axes. Waits for the first heartbeat of control-proc."""
        if self._machine is None:
            states = Reader(self._membership, m.MachineState, MACHINE_PATIENCE_S)
            state = states.next()
            # Every heartbeat names the axes; the count is that of the last command.
            while not state.header.machine:
                state = states.next()
            states.close()
            names = tuple(text_of(axis.name) for axis in state.axes)
            self._machine = Machine(state.header.machine, tuple(name for name in names if name))
        return self._machine

    @property
    def axes(self):
        """Names of the axes, in the order of the messages."""
        return self.machine.axes

    def _reader(self, message, timeout):
        reader = Reader(self._membership, message, timeout)
        if self._machine is not None:
            reader.machine = self._machine.number
        return reader

    def readings(self, timeout=2.0):
        """Reader of raw values of the sensors."""
        return self._reader(m.EncoderReading, timeout)

    def samples(self, timeout=2.0):
        """Reader of checked positions and pressures: one message per tick."""
        return self._reader(m.EncoderSample, timeout)

    def commands(self, timeout=2.0):
        """Reader of valve commands with their reasons: one message per tick."""
        return self._reader(m.ValveCommand, timeout)

    def snapshots(self, timeout=2.0):
        """Reader of the identified models: one message per tick."""
        return self._reader(m.CoefficientSnapshot, timeout)

    def references(self, timeout=2.0):
        """Reader of references that another program writes."""
        return self._reader(m.Reference, timeout)

    def requests(self, timeout=2.0):
        """Reader of requests of operators."""
        return self._reader(m.Request, timeout)

    def health(self, timeout=2.0):
        """Reader of the heartbeats of all stages, several times a second."""
        return self._reader(m.StageHealth, timeout)

    def state(self, timeout=2.0):
        """Reader of the machine at one glance, several times a second."""
        return self._reader(m.MachineState, timeout)

    def reference(self):
        """Writer of references, for axes with `kind = "channel"` in their reference. A group takes one."""
        return ReferenceWriter(Publisher(self._membership, m.Reference, self.machine.number), self.machine)

    def request(self, take_over=False, hold_to_run=True):
        """Operator of the axes; see Operator. A group takes one at a time."""
        return Operator(self, take_over, hold_to_run)

    def _publisher(self, message):
        return Publisher(self._membership, message, self.machine.number)
