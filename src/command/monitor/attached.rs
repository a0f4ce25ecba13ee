//! A group that is shown: its frames are published as they come.

use std::time::{Duration, Instant};

use pipeline::{
    channel::{ChannelError, Prefix},
    message::AxisState,
    stage::monotonic_ns,
};

use super::{
    details::{Details, is_looked_at},
    frame::{AxesFrame, Hello, StagesFrame, line},
    published::{Kind, Published},
};
use crate::{
    group::live::{Live, unix_ms},
    report::motion::side::Side,
};

/// Time between two frames at most; there is one with each heartbeat of the controller.
const LONGEST: Duration = Duration::from_millis(400);
/// Time between two frames about the stages.
const STAGES_APART: Duration = Duration::from_millis(450);

/// A group that is shown.
pub struct Attached {
    /// Number of the attachment.
    attachment: u64,
    /// The page may operate axes.
    controls: bool,
    live: Live,
    side: Option<Side>,
    /// Number of the newest event that was published.
    told: u64,
    /// While somebody looks at them.
    details: Option<Details>,
    framed: Instant,
    staged: Instant,
}

impl Attached {
    /// Joins a group that runs, and publishes who it is.
    ///
    /// # Errors
    /// Its channels cannot be opened.
    pub fn join(prefix: &Prefix, attachment: u64, controls: bool, published: &Published) -> Result<Self, ChannelError> {
        let live = Live::join(prefix, "monitor")?;
        let now = Instant::now();
        published.history().clear();
        published.put(Kind::Events, "[]".to_owned());
        let mut attached =
            Self { attachment, controls, live, side: None, told: 0, details: None, framed: now, staged: now };
        attached.greet(published);
        Ok(attached)
    }

    /// Leaves the group, and removes its files if it was the last member.
    pub fn leave(self) {
        self.live.leave();
    }

    /// Whether the group has ended.
    pub fn is_over(&mut self) -> bool {
        self.live.is_over()
    }

    /// Publishes group and machine.
    fn greet(&mut self, published: &Published) {
        let machine = self.live.machine();
        self.side = machine.as_ref().ok().and_then(|machine| machine.mechanism.as_ref()).map(Side::new);
        published.put(Kind::Hello, line(&Hello::of(self.attachment, self.live.prefix(), machine, self.controls)));
    }

    /// Reads what has come and publishes it.
    ///
    /// # Errors
    /// A channel cannot be read.
    pub fn step(&mut self, published: &Published) -> Result<(), ChannelError> {
        let new = self.live.step()?;
        if self.live.learn() {
            self.greet(published);
        }
        new.iter().for_each(|state| published.history().push(unix_ms(), state));
        let (told, number) = self.live.told();
        if number != self.told {
            self.told = number;
            published.put(Kind::Events, line(told));
        }
        self.look_closer(published)?;
        if !new.is_empty() || self.framed.elapsed() > LONGEST {
            self.framed = Instant::now();
            self.frame(published);
        }
        Ok(())
    }

    /// Listens to the channels of the details while somebody looks at them.
    fn look_closer(&mut self, published: &Published) -> Result<(), ChannelError> {
        if !is_looked_at(*published.details_asked()) {
            self.details = None;
            return Ok(());
        }
        let details = match &mut self.details {
            Some(details) => details,
            none => none.insert(Details::open(&self.live)?),
        };
        let names: Vec<&str> = match self.live.state() {
            Some(state) => state.axes.iter().take(state.header.axis_count as usize).map(AxisState::name).collect(),
            None => Vec::new(),
        };
        if let Some(frame) = details.step(&names)? {
            *published.details() = line(&frame);
        }
        Ok(())
    }

    fn frame(&mut self, published: &Published) {
        let report = self.live.report();
        let frame = AxesFrame::new(&report, self.live.state(), monotonic_ns(), self.side.as_ref());
        published.put(Kind::Axes, line(&frame));
        if self.staged.elapsed() > STAGES_APART {
            self.staged = Instant::now();
            published.put(Kind::Stages, line(&StagesFrame::new(&report)));
        }
        *published.report() = Some(report);
    }
}
