#!/usr/bin/env python3
"""A plant in Python, in the place of plant-sim: valve commands in, encoder readings out.

Needs Python 3.9 or newer and the package hydraxis:

    pip install ./python

Let the supervisor start it, in real time or in lock-step:

    hydraxis run examples/four-axes.toml --set stage.plant-sim.command='["python3","examples/plant.py"]'
    hydraxis run examples/four-axes.toml --set stage.plant-sim.command='["python3","examples/plant.py"]' --lockstep

Every axis is a dead time, a lag of first order, a dead band and an integrator:

    tau dx/dt + x = u(t - t_d)        dy/dt = K sign(x) max(0, |x| - d) / (1 - d)

    u    valve command, -1 to 1               t_d  dead time, s: dead_time
    x    spool position, -1 to 1              tau  lag, s: valve_time_constant
    y    piston position, m, 0 to stroke      d    dead band: dead_band_extend or dead_band_retract
    K    speed at full opening, m/s

t_d, tau and d are those of [axis.NAME.plant] in the machine file. Nothing else of that table is used. The sensors are
at the cylinders, and there are no pressure transducers.
"""

from collections import deque
from pathlib import Path

import hydraxis

STEP_S = 0.001  # of the integration
FULL_SPEED = 0.6  # K, m/s


class Axis:
    """One axis, moved on in steps of STEP_S."""

    def __init__(self, table):
        plant = table["plant"]
        self.stroke = table["stroke"]
        if table["encoder"].get("kind", "cylinder") != "cylinder":
            raise ValueError("this plant has sensors at its cylinders only: axis.NAME.encoder.kind = \"cylinder\"")
        self.resolution = table["encoder"]["resolution"]
        self.position = plant["initial_position"]
        self.time_constant = plant["valve_time_constant"]
        self.dead_bands = (plant["dead_band_retract"], plant["dead_band_extend"])
        self.spool = 0.0
        steps = round(plant["dead_time"] / STEP_S) + 1
        self.delayed = deque([0.0] * steps, maxlen=steps)  # commands of the last steps, oldest first

    def step(self, command):
        self.delayed.append(command)
        self.spool += (self.delayed[0] - self.spool) * STEP_S / self.time_constant
        dead_band = self.dead_bands[self.spool > 0]
        opening = max(0.0, abs(self.spool) - dead_band) / (1 - dead_band)
        speed = FULL_SPEED * (opening if self.spool > 0 else -opening)
        self.position = min(max(self.position + speed * STEP_S, 0.0), self.stroke)


class Machine(hydraxis.Plant):
    """All axes of the machine."""

    built_in = Path(__file__).parent / "excavator.toml"  # what `hydraxis run` uses without a machine file

    def __init__(self, machine):
        self.axes = [Axis(table) for table in machine["axis"].values()]

    def advance(self, commands, seconds):
        for axis, command in zip(self.axes, commands):
            for _ in range(round(seconds / STEP_S)):
                axis.step(command)

    def read(self):
        return [round(axis.position / axis.resolution) for axis in self.axes]


if __name__ == "__main__":
    Machine.main()
