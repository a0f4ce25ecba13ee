//! The arguments of `hydraxis monitor`.

use std::net::SocketAddr;

use clap::Args;
use pipeline::channel::Prefix;

use crate::group::page::LISTEN;

/// `monitor`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis monitor                                   then open http://127.0.0.1:8787/ in a browser
  hydraxis monitor --allow-control                   also to operate axes, with the address that it prints
  hydraxis monitor --prefix demo --listen 127.0.0.1:0    a free port, which it prints
  curl http://127.0.0.1:8787/metrics                 the figures for Prometheus
  curl http://127.0.0.1:8787/health                  200 while all stages are heard, else 503

A page that shows a running group: the machine in its pose, axes, stages, latencies, faults, trends. It operates
nothing, unless --allow-control says so: then it has a button that stops all axes, and for whoever has the token that is
shown once, axes that are armed for as long as a button is held. It waits for a group, and comes back by itself when the
group or this program does. It needs no network: everything is in this program. It listens to two channels that no stage
reads, with the least priority, so the loops are not slowed down; to others only while a browser shows the models.

Whoever reaches the address can look at the machine. So it is this computer only, unless you say otherwise; from
elsewhere come through ssh -L 8787:127.0.0.1:8787, or through a reverse proxy with TLS and passwords.")]
pub struct MonitorArguments {
    /// The group [default: the only one that runs]
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// Address and port of the page; port 0 takes a free one
    #[arg(long, value_name = "ADDR:PORT", default_value = LISTEN)]
    pub listen: SocketAddr,
    /// Name under which browsers may ask for the page, besides addresses and localhost; may be given several times
    #[arg(long = "host", value_name = "NAME")]
    pub hosts: Vec<String>,
    /// Let the page operate axes: Off for everybody who sees it, the rest with a token that is shown once
    #[arg(long)]
    pub allow_control: bool,
    /// End when the process with this number ends, or when standard input does
    #[arg(long, hide = true)]
    pub parent: Option<i32>,
}
