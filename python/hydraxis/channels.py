"""Channels: readers that count what they lose, and publishers.

Trap: a message is lent by the library only until the next one, so every message is copied before it is handed on.
"""

import atexit
import ctypes
import functools
import os
import time
import weakref
from pathlib import Path

from .errors import GroupEnded, MissingPackage, NoChannel, NoPlace, OtherLayout, Timeout, no_group

POLL_S = 0.001  # between two looks at a channel; the smallest buffer of a channel at 1 kHz lasts for 64 ms
END_S = 0.1  # between two looks whether the group has ended
OPEN_PATIENCE_S = 10.0  # for the channels of a group that is just starting
BURIAL_PATIENCE_S = 3.0  # for the supervisor to free the place of a writer that was killed
LAYOUT = "hydraxis.layout"
MEMBERSHIPS = weakref.WeakSet()  # those that the end of the program has to leave


@functools.lru_cache(maxsize=None)
def library():
    """The package iceoryx2; it is imported only by what needs it."""
    try:
        import iceoryx2
    except ImportError:
        raise MissingPackage("iceoryx2==0.10.0") from None
    iceoryx2.set_log_level(iceoryx2.LogLevel.Fatal)  # errors come as exceptions
    return iceoryx2


def folder_of(prefix):
    """Folder of a group's files."""
    place = os.environ.get("TMPDIR") or ("/dev/shm" if os.path.isdir("/dev/shm") else "/tmp")
    return Path(place) / f"hydraxis.{prefix}"


def config_of(prefix):
    """The library's settings that a group of this name uses."""
    iox2 = library()
    config = iox2.config.default()
    glob = config.global_cfg
    glob.prefix = iox2.FileName.new(prefix + ".")
    glob.root_path = iox2.Path.new(str(folder_of(prefix)))
    # Cleaning up after the dead is the supervisor's work.
    glob.node.cleanup_dead_nodes_on_creation = False
    glob.node.cleanup_dead_nodes_on_destruction = False
    glob.service.cleanup_dead_nodes_on_open = False
    return config


class Membership:
    """A node of the group, and whether the group is still the one that it has joined."""

    def __init__(self, prefix, name):
        iox2 = library()
        self.prefix = prefix
        self._folder = folder_of(prefix)
        try:
            self._opened = os.open(self._folder, os.O_RDONLY)
        except FileNotFoundError:
            raise no_group(prefix) from None
        builder = iox2.NodeBuilder.new().name(iox2.NodeName.new(name)).config(config_of(prefix))
        try:
            self.node = builder.signal_handling_mode(iox2.SignalHandlingMode.Disabled).create(iox2.ServiceType.Ipc)
        except iox2.NodeCreationFailure as error:
            raise NoChannel(f'group "{prefix}" cannot be joined: {error}') from None
        self._ports = []
        MEMBERSHIPS.add(self)

    def is_removed(self):
        """Whether the group has ended and removed its files, or a new group of the same name has replaced them."""
        if self.node is None:
            return True
        try:
            return not os.path.samestat(os.fstat(self._opened), os.stat(self._folder))
        except FileNotFoundError:
            return True

    def keep(self, *things):
        """Keeps parts of the library for as long as the membership lasts."""
        self._ports += things

    def drop(self, *things):
        """Closes parts of the library before the end of the membership."""
        for thing in things:
            if thing in self._ports and not self.is_removed():
                self._ports.remove(thing)
                if hasattr(thing, "delete"):
                    thing.delete()

    def close(self):
        """Leaves the group."""
        if self.node is None:
            return
        things, self._ports = [self.node, *self._ports], []
        if self.is_removed():
            # The library would remove files by names that may already belong to a new group.
            for thing in things:
                ctypes.pythonapi.Py_IncRef(ctypes.py_object(thing))
        else:
            for thing in reversed(things):
                if hasattr(thing, "delete"):
                    thing.delete()
        self.node = None
        os.close(self._opened)


@atexit.register
def _leave():
    for membership in list(MEMBERSHIPS):
        membership.close()


def _own(message):
    return f"{message.type_name()} of layout {message.LAYOUT}"


def _found(prefix, message):
    """Type and layout of a channel as it is there, or None."""
    iox2 = library()
    service = iox2.ServiceName.new(f"hydraxis/{message.CHANNEL}")
    try:
        details = iox2.Service.details(service, config_of(prefix), iox2.MessagingPattern.PublishSubscribe,
                                       iox2.ServiceType.Ipc)
    except iox2.ServiceDetailsError:
        return None
    return _layout(details.attributes()) if details is not None else None


def _layout(attributes):
    iox2 = library()
    return "".join(value.to_string() for value in attributes.key_values(iox2.AttributeKey.new(LAYOUT))) or "none"


def open_channel(membership, message, patience=OPEN_PATIENCE_S):
    """The service of a channel, once a stage has created it. Its layout has been compared."""
    iox2 = library()
    name, until = message.CHANNEL, time.monotonic() + patience
    while True:
        try:
            builder = membership.node.service_builder(iox2.ServiceName.new(f"hydraxis/{name}"))
            service = builder.publish_subscribe(message).open()
            break
        except iox2.PublishSubscribeOpenError as error:
            if "Incompatible" in str(error):
                found = _found(membership.prefix, message) or "unknown"
                raise OtherLayout(name, _own(message), f"another type ({error}) of layout {found}") from None
            if membership.is_removed():
                raise GroupEnded(f'group "{membership.prefix}" has ended') from None
            if time.monotonic() > until:
                raise NoChannel(f'group "{membership.prefix}" has no channel "{name}" ({error}): no stage uses it; '
                                f"look with: hydraxis status --prefix {membership.prefix}") from None
            time.sleep(0.02)
    # Opening has compared the type's name, size and alignment; the fingerprint tells swapped fields apart.
    found = _layout(service.attributes)
    if found != message.LAYOUT:
        raise OtherLayout(name, _own(message), f"layout {found}")
    return service


class Publisher:
    """Writes one kind of message and numbers them. It never waits for a reader."""

    def __init__(self, membership, message, machine=0):
        iox2 = library()
        self._membership = membership
        service = open_channel(membership, message)
        until = time.monotonic() + BURIAL_PATIENCE_S
        while True:
            try:
                self._port = service.publisher_builder().max_loaned_samples(1).create()
                break
            except iox2.PublisherCreateError as error:
                if time.monotonic() > until:
                    raise NoPlace(f'channel "{message.CHANNEL}" of group "{membership.prefix}" has '
                                  f"{message.MAX_PUBLISHERS} writer(s) already, as many as it takes ({error}); end "
                                  f"one first: hydraxis status --prefix {membership.prefix}") from None
                time.sleep(0.05)
        self._service = service
        membership.keep(service, self._port)
        self._machine = machine
        self.session = time.monotonic_ns()
        self.sent = 0

    def send(self, message):
        """Sends a message; number, session, machine and time of sending are filled in."""
        header = message.header
        header.number, header.session, header.sent_ns = self.sent, self.session, time.monotonic_ns()
        if self._machine:
            header.machine = self._machine
        iox2 = library()
        try:
            self._port.loan_uninit().write_payload(message).send()
        except (iox2.LoanError, iox2.SendError) as error:
            raise NoChannel(f'channel "{message.CHANNEL}" of group "{self._membership.prefix}" cannot be written: '
                            f"{error}") from None
        self.sent += 1

    def greet(self):
        """Hands the last message to readers that have come since."""
        self._port.update_connections()

    def close(self):
        """Gives up the place on the channel."""
        self._membership.drop(self._port, self._service)


class Reader:
    """Reads one kind of message, in order, and counts what it loses.

    An iterator: it waits for the next message, ends when the group has ended, and raises Timeout when nothing comes
    within `timeout` seconds.

        received    messages read
        lost        messages that were sent and not read: this program is too slow for them
        restarts    starts of writers, beyond the first one of each place on the channel
        foreign     messages about another machine, which are not given out
        last        the newest message that was read, or None
    """

    def __init__(self, membership, message, timeout=2.0):
        self._membership, self._message = membership, message
        self._service = open_channel(membership, message)
        self._port = self._attach()
        membership.keep(self._service, self._port)
        self.timeout = timeout
        self.received = self.lost = self.restarts = self.foreign = 0
        self.last = None
        self.machine = 0  # number of the group's machine; 0 while it is not known
        self._numbers = {}  # newest number of every session

    def _attach(self):
        iox2, message = library(), self._message
        buffer = min(message.BUFFER, self._service.static_config.subscriber_max_buffer_size)
        try:
            return self._service.subscriber_builder().buffer_size(buffer).create()
        except iox2.SubscriberCreateError as error:
            raise NoChannel(f'channel "{message.CHANNEL}" of group "{self._membership.prefix}" has no place for '
                            f"another reader ({error}); end one of the readers first") from None

    def _reattach(self):
        """Attaches anew where nothing comes: the library gives up a connection that it could not make at once."""
        if self._port.has_samples():
            return
        try:
            before, self._port = self._port, self._attach()
        except NoChannel:
            return  # without a second place on the channel the reader keeps the one it has
        self._membership.keep(self._port)
        self._membership.drop(before)

    @property
    def channel(self):
        """Name of the channel."""
        return self._message.CHANNEL

    def read(self):
        """The next message, or None. Never waits."""
        if self._membership.node is None:
            raise GroupEnded(f'group "{self._membership.prefix}" was closed by this program')
        while (sample := self._receive()) is not None:
            message = self._message.from_buffer_copy(sample.payload().contents)
            sample.delete()  # the channel lends one message at a time
            header = message.header
            if self.machine and header.machine not in (0, self.machine):
                self.foreign += 1
                continue
            # A reader that has attached anew gets the last message again.
            if self._numbers.get(header.session) != header.number:
                self._count(header)
                self.last = message
                return message
        return None

    def _receive(self):
        try:
            return self._port.receive()
        except library().ReceiveError as error:
            raise NoChannel(f'channel "{self.channel}" of group "{self._membership.prefix}" cannot be read: '
                            f"{error}") from None

    def _count(self, header):
        self.received += 1
        number = self._numbers.get(header.session)
        if number is not None:
            self.lost += max(header.number - number - 1, 0)
        else:
            writers = self._message.MAX_PUBLISHERS
            self.restarts += len(self._numbers) >= writers
            if len(self._numbers) >= 4 * writers:
                self._numbers.pop(next(iter(self._numbers)))
        self._numbers[header.session] = header.number

    def all(self):
        """All messages that have come since the last look. Never waits."""
        found = []
        while (message := self.read()) is not None:
            found.append(message)
        return found

    def newest(self):
        """The newest message if one has come since the last look, else None. Never waits."""
        found = self.all()
        return found[-1] if found else None

    def next(self, timeout=None):
        """Waits for the next message; `timeout` in seconds, instead of that of the reader.

        Raises Timeout, and GroupEnded.
        """
        patience = self.timeout if timeout is None else timeout
        begin = looked = time.monotonic()
        is_new = True
        while True:
            message = self.read()
            if message is not None:
                return message
            now = time.monotonic()
            if now - looked > END_S or now - begin >= patience:
                looked = now
                if self._membership.is_removed():
                    raise GroupEnded(f'group "{self._membership.prefix}" has ended')
                if now - begin >= patience:
                    raise Timeout(f'group "{self._membership.prefix}" has sent nothing on channel "{self.channel}" for '
                                  f"{patience} s; look with: hydraxis status --prefix {self._membership.prefix}")
                if is_new and now - begin >= patience / 2:
                    is_new = False
                    self._reattach()
            time.sleep(POLL_S)

    def close(self):
        """Gives up the place on the channel."""
        self._membership.drop(self._port, self._service)

    def __iter__(self):
        return self

    def __next__(self):
        try:
            return self.next()
        except GroupEnded:
            raise StopIteration from None


def names_of(bits, kind):
    """Names of the set bits, as the command prints them: names_of(axis.flags, ControlFlag)."""
    single = [bit for bit in kind.__members__.values() if bit.value & (bit.value - 1) == 0]
    return [bit.name.lower().replace("_", "-") for bit in single if bits & bit.value]


def text_of(array):
    """The text in an array of bytes that is filled up with zeros."""
    return bytes(array).rstrip(b"\0").decode("utf-8", "replace")

