"""Hydraxis from Python: watch and operate a running group, stand in for its plant, read its recordings, and simulate,
identify and commission machines.

    import hydraxis

    with hydraxis.Group("demo") as group:
        for sample in group.samples():
            print(sample.header.sequence, sample.axes[0].position)

Units are SI: m, m/s, Pa, s. A valve command is in [-1, 1], positive extends. Times of messages are nanoseconds of
CLOCK_MONOTONIC, which is time.monotonic_ns().
"""

from .channels import Reader, names_of, text_of
from .command import Commissioning, Identification, Simulation, commission, identify, simulate
from .errors import (CommandFailed, Disarmed, GroupEnded, HydraxisError, Latched, MissingPackage, NoAnswer, NoChannel,
                     NoGroup, NoPlace, OtherLayout, Replaced, Taken, Timeout)
from .frames import BlackBox, frame, read_black_box, read_csv
from .group import Group, Machine, is_running, running_groups
from .messages import (MAX_AXES, MAX_PREVIEW, MESSAGES, REFUSALS, AxisMode, ControlFlag, ControlMode, EncoderValue,
                       MissCause, ModelFault, SampleFault, STAGES, StageState)
from .operate import Operator
from .plant import Plant, load_machine
from .reference import ReferenceWriter

__version__ = "0.1.0"
__all__ = [
    "AxisMode", "BlackBox", "CommandFailed", "commission", "Commissioning", "ControlFlag", "ControlMode", "Disarmed",
    "EncoderValue", "frame", "Group", "GroupEnded", "HydraxisError", "Identification", "identify", "is_running",
    "Latched", "load_machine", "Machine", "MAX_AXES", "MAX_PREVIEW", "MESSAGES", "MissCause", "MissingPackage",
    "ModelFault", "names_of", "NoAnswer", "NoChannel", "NoGroup", "NoPlace", "Operator", "OtherLayout", "Plant",
    "read_black_box", "read_csv", "Reader", "ReferenceWriter", "REFUSALS", "Replaced", "running_groups", "SampleFault",
    "simulate", "Simulation", "STAGES", "StageState", "Taken", "text_of", "Timeout",
]
