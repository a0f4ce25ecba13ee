//! `hydraxis-fleet`: the command.

mod arguments;

use std::{
    fs::File,
    io::{IsTerminal, Write, copy, sink, stdin, stdout},
    os::{fd::AsFd, unix::fs::FileTypeExt},
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, sleep},
    time::{Duration, Instant},
};

use arguments::{Arguments, Ask, Bench, Command, Page, Plant, Record, Stage, Top};
#[cfg(feature = "commands")]
use arguments::{Disarm, Operate};
use clap::Parser;
#[cfg(feature = "commands")]
use hydraxis_fleet::command;
use hydraxis_fleet::{
    bench,
    bridge::{self, BridgeError},
    connection::{Connection, ConnectionError},
    fleet::Fleet,
    kernel::utc_ns,
    key::PLANT,
    listen::Listener,
    page::{self, PageError},
    plant::{
        remote::Remote,
        request::Request,
        serve::{ServeError, serve},
        simulated, stage,
    },
    record::{self, RecordError, Recorder},
    router::{self, RouterError},
    settings::{Settings, SettingsError},
    top,
};
use pipeline::{
    channel::remove_leftovers,
    machine::{MachineError, Source},
    stage::{Clock, StageError, StageOptions},
};
use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGTERM},
    flag::register,
};
use thiserror::Error;
use zenoh::{Session, Wait};

/// Time between two tables.
const APART: Duration = Duration::from_secs(1);
/// Time between two looks for a signal.
const LOOK: Duration = Duration::from_millis(50);
/// Time in which a machine has to answer.
const ANSWER: Duration = Duration::from_secs(5);

/// Why the command has failed.
#[derive(Debug, Error)]
enum Failure {
    #[error(transparent)]
    Settings(#[from] SettingsError),
    #[error(transparent)]
    Connection(#[from] ConnectionError),
    #[error(transparent)]
    Bridge(#[from] BridgeError),
    #[error(transparent)]
    Page(#[from] PageError),
    #[error(transparent)]
    Record(#[from] RecordError),
    #[error(transparent)]
    Router(#[from] RouterError),
    #[error(transparent)]
    Bench(#[from] bench::BenchError),
    #[cfg(feature = "commands")]
    #[error(transparent)]
    Command(#[from] command::CommandError),
    #[cfg(feature = "commands")]
    #[error(transparent)]
    Station(#[from] command::StationError),
    #[error(transparent)]
    Machine(#[from] MachineError),
    #[error(transparent)]
    Plant(#[from] ServeError),
    #[error(transparent)]
    Stage(#[from] StageError),
    #[error("found a stage in real time, and a plant on another computer; allowed: --lockstep, as of `hydraxis run`")]
    RealTime,
    #[error("source.kind: found \"{0}\", and a plant on another computer; allowed: \"sim\"")]
    Source(&'static str),
    #[cfg(feature = "commands")]
    #[error("--to: found one axis twice; allowed: one set point for each")]
    Twice,
    #[error("Zenoh: {0}")]
    Zenoh(#[from] zenoh::Error),
    #[error("{0}")]
    Output(#[from] std::io::Error),
    #[error("{0}")]
    NoAnswer(String),
}

impl Failure {
    /// 2 for a file or an argument that is wrong, as for every command of Hydraxis.
    fn exit_code(&self) -> u8 {
        match self {
            Self::Page(PageError::Address(_) | PageError::Listen { .. }) => 2,
            Self::Record(RecordError::Folder { .. }) => 2,
            Self::Settings(_) | Self::Router(RouterError::File { .. } | RouterError::Mode { .. }) => 2,
            #[cfg(feature = "commands")]
            Self::Command(error) if error.is_usage() => 2,
            #[cfg(feature = "commands")]
            Self::Twice => 2,
            Self::Machine(_) | Self::Plant(ServeError::Plant(_)) | Self::RealTime | Self::Source(_) => 2,
            Self::Connection(error) if !matches!(error, ConnectionError::Zenoh(_)) => 2,
            _ => 1,
        }
    }
}

fn main() -> ExitCode {
    let Arguments { command } = Arguments::parse();
    // Why a link fails is said by Zenoh alone. It says so on standard output, which the others need for their answers.
    let logs = matches!(
        command,
        Command::Bridge { .. } | Command::Record(_) | Command::Router { .. } | Command::Plant(_) | Command::Stage(_)
    );
    if logs {
        zenoh::init_log_from_env_or("error");
    }
    match run(&command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}

fn run(command: &Command) -> Result<(), Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    if !matches!(command, Command::Bench(_) | Command::BenchPublish { .. }) {
        [SIGINT, SIGTERM, SIGHUP].into_iter().try_for_each(|signal| register(signal, Arc::clone(&stop)).map(|_| ()))?;
    }
    match command {
        Command::Bridge { settings } => Ok(bridge::run(Settings::load(settings)?, &stop)?),
        Command::Top(arguments) => show(arguments, &stop),
        Command::Page(arguments) => page(arguments, stop),
        Command::Record(arguments) => record(arguments, &stop),
        Command::Ask(arguments) => ask(arguments, &stop),
        Command::Plant(arguments) => simulate(arguments, &stop),
        Command::Stage(arguments) => control(arguments, stop),
        Command::Router { file } => {
            let session = router::open(file)?;
            println!("the router {} runs", session.zid());
            wait(&stop, None);
            Ok(session.close().wait()?)
        }
        #[cfg(feature = "commands")]
        Command::Listen { settings } => Ok(command::listen(&Settings::load(settings)?, &stop)?),
        #[cfg(feature = "commands")]
        Command::Consent { settings, time } => Ok(command::consent(&Settings::load(settings)?, *time, &stop)?),
        #[cfg(feature = "commands")]
        Command::Disarm(arguments) => disarm(arguments, &stop),
        #[cfg(feature = "commands")]
        Command::Operate(arguments) => operate(arguments, &stop),
        Command::Bench(arguments) => measure(arguments),
        Command::BenchPublish { router, machines } => Ok(bench::publish(router, *machines)?),
    }
}

/// Waits for so long, or for a signal; true after a signal.
fn wait(stop: &AtomicBool, time: Option<Duration>) -> bool {
    let until = time.map(|time| Instant::now() + time);
    while until.is_none_or(|until| Instant::now() < until) {
        if stop.load(Ordering::Relaxed) {
            return true;
        }
        sleep(LOOK);
    }
    false
}

/// Connects; none after a signal, which has to end a command also where no router answers.
///
/// # Errors
/// No router answers within `patience`, or none can be reached like this.
fn connect(connection: Connection, patience: Option<Duration>, stop: &AtomicBool) -> Result<Option<Session>, Failure> {
    let (routers, begun) = (connection.router.join(", "), Instant::now());
    let is_stopped = || stop.load(Ordering::Relaxed);
    let session =
        connection.open_unless(|| is_stopped() || patience.is_some_and(|patience| begun.elapsed() > patience))?;
    match patience {
        Some(patience) if session.is_none() && !is_stopped() => {
            let patience = humantime::format_duration(patience);
            Err(Failure::NoAnswer(format!("router {routers}: not reached within {patience}")))
        }
        _ => Ok(session),
    }
}

fn page(arguments: &Page, stop: Arc<AtomicBool>) -> Result<(), Failure> {
    let socket = page::bind(arguments.listen)?;
    let Some(session) = connect(arguments.router.connection(), None, &stop)? else { return Ok(()) };
    let listener = Listener::new(&session, arguments.site.as_ref(), Fleet::new(arguments.stale_after))?;
    println!("all machines: http://{}/", socket.local_addr()?);
    page::serve(socket, listener, stop)?;
    Ok(session.close().wait()?)
}

fn record(arguments: &Record, stop: &AtomicBool) -> Result<(), Failure> {
    let recorder = Recorder::new(arguments.settings())?;
    let Some(session) = connect(arguments.router.connection(), None, stop)? else { return Ok(()) };
    record::run(&session, recorder, stop)?;
    Ok(session.close().wait()?)
}

fn show(arguments: &Top, stop: &AtomicBool) -> Result<(), Failure> {
    let patience = arguments.once.map(|once| once + ANSWER);
    let Some(session) = connect(arguments.router.connection(), patience, stop)? else { return Ok(()) };
    let listener = Listener::new(&session, arguments.site.as_ref(), Fleet::new(arguments.stale_after))?;
    let is_screen = stdout().is_terminal() && !arguments.json;
    loop {
        let is_over = wait(stop, Some(arguments.once.unwrap_or(APART)));
        if is_over && arguments.once.is_none() {
            break;
        }
        let rows = top::rows(&listener.fleet(), utc_ns());
        let text = if arguments.json {
            format!("{}\n", serde_json::to_string(&rows).map_err(std::io::Error::from)?)
        } else {
            top::table(&rows, arguments.axes)
        };
        // From the top left corner, and nothing of the table before below it.
        let clear = if is_screen { "\x1b[H\x1b[J" } else { "" };
        match write!(stdout(), "{clear}{text}").and_then(|()| stdout().flush()) {
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => break,
            other => other?,
        }
        if arguments.once.is_some() {
            break;
        }
    }
    drop(listener);
    Ok(session.close().wait()?)
}

fn ask(arguments: &Ask, stop: &AtomicBool) -> Result<(), Failure> {
    let Some(session) = connect(arguments.router.connection(), Some(ANSWER), stop)? else { return Ok(()) };
    let key = arguments.machine.key(&arguments.what);
    let answers = session.get(&key).timeout(ANSWER).wait()?;
    let answer = answers.recv().map_err(|_| Failure::NoAnswer(format!("{key}: nobody answers")))?;
    match answer.into_result() {
        Ok(sample) => println!("{}", sample.payload().try_to_string().unwrap_or_default()),
        Err(error) => {
            let why = error.payload().try_to_string().unwrap_or_default().into_owned();
            return Err(Failure::NoAnswer(format!("{key}: {why}")));
        }
    }
    Ok(session.close().wait()?)
}

/// Prints a line. Whoever moves or stops a machine goes on when nobody reads it.
#[cfg(feature = "commands")]
fn print(line: &str) {
    let _ = writeln!(stdout(), "{line}");
}

#[cfg(feature = "commands")]
fn disarm(arguments: &Disarm, stop: &AtomicBool) -> Result<(), Failure> {
    let station = &arguments.station;
    let Some(session) = connect(station.router.connection(), Some(ANSWER), stop)? else { return Ok(()) };
    let (place, name) = (station.machine.clone(), station.station.clone());
    let disarmed = command::Station { session: &session, place, name }.disarm(arguments.axis.clone())?;
    for (axis, state) in disarmed.axes {
        print(&format!("axis.{axis}: {state}"));
    }
    Ok(session.close().wait()?)
}

#[cfg(feature = "commands")]
fn operate(arguments: &Operate, stop: &Arc<AtomicBool>) -> Result<(), Failure> {
    let station = &arguments.station;
    if !arguments.enable {
        println!("nothing is armed; allowed: with --enable, and then the machine may move");
        return Ok(());
    }
    let targets: std::collections::BTreeMap<String, f64> = arguments.to.iter().cloned().collect();
    if targets.len() < arguments.to.len() {
        return Err(Failure::Twice);
    }
    let Some(session) = connect(station.router.connection(), Some(ANSWER), stop)? else { return Ok(()) };
    if let Some(duration) = arguments.duration {
        let stop = Arc::clone(stop);
        thread::spawn(move || {
            sleep(duration);
            stop.store(true, Ordering::Relaxed);
        });
    }
    let mut told = None;
    let tell = |answer: &command::protocol::Answer| {
        if told.is_some_and(|told: Instant| told.elapsed() < APART) {
            return;
        }
        told = Some(Instant::now());
        for (axis, view) in &answer.axes {
            let metres = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.4} m"));
            let [position, set_point] = [view.position, view.set_point].map(metres);
            print(&format!("axis.{axis}: {}, {position}, set point {set_point}", view.state));
        }
    };
    let (place, name) = (station.machine.clone(), station.station.clone());
    command::Station { session: &session, place, name }.operate(&targets, stop, tell)?;
    print("off");
    Ok(session.close().wait()?)
}

fn simulate(arguments: &Plant, stop: &AtomicBool) -> Result<(), Failure> {
    let (settings, machine) = (Settings::load(&arguments.settings)?, arguments.machine.load()?);
    let Some(session) = connect(settings.connection(), None, stop)? else { return Ok(()) };
    let _plant = serve(&session, &settings.place(), &machine, arguments.seed)?;
    wait(stop, None);
    Ok(session.close().wait()?)
}

fn control(arguments: &Stage, stop: Arc<AtomicBool>) -> Result<(), Failure> {
    if !arguments.lockstep {
        return Err(Failure::RealTime);
    }
    end_with_supervisor(&stop);
    let (settings, machine) = (Settings::load(&arguments.settings)?, arguments.machine.load()?);
    if machine.source != Source::Sim {
        return Err(Failure::Source(machine.source.kind()));
    }
    let patience = settings.plant.patience;
    let session = connect(settings.connection(), Some(patience), &stop).map_err(|failure| match failure {
        Failure::NoAnswer(text) => Failure::NoAnswer(format!("{text}, plant.patience")),
        other => other,
    })?;
    let Some(session) = session else { return Ok(()) };
    let common = Request { run: utc_ns() as u64, reading: 0, seed: arguments.seed, machine: simulated(&machine) };
    let remote = Remote::new(session.clone(), settings.place().key(PLANT), common, patience);
    let options = StageOptions {
        prefix: arguments.prefix.clone(),
        clock: Clock::LockStep,
        ticks: arguments.ticks,
        seed: arguments.seed,
        arm: false,
        first_tick: 0,
        is_recorded: arguments.recorded,
        warn: true,
        stop,
        reset: Arc::default(),
        off: Arc::default(),
    };
    let ended = stage::run(remote, &machine, options);
    // The last member of a group that was started by hand removes its files.
    let _ = remove_leftovers(&arguments.prefix);
    ended?;
    Ok(session.close().wait()?)
}

/// Asks for the end when the supervisor is gone, which holds the other end of standard input where that is a pipe.
fn end_with_supervisor(stop: &Arc<AtomicBool>) {
    let Ok(mut input) = stdin().as_fd().try_clone_to_owned().map(File::from) else { return };
    if input.metadata().is_ok_and(|about| about.file_type().is_fifo()) {
        let stop = Arc::clone(stop);
        thread::spawn(move || {
            let _ = copy(&mut input, &mut sink());
            stop.store(true, Ordering::Relaxed);
        });
    }
}

fn measure(arguments: &Bench) -> Result<(), Failure> {
    let mut measured = Vec::new();
    for machines in &arguments.machines {
        measured.push(bench::measure(*machines as usize, arguments.duration)?);
        if !arguments.json {
            // Each line as soon as it is there, with the heading once.
            let table = bench::table(&measured[measured.len() - 1..]);
            print!(
                "{}",
                if measured.len() == 1 { table.as_str() } else { table.split_once('\n').map_or("", |(_, line)| line) }
            );
        }
    }
    if arguments.json {
        println!("{}", serde_json::to_string(&measured).map_err(std::io::Error::from)?);
    }
    Ok(())
}
