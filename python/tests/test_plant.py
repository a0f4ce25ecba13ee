"""A plant in Python in the place of plant-sim, in both clocks."""

import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from support import EXAMPLES, ROOT, executable, hydraxis, retried
from hydraxis.plant import seconds

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


if __name__ == "__main__":
    unittest.main()
