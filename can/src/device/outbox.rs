//! Frames that are to be sent.

use crate::Frame;

/// Most frames that wait: eight axes with two devices each, four frames for each device in one cycle.
const ROOM: usize = 64;

/// Frames that are to be sent, in their order. Takes no memory after construction.
#[derive(Debug, Clone)]
pub struct Outbox {
    frames: [Frame; ROOM],
    count: usize,
    /// Frames for which there was no room.
    dropped: u64,
}

impl Default for Outbox {
    fn default() -> Self {
        Self { frames: [Frame::standard(0, []); ROOM], count: 0, dropped: 0 }
    }
}

impl Outbox {
    /// Adds a frame; one that finds no room is counted.
    pub fn push(&mut self, frame: Frame) {
        match self.frames.get_mut(self.count) {
            Some(place) => {
                *place = frame;
                self.count += 1;
            }
            None => self.dropped += 1,
        }
    }

    /// The frames that wait.
    pub fn frames(&self) -> &[Frame] {
        &self.frames[..self.count]
    }

    /// Forgets the frames, once they were sent.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Number of frames for which there was no room.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}
