"""Operation of the axes of a running group: arm, hold, move by hand, switch off.

A program that operates answers every sample with a request; the controller computes from it how old the request is. So
there is no thread that goes on when the program hangs: whoever waits, waits in a method of the operator.

Trap: an edge arms, not a mode. The number `enable` of an axis changes between two messages of one session. A fault
latches: then the axis is neutral until it is reset, which is an edge as well.
"""

import time

from .channels import names_of
from .errors import Disarmed, GroupEnded, HydraxisError, Latched, NoAnswer, Replaced, Taken
from .messages import AxisMode, ControlFlag, Request

ANSWER_PATIENCE_S = 5.0  # for what the controller is asked, settling included
FLAGS_OF_MODELS = (ControlFlag.NO_MODEL | ControlFlag.MODEL_STALE | ControlFlag.MODEL_REFUSED
                   | ControlFlag.MODEL_WORSE | ControlFlag.MODEL_TRIAL)


class Operator:
    """Operates axes. Use it in a `with` statement: at its end, the axes that it has armed are off.

        with group.request() as operator:
            operator.hold("boom", 0.7)              # arms, goes to 0.7 m; returns when the axis is on its way
            for sample in operator.run(3.0):        # three seconds, a request for every sample
                print(sample.axes[0].position)

    With `hold_to_run`, which is the default, every mode ends 0.1 s after the last request: axes move only as long as
    this program calls `step`, `run`, or a method that changes a mode. `take_over` takes the place of a program that
    operates now.
    """

    def __init__(self, group, take_over=False, hold_to_run=True):
        self.machine = group.machine
        self._group = group
        self._samples, self._commands = group.samples(), group.commands()
        self._publisher = group._publisher(Request)
        self._request = Request()
        self._request.session = self._publisher.session
        self._request.takes_over = int(take_over)
        self._request.header.axis_count = len(self.machine.axes)
        for axis in self._request.axes:
            axis.hold_to_run = int(hold_to_run)
        self._mine = set()  # axes that this program keeps in a mode
        self._is_current = False
        try:
            self._join()
        except BaseException:
            self._close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        try:
            self.end()
        except HydraxisError:
            if kind is None:
                raise

    def _join(self):
        """Waits until the controller takes the requests of this program, which ask for nothing yet."""
        session, first = self._request.session, []

        def is_taken(command):
            if command.operator != session:
                return False
            first.append(command.axes[0].taken_requests)
            return first[-1] > first[0]

        try:
            self._until(is_taken, "an answer of the controller", 1.0)
        except NoAnswer:
            last = self._commands.last
            if last is not None and last.operator not in (0, session):
                raise Taken(f'another program operates group "{self._group.prefix}"; end it, or take its place with '
                            "request(take_over=True)") from None
            raise
        self._is_current = True

    # ------------------------------------------------------------------------------------------------ what to do

    def hold(self, axes, target=None):
        """Holds axes at a set point, m, or where they come to a stand. Arms them."""
        self._change(axes, AxisMode.HOLD, target=target)

    def track(self, axes=None):
        """Lets axes follow their references. Arms them."""
        self._change(axes, AxisMode.TRACK)

    def manual(self, axes, command=0.0):
        """Gives axes a valve command in [-1, 1], positive extends, within all limits. Arms them."""
        self._change(axes, AxisMode.MANUAL, command=command)

    def command(self, axes, command):
        """Changes the valve command of axes in manual, with the next request."""
        for axis in self.machine.choose(axes):
            if self._of(axis).mode != AxisMode.MANUAL:
                raise HydraxisError(f"axis.{axis}: found a valve command; allowed: after manual()")
            self._of(axis).command = in_range(command)

    def off(self, axes=None):
        """Disarms axes. A latched axis stays latched: only reset() acknowledges a fault."""
        chosen = self.machine.choose(axes)

        def is_off(command):
            for axis in chosen:
                is_latched = self._flags(axis, command) & ControlFlag.LATCHED
                self._of(axis).mode = AxisMode.UNCHANGED if is_latched else AxisMode.OFF
            return all(self._flags(axis, command) & (ControlFlag.LATCHED | ControlFlag.DISARMED) for axis in chosen)

        self._mine -= set(chosen)
        self._look()
        is_off(self._commands.last)
        self._until(is_off, "off", ANSWER_PATIENCE_S)
        self._forget(chosen)

    def reset(self, axes=None):
        """Acknowledges the faults that have latched axes: they are disarmed and no longer latched."""
        chosen = self.machine.choose(axes)
        self._mine -= set(chosen)
        self._forget(chosen)
        self._be_heard()  # off releases only after a request for something else
        for axis in chosen:
            self._of(axis).mode = AxisMode.OFF
        try:
            is_off = lambda command: all(self._flags(axis, command) & ControlFlag.DISARMED for axis in chosen)
            self._until(is_off, "reset", ANSWER_PATIENCE_S)
        finally:
            self._forget(chosen)

    def leave(self):
        """Lets axes in hold and track go on after the end of this program; those in manual are switched off."""
        self.off([axis for axis in self._mine if self._of(axis).mode == AxisMode.MANUAL])
        for axis in self._request.axes:
            axis.hold_to_run = 0
        self._be_heard()
        self._be_heard()
        self._mine.clear()

    def end(self):
        """Switches off the axes that this program has armed. Latched ones stay latched."""
        mine, self._mine = self._mine, set()
        try:
            if mine and not self._group.has_ended:
                self.off(sorted(mine))
        finally:
            self._close()

    def _close(self):
        for end in (self._samples, self._commands, self._publisher):
            end.close()

    # ------------------------------------------------------------------------------------------------ every sample

    def step(self, timeout=2.0):
        """Waits for the next sample, answers it with the request, and returns it.

        Raises Latched or Disarmed when an axis that this program operates is no longer in its mode, Replaced when
        another program has taken over, Timeout and GroupEnded.
        """
        sample = self._samples.next(timeout)
        # Only the newest sample is worth a request.
        sample = self._samples.newest() or sample
        self._look()
        header = self._request.header
        header.sequence, header.acquired_ns = sample.header.sequence, sample.header.acquired_ns
        self._publisher.send(self._request)
        return sample

    def run(self, seconds=None):
        """Samples for some seconds, or until the group ends; each is answered with the request."""
        until = None if seconds is None else time.monotonic() + seconds
        while until is None or time.monotonic() < until:
            try:
                yield self.step()
            except GroupEnded:
                return

    def state(self, axis):
        """Mode and flags of an axis in words."""
        last = self._commands.last
        if last is None:
            return f"axis.{axis}: no command yet"
        entry = last.axes[self.machine.index(axis)]
        names = names_of(entry.flags & ~FLAGS_OF_MODELS, ControlFlag)
        modes = {mode.value: mode.name.lower() for mode in AxisMode}
        return f"axis.{axis}: {modes.get(entry.operation, 'unknown')}" + (f" ({', '.join(names)})" if names else "")

    def _of(self, axis):
        return self._request.axes[self.machine.index(axis)]

    def _flags(self, axis, command):
        return command.axes[self.machine.index(axis)].flags

    def _forget(self, axes):
        for axis in axes:
            self._of(axis).mode = AxisMode.UNCHANGED
            self._of(axis).has_target, self._of(axis).command = 0, 0.0

    def _be_heard(self):
        """Waits until the controller takes a request as it is now: an edge counts from the message before only while
        that one is younger than 0.1 s, and this program may have paused."""
        taken = self._commands.last.axes[0].taken_requests
        self._until(lambda command: command.axes[0].taken_requests > taken, "an answer of the controller",
                    ANSWER_PATIENCE_S)

    def _change(self, axes, mode, target=None, command=0.0):
        chosen = self.machine.choose(axes)
        command = in_range(command)
        self._look()
        self._be_heard()
        last = self._commands.last
        for axis in chosen:
            if self._flags(axis, last) & ControlFlag.LATCHED:
                raise Latched(f'{self.state(axis)}: look at why, then call reset("{axis}")')
        refused = [last.axes[self.machine.index(axis)].refused_requests for axis in chosen]
        for axis in chosen:
            entry = self._of(axis)
            entry.mode, entry.enable = mode, (entry.enable + 1) % 2**32
            entry.command = command
            entry.has_target, entry.target = int(target is not None), target or 0.0

        def is_in(newest):
            for i, axis in enumerate(chosen):
                entry = newest.axes[self.machine.index(axis)]
                if entry.flags & ControlFlag.LATCHED:
                    self._forget(chosen)
                    raise Latched(f"{self.state(axis)}: not {mode.name.lower()}, a fault has latched it")
                if entry.flags & ControlFlag.REQUEST and entry.refused_requests > refused[i] + 2:
                    self._forget(chosen)
                    raise HydraxisError(f"{self.state(axis)}: the controller refuses the request; allowed: a set point "
                                        "within the soft limits of the axis")
            entries = [newest.axes[self.machine.index(axis)] for axis in chosen]
            return all(e.operation == mode and not e.flags & ControlFlag.SETTLING for e in entries)

        self._until(is_in, mode.name.lower(), ANSWER_PATIENCE_S)
        self._mine |= set(chosen)

    def _until(self, is_done, wanted, patience):
        """Answers samples until a command of the controller, made after the first answer, is as it should be."""
        until, has_asked = time.monotonic() + patience, False
        while True:
            sample = self._samples.next(max(patience, 2.0))
            sample = self._samples.newest() or sample
            for command in self._look():
                if is_done(command) and has_asked:
                    return
            header = self._request.header
            header.sequence, header.acquired_ns = sample.header.sequence, sample.header.acquired_ns
            self._publisher.send(self._request)
            has_asked = True
            if time.monotonic() > until:
                raise NoAnswer(f"{wanted}: not within {patience} s; "
                               + "; ".join(self.state(axis) for axis in self.machine.axes))

    def _look(self):
        """The commands since the last look; raises when one shows that this program has lost an axis."""
        commands = self._commands.all()
        for command in commands:
            # A controller that has been started again does not know of any program yet.
            if self._is_current and command.operator not in (0, self._request.session):
                self._mine.clear()
                raise Replaced(f'another program has taken over the operation of group "{self._group.prefix}"')
        for axis in sorted(self._mine) if commands else ():
            flags = self._flags(axis, commands[-1])
            if flags & (ControlFlag.LATCHED | ControlFlag.DISARMED):
                self._mine.discard(axis)
                self._forget([axis])
                if flags & ControlFlag.LATCHED:
                    raise Latched(f'{self.state(axis)}: look at why, then call reset("{axis}")')
                raise Disarmed(f"{self.state(axis)}: somebody has stopped it, or requests came too late")
        return commands


def in_range(command):
    """A valve command, or ValueError."""
    if not -1.0 <= command <= 1.0:
        raise ValueError(f"command: found {command}; allowed: -1 to 1, positive extends")
    return float(command)


