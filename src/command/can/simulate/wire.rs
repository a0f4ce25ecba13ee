//! The bus of simulated devices: a pseudo terminal with a link to it, or an interface of the kernel.
//!
//! Trap: a program that was killed leaves its link. A name in the network name space tells whether a program that has
//! made the link lives; a link to a pseudo terminal without one is replaced.

use std::{
    fmt, fs,
    hash::{DefaultHasher, Hash, Hasher},
    io,
    os::{
        linux::net::SocketAddrExt,
        unix::{
            fs::{MetadataExt, symlink},
            net::{SocketAddr, UnixDatagram},
        },
    },
    path::{Path, PathBuf},
    time::Duration,
};

use can::{
    BitRates, Frame,
    bus::{Address, Bus, BusError, SlcanBus, SocketBus, expect_format, pseudo_terminal},
    device::Outbox,
};
use pipeline::stage::monotonic_ns;

use super::{devices::Devices, faults::BusFault};
use crate::failure::Failure;

/// Where pseudo terminals are.
const TERMINALS: &str = "/dev/pts";
/// Foreign frames that fill a bus of 500 kbit/s for a step.
const FLOOD: usize = 4;

/// A link to a pseudo terminal, which is removed at the end.
struct Link {
    at: PathBuf,
    /// The terminal that it leads to, while it is there.
    terminal: Option<String>,
    /// Says that this program lives.
    _name: UnixDatagram,
}

impl Drop for Link {
    fn drop(&mut self) {
        let _ = self.remove();
    }
}

impl Link {
    fn new(at: &Path) -> Result<Self, Failure> {
        let wrong = |error: &dyn fmt::Display| Failure::usage(format!("--at: {}: {error}", at.display()));
        let parent = at.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = fs::metadata(parent).map_err(|error| wrong(&error))?;
        let mut hasher = DefaultHasher::new();
        (folder.dev(), folder.ino(), at.file_name()).hash(&mut hasher);
        let name = SocketAddr::from_abstract_name(format!("hydraxis-can-simulate/{:016x}", hasher.finish()));
        let name = name.and_then(|name| UnixDatagram::bind_addr(&name)).map_err(|error| match error.kind() {
            io::ErrorKind::AddrInUse => wrong(&"other simulated devices are there; allowed: a path of its own"),
            _ => wrong(&error),
        })?;
        Ok(Self { at: at.to_owned(), terminal: None, _name: name })
    }

    /// Removes the link that was made, and nothing else.
    fn remove(&mut self) -> io::Result<()> {
        if self.terminal.take().is_some() { fs::remove_file(&self.at) } else { Ok(()) }
    }

    /// Makes the link, in the place of one that a killed program has left.
    fn point_to(&mut self, terminal: &str) -> io::Result<()> {
        if fs::read_link(&self.at).is_ok_and(|old| old.starts_with(TERMINALS)) {
            fs::remove_file(&self.at)?;
        } else if fs::symlink_metadata(&self.at).is_ok() {
            return Err(io::Error::other("a file is there; allowed: a path without one, where the link is made"));
        }
        symlink(terminal, &self.at)?;
        self.terminal = Some(terminal.to_owned());
        Ok(())
    }
}

/// The bus, with its fault.
pub struct Wire {
    /// `None` while it is unplugged.
    bus: Option<Box<dyn Bus>>,
    /// `None` of an interface.
    link: Option<Link>,
    name: String,
    fault: BusFault,
    /// Nobody has the other end open.
    is_alone: bool,
}

impl Wire {
    /// Opens an interface, or makes a pseudo terminal.
    ///
    /// # Errors
    /// The interface cannot be opened, other devices are there, the link cannot be made, or CAN FD is needed and not
    /// there.
    pub fn open(at: &Address, rates: BitRates, needs_flexible: bool) -> Result<Self, Failure> {
        let (bus, link, name) = match at {
            Address::Interface(name) => {
                let bus =
                    SocketBus::open(name, rates.data.is_some()).and_then(|bus| bus.claimed(&format!("{name}/devices")));
                (Box::new(bus.map_err(Failure::run)?) as Box<dyn Bus>, None, name.clone())
            }
            Address::Serial(path) => {
                let mut link = Link::new(path)?;
                let wrong = |error| Failure::usage(format!("--at: {}: {error}", path.display()));
                let (bus, terminal) = plug_in(&mut link).map_err(wrong)?;
                (bus, Some(link), format!("{} ({terminal})", path.display()))
            }
        };
        expect_format(&*bus, at, needs_flexible).map_err(Failure::run)?;
        Ok(Self { bus: Some(bus), link, name, fault: BusFault::Well, is_alone: false })
    }

    /// A fault of the bus.
    ///
    /// # Errors
    /// An interface cannot be unplugged, or there is no pseudo terminal left.
    pub fn spoil(&mut self, fault: BusFault) -> Result<(), String> {
        match (&mut self.link, fault) {
            (Some(link), BusFault::Unplugged) => {
                self.bus = None;
                link.remove().map_err(|error| error.to_string())?;
            }
            (None, BusFault::Unplugged) => return Err("an interface is not unplugged from here".to_owned()),
            (Some(link), _) if self.bus.is_none() => {
                self.bus = Some(plug_in(link).map_err(|error| error.to_string())?.0);
            }
            _ => {}
        }
        self.fault = fault;
        Ok(())
    }

    /// The frames of somebody else that fill the bus in a step.
    pub fn step(&mut self) {
        if let (Some(bus), BusFault::Full) = (&mut self.bus, self.fault) {
            // An adapter without room counts them.
            let _ = (0..FLOOD).try_for_each(|_| bus.send(&Frame::standard(0x7F, [0; 8])).map(|_| ()));
        }
    }

    /// Takes the frames that have come, and sends what the devices answer.
    ///
    /// # Errors
    /// The bus cannot be used.
    pub fn exchange(&mut self, devices: &mut Devices, out: &mut Outbox) -> Result<(), Failure> {
        let Some(bus) = &mut self.bus else {
            out.clear();
            return Ok(());
        };
        let exchanged = exchange(bus.as_mut(), self.fault, devices, out);
        self.is_alone = matches!(exchanged, Err(BusError::Gone(_))) && self.link.is_some();
        if self.is_alone { Ok(()) } else { exchanged.map_err(Failure::run) }
    }

    /// Waits for frames until the next step at most.
    ///
    /// # Errors
    /// The bus cannot be used.
    pub fn wait(&mut self, until_ns: u64) -> Result<(), Failure> {
        let rest = Duration::from_nanos(until_ns.saturating_sub(monotonic_ns()));
        let is_silent = self.is_silent();
        let Some(bus) = self.bus.as_mut().filter(|_| !is_silent) else { return Ok(()) };
        match bus.wait(rest) {
            // The next exchange looks whether somebody has opened the other end again.
            Err(BusError::Gone(_)) if self.link.is_some() => self.is_alone = true,
            waited => waited.map_err(Failure::run)?,
        }
        Ok(())
    }

    /// Whether nothing can come: [`Self::wait`] does not wait.
    pub fn is_silent(&self) -> bool {
        self.is_alone || self.bus.is_none() || self.fault == BusFault::Full
    }
}

impl fmt::Display for Wire {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(&self.name)
    }
}

/// A new pseudo terminal at the link, and its name.
fn plug_in(link: &mut Link) -> io::Result<(Box<dyn Bus>, String)> {
    let (adapter, terminal) = pseudo_terminal()?;
    let bus = SlcanBus::adapter(adapter).map_err(io::Error::other)?;
    link.point_to(&terminal)?;
    Ok((Box::new(bus), terminal))
}

fn exchange(bus: &mut dyn Bus, fault: BusFault, devices: &mut Devices, out: &mut Outbox) -> Result<(), BusError> {
    match fault {
        BusFault::Off => {
            out.clear();
            while bus.receive()?.is_some() {}
        }
        BusFault::Full => out.clear(),
        BusFault::Well | BusFault::Unplugged => {
            while let Some(received) = bus.receive()? {
                devices.take(&received.frame, out);
                send(bus, out)?;
            }
        }
    }
    send(bus, out)
}

fn send(bus: &mut dyn Bus, out: &mut Outbox) -> Result<(), BusError> {
    for frame in out.frames() {
        bus.send(frame)?;
    }
    out.clear();
    bus.flush()
}
