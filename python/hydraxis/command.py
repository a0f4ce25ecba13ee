"""The commands simulate, identify and commission, with their figures as dicts and data frames.

The command is found by the variable HYDRAXIS, else as `hydraxis` on the path. An error is raised as CommandFailed, with
the command's own message.
"""

import json
import os
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from .errors import CommandFailed, HydraxisError
from .frames import pandas, read_csv

INPUT = "input.csv"


def executable():
    """Path of the command."""
    found = os.environ.get("HYDRAXIS") or _parent() or shutil.which("hydraxis")
    if not found:
        raise HydraxisError("the command hydraxis is not on the path; install it with: cargo install --path . in the "
                            "folder of Hydraxis, or name it by the variable HYDRAXIS")
    return found


def _parent():
    """The supervisor that has started this program, if there is one."""
    try:
        parent = os.readlink(f"/proc/{os.getppid()}/exe")
    except OSError:
        return None
    return parent if os.path.basename(parent) == "hydraxis" else None


def run(*arguments):
    """Runs the command; returns its exit code, what it printed, and its messages. Bad usage raises CommandFailed."""
    words = [executable(), *map(str, arguments)]
    done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise CommandFailed(done.stderr.strip(), done.returncode)
    return done.returncode, done.stdout, done.stderr.strip()


def _machine(machine, model, settings, scenario, seed):
    arguments = [] if machine is None else [machine]
    arguments += [] if model is None else ["--model", model]
    for key, value in (settings or {}).items():
        arguments += ["--set", f"{key}={_toml(value)}"]
    arguments += [] if scenario is None else ["--scenario", scenario]
    return arguments + ["--seed", seed]


def _toml(value):
    if isinstance(value, str):
        return value
    return json.dumps(value)


def _duration(value):
    return f"{value}s" if isinstance(value, (int, float)) else str(value)


def _axes(axes):
    chosen = () if axes is None else (axes,) if isinstance(axes, str) else axes
    return [argument for axis in chosen for argument in ("--axis", axis)]


def _report(path):
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def _table(figures, order=()):
    """Figures by axis as a data frame: one row per axis, names of figures with dots."""
    names = sorted(figures, key=lambda name: order.index(name) if name in order else len(order))
    table = pandas().json_normalize([figures[name] for name in names])
    table.index = names
    return table


def _file(data, folder):
    """The path of a recording; a data frame is written to a file first, with its index t as a column."""
    if not hasattr(data, "to_csv"):
        return data
    path = Path(folder) / INPUT
    data.to_csv(path, index=data.index.name == "t")
    return path


@dataclass(frozen=True)
class Simulation:
    """A simulated run."""

    report: dict  # figures, as --json gives them; None of a plant without a controller
    axes: object  # data frame: one row of figures per axis; None of a plant without a controller
    trajectory: object  # data frame: one row per tick, with the time t (s) as its index


def simulate(machine=None, *, duration=None, scenario=None, seed=1, model=None, settings=None, open_loop=None,
             axes=None):
    """Simulates a machine: `hydraxis simulate`. Without `machine` the built-in excavator.

    duration    s, or a text such as "20s"
    settings    keys of the machine file and their values: {"axis.boom.control.gain": 4.0}
    open_loop   valve commands in the place of a controller: a CSV file, or a data frame with the time t (s) and a
                column per axis
    axes        only these axes in the trajectory

    A run that ends with a latched axis raises CommandFailed, whose `result` is the Simulation.
    """
    with tempfile.TemporaryDirectory() as folder:
        figures, path = Path(folder) / "figures.json", Path(folder) / "trajectory.csv"
        arguments = _machine(machine, model, settings, scenario, seed) + _axes(axes) + ["--trajectory", path]
        if open_loop is None:
            arguments += ["--json", figures]
        else:
            arguments += ["--open-loop", _file(open_loop, folder)]
        arguments += [] if duration is None else ["--duration", _duration(duration)]
        code, _, said = run("simulate", *arguments)
        report = _report(figures)
        result = None
        if path.exists() and (report is not None or code == 0):
            trajectory = read_csv(path)
            order = [column.partition(".")[0] for column in trajectory.columns]
            result = Simulation(report, _table(report["axes"], order) if report else None, trajectory)
        if code != 0:
            raise CommandFailed(said, code, result)
        return result


@dataclass(frozen=True)
class Identification:
    """Models that were identified on a recording."""

    report: dict  # figures, as --json gives them
    errors: object  # data frame: errors of the models over the test part


def identify(data, *, input="u", output="y", period=None, train=None, options=()):
    """Identifies models on a recording, a CSV file or a data frame: `hydraxis identify`.

    period      s, or a text such as "10ms"; without it from the time t
    train       rows for offline identification: a number, or a fraction of all
    options     further options of the command: ["--na", 2, "--integrator"]
    """
    with tempfile.TemporaryDirectory() as folder:
        figures = Path(folder) / "figures.json"
        arguments = [_file(data, folder), "--input", input, "--output", output, "--json", figures, *options]
        arguments += [] if period is None else ["--period", _duration(period)]
        arguments += [] if train is None else ["--train", train]
        code, _, said = run("identify", *arguments)
        if code != 0:
            raise CommandFailed(said, code)
        report = _report(figures)
        return Identification(report, _errors(report))


def _errors(report):
    """Errors of the models, one row per model and kind of prediction."""
    rows = []
    for model in ("classical", "adaptive", "persistence"):
        for kind in ("one_step", "h_step", "free_run"):
            figures = (report.get(model) or {}).get(kind)
            if isinstance(figures, dict):
                rows.append({"model": model, "prediction": kind, **figures})
    return pandas().DataFrame(rows).set_index(["model", "prediction"])


@dataclass(frozen=True)
class Commissioning:
    """Models that were found by an experiment."""

    report: list  # figures of every axis, as --json gives them
    axes: object  # data frame: one row per axis: dead time, dead bands, fit
    loops: object  # data frame: margins, one row per axis and controller
    model: Path  # the model file: simulate(model=..), hydraxis run --model


def commission(machine=None, *, out="model.toml", overwrite=False, axes=None, duration=None, scenario=None, seed=1,
               settings=None, travel=None, speed=None, prefix=None, enable=False, report=None):
    """Finds the models of axes by an experiment: `hydraxis commission`.

    out         model file to write; with `overwrite` also where there is one
    duration    of the experiment with each axis, s
    travel      width of the window around the present position, m
    speed       bound of the speed, m/s
    prefix      with `enable`: the machine of this running group moves, and no simulated one
    report      HTML file with pictures to write
    """
    with tempfile.TemporaryDirectory() as folder:
        figures = Path(folder) / "figures.json"
        arguments = _machine(machine, None, settings, scenario, seed) + _axes(axes)
        arguments += ["--out", out, "--json", figures] + (["--force"] if overwrite else [])
        options = {"--duration": None if duration is None else _duration(duration), "--travel": travel,
                   "--speed": speed, "--prefix": prefix, "--report": report}
        arguments += [part for option, value in options.items() if value is not None for part in (option, value)]
        code, _, said = run("commission", *arguments, *(["--enable"] if enable else []))
        if code != 0:
            raise CommandFailed(said, code)
        found = _report(figures)
        loops = [loop for axis in found for loop in axis["loops"]]
        axes = [{name: value for name, value in axis.items() if name != "loops"} for axis in found]
        frame = pandas().DataFrame
        return Commissioning(found, frame(axes).set_index("axis"), frame(loops).set_index(["axis", "controller"]),
                             Path(out))
