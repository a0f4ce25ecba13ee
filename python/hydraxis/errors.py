"""What can go wrong. Every text says what was found and what to do."""


class HydraxisError(Exception):
    """The common type of all errors of this package."""


class NoGroup(HydraxisError):
    """No group runs, several do, or the name is none."""


def no_group(prefix):
    """The error where no group of this name runs."""
    return NoGroup(f'no group "{prefix}" runs; start one with: hydraxis run MACHINE.toml --prefix {prefix}')


class NoChannel(HydraxisError):
    """The group has no such channel, or the channel has no place left."""


class NoPlace(NoChannel):
    """Other programs write the channel already, as many as it takes."""


class OtherLayout(HydraxisError):
    """The group was built for other messages than this package."""

    def __init__(self, channel, own, found):
        super().__init__(
            f'channel "{channel}" carries {found}, this package reads {own}: group and package are of different '
            "versions; install the package of the folder python/ of the Hydraxis that runs the group: "
            "pip install ./python")
        self.channel, self.own, self.found = channel, own, found


class GroupEnded(HydraxisError):
    """The group has ended."""


class Timeout(HydraxisError, TimeoutError):
    """Nothing came in time, although the group still has its files."""


class Taken(HydraxisError):
    """Another program operates the group."""


class Replaced(HydraxisError):
    """Another program has taken over the operation of the group."""


class NoAnswer(HydraxisError):
    """The controller did not do what it was asked in time."""


class Latched(HydraxisError):
    """A fault has latched an axis: it is neutral until it is reset and armed again."""


class Disarmed(HydraxisError):
    """An axis that this program operates was disarmed: somebody has stopped it, or requests came too late."""


class CommandFailed(HydraxisError):
    """The command `hydraxis` failed; the text is its own message. `result` is what it gave nevertheless, or None."""

    def __init__(self, text, code, result=None):
        super().__init__(text)
        self.code, self.result = code, result


class MissingPackage(HydraxisError, ImportError):
    """A package is missing that only some functions need."""

    def __init__(self, package):
        super().__init__(f"the package {package} is missing; install it with: pip install {package}")
