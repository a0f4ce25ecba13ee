//! A group in lock-step whose plant is the test's: it says what the encoders read, and sees what comes of it.

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

/// m per count.
pub const RESOLUTION: f64 = 1e-4;
/// Ticks per second.
pub const RATE: f64 = 100.0;

/// The stages but for plant-sim, and in its place an integrator with a dead band for each axis.
pub struct Scripted {
    readings: Publisher<EncoderReading>,
    commands: Reader<ValveCommand>,
    snapshots: Reader<CoefficientSnapshot>,
    references: Publisher<Reference>,
    requests: Publisher<Request>,
    /// Where the pistons are, m.
    pub positions: [f64; AXES],
    /// Speed at full command, m/s.
    pub speed: f64,
    /// What is asked of the axes with every tick, if anything is.
    pub request: Option<Request>,
    /// The next tick.
    pub tick: u64,
    // Last: whoever is still a member when the group is dropped keeps its files.
    _channels: Group,
    group: TestGroup,
}

impl Scripted {
    /// Armed or off as `arguments` say, to end after `ticks`.
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
        }
    }

    /// Works one tick; `fault` changes what the encoders say.
    pub fn step(&mut self, fault: impl FnOnce(&mut EncoderReading)) -> ValveCommand {
        let mut reading = EncoderReading::default();
        for (encoder, position) in reading.encoders.iter_mut().zip(self.positions) {
            encoder.counts = (position / RESOLUTION).round() as i64;
        }
        fault(&mut reading);
        if let Some(request) = self.request {
            send(&self.requests, request, self.tick);
        }
        send(&self.readings, reading, self.tick);
        let command: ValveCommand = receive(&mut self.commands, self.tick, || self.readings.greet());
        receive(&mut self.snapshots, self.tick, || self.readings.greet());
        for (position, axis) in self.positions.iter_mut().zip(&command.axes) {
            assert!((-1.0..=1.0).contains(&axis.command), "tick {}: {}", self.tick, axis.command);
            *position += self.speed / RATE * moving(axis.command);
        }
        self.tick += 1;
        command
    }

    /// The same for several ticks without a fault; the last command.
    pub fn steps(&mut self, ticks: u64) -> ValveCommand {
        (0..ticks).map(|_| self.step(|_| ())).last().unwrap()
    }

    /// Sends targets for the coming tick and those after it, the same for all axes.
    pub fn refer(&self, targets: &[f64]) {
        let mut reference = Reference { preview: targets.len() as u32, ..Reference::default() };
        reference.positions[..AXES].iter_mut().for_each(|axis| axis[..targets.len()].copy_from_slice(targets));
        send(&self.references, reference, self.tick);
    }

    /// Asks one mode of all axes from now on, with an edge that enables.
    pub fn ask(&mut self, mode: AxisMode, command: f64, target: Option<f64>) {
        let request = self.request.get_or_insert(Request { session: 1, ..Request::default() });
        for axis in &mut request.axes[..AXES] {
            axis.mode = mode as u32;
            axis.enable += 1;
            axis.command = command;
            (axis.target, axis.has_target) = (target.unwrap_or_default(), u32::from(target.is_some()));
        }
    }

    /// Ends the stages, which must have had all their ticks.
    pub fn end(mut self) {
        self.group.expect_end();
    }
}

/// What of a command moves the scripted axis.
pub fn moving(command: f64) -> f64 {
    command.signum() * (command.abs() - 0.1).max(0.0) / 0.9
}

/// Whether an axis is neutral and latched by this cause, whatever else is said of it.
pub fn is_latched(axis: &AxisCommand, cause: u32) -> bool {
    axis.command == 0.0 && axis.flags & control_flag::LATCHED & cause != 0
}

/// Settings that let every axis take its targets from the channel.
pub fn from_channel() -> Vec<String> {
    let settings = ["boom", "arm", "telescope", "bucket"].map(|axis| format!("axis.{axis}.reference.kind=channel"));
    settings.into_iter().flat_map(|setting| ["--set".to_owned(), setting]).collect()
}
