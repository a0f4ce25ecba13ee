//! `hydraxis operate --tip`: the bucket's teeth go to a place in a straight line ([`crate::teeth`]).

use std::time::Instant;

use pipeline::{channel::Prefix, message::AxisMode};

use super::{LINE_PERIOD, OperateArguments};
use crate::{
    failure::Failure,
    group::operator::Operator,
    report::output::show,
    teeth::{ALL, SPEED, TeethMove, TeethPlace},
};

/// Distance of the teeth from their place beyond which they have not come to it, m.
const ARRIVED: f64 = 0.03;

/// What the arguments ask of this group; none without `--tip`.
///
/// # Errors
/// The machine of the group has no teeth, its axes follow no program, or only some of them are meant.
pub fn asked(arguments: &OperateArguments, prefix: &Prefix) -> Result<Option<TeethMove>, Failure> {
    let Some(to) = arguments.tip else { return Ok(None) };
    if !arguments.group.axes.is_empty() {
        let text = "--tip: found together with --axis; allowed: without, since all four axes move the teeth";
        return Err(Failure::usage(text));
    }
    let place = TeethPlace { to, pitch: arguments.pitch, speed: arguments.speed.unwrap_or(SPEED) };
    TeethMove::new(prefix, place).map(Some).map_err(about)
}

/// Refuses what the machine cannot do.
///
/// # Errors
/// A position is not known, or the machine cannot do it.
pub fn judge(teeth: &TeethMove, operator: &mut Operator) -> Result<(), Failure> {
    teeth.plan(operator).map(|_| ()).map_err(about)
}

/// Arms the axes, moves the teeth, and holds them there until the end.
///
/// # Errors
/// An axis does not follow any more, or the group cannot be operated.
pub fn run(teeth: &TeethMove, arguments: &OperateArguments, operator: &mut Operator) -> Result<(), Failure> {
    let Some(mut moving) = teeth.begin(operator).map_err(about)? else { return Ok(()) };
    let begin = Instant::now();
    let (mut next_line, mut away) = (begin, teeth.away(moving.start()));
    while arguments.duration.is_none_or(|duration| begin.elapsed() < duration) {
        let Some(sample) = operator.sample()? else { break };
        let (now, arrives) = moving.step(operator, &sample)?;
        away = teeth.away([now.x, now.z]);
        if Instant::now() >= next_line {
            next_line += LINE_PERIOD;
            let seconds = 1e-9 * sample.header.sequence as f64 * operator.machine().period_ns as f64;
            show(&format!("{seconds:8.2} s  {}\n", teeth.told(&now)))?;
        }
        if arrives {
            show(&format!("at the end: {}\n", teeth.told(&now)))?;
            if arguments.leave {
                ALL.into_iter().for_each(|axis| operator.axis(axis).hold_to_run = 0);
                operator.change(&ALL, AxisMode::Hold)?;
                break;
            }
        }
    }
    if operator.stopping() || away <= ARRIVED {
        return Ok(());
    }
    let (Some([x, z]), away, allowed) = (arguments.tip, 1e3 * away, 1e3 * ARRIVED) else { return Ok(()) };
    Err(Failure::run(format!(
        "--tip: found the teeth {away:.0} mm from [{x}, {z}] m at the end; allowed: {allowed:.0} mm: more time, or a \
         lower --speed"
    )))
}

fn about(failure: Failure) -> Failure {
    failure.about("--tip")
}
