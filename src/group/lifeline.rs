//! How a stage that a supervisor has started learns that the supervisor is gone.
//!
//! By two ways, either of which is enough: the kernel's death signal, and standard input, a pipe of which only the
//! supervisor holds the other end, so that it ends when the supervisor does, however that came about. Both ask the stage
//! to end as Ctrl-C does, with neutral valves; one that has not after [`PATIENCE`] is ended.
//!
//! Trap: the kernel takes the death signal away from a program with file capabilities, and sends it already when the
//! *thread* that started the stage ends. The pipe knows neither.

use std::{
    io::{ErrorKind, Read, Write, stderr, stdin},
    thread::{Builder, sleep},
    time::Duration,
};

use rustix::process::{Signal, getpid, getppid, kill_process, set_parent_process_death_signal};

/// How long the stage may take to end by itself.
const PATIENCE: Duration = Duration::from_millis(500);
/// Stack of the thread that watches, which may be locked into memory.
const STACK: usize = 64 * 1024;

/// Arranges that this process ends when `parent` does. The stop flag must be listening to SIGTERM already.
///
/// # Errors
/// The parent is gone, or the thread cannot be started.
pub fn hold(parent: i32, name: &'static str) -> Result<(), String> {
    set_parent_process_death_signal(Some(Signal::TERM)).map_err(|error| format!("death signal: {error}"))?;
    // The parent may have died before the call above.
    if getppid().map(|pid| pid.as_raw_pid()) != Some(parent) {
        return Err("whoever started this stage is gone".to_owned());
    }
    let watch = Builder::new().name("lifeline".to_owned()).stack_size(STACK).spawn(move || {
        await_end_of_input();
        // A signal, not the flag alone: it also ends a sleep until the next tick.
        let _ = kill_process(getpid(), Signal::TERM);
        sleep(PATIENCE);
        // Whoever read standard error may be gone too.
        let _ = writeln!(stderr(), "{name}: whoever started it is gone, and it did not end within {PATIENCE:?}");
        std::process::exit(1);
    });
    watch.map(|_| ()).map_err(|error| format!("lifeline: {error}"))
}

fn await_end_of_input() {
    let mut ignored = [0; 64];
    loop {
        match stdin().read(&mut ignored) {
            Ok(0) => return,
            Ok(_) => {}
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => return,
        }
    }
}
