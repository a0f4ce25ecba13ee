"""Groups for tests: started with names of their own, and gone afterwards."""

import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"

try:
    import hydraxis  # as it is installed
except ImportError:
    sys.path.insert(0, str(ROOT / "python"))
    import hydraxis
from hydraxis.command import executable  # noqa: E402

# A shell that starts the tests in the background lets them, and all that they start, ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)

START_PATIENCE_S = 20.0
END_PATIENCE_S = 30.0
# A busy computer gives a stage no time for many periods.
PATIENT = ["--set", "timing.feedback_timeout=2s"]
AXES = ["boom", "arm", "telescope", "bucket"]
CHANNEL_REFERENCES = [part for axis in AXES for part in ("--set", f"axis.{axis}.reference.kind=channel")]
TRIES = 3

_count = 0


class Running:
    """A group in real time, in a `with` statement."""

    def __init__(self, *arguments, machine=None, prefix=None, patient=True):
        global _count
        _count += 1
        self.prefix = prefix or f"py{os.getpid()}-{_count}"
        self.folder = tempfile.TemporaryDirectory()
        self.log = open(Path(self.folder.name) / "log.txt", "w+")
        command = [executable(), "run", *([str(machine)] if machine else []), "--prefix", self.prefix,
                   "--black-box", self.folder.name, "--duration", "10min", *(PATIENT if patient else []), *arguments]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "HYDRAXIS_RECORDINGS": "off"}
        self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log,
                                        cwd=ROOT, env=environment)

    def __enter__(self):
        until = time.monotonic() + START_PATIENCE_S
        try:
            while not (hydraxis.is_running(self.prefix) and self.is_sending()):
                if self.process.poll() is not None or time.monotonic() > until:
                    raise TimeoutError("no heartbeat")
                time.sleep(0.05)
        except Exception as error:
            self.__exit__()
            raise AssertionError(f"the group does not start: {self.said}") from error
        return self

    def is_sending(self):
        """Whether control-proc has sent a heartbeat."""
        try:
            with hydraxis.Group(self.prefix, "test") as group:
                return bool(group.machine.axes)
        except hydraxis.HydraxisError:
            return False

    def group(self):
        return hydraxis.Group(self.prefix, "test")

    def end(self):
        """Ends the run in order."""
        if self.process.poll() is None:
            self.process.terminate()
        try:
            self.process.wait(END_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise

    def __exit__(self, kind=None, *_):
        code = self.process.poll()
        try:
            self.end()
        finally:
            self.log.seek(0)
            self.said = self.log.read()
            self.log.close()
            if kind is not None:
                print(f"the group ({code}) said:\n{self.said}", file=sys.stderr)
            self.folder.cleanup()
        left = list(Path("/dev/shm").glob(f"{self.prefix}.*"))
        assert not left, f"left behind: {left}"


def command(*arguments):
    """Runs the command to its end."""
    return subprocess.run([executable(), *arguments], capture_output=True, text=True, cwd=ROOT)


def retried(test):
    """Runs a test of real time up to TRIES times: a busy computer may give a stage no time for many periods."""
    import functools

    @functools.wraps(test)
    def again(self):
        for last in [False] * (TRIES - 1) + [True]:
            try:
                return test(self)
            except (AssertionError, hydraxis.Latched, hydraxis.Disarmed) as error:
                if last:
                    raise
                print(f"{test.__name__}: again, after: {error}", file=sys.stderr)
                self.tearDown()
                self.setUp()
    return again


def needs(*packages):
    """Skips a test where packages are missing that only some functions of hydraxis need."""
    import importlib.util
    missing = [package for package in packages if importlib.util.find_spec(package) is None]
    return unittest.skipIf(missing, f"not installed: {', '.join(missing)}")
