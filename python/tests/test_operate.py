"""Operating a running group: arming, set points, commands by hand, one operator at a time, stops and faults."""

import time
import unittest

from support import CHANNEL_REFERENCES, EXAMPLES, Running, command, hydraxis, retried
from hydraxis import AxisMode, ControlFlag


def last(group):
    return group.commands().next()


class Operate(unittest.TestCase):
    def setUp(self):
        self.running = Running("--off", machine=EXAMPLES / "four-axes.toml").__enter__()
        self.group = self.running.group()

    def tearDown(self):
        self.group.close()
        self.running.__exit__()

    @retried
    def test_an_axis_goes_to_its_set_point_and_is_off_at_the_end(self):
        begin = self.group.samples().next().axes[0].position
        with self.group.request() as operator:
            operator.hold("boom", begin + 0.02)
            self.assertEqual(operator.state("boom"), "axis.boom: hold")
            for sample in operator.run(4.0):
                pass
            self.assertAlmostEqual(sample.axes[0].position, begin + 0.02, delta=0.008)
            flags = last(self.group).axes
            self.assertTrue(flags[1].flags & ControlFlag.DISARMED)
        self.assertTrue(last(self.group).axes[0].flags & ControlFlag.DISARMED)

    @retried
    def test_commands_by_hand_move_an_axis_both_ways(self):
        with self.group.request() as operator:
            operator.manual("boom")
            first = operator.step().axes[0].position
            operator.command("boom", 0.4)
            for sample in operator.run(1.0):
                pass
            up = sample.axes[0].position
            self.assertGreater(up, first + 0.01)
            operator.command("boom", -0.4)
            for sample in operator.run(1.5):
                pass
            self.assertLess(sample.axes[0].position, up)
            with self.assertRaisesRegex(ValueError, "found 1.5; allowed: -1 to 1"):
                operator.command("boom", 1.5)
            with self.assertRaisesRegex(hydraxis.HydraxisError, "allowed: after manual"):
                operator.command("arm", 0.1)

    @retried
    def test_a_program_that_hangs_moves_nothing(self):
        with self.group.request() as operator:
            operator.hold("boom")
            time.sleep(1.0)
            with self.assertRaises(hydraxis.Disarmed):
                for _ in operator.run(1.0):
                    pass
            command = last(self.group).axes[0]
            self.assertTrue(command.flags & ControlFlag.REQUEST_STOPPED, hydraxis.names_of(command.flags, ControlFlag))

    @retried
    def test_axes_that_are_left_go_on_without_the_program(self):
        with self.group.request(hold_to_run=False) as operator:
            operator.hold("boom")
            time.sleep(0.5)  # an edge counts also after a pause
            operator.manual("arm")
            operator.leave()
        time.sleep(0.5)
        axes = last(self.group).axes
        self.assertEqual((axes[0].operation, axes[1].operation), (AxisMode.HOLD, AxisMode.OFF))

    @retried
    def test_a_set_point_outside_the_soft_limits_is_refused(self):
        with self.group.request() as operator:
            with self.assertRaisesRegex(hydraxis.HydraxisError, "refuses the request; allowed: a set point within"):
                operator.hold("boom", 50.0)
            self.assertTrue(last(self.group).axes[0].flags & ControlFlag.DISARMED)

    @retried
    def test_one_program_operates_at_a_time(self):
        with self.group.request() as first:
            first.hold("boom")
            # The other one is another program: this one goes on meanwhile.
            text = ("import sys, hydraxis\n"
                    "with hydraxis.Group(sys.argv[1]) as group:\n"
                    "    try:\n"
                    "        with group.request(take_over=sys.argv[2] == 'over') as operator:\n"
                    "            print('operates', flush=True)\n"
                    "            for _ in operator.run(1.0): pass\n"
                    "    except hydraxis.Taken as error: print('taken', error, flush=True)\n")
            self.assertIn("taken another program operates", self.beside(first, text, "wait"))
            self.assertEqual(first.state("boom"), "axis.boom: hold")
            with self.assertRaises(hydraxis.Replaced):
                self.beside(first, text, "over")

    def beside(self, operator, text, *arguments):
        """What another program prints while this one operates."""
        import os, subprocess, sys
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        other = subprocess.Popen([sys.executable, "-c", text, self.running.prefix, *arguments],
                                 stdout=subprocess.PIPE, text=True, env=environment)
        try:
            for _ in operator.run(20.0):
                if other.poll() is not None:
                    break
        finally:
            printed, _ = other.communicate(timeout=30)
        return printed

    @retried
    def test_a_latched_axis_is_told_and_released_only_by_a_reset(self):
        with self.group.request() as operator:
            operator.hold("boom")
            stopped = command("disarm", "--prefix", self.running.prefix, "--emergency")
            self.assertEqual(stopped.returncode, 0, stopped.stderr)
            with self.assertRaisesRegex(hydraxis.Latched, r'emergency-stop\): look at why, then call reset\("boom"\)'):
                for _ in operator.run(2.0):
                    pass
            with self.assertRaises(hydraxis.Latched):
                operator.hold("boom")
            operator.off()
            self.assertTrue(last(self.group).axes[0].flags & ControlFlag.EMERGENCY_STOP)
            operator.reset()
            self.assertFalse(last(self.group).axes[0].flags & ControlFlag.LATCHED)
            operator.hold("boom")
            self.assertEqual(operator.state("boom"), "axis.boom: hold")

    @retried
    def test_a_stop_beside_is_told(self):
        with self.group.request() as operator:
            operator.hold("boom")
            self.assertEqual(command("disarm", "--prefix", self.running.prefix).returncode, 0)
            with self.assertRaises(hydraxis.Disarmed):
                for _ in operator.run(2.0):
                    pass


class References(unittest.TestCase):
    def test_an_axis_follows_the_references_of_a_program(self):
        # Warm oil, so that the boom leaves its dead band at once, and no end of the motion where this program gets no
        # core for 0.1 s: neither is what is tested here.
        arguments = ["--off", "--scenario", "nominal", *CHANNEL_REFERENCES]
        with Running(*arguments, machine=EXAMPLES / "four-axes.toml") as running, running.group() as group:
            writer = group.reference()
            begin = group.samples().next().axes[0].position
            with group.request(hold_to_run=False) as operator:
                sample = operator.step()
                writer.send(sample, {"boom": begin})
                operator.track("boom")
                first = operator.step().header.sequence
                for sample in operator.run(4.0):
                    goal = begin + min((sample.header.sequence - first) * 0.0004, 0.04)
                    writer.send(sample, {"boom": goal})
                self.assertAlmostEqual(sample.axes[0].position, begin + 0.04, delta=0.015)
                # A jump is refused, and the axis holds.
                for sample in operator.run(0.5):
                    writer.send(sample, {"boom": goal + 0.3})
                self.assertTrue(last(group).axes[0].flags & ControlFlag.REFERENCE)
                self.assertAlmostEqual(sample.axes[0].position, goal, delta=0.02)
            with self.assertRaises(hydraxis.NoChannel):
                group.reference()

    def test_references_without_sense_are_refused_before_they_are_sent(self):
        class Nothing:
            sent = 0

            def send(self, message):
                self.sent += 1

        writer = hydraxis.ReferenceWriter(Nothing(), hydraxis.Machine(7, ("boom", "arm")))
        for positions, said in [({}, "found none"), ({"boom": float("nan")}, "not finite"),
                                ({"boom": [0.1] * 33}, "33"), ({"boom": [0.1], "arm": [0.1, 0.2]}, "equally many"),
                                ({"boom": []}, "allowed: equally")]:
            with self.assertRaisesRegex(ValueError, said):
                writer.send(5, positions)
        with self.assertRaises(KeyError):
            writer.send(5, {"boon": 0.1})
        writer.send(5, {"boom": 0.1})
        with self.assertRaisesRegex(ValueError, "found 4 after 5"):
            writer.send(4, {"boom": 0.1})
        self.assertEqual(writer.sent, 1)


if __name__ == "__main__":
    unittest.main()
