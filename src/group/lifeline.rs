//! How a stage learns that the supervisor that started it has ended.
//!
//! Two signs tell the stage, and each of them is enough: the kernel's death signal; and the end of standard input,
//! which is a pipe whose other end only the supervisor holds. Both ask the stage to end as Ctrl-C does, with neutral
//! valves. A stage that has not ended after its patience is ended here.
//!
//! Trap: the kernel does not send the death signal to a program with file capabilities, and it sends the signal already
//! when the *thread* that started the stage ends. The pipe has neither defect.

use std::{
    io::{self, ErrorKind, Read, Write, stderr, stdin},
    thread::{Builder, sleep},
    time::Duration,
};

use rustix::{
    io::Errno,
    process::{Signal, getpid, getppid, kill_process, set_parent_process_death_signal},
};
use thiserror::Error;

/// Time in which a stage should end by itself.
pub const STAGE_PATIENCE: Duration = Duration::from_millis(500);
/// Stack of the watching thread, bytes. It is small because it may be locked into memory.
const STACK: usize = 64 * 1024;

/// Why a stage cannot be tied to its supervisor.
#[derive(Debug, Error)]
pub enum LifelineError {
    /// The kernel refuses the death signal.
    #[error("the death signal of the parent cannot be set")]
    DeathSignal(#[source] Errno),
    /// The supervisor ended before the stage could watch it.
    #[error("the process that started this stage has ended")]
    ParentGone,
    /// The watching thread cannot be started.
    #[error("the thread that watches standard input cannot be started")]
    Thread(#[source] io::Error),
}

/// Arranges that this process ends when `parent` does, by itself or after `patience` by force. The stop flag must
/// already be set by SIGTERM.
///
/// # Errors
/// The parent has ended, or the thread cannot be started.
pub fn hold(parent: i32, name: &'static str, patience: Duration) -> Result<(), LifelineError> {
    set_parent_process_death_signal(Some(Signal::TERM)).map_err(LifelineError::DeathSignal)?;
    // The parent may have ended before the call above.
    if getppid().map(|pid| pid.as_raw_pid()) != Some(parent) {
        return Err(LifelineError::ParentGone);
    }
    let watch = Builder::new().name("lifeline".to_owned()).stack_size(STACK).spawn(move || {
        await_end_of_input();
        // A signal, because the flag alone does not end a sleep until the next tick.
        let _ = kill_process(getpid(), Signal::TERM);
        sleep(patience);
        let patience = humantime::format_duration(patience);
        // The reader of standard error may have ended as well.
        let _ = writeln!(stderr(), "{name}: its supervisor has ended, and it did not end within {patience}");
        std::process::exit(1);
    });
    watch.map(|_| ()).map_err(LifelineError::Thread)
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
