"""A plant in Python in the place of plant-sim, in both clocks."""

import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

from support import AXES, EXAMPLES, ROOT, Running, executable, hydraxis, retried
from hydraxis.plant import counts, seconds

PLANT = f'stage.plant-sim.command=["{sys.executable}","examples/plant.py"]'


def run(*arguments):
    """A run of the example's plant; its report."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        done = subprocess.run(
            [executable(), "run", "examples/four-axes.toml", "--set", PLANT, "--prefix", f"py{os.getpid()}-plant",
             "--json", report, "--black-box", folder, *arguments],
            cwd=ROOT, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})
        assert done.returncode == 0, done.stderr
        return json.loads(report.read_text())


# A plant that tells what it gives to its valves.
SECOND = """
import hydraxis

class Rig(hydraxis.Plant):
    def __init__(self, machine):
        pass

    def advance(self, commands, seconds):
        print("valves", commands, flush=True)

    def read(self):
        return [0, 0, 0, 0]

Rig.main()
"""


class Plants(unittest.TestCase):
    def test_axes_of_the_plant_follow_in_lock_step_and_runs_are_equal(self):
        reports = [run("--lockstep", "--duration", "6s") for _ in range(2)]
        for name, axis in reports[0]["axes"].items():
            self.assertLess(axis["tracking"]["rmse"], 0.05, name)
            self.assertEqual(axis["tracking"], reports[1]["axes"][name]["tracking"])

    @retried
    def test_axes_of_the_plant_move_in_real_time(self):
        report = run("--duration", "5s", "--set", "timing.feedback_timeout=2s")
        self.assertGreater(report["ticks"], 100)

    def test_a_machine_file_is_read_with_its_settings(self):
        settings = ["axis.boom.stroke=1.5", "axis.boom.reference.kind=hold", "timing.period=5ms"]
        machine = hydraxis.load_machine(EXAMPLES / "four-axes.toml", settings)
        boom = machine["axis"]["boom"]
        self.assertEqual((boom["stroke"], boom["reference"]["kind"]), (1.5, "hold"))
        self.assertEqual(seconds(machine["timing"]["period"]), 0.005)
        with self.assertRaisesRegex(ValueError, 'found "soon"'):
            seconds("soon")

    def test_counts_are_finite_numbers_of_64_bits(self):
        self.assertEqual([counts(value, 0) for value in (7.4, -2 ** 62, True)], [7, -2 ** 62, 1])
        for wrong in (None, "7", math.nan, math.inf, 2 ** 63, -1e19):
            with self.assertRaisesRegex(ValueError, "found .* for axis 0"):
                counts(wrong, 0)


class ByHand(unittest.TestCase):
    """A program that is started by hand, before its group."""

    def setUp(self):
        # The group reads the machine file with an external source; so does the program.
        self.settings = ["--set", "source.kind=external"]
        self.prefix = f"py{os.getpid()}-by-hand"
        self.program = self.start()
        self.told = self.program.stderr.readline()

    def start(self):
        return subprocess.Popen(
            [sys.executable, "examples/plant.py", "examples/four-axes.toml", "--prefix", self.prefix, *self.settings],
            cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})

    def tearDown(self):
        self.program.kill()
        self.program.communicate()

    def test_it_says_what_it_waits_for_and_ends_at_ctrl_c(self):
        self.assertEqual(self.told, f'waits for group "{self.prefix}"; start it in another terminal with: hydraxis run '
                         f"examples/four-axes.toml --set source.kind=external --prefix {self.prefix}\n")
        time.sleep(0.5)
        self.program.send_signal(signal.SIGINT)
        said, told = self.program.communicate(timeout=30)
        self.assertEqual((self.program.returncode, said, told), (0, "", ""))
        self.assertEqual(list(Path("/dev/shm").glob(f"{self.prefix}.*")), [])

    def test_it_works_when_its_group_comes_and_ends_with_it(self):
        self.assertIn("waits for group", self.told)
        with Running("--off", *self.settings, machine=EXAMPLES / "four-axes.toml", prefix=self.prefix) as running:
            with running.group() as group:
                samples = group.samples(timeout=20.0)
                for sample in samples:
                    if not any(axis.faults for axis in sample.axes[:len(AXES)]):
                        break
                self.assertGreater(group.readings().next().header.number, 0)
                # Killed and started again at once: the place of the killed writer is free only after a while.
                self.program.kill()
                self.program.communicate()
                self.program = self.start()
                samples.next()
                session = group.readings().next(20.0).header.session
                self.assertEqual(group.readings().next(20.0).header.session, session)
                # A second one by mistake, at the same valves: it sends nothing to them, not even neutral.
                second = subprocess.run(
                    [sys.executable, "-c", SECOND, EXAMPLES / "four-axes.toml", "--prefix", self.prefix,
                     *self.settings],
                    cwd=ROOT, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60,
                    env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})
                self.assertEqual((second.returncode, second.stdout), (1, ""))
                self.assertIn("NoPlace: ", second.stderr)
        _, told = self.program.communicate(timeout=30)
        self.assertEqual(self.program.returncode, 1)
        self.assertEqual(told, f'GroupEnded: group "{self.prefix}" has ended; start this program again after the next '
                         "`hydraxis run`\n")


if __name__ == "__main__":
    unittest.main()
