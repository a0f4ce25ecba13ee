/* Messages, channels, flags and modes of Hydraxis, for programs in C and C++.

   This file is written out of the message types in pipeline/src/message/. Changes are lost: change the types, and type
   HYDRAXIS_BOOK=overwrite cargo test --test book

   A channel is a publish-subscribe service of iceoryx2 0.10 with the name HYDRAXIS_.._SERVICE and the type name
   HYDRAXIS_.._TYPE, below the prefix and the root path of its group. Compare the attribute HYDRAXIS_LAYOUT_ATTRIBUTE
   of the service with HYDRAXIS_.._LAYOUT before the first message: another value is another version. */

#ifndef HYDRAXIS_H
#define HYDRAXIS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define HYDRAXIS_ASSERT(condition, text) static_assert(condition, text)
#else
#define HYDRAXIS_ASSERT(condition, text) _Static_assert(condition, text)
#endif

#define HYDRAXIS_LAYOUT_ATTRIBUTE "hydraxis.layout"
#define HYDRAXIS_MAX_AXES 8
#define HYDRAXIS_MAX_PREVIEW 32

#define HYDRAXIS_ENCODER_READING_SERVICE "hydraxis/encoder-reading"
#define HYDRAXIS_ENCODER_READING_TYPE "hydraxis.EncoderReading/4"
#define HYDRAXIS_ENCODER_READING_LAYOUT "3214f5e4a4226ee8"
#define HYDRAXIS_ENCODER_READING_BUFFER 256

#define HYDRAXIS_ENCODER_SAMPLE_SERVICE "hydraxis/encoder-sample"
#define HYDRAXIS_ENCODER_SAMPLE_TYPE "hydraxis.EncoderSample/4"
#define HYDRAXIS_ENCODER_SAMPLE_LAYOUT "a04f2da412a297eb"
#define HYDRAXIS_ENCODER_SAMPLE_BUFFER 256

#define HYDRAXIS_VALVE_COMMAND_SERVICE "hydraxis/valve-command"
#define HYDRAXIS_VALVE_COMMAND_TYPE "hydraxis.ValveCommand/11"
#define HYDRAXIS_VALVE_COMMAND_LAYOUT "ed9a0594504275f5"
#define HYDRAXIS_VALVE_COMMAND_BUFFER 256

#define HYDRAXIS_COEFFICIENT_SNAPSHOT_SERVICE "hydraxis/coefficient-snapshot"
#define HYDRAXIS_COEFFICIENT_SNAPSHOT_TYPE "hydraxis.CoefficientSnapshot/5"
#define HYDRAXIS_COEFFICIENT_SNAPSHOT_LAYOUT "f1146bb091332a2a"
#define HYDRAXIS_COEFFICIENT_SNAPSHOT_BUFFER 64

#define HYDRAXIS_REFERENCE_SERVICE "hydraxis/reference"
#define HYDRAXIS_REFERENCE_TYPE "hydraxis.Reference/2"
#define HYDRAXIS_REFERENCE_LAYOUT "5cb93046473a9df1"
#define HYDRAXIS_REFERENCE_BUFFER 128

#define HYDRAXIS_REQUEST_SERVICE "hydraxis/request"
#define HYDRAXIS_REQUEST_TYPE "hydraxis.Request/4"
#define HYDRAXIS_REQUEST_LAYOUT "2be21f0c58a2d60f"
#define HYDRAXIS_REQUEST_BUFFER 128

#define HYDRAXIS_STAGE_HEALTH_SERVICE "hydraxis/stage-health"
#define HYDRAXIS_STAGE_HEALTH_TYPE "hydraxis.StageHealth/3"
#define HYDRAXIS_STAGE_HEALTH_LAYOUT "e7895b40e164885c"
#define HYDRAXIS_STAGE_HEALTH_BUFFER 16

#define HYDRAXIS_MACHINE_STATE_SERVICE "hydraxis/machine-state"
#define HYDRAXIS_MACHINE_STATE_TYPE "hydraxis.MachineState/7"
#define HYDRAXIS_MACHINE_STATE_LAYOUT "a868728977d52899"
#define HYDRAXIS_MACHINE_STATE_BUFFER 16

enum HydraxisAxisMode {
    // Only in a request: the axis keeps its mode.
    HYDRAXIS_AXIS_MODE_UNCHANGED = 0,
    // Neutral, until the axis is armed.
    HYDRAXIS_AXIS_MODE_OFF = 1,
    // A person gives the valve command, request by request.
    HYDRAXIS_AXIS_MODE_MANUAL = 2,
    // The axis goes to a set point and stays there.
    HYDRAXIS_AXIS_MODE_HOLD = 3,
    // The axis follows its reference.
    HYDRAXIS_AXIS_MODE_TRACK = 4,
    // A commissioning program gives the valve command, request by request.
    HYDRAXIS_AXIS_MODE_COMMISSION = 5
};

enum HydraxisControlMode {
    // Neutral: the axis is not armed, is settling, or has a latched fault.
    HYDRAXIS_CONTROL_MODE_NEUTRAL = 0,
    // The fallback, a PI controller with dead-band compensation.
    HYDRAXIS_CONTROL_MODE_FALLBACK = 1,
    // The predictive controller.
    HYDRAXIS_CONTROL_MODE_MODEL = 2,
    // A recording plays; no controller runs.
    HYDRAXIS_CONTROL_MODE_REPLAY = 3,
    // A person, by Request, within the limits.
    HYDRAXIS_CONTROL_MODE_MANUAL = 4,
    // A commissioning program, by Request, within the limits.
    HYDRAXIS_CONTROL_MODE_COMMISSION = 5
};

enum HydraxisStageState {
    // The channels are open; the stage waits for its first input.
    HYDRAXIS_STAGE_STATE_READY = 1,
    // The stage works.
    HYDRAXIS_STAGE_STATE_RUNNING = 2,
    // The stage has ended; this is its last message.
    HYDRAXIS_STAGE_STATE_STOPPED = 3
};

enum HydraxisMissCause {
    // The input was sent late, or never.
    HYDRAXIS_MISS_CAUSE_LATE_INPUT = 1,
    // The input had arrived, or the timer was due, and the stage was not woken or had no core.
    HYDRAXIS_MISS_CAUSE_LATE_RELEASE = 2,
    // The work of the stage itself took long.
    HYDRAXIS_MISS_CAUSE_LONG_WORK = 3
};

enum HydraxisControlFlag {
    // The axis is not armed.
    HYDRAXIS_CONTROL_FLAG_DISARMED = 1,
    // The axis is settling: it waits for healthy samples before it moves.
    HYDRAXIS_CONTROL_FLAG_SETTLING = 2,
    // The feedback was stale, implausible or stuck; latched.
    HYDRAXIS_CONTROL_FLAG_FEEDBACK = 4,
    // The reference stopped, jumped, left the soft limits or is not finite; the axis holds.
    HYDRAXIS_CONTROL_FLAG_REFERENCE = 8,
    // The identifier has no model yet.
    HYDRAXIS_CONTROL_FLAG_NO_MODEL = 16,
    // The last approved snapshot is old; it is used until its lifetime is over.
    HYDRAXIS_CONTROL_FLAG_MODEL_STALE = 32,
    // The newest snapshot was refused.
    HYDRAXIS_CONTROL_FLAG_MODEL_REFUSED = 64,
    // The newest request was refused; the axis goes on in its mode.
    HYDRAXIS_CONTROL_FLAG_REQUEST = 128,
    // Requests stopped while the axis needed them; the axis has been off since.
    HYDRAXIS_CONTROL_FLAG_REQUEST_STOPPED = 256,
    // A soft limit is near: the command that was asked for would not stop the axis before it.
    HYDRAXIS_CONTROL_FLAG_SOFT_LIMIT = 512,
    // Commands came too late several times in a row; latched.
    HYDRAXIS_CONTROL_FLAG_DEADLINE = 1024,
    // The predictive controller found no plan several times in a row; latched.
    HYDRAXIS_CONTROL_FLAG_SOLVER = 2048,
    // The axis was driven and hardly moved; latched.
    HYDRAXIS_CONTROL_FLAG_STALL = 4096,
    // The following error was too large for too long; latched.
    HYDRAXIS_CONTROL_FLAG_FOLLOWING = 8192,
    // The emergency stop is or was pressed; latched, with the pilot pressure cut off.
    HYDRAXIS_CONTROL_FLAG_EMERGENCY_STOP = 16384,
    // No model has been usable for so long that the axis is limited to half of its speed.
    HYDRAXIS_CONTROL_FLAG_HALF_SPEED = 32768,
    // The model followed worse than the fallback, which a trial has shown: the fallback controls.
    HYDRAXIS_CONTROL_FLAG_MODEL_WORSE = 65536,
    // The reference goes on more slowly: it asks for more than an axis can give, or an axis waits for readings, or has
    // only just been taken up.
    HYDRAXIS_CONTROL_FLAG_SLOWED = 131072,
    // The axis moved though nobody had commanded it; latched, with the pilot pressure cut off.
    HYDRAXIS_CONTROL_FLAG_MOTION = 262144,
    // The computer has been suspended, or a sample has a time that is still to come, so that nobody knows how old it
    // is.
    HYDRAXIS_CONTROL_FLAG_CLOCK = 524288,
    // A virtual wall is near: the command that was asked for would not stop boom, arm and bucket before it.
    HYDRAXIS_CONTROL_FLAG_WALL = 1048576,
    // The fallback controls for a few seconds, so that the model can be compared with it.
    HYDRAXIS_CONTROL_FLAG_MODEL_TRIAL = 2097152,
    // The axis swung though its reference did not ask for it: the fallback controls, with lower gains where it swung as
    // well.
    HYDRAXIS_CONTROL_FLAG_CAUTION = 4194304,
    // The axis swung on under the lowest gains; latched.
    HYDRAXIS_CONTROL_FLAG_SWING = 8388608,
    HYDRAXIS_CONTROL_FLAG_LATCHED = 9206788,
    HYDRAXIS_CONTROL_FLAG_CUT_OFF = 278528
};

enum HydraxisSampleFault {
    // The position is outside the stroke by more than the tolerance.
    HYDRAXIS_SAMPLE_FAULT_RANGE = 1,
    // The position moved faster than the axis can.
    HYDRAXIS_SAMPLE_FAULT_SPEED = 2,
    // The encoder reported an error, or the position is computed from the sensor of another axis whose position is
    // unusable.
    HYDRAXIS_SAMPLE_FAULT_ENCODER = 4,
    // No new reading arrived for this tick, or none of this sensor or of one that the position is computed from.
    HYDRAXIS_SAMPLE_FAULT_STALE = 8,
    // The raw value has not changed for longer than stuck_after: a fault only while the axis is commanded to move.
    HYDRAXIS_SAMPLE_FAULT_STUCK = 16,
    // A chamber pressure is missing or outside the range of its transducer. The position is not affected.
    HYDRAXIS_SAMPLE_FAULT_PRESSURE = 32,
    // Positions that are too fast follow each other evenly in one direction: the axis falls or is pushed. Comes with
    // SPEED.
    HYDRAXIS_SAMPLE_FAULT_RUNAWAY = 64,
    HYDRAXIS_SAMPLE_FAULT_UNUSABLE = 15
};

enum HydraxisModelFault {
    // Offline identification has not ended: there are no coefficients yet.
    HYDRAXIS_MODEL_FAULT_TRAINING = 1,
    // The training data did not excite every coefficient; the coefficients without excitation are held at zero.
    HYDRAXIS_MODEL_FAULT_RANK_DEFICIENT = 2,
    // The covariance reached its bound in this update.
    HYDRAXIS_MODEL_FAULT_COVARIANCE_BOUND = 4,
    // A coefficient or the covariance is not finite.
    HYDRAXIS_MODEL_FAULT_NOT_FINITE = 8,
    // The last sample could not be used.
    HYDRAXIS_MODEL_FAULT_SAMPLE_SKIPPED = 16,
    // The last sample was an outlier.
    HYDRAXIS_MODEL_FAULT_OUTLIER = 32,
    // The axis rests, so the coefficients are not updated.
    HYDRAXIS_MODEL_FAULT_RESTING = 64,
    // One sign of the command has not been used for long: the coefficients of that branch are old.
    HYDRAXIS_MODEL_FAULT_ONE_SIDED = 128,
    // A pole of the adaptive model makes a prediction grow more than e-fold over the horizon.
    HYDRAXIS_MODEL_FAULT_UNSTABLE = 256,
    // The adaptive model's gain is less than a quarter or more than four times the classical model's gain, or has the
    // other sign.
    HYDRAXIS_MODEL_FAULT_GAIN = 512,
    HYDRAXIS_MODEL_FAULT_LASTING = 11
};

typedef struct HydraxisHeader {
    // Number of the sample that caused the message: the index of its tick since the start of the source. An
    // EncoderReading counts its own readings. A gap in the numbers is a tick that no stage worked.
    uint64_t sequence;
    // Number of this message on its channel, from 0 on; the publisher fills it in. A gap is a lost message.
    uint64_t number;
    // Time of the acquisition of that sample, ns of CLOCK_MONOTONIC.
    uint64_t acquired_ns;
    // Time of sending this message, ns of CLOCK_MONOTONIC.
    uint64_t sent_ns;
    // Number of the life of the publisher, which no publisher before had; the publisher fills it in. Another one tells
    // a start from a repetition.
    uint64_t session;
    // Number of axes in the arrays; the entries beyond it are zero.
    uint32_t axis_count;
    // The machine that the message is about: the lower half of its fingerprint, which is never 0. 0 does not say which.
    // The publisher fills it in.
    uint32_t machine;
} HydraxisHeader;
HYDRAXIS_ASSERT(offsetof(HydraxisHeader, sequence) == 0, "HydraxisHeader.sequence");
HYDRAXIS_ASSERT(offsetof(HydraxisHeader, number) == 8, "HydraxisHeader.number");
HYDRAXIS_ASSERT(offsetof(HydraxisHeader, acquired_ns) == 16, "HydraxisHeader.acquired_ns");
HYDRAXIS_ASSERT(offsetof(HydraxisHeader, sent_ns) == 24, "HydraxisHeader.sent_ns");
HYDRAXIS_ASSERT(offsetof(HydraxisHeader, session) == 32, "HydraxisHeader.session");
HYDRAXIS_ASSERT(offsetof(HydraxisHeader, axis_count) == 40, "HydraxisHeader.axis_count");
HYDRAXIS_ASSERT(offsetof(HydraxisHeader, machine) == 44, "HydraxisHeader.machine");
HYDRAXIS_ASSERT(sizeof(HydraxisHeader) == 48, "HydraxisHeader");

typedef struct HydraxisEncoderValue {
    // Counts as the sensor gives them; at the cylinder position = counts * resolution, at a joint angle = zero + counts
    // * resolution.
    int64_t counts;
    // Pressure of the piston side, Pa above the atmosphere.
    double piston_pressure;
    // Pressure of the rod side, Pa above the atmosphere.
    double rod_pressure;
    // Error word of the encoder; 0 when it reports no error, and all bits where it was not read this time.
    uint32_t error;
    // 1 where both pressures are measured; 0 without transducers.
    uint32_t has_pressures;
} HydraxisEncoderValue;
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderValue, counts) == 0, "HydraxisEncoderValue.counts");
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderValue, piston_pressure) == 8, "HydraxisEncoderValue.piston_pressure");
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderValue, rod_pressure) == 16, "HydraxisEncoderValue.rod_pressure");
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderValue, error) == 24, "HydraxisEncoderValue.error");
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderValue, has_pressures) == 28, "HydraxisEncoderValue.has_pressures");
HYDRAXIS_ASSERT(sizeof(HydraxisEncoderValue) == 32, "HydraxisEncoderValue");

typedef struct HydraxisEncoderReading {
    // sequence counts readings; acquired_ns is the time of the reading.
    HydraxisHeader header;
    // One value per axis.
    HydraxisEncoderValue encoders[8];
    // 0 while the machine's emergency stop is released.
    uint32_t emergency_stop;
    // Zero.
    uint32_t reserved;
} HydraxisEncoderReading;
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderReading, header) == 0, "HydraxisEncoderReading.header");
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderReading, encoders) == 48, "HydraxisEncoderReading.encoders");
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderReading, emergency_stop) == 304, "HydraxisEncoderReading.emergency_stop");
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderReading, reserved) == 308, "HydraxisEncoderReading.reserved");
HYDRAXIS_ASSERT(sizeof(HydraxisEncoderReading) == 312, "HydraxisEncoderReading");

typedef struct HydraxisAxisSample {
    // Piston position, m (or the recorded output, in its unit). While faults is set: the last plausible position.
    double position;
    // Backward difference of the position, m/s.
    double velocity;
    // Reasons not to use the value, sample_fault bits; 0 is healthy.
    uint32_t faults;
    // Number of ticks for which the raw value has not changed.
    uint32_t unchanged;
    // Pressure of the piston side, Pa above the atmosphere; NaN while has_pressures is 0.
    double piston_pressure;
    // Pressure of the rod side, Pa above the atmosphere; NaN while has_pressures is 0.
    double rod_pressure;
    // 1 while both pressures are usable; 0 without transducers, without a new reading, and with the fault
    // sample_fault::PRESSURE.
    uint32_t has_pressures;
    // Zero.
    uint32_t reserved;
} HydraxisAxisSample;
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSample, position) == 0, "HydraxisAxisSample.position");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSample, velocity) == 8, "HydraxisAxisSample.velocity");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSample, faults) == 16, "HydraxisAxisSample.faults");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSample, unchanged) == 20, "HydraxisAxisSample.unchanged");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSample, piston_pressure) == 24, "HydraxisAxisSample.piston_pressure");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSample, rod_pressure) == 32, "HydraxisAxisSample.rod_pressure");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSample, has_pressures) == 40, "HydraxisAxisSample.has_pressures");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSample, reserved) == 44, "HydraxisAxisSample.reserved");
HYDRAXIS_ASSERT(sizeof(HydraxisAxisSample) == 48, "HydraxisAxisSample");

typedef struct HydraxisEncoderSample {
    // sequence is the index of the tick.
    HydraxisHeader header;
    // One entry per axis.
    HydraxisAxisSample axes[8];
    // 0 while the machine's emergency stop is released, according to the newest reading.
    uint32_t emergency_stop;
    // Zero.
    uint32_t reserved;
} HydraxisEncoderSample;
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderSample, header) == 0, "HydraxisEncoderSample.header");
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderSample, axes) == 48, "HydraxisEncoderSample.axes");
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderSample, emergency_stop) == 432, "HydraxisEncoderSample.emergency_stop");
HYDRAXIS_ASSERT(offsetof(HydraxisEncoderSample, reserved) == 436, "HydraxisEncoderSample.reserved");
HYDRAXIS_ASSERT(sizeof(HydraxisEncoderSample) == 440, "HydraxisEncoderSample");

typedef struct HydraxisErrorStatistics {
    // Number of values.
    uint64_t count;
    // Arithmetic mean, in the unit of the values.
    double mean;
    // Sum of squared deviations from the mean, in that unit squared.
    double m2;
    // Largest magnitude, in that unit.
    double max;
} HydraxisErrorStatistics;
HYDRAXIS_ASSERT(offsetof(HydraxisErrorStatistics, count) == 0, "HydraxisErrorStatistics.count");
HYDRAXIS_ASSERT(offsetof(HydraxisErrorStatistics, mean) == 8, "HydraxisErrorStatistics.mean");
HYDRAXIS_ASSERT(offsetof(HydraxisErrorStatistics, m2) == 16, "HydraxisErrorStatistics.m2");
HYDRAXIS_ASSERT(offsetof(HydraxisErrorStatistics, max) == 24, "HydraxisErrorStatistics.max");
HYDRAXIS_ASSERT(sizeof(HydraxisErrorStatistics) == 32, "HydraxisErrorStatistics");

typedef struct HydraxisAxisCommand {
    // Valve command in [-1, 1], positive extends; made from sample sequence and held until the next.
    double command;
    // Reference of this tick, m.
    double reference;
    // Following error, reference - position, m.
    double error;
    // Which controller made the command, a ControlMode as number.
    uint32_t mode;
    // Why the axis stands still or the model is not used, control_flag bits; 0 is healthy.
    uint32_t flags;
    // Mode that the axis is operated in, an AxisMode as number; 0 in a replay.
    uint32_t operation;
    // Number of Request messages that were refused so far.
    uint32_t refused_requests;
    // Number of Request messages that were accepted so far.
    uint64_t taken_requests;
    // Numbers of snapshots that were refused so far, by REFUSALS.
    uint64_t rejected_snapshots[7];
    // Number of plans of the predictive controller that its solver did not solve so far.
    uint64_t unsolved_plans;
    // Following error over all ticks in which a controller followed the reference, approaches left out, m.
    HydraxisErrorStatistics tracking;
    // Following error over the ticks whose command the predictive controller made, m.
    HydraxisErrorStatistics model_tracking;
    // Number of times that a fault latched the axis so far.
    uint64_t latches;
    // Tick of the last sample before the axis was latched for the last time; 0 before the first time.
    uint64_t latched_at;
    // Why the axis was latched for the last time, control_flag bits; they stay when the axis is released.
    uint32_t latched_by;
    // Number of ticks with a slowed reference since the axis was armed.
    uint32_t slowed_ticks;
    // Gains of the fallback, as a part of those in the machine file: 1 until a Request has changed them, 0 in a replay.
    double gain;
} HydraxisAxisCommand;
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, command) == 0, "HydraxisAxisCommand.command");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, reference) == 8, "HydraxisAxisCommand.reference");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, error) == 16, "HydraxisAxisCommand.error");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, mode) == 24, "HydraxisAxisCommand.mode");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, flags) == 28, "HydraxisAxisCommand.flags");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, operation) == 32, "HydraxisAxisCommand.operation");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, refused_requests) == 36, "HydraxisAxisCommand.refused_requests");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, taken_requests) == 40, "HydraxisAxisCommand.taken_requests");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, rejected_snapshots) == 48, "HydraxisAxisCommand.rejected_snapshots");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, unsolved_plans) == 104, "HydraxisAxisCommand.unsolved_plans");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, tracking) == 112, "HydraxisAxisCommand.tracking");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, model_tracking) == 144, "HydraxisAxisCommand.model_tracking");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, latches) == 176, "HydraxisAxisCommand.latches");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, latched_at) == 184, "HydraxisAxisCommand.latched_at");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, latched_by) == 192, "HydraxisAxisCommand.latched_by");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, slowed_ticks) == 196, "HydraxisAxisCommand.slowed_ticks");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisCommand, gain) == 200, "HydraxisAxisCommand.gain");
HYDRAXIS_ASSERT(sizeof(HydraxisAxisCommand) == 208, "HydraxisAxisCommand");

typedef struct HydraxisTeethState {
    // Forward of the centre of swing, m.
    double x;
    // Above ground, m.
    double z;
    // Pitch of the bucket, from the x axis to the teeth, rad.
    double pitch;
    // Distance of the teeth from the nearest place of their way, its ends included, m; 0 unless they follow it.
    double error;
    // Pitch minus the planned one, rad; 0 unless the teeth follow their way.
    double pitch_error;
    // Length of the way up to where the teeth should be, m; 0 unless they follow it.
    double way;
    // What the bucket carries, kg: that of the machine file, or as estimated by the chamber pressures.
    double payload;
    // A TipState as number.
    uint32_t state;
    // Zero.
    uint32_t reserved;
} HydraxisTeethState;
HYDRAXIS_ASSERT(offsetof(HydraxisTeethState, x) == 0, "HydraxisTeethState.x");
HYDRAXIS_ASSERT(offsetof(HydraxisTeethState, z) == 8, "HydraxisTeethState.z");
HYDRAXIS_ASSERT(offsetof(HydraxisTeethState, pitch) == 16, "HydraxisTeethState.pitch");
HYDRAXIS_ASSERT(offsetof(HydraxisTeethState, error) == 24, "HydraxisTeethState.error");
HYDRAXIS_ASSERT(offsetof(HydraxisTeethState, pitch_error) == 32, "HydraxisTeethState.pitch_error");
HYDRAXIS_ASSERT(offsetof(HydraxisTeethState, way) == 40, "HydraxisTeethState.way");
HYDRAXIS_ASSERT(offsetof(HydraxisTeethState, payload) == 48, "HydraxisTeethState.payload");
HYDRAXIS_ASSERT(offsetof(HydraxisTeethState, state) == 56, "HydraxisTeethState.state");
HYDRAXIS_ASSERT(offsetof(HydraxisTeethState, reserved) == 60, "HydraxisTeethState.reserved");
HYDRAXIS_ASSERT(sizeof(HydraxisTeethState) == 64, "HydraxisTeethState");

typedef struct HydraxisCommandInputs {
    // Number of the snapshot that was used, plus 1; 0 without a snapshot.
    uint64_t snapshot;
    // Session of the program that has sent the newest Reference; 0 without a reference.
    uint64_t reference_session;
    // Number of the newest reference.
    uint64_t reference_number;
    // Count of the Request messages that control-proc has read so far.
    uint64_t requests;
    // Session of the publisher of the last request that was read; 0 before the first one.
    uint64_t request_session;
    // Number of the last request that was read.
    uint64_t request_number;
    // What happened between the command before and this one, command_event bits.
    uint32_t events;
    // Zero.
    uint32_t reserved;
} HydraxisCommandInputs;
HYDRAXIS_ASSERT(offsetof(HydraxisCommandInputs, snapshot) == 0, "HydraxisCommandInputs.snapshot");
HYDRAXIS_ASSERT(offsetof(HydraxisCommandInputs, reference_session) == 8, "HydraxisCommandInputs.reference_session");
HYDRAXIS_ASSERT(offsetof(HydraxisCommandInputs, reference_number) == 16, "HydraxisCommandInputs.reference_number");
HYDRAXIS_ASSERT(offsetof(HydraxisCommandInputs, requests) == 24, "HydraxisCommandInputs.requests");
HYDRAXIS_ASSERT(offsetof(HydraxisCommandInputs, request_session) == 32, "HydraxisCommandInputs.request_session");
HYDRAXIS_ASSERT(offsetof(HydraxisCommandInputs, request_number) == 40, "HydraxisCommandInputs.request_number");
HYDRAXIS_ASSERT(offsetof(HydraxisCommandInputs, events) == 48, "HydraxisCommandInputs.events");
HYDRAXIS_ASSERT(offsetof(HydraxisCommandInputs, reserved) == 52, "HydraxisCommandInputs.reserved");
HYDRAXIS_ASSERT(sizeof(HydraxisCommandInputs) == 56, "HydraxisCommandInputs");

typedef struct HydraxisValveCommand {
    // sequence names the sample that the command was made from.
    HydraxisHeader header;
    // One entry per axis.
    HydraxisAxisCommand axes[8];
    // 1 asks for the pilot pressure of all valves to be cut off, whatever the commands are; else 0.
    uint32_t cut_off;
    // Zero.
    uint32_t reserved;
    // Session of the Requests that count, or counted last; 0 before the first.
    uint64_t operator_;
    // Where the bucket's teeth are; without a [mechanism] and in a replay nothing is known of them.
    HydraxisTeethState teeth;
    // What the command was made of; zero in a replay.
    HydraxisCommandInputs inputs;
} HydraxisValveCommand;
HYDRAXIS_ASSERT(offsetof(HydraxisValveCommand, header) == 0, "HydraxisValveCommand.header");
HYDRAXIS_ASSERT(offsetof(HydraxisValveCommand, axes) == 48, "HydraxisValveCommand.axes");
HYDRAXIS_ASSERT(offsetof(HydraxisValveCommand, cut_off) == 1712, "HydraxisValveCommand.cut_off");
HYDRAXIS_ASSERT(offsetof(HydraxisValveCommand, reserved) == 1716, "HydraxisValveCommand.reserved");
HYDRAXIS_ASSERT(offsetof(HydraxisValveCommand, operator_) == 1720, "HydraxisValveCommand.operator");
HYDRAXIS_ASSERT(offsetof(HydraxisValveCommand, teeth) == 1728, "HydraxisValveCommand.teeth");
HYDRAXIS_ASSERT(offsetof(HydraxisValveCommand, inputs) == 1792, "HydraxisValveCommand.inputs");
HYDRAXIS_ASSERT(sizeof(HydraxisValveCommand) == 1848, "HydraxisValveCommand");

typedef struct HydraxisCoefficients {
    // Order of A.
    uint32_t na;
    // Order of B.
    uint32_t nb;
    // Delay, samples.
    uint32_t nk;
    // Number of coefficients of N for each sign of u.
    uint32_t order;
    // Basis of N: 0 powers, 1 hinges at knots.
    uint32_t basis;
    // 1 when the model has a drift, else 0.
    uint32_t has_drift;
    // a_1 .. a_na.
    double a[7];
    // b_0 .. b_nb.
    double b[5];
    // f_1 .. f_r, for u >= 0.
    double f[5];
    // g_1 .. g_r, for u < 0.
    double g[5];
    // c, in the unit of the output per sample.
    double drift;
    // Dead band: largest magnitude below zero, and largest above zero, that does not open the valve.
    double dead_band[2];
    // Magnitudes of the command beyond the dead band at which the r hinges begin, rising.
    double knots[5];
} HydraxisCoefficients;
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, na) == 0, "HydraxisCoefficients.na");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, nb) == 4, "HydraxisCoefficients.nb");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, nk) == 8, "HydraxisCoefficients.nk");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, order) == 12, "HydraxisCoefficients.order");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, basis) == 16, "HydraxisCoefficients.basis");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, has_drift) == 20, "HydraxisCoefficients.has_drift");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, a) == 24, "HydraxisCoefficients.a");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, b) == 80, "HydraxisCoefficients.b");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, f) == 120, "HydraxisCoefficients.f");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, g) == 160, "HydraxisCoefficients.g");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, drift) == 200, "HydraxisCoefficients.drift");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, dead_band) == 208, "HydraxisCoefficients.dead_band");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficients, knots) == 224, "HydraxisCoefficients.knots");
HYDRAXIS_ASSERT(sizeof(HydraxisCoefficients) == 264, "HydraxisCoefficients");

typedef struct HydraxisModelErrors {
    // Output minus the prediction from the coefficients before it and the measured past.
    HydraxisErrorStatistics one_step;
    // Output minus the prediction made horizon samples before, with the coefficients held since then.
    HydraxisErrorStatistics h_step;
    // Output minus the output of the model when its own outputs have been fed back since the end of training.
    HydraxisErrorStatistics free_run;
} HydraxisModelErrors;
HYDRAXIS_ASSERT(offsetof(HydraxisModelErrors, one_step) == 0, "HydraxisModelErrors.one_step");
HYDRAXIS_ASSERT(offsetof(HydraxisModelErrors, h_step) == 32, "HydraxisModelErrors.h_step");
HYDRAXIS_ASSERT(offsetof(HydraxisModelErrors, free_run) == 64, "HydraxisModelErrors.free_run");
HYDRAXIS_ASSERT(sizeof(HydraxisModelErrors) == 96, "HydraxisModelErrors");

typedef struct HydraxisAxisSnapshot {
    // The adaptive model, updated online.
    HydraxisCoefficients adaptive;
    // The classical model, identified offline and held.
    HydraxisCoefficients classical;
    // Errors of adaptive.
    HydraxisModelErrors adaptive_errors;
    // Errors of classical.
    HydraxisModelErrors classical_errors;
    // h-step errors of the adaptive model's coefficients before they are separated into b, f and g: what the separation
    // costs. No program is given these coefficients.
    HydraxisErrorStatistics unseparated_h_step;
    // The output over these samples; the fit in percent needs its spread.
    HydraxisErrorStatistics output;
    // Output minus the output horizon samples before: the error of predicting no change.
    HydraxisErrorStatistics persistence;
    // 1 - forgetting factor over the updates: its max belongs to the smallest factor.
    HydraxisErrorStatistics forgetting;
    // Forgetting factor of the last update.
    double forgetting_factor;
    // Innovation of the last update: output minus one-step prediction.
    double innovation;
    // Innovation of the last update, divided by its usual size: about 1 for a healthy model.
    double innovation_ratio;
    // Largest magnitude of a pole of the adaptive model.
    double pole_radius;
    // Travel over the horizon after a step to the mean positive (0) and negative (1) command so far: travel of the
    // adaptive model divided by travel of the classical model.
    double gain_ratio[2];
    // Part of the recent samples in which a positive (0) or negative (1) command was in the regressor.
    double excitation[2];
    // Trace of the covariance.
    double covariance_trace;
    // Part of the weighted norm of the products f_i b_j that the separation into b, f, g does not explain; 0 for an
    // exact separation.
    double split_residual;
    // Lowest command that N was identified from: below it N is extrapolated.
    double command_low;
    // Highest command that N was identified from: above it N is extrapolated.
    double command_high;
    // Number of recursive updates.
    uint64_t updates;
    // Number of samples that could not be used (gap, fault, missing command).
    uint64_t skipped;
    // Number of outliers: samples too far from all predictions to be used.
    uint64_t outliers;
    // Number of samples since the last sample that updated the coefficients.
    uint64_t since_update;
    // Weights of the estimators that the estimator auto runs side by side, in the order of MEMBERS; their sum is 1. All
    // are 0 with another estimator, and before training has found a first model.
    double weights[11];
    // Length of the horizon, samples.
    uint32_t horizon;
    // Reasons to distrust the model, model_fault bits; 0 is healthy.
    uint32_t faults;
} HydraxisAxisSnapshot;
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, adaptive) == 0, "HydraxisAxisSnapshot.adaptive");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, classical) == 264, "HydraxisAxisSnapshot.classical");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, adaptive_errors) == 528, "HydraxisAxisSnapshot.adaptive_errors");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, classical_errors) == 624, "HydraxisAxisSnapshot.classical_errors");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, unseparated_h_step) == 720, "HydraxisAxisSnapshot.unseparated_h_step");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, output) == 752, "HydraxisAxisSnapshot.output");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, persistence) == 784, "HydraxisAxisSnapshot.persistence");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, forgetting) == 816, "HydraxisAxisSnapshot.forgetting");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, forgetting_factor) == 848, "HydraxisAxisSnapshot.forgetting_factor");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, innovation) == 856, "HydraxisAxisSnapshot.innovation");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, innovation_ratio) == 864, "HydraxisAxisSnapshot.innovation_ratio");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, pole_radius) == 872, "HydraxisAxisSnapshot.pole_radius");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, gain_ratio) == 880, "HydraxisAxisSnapshot.gain_ratio");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, excitation) == 896, "HydraxisAxisSnapshot.excitation");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, covariance_trace) == 912, "HydraxisAxisSnapshot.covariance_trace");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, split_residual) == 920, "HydraxisAxisSnapshot.split_residual");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, command_low) == 928, "HydraxisAxisSnapshot.command_low");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, command_high) == 936, "HydraxisAxisSnapshot.command_high");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, updates) == 944, "HydraxisAxisSnapshot.updates");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, skipped) == 952, "HydraxisAxisSnapshot.skipped");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, outliers) == 960, "HydraxisAxisSnapshot.outliers");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, since_update) == 968, "HydraxisAxisSnapshot.since_update");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, weights) == 976, "HydraxisAxisSnapshot.weights");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, horizon) == 1064, "HydraxisAxisSnapshot.horizon");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisSnapshot, faults) == 1068, "HydraxisAxisSnapshot.faults");
HYDRAXIS_ASSERT(sizeof(HydraxisAxisSnapshot) == 1072, "HydraxisAxisSnapshot");

typedef struct HydraxisCoefficientSnapshot {
    // sequence names the last sample that updated the coefficients.
    HydraxisHeader header;
    // One entry per axis.
    HydraxisAxisSnapshot axes[8];
} HydraxisCoefficientSnapshot;
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficientSnapshot, header) == 0, "HydraxisCoefficientSnapshot.header");
HYDRAXIS_ASSERT(offsetof(HydraxisCoefficientSnapshot, axes) == 48, "HydraxisCoefficientSnapshot.axes");
HYDRAXIS_ASSERT(sizeof(HydraxisCoefficientSnapshot) == 8624, "HydraxisCoefficientSnapshot");

typedef struct HydraxisReference {
    // sequence is the tick that the first reference is meant for; it must not go back.
    HydraxisHeader header;
    // References per axis, m: entry i is for tick sequence + i.
    double positions[8][32];
    // Number of references per axis, 1 to MAX_PREVIEW.
    uint32_t preview;
    // Zero.
    uint32_t reserved;
} HydraxisReference;
HYDRAXIS_ASSERT(offsetof(HydraxisReference, header) == 0, "HydraxisReference.header");
HYDRAXIS_ASSERT(offsetof(HydraxisReference, positions) == 48, "HydraxisReference.positions");
HYDRAXIS_ASSERT(offsetof(HydraxisReference, preview) == 2096, "HydraxisReference.preview");
HYDRAXIS_ASSERT(offsetof(HydraxisReference, reserved) == 2100, "HydraxisReference.reserved");
HYDRAXIS_ASSERT(sizeof(HydraxisReference) == 2104, "HydraxisReference");

typedef struct HydraxisAxisRequest {
    // Mode that is asked for, an AxisMode as number.
    uint32_t mode;
    // Arms an axis that is off when this number differs from the one in the message before of the same session. So
    // neither the first message of a program nor a repeated one arms an axis.
    uint32_t enable;
    // Valve command in [-1, 1], positive extends; only for the modes manual and commission.
    double command;
    // Set point, m; only for the mode hold.
    double target;
    // 1 when there is a set point; with 0 the axis holds the position at which it comes to a stand.
    uint32_t has_target;
    // 1 to disarm the axis when the messages of this session stop, in every mode; 0 only in the modes manual and
    // commission.
    uint32_t hold_to_run;
    // Gains of the fallback from now on, as a part of those in the machine file; 0 leaves them as they are. Only for an
    // axis that is not armed, within AxisState::gain_range, and not in the first message of a session. With the mode
    // off it is not looked at.
    double gain;
} HydraxisAxisRequest;
HYDRAXIS_ASSERT(offsetof(HydraxisAxisRequest, mode) == 0, "HydraxisAxisRequest.mode");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisRequest, enable) == 4, "HydraxisAxisRequest.enable");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisRequest, command) == 8, "HydraxisAxisRequest.command");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisRequest, target) == 16, "HydraxisAxisRequest.target");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisRequest, has_target) == 24, "HydraxisAxisRequest.has_target");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisRequest, hold_to_run) == 28, "HydraxisAxisRequest.hold_to_run");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisRequest, gain) == 32, "HydraxisAxisRequest.gain");
HYDRAXIS_ASSERT(sizeof(HydraxisAxisRequest) == 40, "HydraxisAxisRequest");

typedef struct HydraxisRequest {
    // sequence is the newest sample that the program has read; it shows how old the request is.
    HydraxisHeader header;
    // Number that differs from those of all programs before, such as the time of the program's start, ns.
    uint64_t session;
    // 1 to take the place of a program that operates now. That one's requests have no effect any more.
    uint32_t takes_over;
    // 0.
    uint32_t reserved;
    // One entry per axis; an entry of zeros asks for nothing.
    HydraxisAxisRequest axes[8];
} HydraxisRequest;
HYDRAXIS_ASSERT(offsetof(HydraxisRequest, header) == 0, "HydraxisRequest.header");
HYDRAXIS_ASSERT(offsetof(HydraxisRequest, session) == 48, "HydraxisRequest.session");
HYDRAXIS_ASSERT(offsetof(HydraxisRequest, takes_over) == 56, "HydraxisRequest.takes_over");
HYDRAXIS_ASSERT(offsetof(HydraxisRequest, reserved) == 60, "HydraxisRequest.reserved");
HYDRAXIS_ASSERT(offsetof(HydraxisRequest, axes) == 64, "HydraxisRequest.axes");
HYDRAXIS_ASSERT(sizeof(HydraxisRequest) == 384, "HydraxisRequest");

typedef struct HydraxisMissedDeadlines {
    // MissCause::LateInput.
    uint64_t late_input;
    // MissCause::LateRelease.
    uint64_t late_release;
    // MissCause::LongWork.
    uint64_t long_work;
    // Tick of the last miss.
    uint64_t last_tick;
    // Cause of the last miss, a MissCause as number; 0 before the first miss.
    uint32_t last_cause;
    // Zero.
    uint32_t reserved;
} HydraxisMissedDeadlines;
HYDRAXIS_ASSERT(offsetof(HydraxisMissedDeadlines, late_input) == 0, "HydraxisMissedDeadlines.late_input");
HYDRAXIS_ASSERT(offsetof(HydraxisMissedDeadlines, late_release) == 8, "HydraxisMissedDeadlines.late_release");
HYDRAXIS_ASSERT(offsetof(HydraxisMissedDeadlines, long_work) == 16, "HydraxisMissedDeadlines.long_work");
HYDRAXIS_ASSERT(offsetof(HydraxisMissedDeadlines, last_tick) == 24, "HydraxisMissedDeadlines.last_tick");
HYDRAXIS_ASSERT(offsetof(HydraxisMissedDeadlines, last_cause) == 32, "HydraxisMissedDeadlines.last_cause");
HYDRAXIS_ASSERT(offsetof(HydraxisMissedDeadlines, reserved) == 36, "HydraxisMissedDeadlines.reserved");
HYDRAXIS_ASSERT(sizeof(HydraxisMissedDeadlines) == 40, "HydraxisMissedDeadlines");

typedef struct HydraxisChannelHealth {
    // Which channel, its index in CHANNELS.
    uint32_t channel;
    // 1 after the first message; before it 0.
    uint32_t any;
    // Number of messages read.
    uint64_t received;
    // Number of lost messages: sent and never read, by the gaps in their numbers.
    uint64_t lost;
    // Number of restarts of its publisher.
    uint64_t restarts;
    // Number of messages about another machine, which were not read.
    uint64_t foreign;
    // Age of the newest message's sample at this heartbeat, ns.
    uint64_t age_ns;
    // Longest time between the samples of two messages in a row, ns.
    uint64_t longest_gap_ns;
} HydraxisChannelHealth;
HYDRAXIS_ASSERT(offsetof(HydraxisChannelHealth, channel) == 0, "HydraxisChannelHealth.channel");
HYDRAXIS_ASSERT(offsetof(HydraxisChannelHealth, any) == 4, "HydraxisChannelHealth.any");
HYDRAXIS_ASSERT(offsetof(HydraxisChannelHealth, received) == 8, "HydraxisChannelHealth.received");
HYDRAXIS_ASSERT(offsetof(HydraxisChannelHealth, lost) == 16, "HydraxisChannelHealth.lost");
HYDRAXIS_ASSERT(offsetof(HydraxisChannelHealth, restarts) == 24, "HydraxisChannelHealth.restarts");
HYDRAXIS_ASSERT(offsetof(HydraxisChannelHealth, foreign) == 32, "HydraxisChannelHealth.foreign");
HYDRAXIS_ASSERT(offsetof(HydraxisChannelHealth, age_ns) == 40, "HydraxisChannelHealth.age_ns");
HYDRAXIS_ASSERT(offsetof(HydraxisChannelHealth, longest_gap_ns) == 48, "HydraxisChannelHealth.longest_gap_ns");
HYDRAXIS_ASSERT(sizeof(HydraxisChannelHealth) == 56, "HydraxisChannelHealth");

typedef struct HydraxisPercentiles {
    // Number of values, values beyond the range included.
    uint64_t count;
    // Median.
    uint64_t p50;
    // 99 %.
    uint64_t p99;
    // 99.9 %.
    uint64_t p99_9;
    // 99.99 %.
    uint64_t p99_99;
    // Largest value, exact also when it is beyond the histogram's range.
    uint64_t max;
    // Number of values beyond the histogram's range.
    uint64_t beyond;
} HydraxisPercentiles;
HYDRAXIS_ASSERT(offsetof(HydraxisPercentiles, count) == 0, "HydraxisPercentiles.count");
HYDRAXIS_ASSERT(offsetof(HydraxisPercentiles, p50) == 8, "HydraxisPercentiles.p50");
HYDRAXIS_ASSERT(offsetof(HydraxisPercentiles, p99) == 16, "HydraxisPercentiles.p99");
HYDRAXIS_ASSERT(offsetof(HydraxisPercentiles, p99_9) == 24, "HydraxisPercentiles.p99_9");
HYDRAXIS_ASSERT(offsetof(HydraxisPercentiles, p99_99) == 32, "HydraxisPercentiles.p99_99");
HYDRAXIS_ASSERT(offsetof(HydraxisPercentiles, max) == 40, "HydraxisPercentiles.max");
HYDRAXIS_ASSERT(offsetof(HydraxisPercentiles, beyond) == 48, "HydraxisPercentiles.beyond");
HYDRAXIS_ASSERT(sizeof(HydraxisPercentiles) == 56, "HydraxisPercentiles");

typedef struct HydraxisStageHealth {
    // sequence is the last tick worked; sent_ns is the heartbeat.
    HydraxisHeader header;
    // Which stage: its number in StageKind, in the order of the data.
    uint32_t stage;
    // What the stage is doing, a StageState as number.
    uint32_t state;
    // Process id of the stage.
    uint32_t pid;
    // Number of channels that the stage reads.
    uint32_t channel_count;
    // Time since which the figures below count, ns of CLOCK_MONOTONIC: the start, or the last reset.
    uint64_t since_ns;
    // Number of ticks worked since then.
    uint64_t samples;
    // Number of samples with a fault bit since then (sensor-proc only).
    uint64_t implausible;
    // Missed ticks since then.
    HydraxisMissedDeadlines missed;
    // The channels that the stage reads, channel_count of them.
    HydraxisChannelHealth channels[4];
    // Time from sending an input to picking it up, ns.
    HydraxisPercentiles wait;
    // Time from picking up an input to sending the output, ns.
    HydraxisPercentiles work;
    // Time from the acquisition of a sample to sending its command, ns (control-proc only).
    HydraxisPercentiles end_to_end;
    // Lateness of the timer against the intended time, ns (stages with a timer only).
    HydraxisPercentiles release_jitter;
} HydraxisStageHealth;
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, header) == 0, "HydraxisStageHealth.header");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, stage) == 48, "HydraxisStageHealth.stage");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, state) == 52, "HydraxisStageHealth.state");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, pid) == 56, "HydraxisStageHealth.pid");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, channel_count) == 60, "HydraxisStageHealth.channel_count");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, since_ns) == 64, "HydraxisStageHealth.since_ns");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, samples) == 72, "HydraxisStageHealth.samples");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, implausible) == 80, "HydraxisStageHealth.implausible");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, missed) == 88, "HydraxisStageHealth.missed");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, channels) == 128, "HydraxisStageHealth.channels");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, wait) == 352, "HydraxisStageHealth.wait");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, work) == 408, "HydraxisStageHealth.work");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, end_to_end) == 464, "HydraxisStageHealth.end_to_end");
HYDRAXIS_ASSERT(offsetof(HydraxisStageHealth, release_jitter) == 520, "HydraxisStageHealth.release_jitter");
HYDRAXIS_ASSERT(sizeof(HydraxisStageHealth) == 576, "HydraxisStageHealth");

typedef struct HydraxisAxisState {
    // Name of the axis in UTF-8, cut to the length of the array and filled up with zeros.
    uint8_t name[32];
    // Newest sample of the axis.
    HydraxisAxisSample sample;
    // Newest command of the axis.
    HydraxisAxisCommand command;
    // Forgetting factor of the newest snapshot; 0 before the first snapshot.
    double forgetting_factor;
    // Standard deviation of the adaptive model's h-step error, in the unit of the identified output.
    double h_step_sigma;
    // Age of the newest snapshot's sample at this heartbeat, ns.
    uint64_t model_age_ns;
    // Reasons to distrust the model, super::model_fault bits.
    uint32_t model_faults;
    // 1 after the first snapshot; before it 0.
    uint32_t has_model;
    // Least and largest AxisCommand::gain that a request may ask for: the loop on the commissioned model keeps its
    // margins. Both are 1 without such a model.
    double gain_range[2];
} HydraxisAxisState;
HYDRAXIS_ASSERT(offsetof(HydraxisAxisState, name) == 0, "HydraxisAxisState.name");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisState, sample) == 32, "HydraxisAxisState.sample");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisState, command) == 80, "HydraxisAxisState.command");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisState, forgetting_factor) == 288, "HydraxisAxisState.forgetting_factor");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisState, h_step_sigma) == 296, "HydraxisAxisState.h_step_sigma");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisState, model_age_ns) == 304, "HydraxisAxisState.model_age_ns");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisState, model_faults) == 312, "HydraxisAxisState.model_faults");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisState, has_model) == 316, "HydraxisAxisState.has_model");
HYDRAXIS_ASSERT(offsetof(HydraxisAxisState, gain_range) == 320, "HydraxisAxisState.gain_range");
HYDRAXIS_ASSERT(sizeof(HydraxisAxisState) == 336, "HydraxisAxisState");

typedef struct HydraxisMachineState {
    // sequence names the sample.
    HydraxisHeader header;
    // One entry per axis.
    HydraxisAxisState axes[8];
    // Where the bucket's teeth are.
    HydraxisTeethState teeth;
} HydraxisMachineState;
HYDRAXIS_ASSERT(offsetof(HydraxisMachineState, header) == 0, "HydraxisMachineState.header");
HYDRAXIS_ASSERT(offsetof(HydraxisMachineState, axes) == 48, "HydraxisMachineState.axes");
HYDRAXIS_ASSERT(offsetof(HydraxisMachineState, teeth) == 2736, "HydraxisMachineState.teeth");
HYDRAXIS_ASSERT(sizeof(HydraxisMachineState) == 2800, "HydraxisMachineState");

#endif
