//! `hydraxis monitor`: a running group as a page for browsers, and as figures for programs.
//!
//! ```text
//! channels --watcher: reads, every 25 ms--> published texts --server: the newest ones--> browsers
//!                                      \--> history, figures --server: when asked--> browsers, Prometheus
//! ```
//!
//! | file | what |
//! |---|---|
//! | `watcher` | attaches to the group, leaves it, publishes |
//! | `attached` | publishes the frames of one group |
//! | `details` | models and hops, while somebody looks at them |
//! | `frame` | what a browser gets, as JSON |
//! | `history` | the trends of the last minutes |
//! | `published` | what both threads share |
//! | `server` | connections, their limits, routes |
//! | `guard` | which requests are refused |
//! | `control` | what a page may ask of the axes, with `--allow-control` |
//! | `hold` | axes that are armed while a button is held |
//! | `token` | the secret that a page needs for that |
//! | `metrics` | the figures in the text format of Prometheus |
//! | `page/` | the page: HTML, style, script; and uPlot, which draws the trends |
//!
//! Runs in a process of its own with the least priority, beside the loop. It reads two channels that no stage reads.
//! With `--allow-control` server and operator keep the usual priority, so that a button that is held stays held. The
//! server never waits for a browser: a browser that reads slowly gets the newest frame when it reads again.

mod arguments;
mod attached;
mod control;
mod details;
mod frame;
mod guard;
mod history;
mod hold;
mod metrics;
mod published;
mod server;
mod token;
mod watcher;

use std::{net::TcpListener, sync::Arc};

use crate::{
    failure::Failure,
    group::{lifeline, live::Search, page::refuse_control, signals::stop_flag},
    report::output::show,
};
pub use arguments::MonitorArguments;

use control::Control;
use guard::Guard;
use published::Published;
use watcher::Watcher;

/// Least priority among the processes that share a core.
const NICE: i32 = 19;

/// What the system keeps for a browser that reads slowly, bytes: a second of frames.
const SEND_BUFFER: usize = 64 * 1024;

/// Runs the command.
pub fn run(arguments: &MonitorArguments) -> Result<(), Failure> {
    let stop = stop_flag()?;
    if let Some(parent) = arguments.parent {
        lifeline::hold(parent, "monitor", lifeline::STAGE_PATIENCE)
            .map_err(|error| Failure::from(error).about("monitor"))?;
    }
    if let Some(refused) = Some(arguments.listen).filter(|_| arguments.allow_control).and_then(refuse_control) {
        return Err(Failure::usage(refused));
    }
    let listener = TcpListener::bind(arguments.listen).and_then(|listener| {
        listener.set_nonblocking(true)?;
        // Connections inherit it.
        rustix::net::sockopt::set_socket_send_buffer_size(&listener, SEND_BUFFER)?;
        let address = listener.local_addr()?;
        Ok((listener, address))
    });
    let (listener, address) = listener.map_err(|error| {
        let allowed = "allowed: an address of this computer with a free port, such as 127.0.0.1:0";
        Failure::usage(format!("--listen: {} cannot be used ({error}); {allowed}", arguments.listen))
    })?;
    let published = Arc::new(Published::new());
    let control = arguments.allow_control.then(|| Control::new(Arc::clone(&published)).map(Arc::new)).transpose();
    let control = control.map_err(|error| Failure::run(error).about("monitor"))?;
    if control.is_none() {
        be_nice();
    }
    let guard = Guard::new(&arguments.hosts, control.is_some());
    let started = server::start(listener, guard, Arc::clone(&published), control.as_ref());
    started.map_err(|error| Failure::run(error).about("monitor"))?;
    // Threads that run already keep their priority.
    be_nice();
    show(&format!("monitor: http://{address}/\n"))?;
    if let Some(control) = &control {
        // To standard error, which `hydraxis run` does not write to its log.
        eprintln!("control: http://{address}/#{} lets whoever has it operate axes", control.token());
    }
    if !address.ip().is_loopback() {
        eprintln!("warning: --listen: everybody who reaches {address} can look at the machine");
    }
    if let Some(Err(why)) = Search::new(arguments.prefix.clone()).look() {
        eprintln!("{why}; waiting for it");
    }
    Watcher::new(arguments.prefix.clone(), published, arguments.allow_control).watch(&stop);
    Ok(())
}

/// Gives this thread, and those that it starts from now on, the least priority. Without the right to it they keep
/// theirs.
fn be_nice() {
    let _ = rustix::process::nice(NICE);
}
