"""Reading a running group: names, order, losses, its end, and messages of another layout."""

import ctypes
import os
import subprocess
import sys
import time
import unittest

from support import AXES, EXAMPLES, TRIES, Running, hydraxis
from hydraxis import messages
from hydraxis.channels import Membership, Publisher, Reader


class Swapped(ctypes.Structure):
    """A reference with two fields of one size in each other's places: same type name, same size."""
    CHANNEL, LAYOUT, MAX_PUBLISHERS, BUFFER = "reference", "0123456789abcdef", 1, 4
    _fields_ = [("header", messages.Header), ("positions", ctypes.c_double * 256), ("reserved", ctypes.c_uint32),
                ("preview", ctypes.c_uint32)]
    type_name = staticmethod(messages.Reference.type_name)


class Older(ctypes.Structure):
    """A request of an older version."""
    CHANNEL, LAYOUT, MAX_PUBLISHERS, BUFFER = "request", "0123456789abcdef", 4, 64
    _fields_ = messages.Request._fields_

    @staticmethod
    def type_name():
        return "hydraxis.Request/2"


class Group(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.running = Running("--off").__enter__()

    @classmethod
    def tearDownClass(cls):
        cls.running.__exit__()

    def test_a_group_tells_its_machine(self):
        with self.running.group() as group:
            self.assertEqual(list(group.axes), AXES)
            self.assertEqual(group.machine.number, group.samples().next().header.machine)
            with self.assertRaisesRegex(KeyError, "allowed: one of boom, arm"):
                group.machine.index("boon")
            self.assertIn(self.running.prefix, hydraxis.running_groups())

    def test_every_channel_that_stages_write_is_read_in_order(self):
        with self.running.group() as group:
            for reader in (group.readings(), group.samples(), group.commands(), group.snapshots(), group.state()):
                found = [reader.next() for _ in range(5)]
                numbers = [message.header.number for message in found]
                self.assertEqual(numbers, sorted(set(numbers)), reader.channel)
                self.assertEqual((reader.received, reader.restarts, reader.foreign), (5, 0, 0))
            stages = {hydraxis.STAGES[beat.stage] for beat, _ in zip(group.health(), range(12))}
            self.assertEqual(stages, set(hydraxis.STAGES))

    def test_a_reader_that_is_slow_counts_what_it_loses(self):
        with self.running.group() as group:
            reader = group.readings()
            first = reader.next()
            time.sleep(1.0)  # the channel keeps 256 readings, plant-sim makes 1000 a second
            found = reader.all()
            self.assertGreater(reader.lost, 0)
            self.assertEqual(found[-1].header.number - first.header.number, len(found) + reader.lost)

    def test_nothing_in_time_is_an_error_that_names_the_channel(self):
        with self.running.group() as group:
            with self.assertRaisesRegex(hydraxis.Timeout, 'nothing on channel "request" for 0.2 s'):
                group.requests().next(timeout=0.2)
            self.assertIsNone(group.references().read())

    def test_messages_of_another_layout_are_refused_with_both_fingerprints(self):
        with self.running.group() as group:
            for end in (Reader, Publisher):
                with self.assertRaises(hydraxis.OtherLayout) as refused:
                    end(group._membership, Swapped)
                text = str(refused.exception)
                self.assertIn("layout 0123456789abcdef", text)
                self.assertIn(f"layout {messages.Reference.LAYOUT}", text)
                self.assertIn("pip install ./python", text)
            with self.assertRaises(hydraxis.OtherLayout) as refused:
                Reader(group._membership, Older)
            for part in ("hydraxis.Request/2", "0123456789abcdef", messages.Request.LAYOUT):
                self.assertIn(part, str(refused.exception))

    def test_a_closed_group_gives_nothing(self):
        group = self.running.group()
        samples = group.samples()
        samples.next()
        group.close()
        group.close()
        self.assertEqual(list(samples), [])
        with self.assertRaises(hydraxis.GroupEnded):
            samples.read()


class Absent(unittest.TestCase):
    def test_a_group_that_does_not_run_is_told_with_what_to_type(self):
        with self.assertRaisesRegex(hydraxis.NoGroup, "hydraxis run MACHINE.toml --prefix py-nobody"):
            hydraxis.Group("py-nobody")
        with self.assertRaisesRegex(hydraxis.NoGroup, "allowed: 1 to 32 letters"):
            hydraxis.Group("a/b")

    def test_a_group_that_ends_before_it_is_joined_is_told_with_what_to_type(self):
        expected = 'no group "py-nobody" runs; .*hydraxis run MACHINE.toml --prefix py-nobody'
        with self.assertRaisesRegex(hydraxis.NoGroup, expected):
            Membership("py-nobody", "test")

    def test_programs_tell_it_without_a_traceback(self):
        for words in (["watch.py"], ["logger.py", os.devnull], ["reference.py"]):
            done = subprocess.run([sys.executable, EXAMPLES / words[0], *words[1:], "--prefix", "py-nobody"],
                                  capture_output=True, text=True, env=environment(), timeout=60)
            self.assertEqual(done.returncode, 1)
            self.assertEqual(done.stderr, 'error: no group "py-nobody" runs; start one with: hydraxis run '
                                          "MACHINE.toml --prefix py-nobody\n")


class End(unittest.TestCase):
    def test_readers_end_with_their_group_and_a_program_may_stay(self):
        with Running("--off") as running:
            group = running.group()
            samples = group.samples()
            samples.next()
            running.end()
            self.assertGreaterEqual(len(list(samples)), 0)
            self.assertTrue(group.has_ended)
            with self.assertRaises(hydraxis.GroupEnded):
                group.commands()
        group.close()

    def test_the_end_of_a_program_leaves_the_next_group_of_the_name_alone(self):
        text = ("import hydraxis, sys\ngroup = hydraxis.Group(sys.argv[1])\nsamples = group.samples()\n"
                "for sample in samples: pass\nprint('ended', flush=True)\nsys.stdin.read()\n")
        with Running("--off") as running:
            reading = subprocess.Popen([sys.executable, "-c", text, running.prefix], stdin=subprocess.PIPE,
                                       stdout=subprocess.PIPE, text=True, env=environment())
            with running.group() as group:
                readers = group.samples()
                for _ in range(200):
                    readers.next()
            running.end()
            self.assertEqual(reading.stdout.readline(), "ended\n")
        with Running("--off", prefix=running.prefix) as again, again.group() as group:
            samples = group.samples()
            samples.next()
            reading.communicate("")
            self.assertEqual(reading.returncode, 0)
            for _ in range(50):
                samples.next()
            with again.group() as other:
                other.commands().next()


class Rate(unittest.TestCase):
    def test_a_kilohertz_is_read_and_references_are_written_without_loss(self):
        import rate
        for _ in range(TRIES):
            found = rate.run(10.0)
            self.assertGreater(found["samples"], 1000, found)
            if found["samples_lost"] == found["references_lost"] == found["commands_lost"] == 0:
                break
        self.assertEqual((found["samples_lost"], found["commands_lost"], found["references_lost"]), (0, 0, 0), found)


def environment():
    return {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}


if __name__ == "__main__":
    unittest.main()
