//! SocketCAN: an interface of the kernel.
//!
//! The time of a frame is the kernel's where it gives one. It counts on the clock of the day, so the age of the frame
//! is taken from there and put onto `CLOCK_MONOTONIC`; a clock that was set meanwhile gives an age that no frame has,
//! and the time of reading is taken then.
//!
//! Trap: the kernel sends the frame of a full queue to nobody and says `ENOBUFS`: the frame is counted as unsent. A
//! controller that goes bus-off says so by an error frame; without `restart-ms` it stays off.
//!
//! Whether an interface has CAN FD is told by the longest frame that it takes (its MTU): 16 bytes with their header, or
//! 72. One that has none refuses such a frame as if the adapter were gone, so none is handed to it.

use std::{
    fs,
    io::{self, ErrorKind},
    os::fd::AsFd,
    path::Path,
    time::{Duration, SystemTime},
};

use embedded_can::Frame as _;
use socketcan::{CanAnyFrame, CanDataFrame, CanFdFrame, CanFdSocket, CanRemoteFrame, Socket as _, SocketOptions as _};

use super::{Bus, BusError, Claim, serial::wait_for};
use crate::{Counters, Format, Frame, Received, frame_clock::monotonic_ns};

/// Older than this no frame can be that is still in the queue of the socket.
const OLDEST: Duration = Duration::from_secs(1);
/// What is said where the kernel has no CAN.
const NO_CAN: &str = "this kernel has no CAN (AF_CAN), or has not loaded it; type: modprobe can_raw";
/// Is there where the kernel has CAN.
const CAN_FOLDER: &str = "/proc/net/can";
/// The kernel has no CAN.
const EAFNOSUPPORT: i32 = 97;
/// There is no such interface.
const ENODEV: i32 = 19;
/// The interface is down.
const ENETDOWN: i32 = 100;
/// Longest frame of an interface with CAN FD, bytes.
const FD_MTU: u32 = 72;
/// Flag of an interface that is up.
const IFF_UP: u32 = 1;
/// The queue of the interface is full.
const ENOBUFS: i32 = 105;
/// Class bit of an error frame: the controller has gone bus-off.
const BUS_OFF: u32 = 0x40;

/// An interface of the kernel.
pub struct SocketBus {
    socket: CanFdSocket,
    has_times: bool,
    is_flexible: bool,
    /// Whether data of CAN FD are sent at a bit rate of their own.
    is_fast: bool,
    counters: Counters,
    claim: Option<Claim>,
}

impl SocketBus {
    /// Opens the interface `name`, such as `can0`. With `is_fast` data of CAN FD are sent at a bit rate of their own.
    ///
    /// # Errors
    /// The kernel has no CAN, there is no such interface, it is down, or the right is missing.
    pub fn open(name: &str, is_fast: bool) -> Result<Self, BusError> {
        let socket = CanFdSocket::open(name).map_err(|error| BusError::open(name, &explain(name, &error), error))?;
        if !is_up(name) {
            // The socket itself would say so with the first frame only.
            let down = io::Error::from_raw_os_error(ENETDOWN);
            return Err(BusError::open(name, &explain(name, &down), down));
        }
        let failed = |error| BusError::open(name, "the socket cannot be set up", error);
        socket.set_nonblocking(true).map_err(failed)?;
        socket.set_error_filter_accept_all().map_err(failed)?;
        let has_times = socket.set_recv_timestamp(true).is_ok();
        let is_flexible = has_flexible(name);
        Ok(Self { socket, has_times, is_flexible, is_fast, counters: Counters::default(), claim: None })
    }

    /// With the right to send, which no other program has then.
    ///
    /// # Errors
    /// Another program has it.
    pub fn claimed(self, name: &str) -> Result<Self, BusError> {
        Ok(Self { claim: Some(Claim::take(name)?), ..self })
    }

    fn read(&self) -> io::Result<(CanAnyFrame, Option<SystemTime>)> {
        if self.has_times {
            let (frame, times) = self.socket.read_frame_with_timestamp().map(|(frame, time)| (frame, Some(time)))?;
            return Ok((frame, times));
        }
        self.socket.read_frame().map(|frame| (frame, None))
    }

    /// Counts an error frame by its class bits.
    fn count_error(&mut self, class: u32) {
        if class & BUS_OFF != 0 {
            self.counters.bus_off += 1;
        } else {
            self.counters.errors += 1;
        }
    }
}

/// Whether an interface is up, by its flags; an unknown one is taken as up.
fn is_up(name: &str) -> bool {
    let flags = fs::read_to_string(format!("/sys/class/net/{name}/flags")).ok();
    let flags = flags.and_then(|text| u32::from_str_radix(text.trim().trim_start_matches("0x"), 16).ok());
    flags.is_none_or(|flags| flags & IFF_UP != 0)
}

/// Whether an interface has CAN FD.
fn has_flexible(name: &str) -> bool {
    let mtu = fs::read_to_string(format!("/sys/class/net/{name}/mtu")).ok();
    mtu.and_then(|text| text.trim().parse::<u32>().ok()).is_some_and(|mtu| mtu >= FD_MTU)
}

fn explain(name: &str, error: &io::Error) -> String {
    match error.raw_os_error() {
        Some(EAFNOSUPPORT) => NO_CAN.to_owned(),
        // The name is looked up before the kernel is asked for CAN.
        Some(ENODEV) if !Path::new(CAN_FOLDER).exists() => NO_CAN.to_owned(),
        Some(ENODEV) => format!("there is no such interface; `ip link` shows those there are, {name} is none of them"),
        Some(ENETDOWN) => format!("the interface is down; type: ip link set {name} up type can bitrate 500000"),
        _ if error.kind() == ErrorKind::PermissionDenied => "this user may not open CAN sockets".to_owned(),
        _ => "cannot be opened as a CAN interface".to_owned(),
    }
}

/// The frame as ours; `None` of an error frame.
fn ours(frame: &CanAnyFrame) -> Option<Frame> {
    match frame {
        CanAnyFrame::Normal(frame) => Frame::new(frame.id(), frame.data()),
        CanAnyFrame::Remote(frame) => Frame::new_remote(frame.id(), frame.dlc()),
        CanAnyFrame::Fd(frame) => Frame::flexible(frame.id(), frame.is_brs(), frame.data()),
        CanAnyFrame::Error(_) => None,
    }
}

fn theirs(frame: &Frame) -> Option<CanAnyFrame> {
    match frame.format() {
        Format::Remote => CanRemoteFrame::new_remote(frame.id(), frame.dlc()).map(CanAnyFrame::Remote),
        Format::Classical => CanDataFrame::new(frame.id(), frame.data()).map(CanAnyFrame::Normal),
        Format::Flexible { is_fast } => {
            let mut theirs = CanFdFrame::new(frame.id(), frame.data())?;
            theirs.set_brs(is_fast);
            Some(CanAnyFrame::Fd(theirs))
        }
    }
}

/// The time of `stamp` on the monotonic clock, where `now_ns` and `today` are the same time on both clocks.
fn onto_monotonic(stamp: SystemTime, today: SystemTime, now_ns: u64) -> u64 {
    match today.duration_since(stamp) {
        Ok(age) if age < OLDEST => now_ns.saturating_sub(age.as_nanos() as u64),
        _ => now_ns,
    }
}

impl Bus for SocketBus {
    fn receive(&mut self) -> Result<Option<Received>, BusError> {
        loop {
            match self.read() {
                Ok((CanAnyFrame::Error(error), _)) => self.count_error(error.error_bits()),
                Ok((frame, stamp)) => {
                    let now_ns = monotonic_ns();
                    let time_ns = stamp.map_or(now_ns, |stamp| onto_monotonic(stamp, SystemTime::now(), now_ns));
                    if let Some(frame) = ours(&frame) {
                        self.counters.count_received(&frame);
                        return Ok(Some(Received { frame, time_ns }));
                    }
                    self.counters.malformed += 1;
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(None),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(BusError::Gone(error)),
            }
        }
    }

    fn send(&mut self, frame: &Frame) -> Result<bool, BusError> {
        let frame = &frame.with_speed(self.is_fast);
        let can_send = self.claim.is_some() && (self.is_flexible || !frame.is_flexible());
        let Some(theirs) = theirs(frame).filter(|_| can_send) else {
            self.counters.unsent += 1;
            return Ok(false);
        };
        match self.socket.write_frame(&theirs) {
            Ok(()) => {
                self.counters.count_sent(frame);
                Ok(true)
            }
            Err(error) if error.raw_os_error() == Some(ENOBUFS) || error.kind() == ErrorKind::WouldBlock => {
                self.counters.unsent += 1;
                Ok(false)
            }
            Err(error) => Err(BusError::Gone(error)),
        }
    }

    fn flush(&mut self) -> Result<(), BusError> {
        Ok(())
    }

    fn is_flexible(&self) -> bool {
        self.is_flexible
    }

    fn wait(&mut self, longest: Duration) -> Result<(), BusError> {
        wait_for(self.socket.as_fd(), longest).map_err(BusError::Gone)
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_age_of_a_frame_is_put_onto_the_monotonic_clock() {
        let today = SystemTime::UNIX_EPOCH + Duration::from_secs(1000);
        let stamp = today - Duration::from_micros(150);
        assert_eq!(onto_monotonic(stamp, today, 1_000_000), 850_000);
        assert_eq!(onto_monotonic(today + Duration::from_secs(3600), today, 1_000_000), 1_000_000);
        assert_eq!(onto_monotonic(today - Duration::from_secs(3600), today, 1_000_000), 1_000_000);
    }

    #[test]
    fn frames_of_both_kinds_are_theirs_and_ours_again() {
        let id = embedded_can::ExtendedId::new(0x18FF_0100).unwrap();
        for frame in [
            Frame::new(id, &[1, 2, 3]).unwrap(),
            Frame::new_remote(id, 5).unwrap(),
            Frame::flexible(id, true, &[9; 48]).unwrap(),
            Frame::flexible(id, false, &[9; 8]).unwrap(),
        ] {
            assert_eq!(ours(&theirs(&frame).unwrap()), Some(frame));
        }
    }

    #[test]
    fn an_interface_that_cannot_be_opened_is_explained() {
        let Err(error) = SocketBus::open("none-such0", false) else { panic!("there is an interface none-such0") };
        let said = error.to_string();
        assert!(is_up("lo") && is_up("none-such0"));
        let expected = ["none-such0: this kernel has no CAN (AF_CAN)", "none-such0: there is no such interface"];
        assert!(expected.iter().any(|start| said.starts_with(start)), "{said}");
    }
}
