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
//! | `frame` | what a browser gets, as JSON |
//! | `history` | the trends of the last minutes |
//! | `published` | what both threads share |
//! | `server` | connections, their limits, routes |
//! | `guard` | which requests are refused |
//! | `metrics` | the figures in the text format of Prometheus |
//! | `page/` | the page: HTML, style, script; and uPlot, which draws the trends |
//!
//! Runs in a process of its own with the least priority, beside the loop. It reads two channels that no stage reads.
//! The server never waits for a browser: a browser that reads slowly gets the newest frame when it reads again.

mod arguments;
mod attached;
mod frame;
mod guard;
mod history;
mod metrics;
mod published;
mod server;
mod watcher;

use std::{net::TcpListener, sync::Arc};

use crate::{
    failure::Failure,
    group::{lifeline, live::Search, signals::stop_flag},
    report::output::show,
};
pub use arguments::MonitorArguments;

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
    // Without the right to it, the process keeps its priority.
    let _ = rustix::process::nice(NICE);
    let published = Arc::new(Published::new());
    let guard = Guard::new(&arguments.hosts);
    server::start(listener, guard, Arc::clone(&published)).map_err(|error| Failure::run(error).about("monitor"))?;
    show(&format!("monitor: http://{address}/\n"))?;
    if !address.ip().is_loopback() {
        eprintln!("warning: --listen: everybody who reaches {address} can look at the machine");
    }
    if let Some(Err(why)) = Search::new(arguments.prefix.clone()).look() {
        eprintln!("{why}; waiting for it");
    }
    Watcher::new(arguments.prefix.clone(), published).watch(&stop);
    Ok(())
}
