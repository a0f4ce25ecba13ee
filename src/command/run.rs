//! `hydraxis run`: starts one process for each stage, watches them, and reports.
//!
//! This process runs beside the loop. It reads channels that no stage waits for.

use std::{
    net::SocketAddr,
    path::PathBuf,
    sync::Arc,
    time::{Duration, Instant},
};

use clap::Args;
use pipeline::{
    channel::{ChannelError, Claim, Group, Prefix},
    machine::{Drive, Machine, Source},
    stage::{Clock, SUPERVISOR, StageKind, StageOptions},
};

use super::{check, record::size, report, simulate::ticks};
use crate::{
    arguments::{
        MachineFile, load,
        values::{duration, whole},
        with_scenarios,
    },
    failure::{Failure, Failures},
    group::{
        monitor::Monitor,
        page::{self, LISTEN, Page},
        preflight::{PreflightError, folders, new_file, programs, rights},
        recorder::LockStepRecorder,
        running::leave,
        supervisor::{Launch, Supervisor},
    },
    model::learned,
    recording::{Facts, LIMIT, LOCK_STEP, default_folder, recordings_folder, store::Place},
    report::{
        control_loop::{LastMessages, LoopReport},
        output::Output,
    },
};

/// Time in which the other stages must end after the last tick.
const END_PATIENCE: Duration = Duration::from_secs(2);
/// Time without a tick after which the run is given up. Where it is longer, [`STALL_PERIODS`] counts.
const STALL_PATIENCE: Duration = Duration::from_secs(10);
/// Periods without a tick after which the run is given up.
const STALL_PERIODS: u32 = 3;

/// `run`.
#[derive(Debug, Args)]
#[command(after_help = with_scenarios("\
Examples:
  hydraxis run                                        the built-in excavator in real time, 20 s
  hydraxis run --lockstep --duration 60s --seed 7     as fast as the computer allows, bit for bit repeatable
  hydraxis run --lockstep --record run.mcap           the same, recorded whole: hydraxis replay run.mcap --verify
  hydraxis run --scenario payload                     with a load that grows during the run
  hydraxis run my.toml --set axis.boom.identification.estimator=constant:0.995 --json out.json

Starts plant-sim, sensor-proc, ident-proc and control-proc as processes of their own, shows a line for each axis
on a terminal, and ends with tables of tracking errors, identification errors, losses and latencies. Ctrl-C ends the
run in order, with neutral valves. A real machine does not move before `hydraxis arm`."))]
pub struct RunArguments {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// Length of the run [default: 20s for a simulated machine, the whole record for a replayed one, without end for an
    /// external one]
    #[arg(long, value_parser = duration, allow_hyphen_values = true)]
    pub duration: Option<Duration>,
    /// Lock-step instead of real time: the next tick begins when all stages have answered the last one
    #[arg(long)]
    pub lockstep: bool,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1, value_parser = whole, allow_hyphen_values = true)]
    pub seed: u64,
    /// Start the identification from what the last run in real time of this machine has learned; without it from what
    /// commissioning has measured
    #[arg(long)]
    pub warm: bool,
    /// Name of the group and of its channels [default: a name that no other run has]
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// Start with all axes disarmed, until `hydraxis arm`, `operate` or `commission` arms them
    #[arg(long)]
    pub off: bool,
    /// Write the figures as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Also write the output of supervisor and stages, with times, to a new file in this folder
    #[arg(long, value_name = "DIR")]
    pub log_folder: Option<PathBuf>,
    /// Folder for the black box, a file with the last 10 s of all channels that is written when a fault latches an axis
    /// or a stage dies; the newest 20 are kept [default: $STATE_DIRECTORY, $XDG_STATE_HOME/hydraxis or
    /// ~/.local/state/hydraxis]
    #[arg(long, value_name = "DIR")]
    pub black_box: Option<PathBuf>,
    /// Also show the run as a page for browsers, as `hydraxis monitor` does; port 0 takes a free one
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, require_equals = true, default_missing_value = LISTEN)]
    pub monitor: Option<SocketAddr>,
    /// Let the page operate axes, as `hydraxis monitor --allow-control` does
    #[arg(long, requires = "monitor")]
    pub allow_control: bool,
    /// Write no black box; a run in lock-step writes none, since it can be repeated
    #[arg(long, conflicts_with = "black_box")]
    pub no_black_box: bool,
    /// Record all channels to one new file, of any length; in lock-step without a gap, for `hydraxis replay` [default:
    /// files in $HYDRAXIS_RECORDINGS, $STATE_DIRECTORY, $XDG_STATE_HOME/hydraxis or ~/.local/state/hydraxis, of which
    /// the oldest ones are removed; in lock-step none]
    #[arg(long, value_name = "FILE.mcap", conflicts_with = "no_record")]
    pub record: Option<PathBuf>,
    /// Also write the page about the recording that `hydraxis report` makes
    #[arg(long, value_name = "FILE.html", requires = "record")]
    pub report: Option<PathBuf>,
    /// Most bytes of all recordings in the folder, such as 500MB or 2GB
    #[arg(long, value_name = "SIZE", default_value = LIMIT, value_parser = size, conflicts_with = "record")]
    pub record_limit: u64,
    /// Record nothing, as HYDRAXIS_RECORDINGS=off does; a run in lock-step is recorded with --record only
    #[arg(long)]
    pub no_record: bool,
}

impl RunArguments {
    /// Where the run is recorded, if it is.
    fn recorded_to(&self) -> Option<Place> {
        if self.no_record || self.lockstep {
            return None;
        }
        let folder = || recordings_folder().map(|folder| Place::Folder(folder, self.record_limit));
        self.record.clone().map(Place::File).or_else(folder)
    }
}

/// Runs the command.
pub fn run(arguments: &RunArguments) -> Result<(), Failure> {
    let clock = if arguments.lockstep { Clock::LockStep } else { Clock::RealTime };
    let prefix = arguments.prefix.clone().unwrap_or_else(Prefix::of_this_process);
    let Checked { machine, file, ticks, warnings, claim } = checked(arguments, clock, &prefix)?;
    let output = Output::open(arguments.json.as_deref())?;
    let is_simulated = machine.source == Source::Sim;
    let options = StageOptions {
        prefix,
        clock,
        ticks,
        seed: arguments.seed,
        // Only a simulated machine moves without being armed by a person.
        arm: is_simulated && !arguments.off,
        first_tick: 0,
        is_recorded: arguments.lockstep && arguments.record.is_some(),
        warn: true,
        stop: Arc::default(),
        reset: Arc::default(),
        off: Arc::default(),
    };
    let wiring = (machine.source == Source::Can).then(|| can_proc::number(&machine).ok()).flatten();
    let launch = Launch { machine: &machine, arguments: &file, options: &options, wiring };
    let result = run_group(&launch, arguments, &warnings);
    // A client that is still attached keeps the files; the next run of this name removes them.
    let _ = claim.remove_leftovers();
    drop(claim);
    // A run that has failed has a page as well.
    let page =
        arguments.record.as_deref().zip(arguments.report.as_deref()).map(|(file, page)| report::write(file, page));
    let Ended { report, is_interrupted } = result?;
    output.write_or_keep(|| report.tables(&machine), &report, is_interrupted)?;
    if let Some(said) = page.transpose()? {
        eprint!("{said}");
    }
    report.verdict().map_err(Failure::run)
}

/// What a run needs before its first process starts.
struct Checked {
    machine: Machine,
    /// What the machine was made of.
    file: MachineFile,
    /// None runs until a signal.
    ticks: Option<u64>,
    warnings: Vec<String>,
    claim: Claim,
}

/// What the run needs; or everything that is wrong, before the first process starts.
fn checked(arguments: &RunArguments, clock: Clock, prefix: &Prefix) -> Result<Checked, Failure> {
    let mut failures = Failures::default();
    let claim = failures.take(Claim::take(prefix).map_err(PreflightError::from));
    failures.extend(folders(prefix, claim.as_ref(), arguments.log_folder.as_deref()));
    if let Some(Err(error)) = arguments.monitor.map(page::check) {
        let allowed = "allowed: an address of this computer with a free port, such as 127.0.0.1:0";
        failures.extend([Failure::usage(format!("--monitor: the address cannot be used ({error}); {allowed}"))]);
    }
    let controlled = arguments.monitor.filter(|_| arguments.allow_control);
    failures.extend(controlled.and_then(page::refuse_control).map(Failure::usage));
    failures.extend(arguments.record.as_deref().and_then(|file| new_file("--record", file).err()));
    failures.extend(arguments.report.as_deref().and_then(|file| new_file("--report", file).err()));
    let mut file = arguments.machine.clone();
    let mut machine = failures.take(load(&file));
    if let Some(cold) = machine.take_if(|_| arguments.warm) {
        // What is typed wins.
        let learned = failures.take(learned::settings(&default_folder(), &cold));
        file.bare.settings.splice(..0, learned.unwrap_or_default());
        machine = failures.take(load(&file));
    }
    let (mut count, mut warnings) = (None, Vec::new());
    if let Some(machine) = &machine {
        let name = &machine.scenario.name;
        if !machine.scenario.commands.is_empty() {
            failures.extend([Failure::usage(format!(
                "scenario \"{name}\" is an open loop, without a controller; type: hydraxis simulate --scenario {name}"
            ))]);
        }
        let rows = failures.take(check::deep(machine));
        failures.take(check::expect_controllable(machine));
        if machine.source.is_real() && clock == Clock::LockStep {
            failures.extend([Failure::usage(format!(
                "--lockstep: found a machine with source.kind \"{}\", whose time nobody can hold; allowed: \
                 \"sim\", with stage.plant-sim.command for a program that simulates in lock-step",
                machine.source.kind()
            ))]);
        }
        count = match (&machine.source, arguments.duration) {
            (Source::External | Source::Can, None) => Some(None),
            (_, duration) => rows.and_then(|rows| failures.take(ticks(machine, rows, duration))).map(Some),
        };
        let (followers, head) = stages(machine, clock);
        failures.extend(programs(machine, followers.into_iter().chain([head])));
        let (missing, others) = rights(machine, clock);
        failures.extend(missing);
        warnings = others;
        warnings.extend(check::warnings(machine));
    }
    let all = machine.zip(count).zip(claim);
    failures.verdict(all).map(|((machine, ticks), claim)| Checked { machine, file, ticks, warnings, claim })
}

/// The stages of a run: those that wait for input, and the one that all wait for, which is started last.
fn stages(machine: &Machine, clock: Clock) -> (Vec<StageKind>, StageKind) {
    use StageKind::{ControlProc, IdentProc, PlantSim, SensorProc};
    let program = machine.stage(PlantSim).command.iter().map(|_| PlantSim);
    match (&machine.source, machine.drive, clock) {
        (Source::Replay(_), ..) => (vec![IdentProc], SensorProc),
        (Source::External, Drive::None, _) => (program.chain([IdentProc]).collect(), SensorProc),
        (Source::External, ..) => (program.chain([IdentProc, ControlProc]).collect(), SensorProc),
        (Source::Can, Drive::None, _) => (vec![PlantSim, IdentProc], SensorProc),
        (Source::Can, ..) => (vec![PlantSim, IdentProc, ControlProc], SensorProc),
        (Source::Sim, _, Clock::LockStep) => (vec![SensorProc, IdentProc, ControlProc], PlantSim),
        (Source::Sim, _, Clock::RealTime) => (vec![PlantSim, IdentProc, ControlProc], SensorProc),
    }
}

/// A run that has ended.
struct Ended {
    report: LoopReport,
    /// A signal has ended it.
    is_interrupted: bool,
}

/// Runs the group from its first process to its last message.
fn run_group(launch: &Launch<'_>, arguments: &RunArguments, warnings: &[String]) -> Result<Ended, Failure> {
    let &Launch { machine, arguments: file, options, .. } = launch;
    let group = Group::join(&options.prefix, SUPERVISOR).map_err(ChannelError::from)?;
    let has_black_box = options.clock == Clock::RealTime && !arguments.no_black_box;
    let mut monitor = Monitor::new(&group, machine)?;
    leave(&options.prefix, file, facts(machine, options))?;
    let mut supervisor = Supervisor::new(*launch, &group, arguments.log_folder.as_deref())?;
    if has_black_box {
        supervisor.keep_black_box(arguments.black_box.clone().unwrap_or_else(default_folder), &mut monitor);
    }
    let scenario = &machine.scenario.name;
    let scenario = if machine.source == Source::Sim { format!(", scenario \"{scenario}\"") } else { String::new() };
    supervisor.say(format!("{}{scenario}: group \"{}\", Ctrl-C ends it", machine.name, options.prefix));
    if machine.drive.is_real() {
        supervisor.say(format!("no axis moves before: hydraxis arm --prefix {}", options.prefix));
    }
    for warning in warnings {
        supervisor.say(format!("warning: {warning}"));
    }
    if let Some(place) = arguments.recorded_to() {
        supervisor.record(place);
    }
    let whole = arguments.record.as_deref().filter(|_| arguments.lockstep);
    let recorder = whole.map(|file| LockStepRecorder::start(&options.prefix, file)).transpose()?;
    let page =
        arguments.monitor.and_then(|address| match Page::start(&options.prefix, address, arguments.allow_control) {
            Ok((page, line)) => {
                supervisor.say(line);
                Some(page)
            }
            Err(error) => {
                supervisor.say(format!("warning: --monitor: {error}; the group runs without a page"));
                None
            }
        });
    let watched = start_and_watch(machine, options, &mut monitor, &mut supervisor);
    // A stage that does not end as it was asked to is a failure of the run as well.
    let stopped = supervisor.stop().map_or(Ok(()), Err);
    let recorded = recorder.map(LockStepRecorder::finish).transpose();
    let polled = monitor.poll();
    supervisor.watch_faults(&mut monitor, true);
    let wall_s = watched?;
    stopped?;
    recorded?.into_iter().for_each(|said| supervisor.say(said.trim_end()));
    polled?;
    drop(page);
    let last = monitor.into_last(supervisor.restart_causes());
    if options.clock == Clock::RealTime {
        keep_learned(machine, &last);
    }
    let report = LoopReport::new(machine, &last, options.clock, wall_s);
    Ok(Ended { report, is_interrupted: supervisor.is_interrupted() })
}

/// Keeps what the axes have learned for a run with `--warm`.
fn keep_learned(machine: &Machine, last: &LastMessages) {
    let (Some(snapshot), Some(command)) = (&last.snapshot, &last.command) else { return };
    if let Err(error) = learned::save(&default_folder(), machine, snapshot, command) {
        eprintln!("warning: what was learned is not kept for --warm: {}: {error}", default_folder().display());
    }
}

/// What a recording says about the run, besides the machine.
fn facts(machine: &Machine, options: &StageOptions) -> Facts {
    let clock = if options.clock == Clock::LockStep { LOCK_STEP } else { "real time" };
    [
        ("clock", clock.to_owned()),
        ("source", machine.source.kind().to_owned()),
        ("scenario", machine.scenario.name.clone()),
        ("seed", options.seed.to_string()),
        ("ticks", options.ticks.map_or("without end".to_owned(), |ticks| ticks.to_string())),
        ("armed at the start", options.arm.to_string()),
    ]
    .map(|(name, fact)| (name.to_owned(), fact))
    .into()
}

/// Starts the stages, the one that all others wait for last, and supervises them until their end. The time since the
/// last one was started, s.
fn start_and_watch(
    machine: &Machine,
    options: &StageOptions,
    monitor: &mut Monitor,
    supervisor: &mut Supervisor,
) -> Result<f64, Failure> {
    let (followers, head) = stages(machine, options.clock);
    for kind in &followers {
        supervisor.start(*kind)?;
    }
    for kind in &followers {
        while !supervisor.is_ready(*kind, monitor) && !supervisor.is_interrupted() {
            supervisor.step(monitor)?;
        }
    }
    let started = Instant::now();
    if !supervisor.is_interrupted() {
        supervisor.start(head)?;
        watch(machine, head, options.ticks, monitor, supervisor)?;
    }
    Ok(started.elapsed().as_secs_f64())
}

/// Supervises until the last tick, a signal, or a failure.
fn watch(
    machine: &Machine,
    head: StageKind,
    ticks: Option<u64>,
    monitor: &mut Monitor,
    supervisor: &mut Supervisor,
) -> Result<(), Failure> {
    let patience = stall_patience(machine.timing.period);
    let duration = ticks.map(|ticks| machine.timing.period.mul_f64(ticks as f64));
    let mut end = None;
    let started = Instant::now();
    while !supervisor.all_done() && !supervisor.is_interrupted() {
        supervisor.step(monitor)?;
        supervisor.announce(monitor);
        if let Some(second) = monitor.second(machine) {
            supervisor.report(second);
        }
        // The last tick is out when its source has ended. The other stages then end by themselves.
        if supervisor.is_done(head) {
            let end = *end.get_or_insert_with(|| Instant::now() + END_PATIENCE);
            if Instant::now() > end {
                break;
            }
        }
        // While a stage starts again, the others wait for it, and all wait for the first reading of an external
        // program; that is no stall.
        let waits = machine.source.is_real() && monitor.last_sample().is_none();
        if waits && duration.is_some_and(|duration| started.elapsed() > duration) {
            break;
        }
        if monitor.stalled_for() > patience && supervisor.all_up(monitor) && !waits {
            return Err(Failure::run(format!(
                "no stage has worked for {}; the last ticks are: {}",
                humantime::format_duration(patience),
                monitor.ticks()
            )));
        }
    }
    Ok(())
}

/// Longest time without a tick.
fn stall_patience(period: Duration) -> Duration {
    STALL_PATIENCE.max(period * STALL_PERIODS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_machine_is_not_a_stalled_one() {
        assert_eq!(stall_patience(Duration::from_millis(10)), Duration::from_secs(10));
        assert!(stall_patience(Duration::from_secs(10)) > 2 * Duration::from_secs(10));
    }
}
