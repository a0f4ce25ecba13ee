//! How a router is reached: as a client of Zenoh, by mutual TLS, without multicast.
//!
//! | setting | value | because |
//! |---|---|---|
//! | lease | 2 s | a router without life is found after 2 s, not after 10 s |
//! | retry | 0.2 to 1 s | data is back within 2 s of the router |
//! | one of several | 1 s, 2 s without a word | the next one is tried soon |
//! | multicast, gossip | off | nobody in the network is asked who else is there |
//! | queue, send buffer | 4 batches of 8 kB, 16 kB | what waits in front of a thin link is old when it arrives |

use std::{
    net::IpAddr,
    panic::resume_unwind,
    path::{Path, PathBuf},
    thread,
    time::{Duration, Instant},
};

use serde::Deserialize;
use serde_json::json;
use thiserror::Error;
use zenoh::{Config, Session, Wait};

use crate::say::say;

/// Time without a message after which a link counts as dead, ms.
const LEASE_MS: u32 = 2000;
/// Pause before the first and the later tries to reach a router, ms.
const RETRY_MS: (u32, u32) = (200, 1000);
/// Time for each of several routers, ms; and for any that takes the connection and says nothing.
const TRY_MS: i64 = 1000;
const OPEN_MS: u32 = 2000;
/// Time without a router after which that is said.
const TELL: Duration = Duration::from_secs(2);
/// Largest batch on a link, bytes, and batches that wait for it.
const BATCH: u32 = 8192;
const QUEUE: u32 = 4;
/// Bytes that the kernel keeps for a link that does not take them: what waits there cannot be taken back.
const SEND_BUFFER: u32 = 16_384;
/// Time between two looks whether a connection is still wanted.
const LOOK: Duration = Duration::from_millis(50);

/// How a router is reached.
#[derive(Debug, Clone)]
pub struct Connection {
    /// Its endpoints: `tls/HOST:PORT`. Of several, the first one that answers.
    pub router: Vec<String>,
    /// Files of TLS.
    pub tls: Option<Tls>,
}

/// Files of mutual TLS, in PEM.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tls {
    /// Certificate of the authority that has signed the router's.
    pub ca: PathBuf,
    /// Own certificate. Its common name is what the router's rules are about.
    pub certificate: PathBuf,
    /// Key of the own certificate.
    pub key: PathBuf,
}

/// Why a router cannot be reached like this.
#[derive(Debug, Error)]
pub enum ConnectionError {
    /// No router is named.
    #[error("router: found none; allowed: one or more of tls/HOST:PORT")]
    NoRouter,
    /// An endpoint is of another kind.
    #[error("router: found \"{0}\"; allowed: tls/HOST:PORT, or tcp/ADDRESS:PORT of this computer")]
    Endpoint(String),
    /// TLS without its files.
    #[error("tls: found none, and the router is \"{0}\"; allowed: ca, certificate and key, three files in PEM")]
    NoFiles(String),
    /// A file of TLS cannot be read.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Zenoh refuses it.
    #[error("Zenoh: {0}")]
    Zenoh(zenoh::Error),
}

impl From<zenoh::Error> for ConnectionError {
    fn from(error: zenoh::Error) -> Self {
        Self::Zenoh(error)
    }
}

impl Tls {
    /// The files, where relative paths are below a folder.
    pub fn below(self, folder: &Path) -> Self {
        Self { ca: folder.join(self.ca), certificate: folder.join(self.certificate), key: folder.join(self.key) }
    }
}

impl Connection {
    /// Whether a router can be reached like this.
    ///
    /// # Errors
    /// An endpoint is neither of TLS nor on this computer, or a file cannot be read.
    pub fn check(&self) -> Result<(), ConnectionError> {
        let is_own = |address: &str| {
            let host = address.rsplit_once(':').map_or("", |(host, _)| host);
            host.trim_matches(['[', ']']).parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
        };
        for router in &self.router {
            match router.split_once('/') {
                Some(("tls", address)) if address.contains(':') => {
                    if self.tls.is_none() {
                        return Err(ConnectionError::NoFiles(router.clone()));
                    }
                }
                Some(("tcp", address)) if is_own(address) => {}
                _ => return Err(ConnectionError::Endpoint(router.clone())),
            }
        }
        let files = self.tls.iter().flat_map(|tls| [&tls.ca, &tls.certificate, &tls.key]);
        for path in files {
            std::fs::File::open(path).map_err(|source| ConnectionError::File { path: path.clone(), source })?;
        }
        if self.router.is_empty() { Err(ConnectionError::NoRouter) } else { Ok(()) }
    }

    /// Connects; waits for a router as long as none answers, and comes back to one by itself later.
    ///
    /// # Errors
    /// Zenoh refuses the configuration.
    pub fn open(&self) -> Result<Session, ConnectionError> {
        self.check()?;
        if self.router.len() == 1 {
            return Ok(zenoh::open(self.config(&self.router, -1)?).wait()?);
        }
        // Zenoh stays with the first of several for as long as it has time. So each one is the first for a while.
        let mut routers = self.router.clone();
        loop {
            match zenoh::open(self.config(&routers, TRY_MS)?).wait() {
                Ok(session) => return Ok(session),
                Err(_) => routers.rotate_left(1),
            }
            // A router that is refused at once, as for its certificate, is tried no more often than others.
            thread::sleep(LOOK);
        }
    }

    /// [`Self::open`] that gives up when `is_over` says so; then none.
    ///
    /// # Errors
    /// Zenoh refuses the configuration.
    pub fn open_unless(self, is_over: impl Fn() -> bool) -> Result<Option<Session>, ConnectionError> {
        self.check()?;
        let (routers, begun, mut is_told) = (self.router.join(", "), Instant::now(), false);
        let session = thread::spawn(move || self.open());
        while !session.is_finished() {
            if is_over() {
                return Ok(None);
            }
            if begun.elapsed() > TELL && !is_told {
                is_told = true;
                say(&format!("no router answers at {routers}; trying again"));
            }
            thread::sleep(LOOK);
        }
        session.join().unwrap_or_else(|panic| resume_unwind(panic)).map(Some)
    }

    /// Stays with the routers for so long, ms; -1 for ever.
    fn config(&self, routers: &[String], time_ms: i64) -> Result<Config, zenoh::Error> {
        let (first, last) = RETRY_MS;
        let tls = self.tls.as_ref().map(|tls| {
            json!({
                "root_ca_certificate": tls.ca,
                "connect_certificate": tls.certificate,
                "connect_private_key": tls.key,
                "enable_mtls": true,
                "verify_name_on_connect": true,
                "close_link_on_expiration": true,
                "so_sndbuf": SEND_BUFFER,
            })
        });
        let config = json!({
            "mode": "client",
            "connect": {
                "endpoints": routers,
                "timeout_ms": time_ms,
                "exit_on_failure": time_ms > 0,
                "retry": { "period_init_ms": first, "period_max_ms": last, "period_increase_factor": 2 },
            },
            "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false } },
            "transport": { "unicast": { "open_timeout": OPEN_MS }, "link": {
                "tx": { "lease": LEASE_MS, "batch_size": BATCH, "queue": { "size": { "data": QUEUE } } },
                "tls": tls.unwrap_or(json!({})),
                "tcp": { "so_sndbuf": SEND_BUFFER },
            } },
        });
        Config::from_json5(&config.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn to(router: &[&str]) -> Connection {
        Connection { router: router.iter().map(|text| (*text).to_owned()).collect(), tls: None }
    }

    #[test]
    fn only_this_computer_is_reached_without_tls() {
        for endpoint in ["tcp/127.0.0.1:7447", "tcp/[::1]:7447"] {
            assert!(to(&[endpoint]).check().is_ok(), "{endpoint}");
        }
        for endpoint in
            ["tcp/10.0.0.1:7447", "tcp/localhost:1", "udp/127.0.0.1:7447", "tcp/0.0.0.0:7447", "router:1", ""]
        {
            let error = to(&["tcp/127.0.0.1:7447", endpoint]).check().unwrap_err();
            assert!(matches!(error, ConnectionError::Endpoint(_)), "{endpoint}: {error}");
        }
        assert!(matches!(to(&["tls/router.quarry:7447"]).check(), Err(ConnectionError::NoFiles(_))));
        assert!(matches!(to(&[]).check(), Err(ConnectionError::NoRouter)));
    }

    #[test]
    fn zenoh_takes_the_configuration() {
        let mut connection = to(&["tls/router.quarry:7447"]);
        let file = |name: &str| PathBuf::from(name);
        connection.tls = Some(Tls { ca: file("ca.pem"), certificate: file("a.pem"), key: file("a.key") });
        assert!(matches!(connection.check(), Err(ConnectionError::File { .. })));
        let config = connection.config(&connection.router, -1).unwrap();
        let value = |key: &str| config.get_json(key).unwrap();
        assert_eq!((value("mode"), value("transport/link/tx/lease")), ("\"client\"".to_owned(), "2000".to_owned()));
        assert_eq!(value("scouting/multicast/enabled"), "false");
        assert_eq!(value("transport/link/tls/connect_certificate"), "\"a.pem\"");
    }
}
