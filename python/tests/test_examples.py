"""The programs of the folder examples, and the Python of the book."""

import ast
import json
import os
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from support import CHANNEL_REFERENCES, EXAMPLES, ROOT, Running, executable, hydraxis, needs, retried

ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "MPLBACKEND": "Agg"}


def program(name, *arguments):
    """Runs an example to its end; what it says."""
    done = subprocess.run([sys.executable, EXAMPLES / name, *arguments], capture_output=True, text=True, cwd=ROOT,
                          env=ENVIRONMENT, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


class Programs(unittest.TestCase):
    @retried
    def test_samples_and_commands_are_watched_and_logged(self):
        with Running() as running, tempfile.TemporaryDirectory() as folder:
            shown, said = program("watch.py", "--prefix", running.prefix, "--count", "2")
            self.assertIn("fallback", shown)
            self.assertIn("0 lost", said)
            log = Path(folder) / "log.csv"
            _, said = program("logger.py", "--prefix", running.prefix, "--seconds", "3", str(log))
            self.assertRegex(said, r"^\d+ rows, 0 messages lost")
            lines = log.read_text().splitlines()
            self.assertTrue(lines[0].startswith("t,boom.command,boom.position,boom.reference,arm.command"))
            self.assertGreater(len(lines), 200)
            self.assertTrue(all(line.count(",") == lines[0].count(",") for line in lines))

    @retried
    def test_references_are_written(self):
        with Running(*CHANNEL_REFERENCES, machine=EXAMPLES / "four-axes.toml") as running, running.group() as group:
            commands = group.commands()
            _, said = program("reference.py", "--prefix", running.prefix, "--seconds", "4", "--amplitude", "0.04")
            self.assertRegex(said, r"\d+ references sent")
            references = [command.axes[0].reference for command in commands.all()]
            self.assertGreater(max(references) - min(references), 0.01)


class Notebook(unittest.TestCase):
    NOTEBOOK = json.loads((EXAMPLES / "commission.ipynb").read_text())

    def cells(self):
        return ["".join(cell["source"]) for cell in self.NOTEBOOK["cells"] if cell["cell_type"] == "code"]

    def test_it_has_no_outputs(self):
        for cell in self.NOTEBOOK["cells"]:
            self.assertFalse(cell.get("outputs") or cell.get("execution_count"))

    @needs("pandas", "matplotlib")
    def test_it_runs(self):
        with tempfile.TemporaryDirectory() as folder:
            text = "\n".join(self.cells())
            done = subprocess.run([sys.executable, "-c", text], cwd=folder, capture_output=True, text=True,
                                  env={**ENVIRONMENT, "HYDRAXIS": str(Path(executable()).resolve())}, timeout=600)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertTrue((Path(folder) / "boom.toml").exists())


class Book(unittest.TestCase):
    def test_python_of_the_book_is_sound_and_names_what_there_is(self):
        count = 0
        for page in (ROOT / "docs" / "src").glob("**/*.md"):
            for block in re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL):
                count += 1
                nodes = [node for node in ast.walk(ast.parse(block, str(page))) if isinstance(node, ast.Attribute)]
                for node in nodes:
                    if isinstance(node.value, ast.Name) and node.value.id == "hydraxis":
                        self.assertTrue(hasattr(hydraxis, node.attr), f"{page}: hydraxis.{node.attr}")
        self.assertGreater(count, 3)


if __name__ == "__main__":
    unittest.main()
