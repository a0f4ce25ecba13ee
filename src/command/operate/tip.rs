//! `hydraxis operate --tip`: the bucket's teeth go to a place in a straight line ([`crate::teeth`]), or from place to
//! place of standard input ([`super::places`]).

use std::time::Instant;

use pipeline::{channel::Prefix, message::AxisMode};

use super::{
    LINE_PERIOD, OperateArguments,
    places::{Next, Places},
};
use crate::{
    failure::Failure,
    group::operator::Operator,
    report::output::show,
    teeth::{ALL, MovableTeeth, TeethPlace},
};

/// Distance of the teeth from their place beyond which they have not come to it, m.
const ARRIVED: f64 = 0.03;

/// What `--tip` asks of a group.
pub struct TipMove {
    teeth: MovableTeeth,
    first: TeethPlace,
    places: Places,
}

impl TipMove {
    /// What the arguments ask of this group; none without `--tip`. Waits for the first place, with no part in the group
    /// so far: whoever operates it goes on.
    ///
    /// # Errors
    /// The machine of the group has no teeth, its axes follow no program, or only some of them are meant; or there is
    /// no place.
    pub fn asked(arguments: &OperateArguments, prefix: &Prefix) -> Result<Option<Self>, Failure> {
        if arguments.tip.is_some() && !arguments.group.axes.is_empty() {
            let text = "--tip: found together with --axis; allowed: without, since all four axes move the teeth";
            return Err(Failure::usage(text));
        }
        let Some(tip) = arguments.tip else { return Ok(None) };
        let teeth = MovableTeeth::new(prefix).map_err(about)?;
        let (first, places) = Places::of(tip, arguments)?;
        Ok(Some(Self { teeth, first, places }))
    }

    /// Refuses a first place that the machine cannot reach from where it is.
    ///
    /// # Errors
    /// A position is not known, or the machine cannot do it.
    pub fn judge(&self, operator: &mut Operator) -> Result<(), Failure> {
        self.teeth.plan(self.first, operator).map(|_| ()).map_err(about)
    }

    /// Arms the axes, moves the teeth to the first place and to those that follow, and holds them there until the end.
    ///
    /// # Errors
    /// An axis does not follow any more, a place is none or cannot be reached, or the group cannot be operated.
    pub fn run(&mut self, arguments: &OperateArguments, operator: &mut Operator) -> Result<(), Failure> {
        let begin = Instant::now();
        let mut next = Some(self.first);
        while let Some(place) = next {
            next = self.go(place, begin, arguments, operator)?;
        }
        Ok(())
    }

    /// Moves the teeth to a place and holds them there, until the next place or the end; the next place.
    fn go(
        &mut self,
        place: TeethPlace,
        begin: Instant,
        arguments: &OperateArguments,
        operator: &mut Operator,
    ) -> Result<Option<TeethPlace>, Failure> {
        let Some(mut moving) = self.teeth.begin(place, operator).map_err(about)? else { return Ok(None) };
        let (mut next_line, mut away) = (Instant::now(), place.away(moving.start()));
        while arguments.duration.is_none_or(|duration| begin.elapsed() < duration) {
            let Some(sample) = operator.sample()? else { break };
            let (now, arrives) = moving.step(operator, &sample)?;
            away = place.away([now.x, now.z]);
            if Instant::now() >= next_line {
                next_line += LINE_PERIOD;
                let seconds = 1e-9 * sample.header.sequence as f64 * operator.machine().period_ns as f64;
                show(&format!("{seconds:8.2} s  {}\n", moving.told(&now)))?;
            }
            if arrives {
                show(&format!("at the end: {}\n", moving.told(&now)))?;
            }
            if !moving.has_arrived() {
                continue;
            }
            match self.places.next()? {
                Next::Wait => {}
                Next::Place(next) if away <= ARRIVED => return Ok(Some(next)),
                Next::Place(_) => break,
                Next::End => {
                    if arguments.leave {
                        ALL.into_iter().for_each(|axis| operator.axis(axis).hold_to_run = 0);
                        operator.change(&ALL, AxisMode::Hold)?;
                    }
                    break;
                }
            }
        }
        if operator.stopping() || away <= ARRIVED {
            return Ok(None);
        }
        let (TeethPlace { to: [x, z], .. }, away, allowed) = (place, 1e3 * away, 1e3 * ARRIVED);
        Err(Failure::run(format!(
            "--tip: found the teeth {away:.0} mm from [{x}, {z}] m at the end; allowed: {allowed:.0} mm: more time, or \
             a lower --speed"
        )))
    }
}

fn about(failure: Failure) -> Failure {
    failure.about("--tip")
}
