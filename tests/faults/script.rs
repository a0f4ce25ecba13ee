//! A group in lock-step whose plant is played by the test: it sends the readings and receives the commands.

use pipeline::{
    channel::{Group, Publisher, Reader},
    message::{
        AxisCommand, AxisMode, CoefficientSnapshot, EncoderReading, Reference, Request, ValveCommand, control_flag,
    },
    stage::StageKind,
};

use crate::harness::{
    TestGroup,
    channel::{AXES, receive, send},
};

/// Resolution of the encoders, m per count.
pub const RESOLUTION: f64 = 1e-4;
/// Ticks per second.
pub const RATE: f64 = 100.0;

/// All stages but plant-sim, and in its place an integrator with a dead band for each axis.
pub struct Scripted {
    readings: Publisher<EncoderReading>,
    commands: Reader<ValveCommand>,
    snapshots: Reader<CoefficientSnapshot>,
    references: Publisher<Reference>,
    requests: Publisher<Request>,
    /// Positions of the pistons, m.
    pub positions: [f64; AXES],
    /// Speed at full command, m/s.
    pub speed: f64,
    /// Request that is sent at every tick, if there is one.
    pub request: Option<Request>,
    /// The next tick.
    pub tick: u64,
    /// The machine, as the commands name it.
    machine: u32,
    // Dropped after all readers and publishers: a member that is left would keep the files of the group.
    _channels: Group,
    group: TestGroup,
}

impl Scripted {
    /// Starts the stages with these arguments. They end after `ticks`.
    pub fn start(test: &str, ticks: u64, arguments: &[&str]) -> Self {
        let mut group = TestGroup::new(test);
        let channels = group.join();
        let readings = channels.publisher().unwrap();
        let (commands, snapshots) = (channels.reader().unwrap(), channels.reader().unwrap());
        let (references, requests) = (channels.publisher().unwrap(), channels.publisher().unwrap());
        let ticks = ticks.to_string();
        group.start_all_but(StageKind::PlantSim, &[&["--lockstep", "--ticks", &ticks], arguments].concat());
        Self {
            group,
            readings,
            commands,
            snapshots,
            references,
            requests,
            _channels: channels,
            positions: [0.65, 0.75, 0.6, 0.55],
            speed: 0.5,
            request: None,
            tick: 0,
            machine: 0,
        }
    }

    /// Works one tick. `fault` changes the reading.
    pub fn step(&mut self, fault: impl FnOnce(&mut EncoderReading)) -> ValveCommand {
        let mut reading = EncoderReading::default();
        for (encoder, position) in reading.encoders.iter_mut().zip(self.positions) {
            encoder.counts = (position / RESOLUTION).round() as i64;
        }
        fault(&mut reading);
        if let Some(mut request) = self.request {
            request.header.machine = self.machine;
            send(&self.requests, request, self.tick);
        }
        send(&self.readings, reading, self.tick);
        let command: ValveCommand = receive(&mut self.commands, self.tick, || self.readings.greet());
        receive(&mut self.snapshots, self.tick, || self.readings.greet());
        for (position, axis) in self.positions.iter_mut().zip(&command.axes) {
            assert!((-1.0..=1.0).contains(&axis.command), "tick {}: {}", self.tick, axis.command);
            *position += self.speed / RATE * moving(axis.command);
        }
        self.machine = command.header.machine;
        self.tick += 1;
        command
    }

    /// Works several ticks without a fault. Returns the last command.
    pub fn steps(&mut self, ticks: u64) -> ValveCommand {
        (0..ticks).map(|_| self.step(|_| ())).last().unwrap()
    }

    /// Sends references for the coming tick and those after it, equal for all axes.
    pub fn refer(&self, targets: &[f64]) {
        let mut reference = Reference { preview: targets.len() as u32, ..Reference::default() };
        reference.header.machine = self.machine;
        reference.positions[..AXES].iter_mut().for_each(|axis| axis[..targets.len()].copy_from_slice(targets));
        send(&self.references, reference, self.tick);
    }

    /// Requests one mode for all axes from now on, and arms them.
    pub fn ask(&mut self, mode: AxisMode, command: f64, target: Option<f64>) {
        let request = self.request.get_or_insert(Request { session: 1, ..Request::default() });
        for axis in &mut request.axes[..AXES] {
            axis.mode = mode as u32;
            axis.enable += 1;
            axis.command = command;
            (axis.target, axis.has_target) = (target.unwrap_or_default(), u32::from(target.is_some()));
        }
    }

    /// Waits for the end of the stages, after the last tick.
    pub fn end(mut self) {
        self.group.expect_end();
    }
}

/// The part of a command that moves the scripted axis: beyond its dead band of 0.1, scaled to 1.
pub fn moving(command: f64) -> f64 {
    command.signum() * (command.abs() - 0.1).max(0.0) / 0.9
}

/// Whether an axis is neutral and latched by this cause; it may have other flags too.
pub fn is_latched(axis: &AxisCommand, cause: u32) -> bool {
    axis.command == 0.0 && axis.flags & control_flag::LATCHED & cause != 0
}

/// Settings by which every axis takes its reference from the channel.
pub fn from_channel() -> Vec<String> {
    let settings = ["boom", "arm", "telescope", "bucket"].map(|axis| format!("axis.{axis}.reference.kind=channel"));
    settings.into_iter().flat_map(|setting| ["--set".to_owned(), setting]).collect()
}
