//! Watches a running group: positions, pressures, commands and models, twice a second.
//!
//! ```sh
//! hydraxis run --prefix demo &
//! cargo run --example watch -- demo
//! ```
//!
//! Watching takes nothing from the group: every channel has places for clients, its writer waits for no reader, and a
//! reader that is slow loses its oldest messages, which are counted here.

use std::{error::Error, thread, time::Duration};

use pipeline::{
    channel::{Group, GroupState, Prefix, Reader, groups},
    message::{CoefficientSnapshot, ControlMode, EncoderSample, ValveCommand},
};

/// Time between two prints.
const PRINT_PERIOD: Duration = Duration::from_millis(500);

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let prefix: Prefix = arguments.next().ok_or("name the group: watch PREFIX [PRINTS]")?.parse()?;
    let prints: usize = arguments.next().map_or(Ok(usize::MAX), |count| count.parse())?;
    if !is_alive(&prefix) {
        return Err(format!(
            "no group \"{prefix}\" is running; start one with: hydraxis run MACHINE.toml --prefix {prefix}"
        )
        .into());
    }
    let group = Group::join(&prefix, "watch")?;
    let mut samples: Reader<EncoderSample> = group.reader()?;
    let mut commands: Reader<ValveCommand> = group.reader()?;
    let mut snapshots: Reader<CoefficientSnapshot> = group.reader()?;

    println!("    tick axis  position  piston    rod   command mode        a | b");
    println!("                   mm     MPa    MPa");
    for _ in 0..prints {
        thread::sleep(PRINT_PERIOD);
        // A reader keeps what came since the last look; only the newest message matters here.
        let is_new = samples.newest()?.if_new().is_some();
        commands.newest()?;
        snapshots.newest()?;
        if !is_new {
            println!("no sample for {PRINT_PERIOD:?}");
            break;
        }
        if let (Some(sample), Some(command)) = (samples.last(), commands.last()) {
            print(sample, command, snapshots.last());
        }
    }
    println!("lost on the way to here: {} samples, {} commands", samples.lost(), commands.lost());
    Ok(())
}

/// Whether a member of the group runs.
fn is_alive(prefix: &Prefix) -> bool {
    groups().iter().any(|group| group.prefix == *prefix && group.state == GroupState::Alive)
}

/// One line per axis.
fn print(sample: &EncoderSample, command: &ValveCommand, snapshot: Option<&CoefficientSnapshot>) {
    let tick = sample.header.sequence;
    for axis in 0..sample.header.axis_count as usize {
        let position_mm = sample.axes[axis].position * 1e3;
        // A machine without pressure transducers has no pressures.
        let pressures = sample.axes[axis].pressures().map_or_else(
            || format!("{:>7} {:>6}", "-", "-"),
            |(piston, rod)| format!("{:7.2} {:6.2}", piston * 1e-6, rod * 1e-6),
        );
        let valve = &command.axes[axis];
        let model = snapshot.map_or("-".to_owned(), |snapshot| {
            let model = &snapshot.axes[axis].adaptive;
            let (a, b) = (&model.a[..model.na as usize], &model.b[..=model.nb as usize]);
            let a: Vec<String> = a.iter().map(|a| format!("{a:+.4}")).collect();
            let b: Vec<String> = b.iter().map(|b| format!("{b:+.3e}")).collect();
            format!("{} | {}", a.join(" "), b.join(" "))
        });
        let mode = ControlMode::name(valve.mode);
        println!("{tick:8} {:4} {position_mm:9.2} {pressures} {:+9.4} {mode:10}  {model}", axis + 1, valve.command);
    }
}
