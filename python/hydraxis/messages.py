"""Messages, channels, flags and modes of Hydraxis, as structures of ctypes.

This file is written out of the message types in pipeline/src/message/. Changes are lost: change the types, and type
HYDRAXIS_BOOK=overwrite cargo test --test book
"""

import ctypes
from ctypes import c_double as f64, c_int64 as i64, c_uint8 as u8, c_uint32 as u32, c_uint64 as u64
from enum import IntEnum, IntFlag

MAX_AXES = 8  # axes in a message; the entries beyond header.axis_count are zero
MAX_PREVIEW = 32  # positions of an axis in a Reference, the present tick included
# Why models were refused, in the order of AxisCommand.rejected_snapshots.
REFUSALS = ["not-finite", "structure", "unstable", "direction", "unreachable", "speed", "worse"]
# Estimators that run side by side, and their memory in horizons, in the order of AxisSnapshot.weights.
MEMBERS = [
    "held",
    "still",
    "linear 4",
    "increments 4",
    "increments 8",
    "directional 8",
    "full 8",
    "full 20",
    "full 200",
    "smoothed 13",
    "smoothed 200",
]
# Stages, in the order of StageHealth.stage.
STAGES = ["plant-sim", "sensor-proc", "ident-proc", "control-proc"]


class AxisMode(IntEnum):
    # Only in a request: the axis keeps its mode.
    UNCHANGED = 0
    # Neutral, until the axis is armed.
    OFF = 1
    # A person gives the valve command, request by request.
    MANUAL = 2
    # The axis goes to a set point and stays there.
    HOLD = 3
    # The axis follows its reference.
    TRACK = 4
    # A commissioning program gives the valve command, request by request.
    COMMISSION = 5


class ControlMode(IntEnum):
    # Neutral: the axis is not armed, is settling, or has a latched fault.
    NEUTRAL = 0
    # The fallback, a PI controller with dead-band compensation.
    FALLBACK = 1
    # The predictive controller.
    MODEL = 2
    # A recording plays; no controller runs.
    REPLAY = 3
    # A person, by Request, within the limits.
    MANUAL = 4
    # A commissioning program, by Request, within the limits.
    COMMISSION = 5


class StageState(IntEnum):
    # The channels are open; the stage waits for its first input.
    READY = 1
    # The stage works.
    RUNNING = 2
    # The stage has ended; this is its last message.
    STOPPED = 3


class MissCause(IntEnum):
    # The input was sent late, or never.
    LATE_INPUT = 1
    # The input had arrived, or the timer was due, and the stage was not woken or had no core.
    LATE_RELEASE = 2
    # The work of the stage itself took long.
    LONG_WORK = 3


class ControlFlag(IntFlag):
    # The axis is not armed.
    DISARMED = 1
    # The axis is settling: it waits for healthy samples before it moves.
    SETTLING = 2
    # The feedback was stale, implausible or stuck; latched.
    FEEDBACK = 4
    # The reference stopped, jumped, left the soft limits or is not finite; the axis holds.
    REFERENCE = 8
    # The identifier has no model yet.
    NO_MODEL = 16
    # The last approved snapshot is old; it is used until its lifetime is over.
    MODEL_STALE = 32
    # The newest snapshot was refused.
    MODEL_REFUSED = 64
    # The newest request was refused; the axis goes on in its mode.
    REQUEST = 128
    # Requests stopped while the axis needed them; the axis has been off since.
    REQUEST_STOPPED = 256
    # A soft limit is near: the command that was asked for would not stop the axis before it.
    SOFT_LIMIT = 512
    # Commands came too late several times in a row; latched.
    DEADLINE = 1024
    # The predictive controller found no plan several times in a row; latched.
    SOLVER = 2048
    # The axis was driven and hardly moved; latched.
    STALL = 4096
    # The following error was too large for too long; latched.
    FOLLOWING = 8192
    # The emergency stop is or was pressed; latched, with the pilot pressure cut off.
    EMERGENCY_STOP = 16384
    # No model has been usable for so long that the axis is limited to half of its speed.
    HALF_SPEED = 32768
    # The model followed worse than the fallback, which a trial has shown: the fallback controls.
    MODEL_WORSE = 65536
    # The reference goes on more slowly: it asks for more than an axis can give, or an axis waits for readings, or has
    # only just been taken up.
    SLOWED = 131072
    # The axis moved though nobody had commanded it; latched, with the pilot pressure cut off.
    MOTION = 262144
    # The computer has been suspended, or a sample has a time that is still to come, so that nobody knows how old it is.
    CLOCK = 524288
    # A virtual wall is near: the command that was asked for would not stop boom, arm and bucket before it.
    WALL = 1048576
    # The fallback controls for a few seconds, so that the model can be compared with it.
    MODEL_TRIAL = 2097152
    # The axis swung though its reference did not ask for it: the fallback controls, with lower gains where it swung as
    # well.
    CAUTION = 4194304
    # The axis swung on under the lowest gains; latched.
    SWING = 8388608
    LATCHED = FEEDBACK | DEADLINE | SOLVER | STALL | FOLLOWING | EMERGENCY_STOP | MOTION | CLOCK | SWING
    CUT_OFF = EMERGENCY_STOP | MOTION


class SampleFault(IntFlag):
    # The position is outside the stroke by more than the tolerance.
    RANGE = 1
    # The position moved faster than the axis can.
    SPEED = 2
    # The encoder reported an error, or the position is computed from the sensor of another axis whose position is
    # unusable.
    ENCODER = 4
    # No new reading arrived for this tick, or none of this sensor or of one that the position is computed from.
    STALE = 8
    # The raw value has not changed for longer than stuck_after: a fault only while the axis is commanded to move.
    STUCK = 16
    # A chamber pressure is missing or outside the range of its transducer. The position is not affected.
    PRESSURE = 32
    # Positions that are too fast follow each other evenly in one direction: the axis falls or is pushed. Comes with
    # SPEED.
    RUNAWAY = 64
    UNUSABLE = RANGE | SPEED | ENCODER | STALE


class ModelFault(IntFlag):
    # Offline identification has not ended: there are no coefficients yet.
    TRAINING = 1
    # The training data did not excite every coefficient; the coefficients without excitation are held at zero.
    RANK_DEFICIENT = 2
    # The covariance reached its bound in this update.
    COVARIANCE_BOUND = 4
    # A coefficient or the covariance is not finite.
    NOT_FINITE = 8
    # The last sample could not be used.
    SAMPLE_SKIPPED = 16
    # The last sample was an outlier.
    OUTLIER = 32
    # The axis rests, so the coefficients are not updated.
    RESTING = 64
    # One sign of the command has not been used for long: the coefficients of that branch are old.
    ONE_SIDED = 128
    # A pole of the adaptive model makes a prediction grow more than e-fold over the horizon.
    UNSTABLE = 256
    # The adaptive model's gain is less than a quarter or more than four times the classical model's gain, or has the
    # other sign.
    GAIN = 512
    LASTING = TRAINING | RANK_DEFICIENT | NOT_FINITE


class Header(ctypes.Structure):
    SIZE = 48
    _fields_ = [
        # Number of the sample that caused the message: the index of its tick since the start of the source. An
        # EncoderReading counts its own readings. A gap in the numbers is a tick that no stage worked.
        ("sequence", u64),
        # Number of this message on its channel, from 0 on; the publisher fills it in. A gap is a lost message.
        ("number", u64),
        # Time of the acquisition of that sample, ns of CLOCK_MONOTONIC.
        ("acquired_ns", u64),
        # Time of sending this message, ns of CLOCK_MONOTONIC.
        ("sent_ns", u64),
        # Number of the life of the publisher, which no publisher before had; the publisher fills it in. Another one
        # tells a start from a repetition.
        ("session", u64),
        # Number of axes in the arrays; the entries beyond it are zero.
        ("axis_count", u32),
        # The machine that the message is about: the lower half of its fingerprint, which is never 0. 0 does not say
        # which. The publisher fills it in.
        ("machine", u32),
    ]


class EncoderValue(ctypes.Structure):
    SIZE = 32
    _fields_ = [
        # Counts as the sensor gives them; at the cylinder position = counts * resolution, at a joint angle = zero +
        # counts * resolution.
        ("counts", i64),
        # Pressure of the piston side, Pa above the atmosphere.
        ("piston_pressure", f64),
        # Pressure of the rod side, Pa above the atmosphere.
        ("rod_pressure", f64),
        # Error word of the encoder; 0 when it reports no error, and all bits where it was not read this time.
        ("error", u32),
        # 1 where both pressures are measured; 0 without transducers.
        ("has_pressures", u32),
    ]


class EncoderReading(ctypes.Structure):
    CHANNEL = "encoder-reading"
    LAYOUT = "3214f5e4a4226ee8"
    MAX_PUBLISHERS = 1
    BUFFER = 256  # messages that a reader may fall behind
    IS_FROM_CLIENTS = False
    SIZE = 312
    _fields_ = [
        # sequence counts readings; acquired_ns is the time of the reading.
        ("header", Header),
        # One value per axis.
        ("encoders", EncoderValue * 8),
        # 0 while the machine's emergency stop is released.
        ("emergency_stop", u32),
        # Zero.
        ("reserved", u32),
    ]

    @staticmethod
    def type_name():
        return "hydraxis.EncoderReading/4"


class AxisSample(ctypes.Structure):
    SIZE = 48
    _fields_ = [
        # Piston position, m (or the recorded output, in its unit). While faults is set: the last plausible position.
        ("position", f64),
        # Backward difference of the position, m/s.
        ("velocity", f64),
        # Reasons not to use the value, sample_fault bits; 0 is healthy.
        ("faults", u32),
        # Number of ticks for which the raw value has not changed.
        ("unchanged", u32),
        # Pressure of the piston side, Pa above the atmosphere; NaN while has_pressures is 0.
        ("piston_pressure", f64),
        # Pressure of the rod side, Pa above the atmosphere; NaN while has_pressures is 0.
        ("rod_pressure", f64),
        # 1 while both pressures are usable; 0 without transducers, without a new reading, and with the fault
        # sample_fault::PRESSURE.
        ("has_pressures", u32),
        # Zero.
        ("reserved", u32),
    ]


class EncoderSample(ctypes.Structure):
    CHANNEL = "encoder-sample"
    LAYOUT = "a04f2da412a297eb"
    MAX_PUBLISHERS = 1
    BUFFER = 256  # messages that a reader may fall behind
    IS_FROM_CLIENTS = False
    SIZE = 440
    _fields_ = [
        # sequence is the index of the tick.
        ("header", Header),
        # One entry per axis.
        ("axes", AxisSample * 8),
        # 0 while the machine's emergency stop is released, according to the newest reading.
        ("emergency_stop", u32),
        # Zero.
        ("reserved", u32),
    ]

    @staticmethod
    def type_name():
        return "hydraxis.EncoderSample/4"


class ErrorStatistics(ctypes.Structure):
    SIZE = 32
    _fields_ = [
        # Number of values.
        ("count", u64),
        # Arithmetic mean, in the unit of the values.
        ("mean", f64),
        # Sum of squared deviations from the mean, in that unit squared.
        ("m2", f64),
        # Largest magnitude, in that unit.
        ("max", f64),
    ]


class AxisCommand(ctypes.Structure):
    SIZE = 208
    _fields_ = [
        # Valve command in [-1, 1], positive extends; made from sample sequence and held until the next.
        ("command", f64),
        # Reference of this tick, m.
        ("reference", f64),
        # Following error, reference - position, m.
        ("error", f64),
        # Which controller made the command, a ControlMode as number.
        ("mode", u32),
        # Why the axis stands still or the model is not used, control_flag bits; 0 is healthy.
        ("flags", u32),
        # Mode that the axis is operated in, an AxisMode as number; 0 in a replay.
        ("operation", u32),
        # Number of Request messages that were refused so far.
        ("refused_requests", u32),
        # Number of Request messages that were accepted so far.
        ("taken_requests", u64),
        # Numbers of snapshots that were refused so far, by REFUSALS.
        ("rejected_snapshots", u64 * 7),
        # Number of plans of the predictive controller that its solver did not solve so far.
        ("unsolved_plans", u64),
        # Following error over all ticks in which a controller followed the reference, approaches left out, m.
        ("tracking", ErrorStatistics),
        # Following error over the ticks whose command the predictive controller made, m.
        ("model_tracking", ErrorStatistics),
        # Number of times that a fault latched the axis so far.
        ("latches", u64),
        # Tick of the last sample before the axis was latched for the last time; 0 before the first time.
        ("latched_at", u64),
        # Why the axis was latched for the last time, control_flag bits; they stay when the axis is released.
        ("latched_by", u32),
        # Number of ticks with a slowed reference since the axis was armed.
        ("slowed_ticks", u32),
        # Gains of the fallback, as a part of those in the machine file: 1 until a Request has changed them, 0 in a
        # replay.
        ("gain", f64),
    ]


class TeethState(ctypes.Structure):
    SIZE = 64
    _fields_ = [
        # Forward of the centre of swing, m.
        ("x", f64),
        # Above ground, m.
        ("z", f64),
        # Pitch of the bucket, from the x axis to the teeth, rad.
        ("pitch", f64),
        # Distance of the teeth from the nearest place of their way, its ends included, m; 0 unless they follow it.
        ("error", f64),
        # Pitch minus the planned one, rad; 0 unless the teeth follow their way.
        ("pitch_error", f64),
        # Length of the way up to where the teeth should be, m; 0 unless they follow it.
        ("way", f64),
        # What the bucket carries, kg: that of the machine file, or as estimated by the chamber pressures.
        ("payload", f64),
        # A TipState as number.
        ("state", u32),
        # Zero.
        ("reserved", u32),
    ]


class CommandInputs(ctypes.Structure):
    SIZE = 56
    _fields_ = [
        # Number of the snapshot that was used, plus 1; 0 without a snapshot.
        ("snapshot", u64),
        # Session of the program that has sent the newest Reference; 0 without a reference.
        ("reference_session", u64),
        # Number of the newest reference.
        ("reference_number", u64),
        # Count of the Request messages that control-proc has read so far.
        ("requests", u64),
        # Session of the publisher of the last request that was read; 0 before the first one.
        ("request_session", u64),
        # Number of the last request that was read.
        ("request_number", u64),
        # What happened between the command before and this one, command_event bits.
        ("events", u32),
        # Zero.
        ("reserved", u32),
    ]


class ValveCommand(ctypes.Structure):
    CHANNEL = "valve-command"
    LAYOUT = "ed9a0594504275f5"
    MAX_PUBLISHERS = 1
    BUFFER = 256  # messages that a reader may fall behind
    IS_FROM_CLIENTS = False
    SIZE = 1848
    _fields_ = [
        # sequence names the sample that the command was made from.
        ("header", Header),
        # One entry per axis.
        ("axes", AxisCommand * 8),
        # 1 asks for the pilot pressure of all valves to be cut off, whatever the commands are; else 0.
        ("cut_off", u32),
        # Zero.
        ("reserved", u32),
        # Session of the Requests that count, or counted last; 0 before the first.
        ("operator", u64),
        # Where the bucket's teeth are; without a [mechanism] and in a replay nothing is known of them.
        ("teeth", TeethState),
        # What the command was made of; zero in a replay.
        ("inputs", CommandInputs),
    ]

    @staticmethod
    def type_name():
        return "hydraxis.ValveCommand/11"


class Coefficients(ctypes.Structure):
    SIZE = 264
    _fields_ = [
        # Order of A.
        ("na", u32),
        # Order of B.
        ("nb", u32),
        # Delay, samples.
        ("nk", u32),
        # Number of coefficients of N for each sign of u.
        ("order", u32),
        # Basis of N: 0 powers, 1 hinges at knots.
        ("basis", u32),
        # 1 when the model has a drift, else 0.
        ("has_drift", u32),
        # a_1 .. a_na.
        ("a", f64 * 7),
        # b_0 .. b_nb.
        ("b", f64 * 5),
        # f_1 .. f_r, for u >= 0.
        ("f", f64 * 5),
        # g_1 .. g_r, for u < 0.
        ("g", f64 * 5),
        # c, in the unit of the output per sample.
        ("drift", f64),
        # Dead band: largest magnitude below zero, and largest above zero, that does not open the valve.
        ("dead_band", f64 * 2),
        # Magnitudes of the command beyond the dead band at which the r hinges begin, rising.
        ("knots", f64 * 5),
    ]


class ModelErrors(ctypes.Structure):
    SIZE = 96
    _fields_ = [
        # Output minus the prediction from the coefficients before it and the measured past.
        ("one_step", ErrorStatistics),
        # Output minus the prediction made horizon samples before, with the coefficients held since then.
        ("h_step", ErrorStatistics),
        # Output minus the output of the model when its own outputs have been fed back since the end of training.
        ("free_run", ErrorStatistics),
    ]


class AxisSnapshot(ctypes.Structure):
    SIZE = 1072
    _fields_ = [
        # The adaptive model, updated online.
        ("adaptive", Coefficients),
        # The classical model, identified offline and held.
        ("classical", Coefficients),
        # Errors of adaptive.
        ("adaptive_errors", ModelErrors),
        # Errors of classical.
        ("classical_errors", ModelErrors),
        # h-step errors of the adaptive model's coefficients before they are separated into b, f and g: what the
        # separation costs. No program is given these coefficients.
        ("unseparated_h_step", ErrorStatistics),
        # The output over these samples; the fit in percent needs its spread.
        ("output", ErrorStatistics),
        # Output minus the output horizon samples before: the error of predicting no change.
        ("persistence", ErrorStatistics),
        # 1 - forgetting factor over the updates: its max belongs to the smallest factor.
        ("forgetting", ErrorStatistics),
        # Forgetting factor of the last update.
        ("forgetting_factor", f64),
        # Innovation of the last update: output minus one-step prediction.
        ("innovation", f64),
        # Innovation of the last update, divided by its usual size: about 1 for a healthy model.
        ("innovation_ratio", f64),
        # Largest magnitude of a pole of the adaptive model.
        ("pole_radius", f64),
        # Travel over the horizon after a step to the mean positive (0) and negative (1) command so far: travel of the
        # adaptive model divided by travel of the classical model.
        ("gain_ratio", f64 * 2),
        # Part of the recent samples in which a positive (0) or negative (1) command was in the regressor.
        ("excitation", f64 * 2),
        # Trace of the covariance.
        ("covariance_trace", f64),
        # Part of the weighted norm of the products f_i b_j that the separation into b, f, g does not explain; 0 for an
        # exact separation.
        ("split_residual", f64),
        # Lowest command that N was identified from: below it N is extrapolated.
        ("command_low", f64),
        # Highest command that N was identified from: above it N is extrapolated.
        ("command_high", f64),
        # Number of recursive updates.
        ("updates", u64),
        # Number of samples that could not be used (gap, fault, missing command).
        ("skipped", u64),
        # Number of outliers: samples too far from all predictions to be used.
        ("outliers", u64),
        # Number of samples since the last sample that updated the coefficients.
        ("since_update", u64),
        # Weights of the estimators that the estimator auto runs side by side, in the order of MEMBERS; their sum is 1.
        # All are 0 with another estimator, and before training has found a first model.
        ("weights", f64 * 11),
        # Length of the horizon, samples.
        ("horizon", u32),
        # Reasons to distrust the model, model_fault bits; 0 is healthy.
        ("faults", u32),
    ]


class CoefficientSnapshot(ctypes.Structure):
    CHANNEL = "coefficient-snapshot"
    LAYOUT = "f1146bb091332a2a"
    MAX_PUBLISHERS = 1
    BUFFER = 64  # messages that a reader may fall behind
    IS_FROM_CLIENTS = False
    SIZE = 8624
    _fields_ = [
        # sequence names the last sample that updated the coefficients.
        ("header", Header),
        # One entry per axis.
        ("axes", AxisSnapshot * 8),
    ]

    @staticmethod
    def type_name():
        return "hydraxis.CoefficientSnapshot/5"


class Reference(ctypes.Structure):
    CHANNEL = "reference"
    LAYOUT = "5cb93046473a9df1"
    MAX_PUBLISHERS = 1
    BUFFER = 128  # messages that a reader may fall behind
    IS_FROM_CLIENTS = True
    SIZE = 2104
    _fields_ = [
        # sequence is the tick that the first reference is meant for; it must not go back.
        ("header", Header),
        # References per axis, m: entry i is for tick sequence + i.
        ("positions", (f64 * 32) * 8),
        # Number of references per axis, 1 to MAX_PREVIEW.
        ("preview", u32),
        # Zero.
        ("reserved", u32),
    ]

    @staticmethod
    def type_name():
        return "hydraxis.Reference/2"


class AxisRequest(ctypes.Structure):
    SIZE = 40
    _fields_ = [
        # Mode that is asked for, an AxisMode as number.
        ("mode", u32),
        # Arms an axis that is off when this number differs from the one in the message before of the same session. So
        # neither the first message of a program nor a repeated one arms an axis.
        ("enable", u32),
        # Valve command in [-1, 1], positive extends; only for the modes manual and commission.
        ("command", f64),
        # Set point, m; only for the mode hold.
        ("target", f64),
        # 1 when there is a set point; with 0 the axis holds the position at which it comes to a stand.
        ("has_target", u32),
        # 1 to disarm the axis when the messages of this session stop, in every mode; 0 only in the modes manual and
        # commission.
        ("hold_to_run", u32),
        # Gains of the fallback from now on, as a part of those in the machine file; 0 leaves them as they are. Only for
        # an axis that is not armed, within AxisState::gain_range, and not in the first message of a session. With the
        # mode off it is not looked at.
        ("gain", f64),
    ]


class Request(ctypes.Structure):
    CHANNEL = "request"
    LAYOUT = "2be21f0c58a2d60f"
    MAX_PUBLISHERS = 4
    BUFFER = 128  # messages that a reader may fall behind
    IS_FROM_CLIENTS = True
    SIZE = 384
    _fields_ = [
        # sequence is the newest sample that the program has read; it shows how old the request is.
        ("header", Header),
        # Number that differs from those of all programs before, such as the time of the program's start, ns.
        ("session", u64),
        # 1 to take the place of a program that operates now. That one's requests have no effect any more.
        ("takes_over", u32),
        # 0.
        ("reserved", u32),
        # One entry per axis; an entry of zeros asks for nothing.
        ("axes", AxisRequest * 8),
    ]

    @staticmethod
    def type_name():
        return "hydraxis.Request/4"


class MissedDeadlines(ctypes.Structure):
    SIZE = 40
    _fields_ = [
        # MissCause::LateInput.
        ("late_input", u64),
        # MissCause::LateRelease.
        ("late_release", u64),
        # MissCause::LongWork.
        ("long_work", u64),
        # Tick of the last miss.
        ("last_tick", u64),
        # Cause of the last miss, a MissCause as number; 0 before the first miss.
        ("last_cause", u32),
        # Zero.
        ("reserved", u32),
    ]


class ChannelHealth(ctypes.Structure):
    SIZE = 56
    _fields_ = [
        # Which channel, its index in CHANNELS.
        ("channel", u32),
        # 1 after the first message; before it 0.
        ("any", u32),
        # Number of messages read.
        ("received", u64),
        # Number of lost messages: sent and never read, by the gaps in their numbers.
        ("lost", u64),
        # Number of restarts of its publisher.
        ("restarts", u64),
        # Number of messages about another machine, which were not read.
        ("foreign", u64),
        # Age of the newest message's sample at this heartbeat, ns.
        ("age_ns", u64),
        # Longest time between the samples of two messages in a row, ns.
        ("longest_gap_ns", u64),
    ]


class Percentiles(ctypes.Structure):
    SIZE = 56
    _fields_ = [
        # Number of values, values beyond the range included.
        ("count", u64),
        # Median.
        ("p50", u64),
        # 99 %.
        ("p99", u64),
        # 99.9 %.
        ("p99_9", u64),
        # 99.99 %.
        ("p99_99", u64),
        # Largest value, exact also when it is beyond the histogram's range.
        ("max", u64),
        # Number of values beyond the histogram's range.
        ("beyond", u64),
    ]


class StageHealth(ctypes.Structure):
    CHANNEL = "stage-health"
    LAYOUT = "e7895b40e164885c"
    MAX_PUBLISHERS = 8
    BUFFER = 16  # messages that a reader may fall behind
    IS_FROM_CLIENTS = False
    SIZE = 576
    _fields_ = [
        # sequence is the last tick worked; sent_ns is the heartbeat.
        ("header", Header),
        # Which stage: its number in StageKind, in the order of the data.
        ("stage", u32),
        # What the stage is doing, a StageState as number.
        ("state", u32),
        # Process id of the stage.
        ("pid", u32),
        # Number of channels that the stage reads.
        ("channel_count", u32),
        # Time since which the figures below count, ns of CLOCK_MONOTONIC: the start, or the last reset.
        ("since_ns", u64),
        # Number of ticks worked since then.
        ("samples", u64),
        # Number of samples with a fault bit since then (sensor-proc only).
        ("implausible", u64),
        # Missed ticks since then.
        ("missed", MissedDeadlines),
        # The channels that the stage reads, channel_count of them.
        ("channels", ChannelHealth * 4),
        # Time from sending an input to picking it up, ns.
        ("wait", Percentiles),
        # Time from picking up an input to sending the output, ns.
        ("work", Percentiles),
        # Time from the acquisition of a sample to sending its command, ns (control-proc only).
        ("end_to_end", Percentiles),
        # Lateness of the timer against the intended time, ns (stages with a timer only).
        ("release_jitter", Percentiles),
    ]

    @staticmethod
    def type_name():
        return "hydraxis.StageHealth/3"


class AxisState(ctypes.Structure):
    SIZE = 336
    _fields_ = [
        # Name of the axis in UTF-8, cut to the length of the array and filled up with zeros.
        ("name", u8 * 32),
        # Newest sample of the axis.
        ("sample", AxisSample),
        # Newest command of the axis.
        ("command", AxisCommand),
        # Forgetting factor of the newest snapshot; 0 before the first snapshot.
        ("forgetting_factor", f64),
        # Standard deviation of the adaptive model's h-step error, in the unit of the identified output.
        ("h_step_sigma", f64),
        # Age of the newest snapshot's sample at this heartbeat, ns.
        ("model_age_ns", u64),
        # Reasons to distrust the model, super::model_fault bits.
        ("model_faults", u32),
        # 1 after the first snapshot; before it 0.
        ("has_model", u32),
        # Least and largest AxisCommand::gain that a request may ask for: the loop on the commissioned model keeps its
        # margins. Both are 1 without such a model.
        ("gain_range", f64 * 2),
    ]


class MachineState(ctypes.Structure):
    CHANNEL = "machine-state"
    LAYOUT = "a868728977d52899"
    MAX_PUBLISHERS = 1
    BUFFER = 16  # messages that a reader may fall behind
    IS_FROM_CLIENTS = False
    SIZE = 2800
    _fields_ = [
        # sequence names the sample.
        ("header", Header),
        # One entry per axis.
        ("axes", AxisState * 8),
        # Where the bucket's teeth are.
        ("teeth", TeethState),
    ]

    @staticmethod
    def type_name():
        return "hydraxis.MachineState/7"


# All messages, by the names of their channels, in the order of the data.
MESSAGES = {
    "encoder-reading": EncoderReading,
    "encoder-sample": EncoderSample,
    "valve-command": ValveCommand,
    "coefficient-snapshot": CoefficientSnapshot,
    "reference": Reference,
    "request": Request,
    "stage-health": StageHealth,
    "machine-state": MachineState,
}
