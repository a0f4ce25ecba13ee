"""The command on a terminal: questions that are answered, lines that are redrawn in place, and Ctrl-C."""

import os
import re
import signal
import tempfile
import unittest
from pathlib import Path

from support import PATIENT, Running, command, retried
from terminal import CTRL_C, Terminal


class Questions(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def test_init_asks_again_after_a_wrong_answer_and_writes_a_file_that_is_sound(self):
        with Terminal("init", folder=self.folder) as terminal:
            terminal.answer(r"names of the axes.*\[cylinder\]: $", "boom")
            terminal.answer(r"pressure of the pump, bar \[210\]: $", "")
            terminal.answer(r"stroke of the cylinder, mm \[500\]: $", "800")
            terminal.answer(r"bore .*, mm \[50\]: $", "63")
            terminal.answer(r"rod, mm \[38\]: $", "99")
            terminal.answer(r'found "99"; allowed: 12.6 mm to 56.7 mm.*\r\n.*rod, mm \[38\]: $', "36")
            asked = len(re.findall(r"\]: ", terminal.text))
            # All other questions take the value that they show.
            while "written: " not in terminal.text:
                asked += 1
                terminal.expect(r"\]: |written: ", asked)
                if "written: " not in terminal.text:
                    terminal.type("\n")
            self.assertEqual(terminal.end(), 0, terminal.text)
            self.assertIn("boom: stroke 800 mm, bore 63 mm, rod 36 mm", terminal.text)
            self.assertTrue(all(len(line) <= 120 for line in terminal.text.splitlines()), terminal.text)
        done = command("check", self.folder / "machine.toml")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("no problem found", done.stdout)

    def test_ctrl_c_at_a_question_leaves_no_file(self):
        with Terminal("init", folder=self.folder) as terminal:
            terminal.answer(r"names of the axes.*: $", "boom")
            terminal.expect(r"pressure of the pump, bar \[210\]: ")
            terminal.type(CTRL_C)
            self.assertEqual(terminal.end(), -signal.SIGINT)
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_the_end_of_the_answers_leaves_no_file(self):
        with Terminal("init", folder=self.folder) as terminal:
            terminal.expect(r"names of the axes.*: ")
            terminal.type("\x04")  # Ctrl-D
            self.assertEqual(terminal.end(), 2)
            self.assertIn("nothing was written", terminal.text)
        self.assertEqual(list(self.folder.iterdir()), [])


class Redrawn(unittest.TestCase):
    def expect_in_place(self, terminal, screens, heading):
        """Each screen has one block, and every line of a block fits."""
        for screen in screens:
            self.assertEqual(sum(bool(re.match(heading, line)) for line in screen), 1, "\n".join(screen))
        lines = terminal.drawn_lines()
        self.assertGreater(len(lines), 10)
        self.assertTrue(all(len(line) <= terminal.columns for line in lines), lines)

    @retried
    def test_a_run_redraws_its_block_and_ends_with_the_tables(self):
        with tempfile.TemporaryDirectory() as boxes:
            with Terminal("run", "--duration", "4s", "--prefix", f"py{os.getpid()}-terminal", "--black-box", boxes,
                          *PATIENT) as terminal:
                self.assertEqual(terminal.end(), 0, terminal.text)
        screens = terminal.screens()
        self.assertGreater(len(screens), 3, terminal.text)
        self.expect_in_place(terminal, screens[:-1], r" axis +error  by ")
        last = screens[-1]
        self.assertTrue(any(line.startswith("Tracking error, mm") for line in last), "\n".join(last))
        self.assertFalse(any(re.match(r" axis +error  by ", line) for line in last), "\n".join(last))
        self.assertRegex("\n".join(last).rstrip(), r"400 ticks, 4\.0+ s of the machine in [\d.]+ s: \d+ lost\.$")

    def test_a_narrow_terminal_cuts_the_lines_of_a_run(self):
        with tempfile.TemporaryDirectory() as boxes:
            with Terminal("run", "--duration", "3s", "--prefix", f"py{os.getpid()}-narrow", "--black-box", boxes,
                          *PATIENT, columns=40) as terminal:
                self.assertEqual(terminal.end(), 0, terminal.text)
        self.expect_in_place(terminal, terminal.screens()[:-1], r" axis +error  by ")


class FullScreen(unittest.TestCase):
    def test_status_shows_the_group_until_ctrl_c(self):
        with Running() as running:
            with Terminal("status", "--watch", "--prefix", running.prefix) as terminal:
                # It has drawn ten times: the cursor is hidden at the end of each.
                terminal.expect(r"\x1b\[\?25l", 10)
                window = terminal.window()
                terminal.type(CTRL_C)
                self.assertEqual(terminal.end(), 0, terminal.text)
        self.assertRegex(window[0], rf"^ {running.prefix} +live +[\d.]+ m?s, tick \d+", "\n".join(window))
        for axis in ["boom", "arm", "telescope", "bucket"]:
            self.assertTrue(any(re.match(rf" {axis} +\w+ +\w+ +[+-]", line) for line in window), "\n".join(window))
        self.assertTrue(any(re.match(r" control-proc +running ", line) for line in window), "\n".join(window))
        self.assertTrue(terminal.text.startswith("\x1b[?1049h"), "a screen of its own")
        self.assertTrue(terminal.text.endswith("\x1b[?1049l\x1b[?25h"), "the terminal is given back")


if __name__ == "__main__":
    unittest.main()
