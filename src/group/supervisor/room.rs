//! Says when a stage that dies could not start again for want of room, and when it can again: one line each time.

use std::{
    path::PathBuf,
    time::{Duration, Instant},
};

use pipeline::channel::{Prefix, ROOM_MARGIN, Room, rooms};

/// Time between two looks.
const PERIOD: Duration = Duration::from_secs(1);

/// What was seen of one place.
struct Place {
    path: PathBuf,
    /// The largest need so far. A stage that has died needs no less for that.
    needed: u64,
    is_short: bool,
}

/// Watches the room for the files of a group.
pub struct RoomWatch {
    prefix: Prefix,
    next: Instant,
    places: Vec<Place>,
}

impl RoomWatch {
    /// Of a group.
    pub fn new(prefix: &Prefix) -> Self {
        Self { prefix: prefix.clone(), next: Instant::now() + PERIOD, places: Vec::new() }
    }

    /// The lines to say now; most often none.
    pub fn look(&mut self) -> Vec<String> {
        let now = Instant::now();
        if now < self.next {
            return Vec::new();
        }
        self.next = now + PERIOD;
        rooms(&self.prefix).into_iter().filter_map(|room| self.judge(room)).collect()
    }

    fn judge(&mut self, mut room: Room) -> Option<String> {
        let index = self.places.iter().position(|place| place.path == room.place).unwrap_or_else(|| {
            self.places.push(Place { path: room.place.clone(), needed: 0, is_short: false });
            self.places.len() - 1
        });
        let place = &mut self.places[index];
        place.needed = place.needed.max(room.needed);
        room.needed = place.needed;
        // Room that changes by little about the bound is told once.
        let is_short = room.is_short() || (place.is_short && room.left < room.needed + ROOM_MARGIN);
        let has_changed = std::mem::replace(&mut place.is_short, is_short) != is_short;
        has_changed.then(|| if is_short { format!("warning: {room}") } else { room.to_string() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room(left: u64, needed: u64) -> Room {
        Room { place: "/dev/shm".into(), left: left << 20, needed: needed << 20 }
    }

    #[test]
    fn a_change_is_said_once_and_not_again_for_small_changes_about_the_bound() {
        let mut watch = RoomWatch::new(&"room".parse().unwrap());
        let mut said = |left, needed| watch.judge(room(left, needed));
        assert_eq!(said(8, 8), None);
        assert!(said(7, 8).unwrap().starts_with("warning: /dev/shm has 7.3 MB left"));
        assert_eq!([said(7, 8), said(8, 8), said(7, 8), said(0, 8)], [const { None }; 4]);
        // A stage has died, and what is left of the group needs less.
        assert_eq!(said(7, 2), None);
        assert_eq!(said(9, 2).unwrap(), "/dev/shm has 9.4 MB left, and a stage needs 8.4 MB to start again: it can");
        assert_eq!(said(8, 2), None);
        assert!(said(0, 2).is_some());
    }
}
