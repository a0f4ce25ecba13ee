"""Simulation, identification and commissioning as data frames, and the recordings of a group."""

import os
import tempfile
import time
import unittest
from pathlib import Path
from unittest import mock

from support import EXAMPLES, ROOT, Running, command, hydraxis, needs

MACHINE = EXAMPLES / "four-axes.toml"
RECORDING = ROOT / "tests" / "data" / "servo_warmup.csv"


@needs("pandas")
class Commands(unittest.TestCase):
    def test_a_simulation_gives_figures_and_the_motion(self):
        run = hydraxis.simulate(MACHINE, duration=3, seed=7, settings={"axis.boom.control.kp": 3.0}, axes="boom")
        self.assertEqual(run.report["ticks"], 300)
        self.assertEqual(run.axes.index[0], "boom")
        self.assertEqual(set(run.axes.index), {"boom", "arm", "telescope", "bucket"})
        self.assertGreater(run.axes.loc["boom", "tracking.rmse"], 0)
        self.assertEqual((len(run.trajectory), run.trajectory.index.name), (300, "t"))
        self.assertIn("boom.position", run.trajectory)
        self.assertNotIn("arm.position", run.trajectory)

    def test_a_plant_moves_under_commands_of_a_data_frame(self):
        import pandas
        commands = pandas.DataFrame({"boom": [0.7, 0.7, 0.0]}, index=pandas.Index([0.0, 1.0, 2.0], name="t"))
        run = hydraxis.simulate(MACHINE, open_loop=commands, scenario="nominal", axes=["boom"])
        self.assertIsNone(run.report)
        self.assertEqual(list(run.trajectory.index), [0.0, 1.0, 2.0])
        self.assertGreater(run.trajectory["boom.position"].iloc[-1], run.trajectory["boom.position"].iloc[0])

    def test_errors_have_the_text_of_the_command(self):
        with self.assertRaisesRegex(hydraxis.CommandFailed, "axis.boom.control.kq.*unknown key") as failed:
            hydraxis.simulate(MACHINE, duration=1, settings={"axis.boom.control.kq": 3.0})
        self.assertEqual((failed.exception.code, failed.exception.result), (2, None))
        with mock.patch.dict(os.environ, {"HYDRAXIS": "", "PATH": ""}):
            with self.assertRaisesRegex(hydraxis.HydraxisError, "cargo install"):
                hydraxis.simulate(MACHINE)

    def test_models_are_identified_from_a_file_and_from_a_data_frame(self):
        found = hydraxis.identify(RECORDING, train=0.4)
        errors = found.errors
        self.assertLess(errors.loc[("adaptive", "h_step"), "sigma"], errors.loc[("classical", "h_step"), "sigma"])
        data = hydraxis.read_csv(RECORDING).rename(columns={"u": "command", "y": "position"})
        again = hydraxis.identify(data, input="command", output="position", train=0.4)
        self.assertEqual(again.report["classical"], found.report["classical"])
        with self.assertRaisesRegex(hydraxis.CommandFailed, "column"):
            hydraxis.identify(data, train=0.4)

    def test_commissioning_writes_a_model_that_a_simulation_takes(self):
        with tempfile.TemporaryDirectory() as folder:
            model = Path(folder) / "model.toml"
            found = hydraxis.commission(MACHINE, out=model, axes="boom", duration=60)
            self.assertEqual((list(found.axes.index), found.model), (["boom"], model))
            self.assertTrue(model.exists())
            self.assertGreater(found.axes.loc["boom", "fit_percent"], 90)
            self.assertGreater(found.loops.loc[("boom", "fallback"), "gain_margin"], 1)
            with self.assertRaises(hydraxis.CommandFailed):
                hydraxis.commission(MACHINE, out=model, axes="boom")
            run = hydraxis.simulate(MACHINE, duration=2, model=model)
            self.assertEqual(run.report["ticks"], 200)


@needs("pandas")
class Recordings(unittest.TestCase):
    def test_messages_become_a_data_frame(self):
        with Running("--off") as running, running.group() as group:
            samples, snapshots = group.samples(), group.snapshots()
            frame = hydraxis.frame([samples.next() for _ in range(10)], group.axes)
            self.assertEqual(len(frame), 10)
            self.assertEqual(frame["sequence"].diff().dropna().min(), 1)
            self.assertTrue(frame["boom.position"].between(0, 3).all())
            self.assertNotIn("boom.reserved", frame)
            self.assertIn("bucket.adaptive.a.0", hydraxis.frame([snapshots.next()], group.axes))

    @needs("mcap", "mcap_ros2")
    def test_a_black_box_is_read(self):
        with Running("--off") as running:
            time.sleep(2.0)
            command("disarm", "--prefix", running.prefix, "--emergency")
            until = time.monotonic() + 20.0
            while not (files := list(Path(running.folder.name).glob("*.mcap"))) and time.monotonic() < until:
                time.sleep(0.1)
            time.sleep(0.5)
            box = hydraxis.read_black_box(files[0])
        self.assertIn("emergency-stop", box.cause)
        self.assertEqual(box.axes, ("boom", "arm", "telescope", "bucket"))
        samples = box.channels["encoder-sample"]
        self.assertTrue(samples["boom.position"].between(0, 3).all())
        self.assertTrue(samples.index.is_monotonic_increasing)
        self.assertLess(samples.index[0], 0)
        self.assertGreater(samples.index[-1], 0)
        after = box.channels["valve-command"]
        self.assertTrue((after[after.index > 0.2]["boom.command"] == 0).all())
        with self.assertRaises(FileNotFoundError):
            hydraxis.read_black_box("nowhere.mcap")


if __name__ == "__main__":
    unittest.main()
