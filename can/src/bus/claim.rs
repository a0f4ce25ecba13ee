//! The right to send on an interface of the kernel: one program at a time has it.
//!
//! Any number of programs can open an interface. Two masters of one bus would set up devices against each other, so a
//! master claims the interface first, by a socket with its name. The name lives in the network name space of the
//! interface, and is free again when its program ends in whatever way.

use std::{
    io,
    os::{linux::net::SocketAddrExt, unix::net::SocketAddr, unix::net::UnixDatagram},
};

use super::BusError;

/// The right to send on an interface, until this value is dropped.
#[derive(Debug)]
pub struct Claim {
    _name: UnixDatagram,
}

impl Claim {
    /// Claims the interface `name`, such as `can0`.
    ///
    /// # Errors
    /// Another program of this computer has claimed it.
    pub fn take(name: &str) -> Result<Self, BusError> {
        let socket = SocketAddr::from_abstract_name(format!("hydraxis-can/{name}"))
            .and_then(|address| UnixDatagram::bind_addr(&address));
        socket.map(|socket| Self { _name: socket }).map_err(|error| {
            let what = match error.kind() {
                io::ErrorKind::AddrInUse => {
                    "another program sends on this bus, such as a running group; allowed: one at a time, so end that \
                     one first. `hydraxis can monitor`, `can record` and `can scan --listen` only listen"
                }
                _ => "the interface cannot be claimed",
            };
            BusError::open(name, what, error)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interface_is_claimed_once_at_a_time() {
        let name = format!("t{}", std::process::id());
        let first = Claim::take(&name).unwrap();
        let error = Claim::take(&name).unwrap_err();
        assert!(error.to_string().starts_with(&format!("{name}: another program sends on this bus")), "{error}");
        drop(first);
        assert!(Claim::take(&name).is_ok());
    }
}
