//! Virtual walls: how far commands may go towards places that no part of boom, arm and bucket passes.
//!
//! ```text
//! d   = limit - n . P - r                           distance of a part from a wall
//! w_i = n . dP/dy_i v_i                             what axis i adds to the speed towards it
//! H(s) = sum_{w_i > 0} (s w_i t_i + s^2 w_i |v_i| / (2 a_i)) - sum_{w_i < 0} s |w_i| c_i + s sum_j X_j
//! X_j = sum_{i /= j} |n . dP/dy_i| x_ij             how far a part swings when axis j stops and swings back
//! x_ij = 2 |M_ij v_j| / (M_ii w0_i)                 how far axis i swings then
//! s   = the largest s <= 1 with H(s) <= max(d, 0), over all walls and parts
//! ```
//!
//! P place of a part and r how far the body stands out there in m, n normal of the wall, y_i position of a cylinder in
//! m, v_i its speed in m/s; t_i time in s and a_i deceleration in m/s2 with which it stops, c_i time in s for which an
//! axis that leads away goes on at least; M mass matrix of the cylinders with the heaviest payload in kg, w0 angular
//! frequency of an axis on its spring of oil in rad/s, 2 pi 4 Hz where it was not found. A part is a pin, the end of
//! the rocker, the teeth, or a corner of the bucket: between them the bodies are taken as straight, so the farthest
//! place is one of these.
//!
//! Two rules, both for all four cylinders together, because one that stops while another goes on moves the teeth:
//!
//! | rule | v | t_i | what it does |
//! |---|---|---|---|
//! | gentle | of a person's commands, by curve and load | `stop_reaction` | these speeds become s times as fast |
//! | hard | the greater of measured and commanded | 1.5 (t_d + tau) + T + 20 ms + 1/w0 | s < 1: neutral |
//!
//! The hard rule spares an axis that leads away while X_j <= |w_j| t_j + 3 mm: not one that shakes the others more than
//! that. t_d is the dead time and tau the lag of the commissioned model; 1/w0 counts only where a swing was found; a_i
//! is `stop_deceleration`. An axis without a commissioned model has t_i = 1 s and c_i = 0, others have c_i =
//! (t_d + tau)/2.
//!
//! A direction that the hard rule has stopped stays neutral for t_i more, and for a swing of the axis at least.
//!
//! A person's command is taken to open the valve by 0.02 more than it does, so that what a wall leaves of it in the end
//! is no command at the edge of the dead band, where an axis begins late and faster than its curve says.
//!
//! Speeds of commands are g times those of the static curve where a load may overrun the axis ([`Overrun`]).
//!
//! Trap: an axis whose position is not known may be anywhere. Then all four are neutral.

use mechanism::{AXES, CylinderDynamics, FourBar, Joint, Mechanism, Pose, PreparedMechanism, Rotation, Vector};
use pipeline::machine::{Axis, Commissioned, Machine, Overrun, Walls as WallSettings};

use crate::load::dynamics_at_rest;

/// t of an axis that is not commissioned, s.
const UNKNOWN_TIME: f64 = 1.0;
/// Part of dead time and lag that stopping may take longer by, and part of it for which motion away goes on for sure.
const LATER: f64 = 1.5;
const SOONER: f64 = 0.5;
/// w0 of an axis of which no swing was found, rad/s: 4 Hz.
const UNKNOWN_SWING: f64 = 4.0 * std::f64::consts::TAU;
/// Momentum that an axis passes on when it stops, in parts of its own: on its spring of oil it comes back as fast.
const RECOIL: f64 = 2.0;
/// Half of the time over which speeds are measured, s.
const SPEED_DELAY: f64 = 0.02;
/// Way beyond d before the hard rule acts, m: the noise of the encoders at rest.
const SLACK: f64 = 3e-3;
/// Opening by which a valve may begin before the dead band that was found ends: a curve is least exact there.
const UNSURE: f64 = 0.02;
/// Least distance of a task from a wall, m, and speed by which teeth may be faster towards it than planned while the
/// axes stop, m/s.
const LEAST_MARGIN: f64 = 0.03;
const ASTRAY: f64 = 0.25;
/// Step of a cylinder for the motion of the rocker, m.
const STEP: f64 = 1e-4;

/// The names of the walls, in the order of [`Walls`], as keys of the machine file.
pub const NAMES: [&str; 3] = ["depth", "height", "reach"];
const NORMALS: [Vector; 3] = [Vector::new(0.0, -1.0), Vector::new(0.0, 1.0), Vector::new(1.0, 0.0)];

/// A place on a body, in its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Part {
    /// Last joint that moves it.
    last: usize,
    frame: Frame,
    at: Vector,
    /// r, m.
    radius: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Frame {
    Boom,
    Arm,
    /// The inner section of the arm, from the bucket pin.
    Inner,
    Bucket,
    /// The end of the rocker.
    Rocker,
}

/// How one axis stops.
#[derive(Debug, Clone, PartialEq)]
struct Stop {
    /// t of the gentle and of the hard rule, s.
    gentle: f64,
    hard: f64,
    /// c, s.
    away: f64,
    /// a, m/s2.
    deceleration: f64,
    /// w0, rad/s.
    swing: f64,
    /// Part of the difference to a commanded speed that the axis makes good in a period.
    decay: f64,
    curve: Curve,
    overrun: Overrun,
    /// Speed that the axis comes to by its commands so far, m/s.
    coming: f64,
    /// Ticks for which a direction that the hard rule has stopped stays neutral.
    rest: u32,
    /// Those that are left, extending and retracting.
    resting: [u32; 2],
}

/// Speed by command.
#[derive(Debug, Clone, PartialEq)]
enum Curve {
    Measured(Commissioned),
    /// (dead bands extending and retracting, largest command, largest speed)
    Assumed((f64, f64), f64, f64),
}

impl Curve {
    fn speed(&self, command: f64) -> f64 {
        match self {
            Self::Measured(model) => model.speed(command),
            Self::Assumed(bands, most, speed) => {
                let closed = if command > 0.0 { bands.0 } else { bands.1 };
                let part = (command.abs() - closed).max(0.0) / (most - closed).max(1e-3);
                speed.copysign(command) * part
            }
        }
    }

    fn command(&self, speed: f64) -> f64 {
        match self {
            Self::Measured(model) => model.command(speed),
            Self::Assumed(..) if speed == 0.0 => 0.0,
            Self::Assumed(bands, most, fastest) => {
                let closed = if speed > 0.0 { bands.0 } else { bands.1 };
                (closed + (most - closed).max(1e-3) * speed.abs() / fastest).copysign(speed)
            }
        }
    }
}

impl Stop {
    fn new(axis: &Axis, period: f64) -> Self {
        let limits = axis.motion_limits(period);
        let control = &axis.control;
        let (mut hard, mut away, mut lag) = (UNKNOWN_TIME, 0.0, UNKNOWN_TIME);
        let (mut swing, mut overrun) = (UNKNOWN_SWING, Overrun::NONE);
        let mut curve = Curve::Assumed(
            (control.dead_band.extend, control.dead_band.retract),
            control.command_limit,
            axis.max_speed,
        );
        if let Some(model) = &axis.commissioned {
            hard = LATER * model.reaction() + period + SPEED_DELAY;
            if model.natural_frequency > 0.0 {
                swing = std::f64::consts::TAU * model.natural_frequency;
                hard += 1.0 / swing;
            }
            (away, lag) = (SOONER * model.reaction(), model.time_constant);
            overrun = model.overrun;
            curve = Curve::Measured(model.clone());
        }
        Self {
            gentle: limits.stop_reaction.max(hard),
            hard,
            away,
            deceleration: limits.stop_deceleration,
            swing,
            decay: 1.0 - (-period / lag.max(1e-6)).exp(),
            curve,
            overrun,
            coming: 0.0,
            rest: (hard.max(std::f64::consts::TAU / swing) / period).ceil() as u32,
            resting: [0; 2],
        }
    }

    /// Leaves a direction neutral for a while that the hard rule has stopped: who goes on with every swing that leads
    /// away keeps it alive.
    fn come_to_rest(&mut self, command: &mut f64, is_stopped: &mut bool, wanted: f64) {
        let side = usize::from(wanted < 0.0);
        if *is_stopped {
            self.resting[side] = self.rest;
        } else if wanted != 0.0 && self.resting[side] > 0 {
            (*command, *is_stopped) = (0.0, true);
        }
        self.resting = self.resting.map(|ticks| ticks.saturating_sub(1));
    }

    /// Speed that a command makes at most, m/s, by the curve.
    fn speed(&self, command: f64, is_manual: bool) -> f64 {
        let more = if is_manual && command != 0.0 { UNSURE } else { 0.0 };
        self.curve.speed(command + more.copysign(command))
    }
}

/// What an axis asks for in a tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wanted {
    /// Valve command.
    pub command: f64,
    /// Position, m, and measured speed, m/s; none where they are not known.
    pub motion: Option<(f64, f64)>,
    /// A person commands it in mode manual: its speed becomes smaller towards a wall.
    pub is_manual: bool,
}

/// What the walls leave of the commands of a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Allowed {
    /// Valve commands.
    pub commands: [f64; AXES],
    /// The hard rule has made these axes neutral.
    pub stopped: [bool; AXES],
}

/// Motion of the cylinders towards a wall.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Headway {
    /// Coefficients of s and s^2 in H.
    linear: f64,
    square: f64,
}

impl Headway {
    fn add(&mut self, w: f64, speed: f64, time: f64, stop: &Stop) {
        if w > 0.0 {
            self.linear += w * time;
            self.square += w * speed.abs() / (2.0 * stop.deceleration);
        } else {
            self.linear += w * stop.away;
        }
    }

    fn at(&self, s: f64) -> f64 {
        s * (self.linear + s * self.square)
    }

    /// The largest s up to 1 with H(s) <= `distance`; 0 for a distance that is not a number.
    fn factor(&self, distance: f64) -> f64 {
        let distance = distance.max(0.0);
        if self.at(1.0) <= distance {
            return 1.0;
        }
        let (b, a) = (self.linear, self.square);
        let root = (b * b + 4.0 * a * distance).sqrt();
        // The form without a difference of nearly equal numbers.
        let factor = if b > 0.0 { 2.0 * distance / (b + root) } else { (root - b) / (2.0 * a) };
        if factor.is_finite() { factor.clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// How far a part comes towards a wall, m, by swings `swings` of all axes, m.
fn shake(rates: &[f64; AXES], swings: &[f64; AXES]) -> f64 {
    rates.iter().zip(swings).map(|(rate, swing)| rate.abs() * swing).sum()
}

/// The walls of a machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Walls {
    mechanism: PreparedMechanism,
    linkage: FourBar,
    /// Length of the bucket's cylinder at position 0, m.
    retracted: f64,
    /// Limits along the normals; infinite where there is no wall.
    limits: [f64; 3],
    parts: Vec<Part>,
    stops: [Stop; AXES],
}

impl Walls {
    /// Of a machine with `[walls]`, `[mechanism]` and four axes; none for another one.
    pub fn of(machine: &Machine) -> Option<Self> {
        let (settings, mut mechanism) = (machine.walls.as_ref()?, machine.mechanism?);
        mechanism.masses.payload.mass = settings.payload;
        let axes: &[Axis; AXES] = machine.axes.first_chunk()?;
        let period = machine.timing.period.as_secs_f64();
        let limit = |limit: Option<f64>| limit.unwrap_or(f64::INFINITY);
        Some(Self {
            mechanism: mechanism.prepared(),
            linkage: mechanism.geometry.bucket,
            retracted: mechanism.retracted[Joint::Bucket.axis()],
            limits: [limit(settings.depth), limit(settings.height), limit(settings.reach)],
            parts: parts(settings, &mechanism),
            stops: axes.each_ref().map(|axis| Stop::new(axis, period)),
        })
    }

    /// The wall that a part of the machine is nearest to with the cylinders at `positions` m, by its name, and the
    /// distance, m; negative beyond the wall.
    pub fn least_distance(&self, positions: &[f64; AXES]) -> Option<(&'static str, f64)> {
        let mut least: Option<(&'static str, f64)> = None;
        self.each(positions, |wall, distance, _| {
            // Not a number is beyond every wall.
            let distance = if distance.is_nan() { f64::NEG_INFINITY } else { distance };
            if least.is_none_or(|(_, least)| distance < least) {
                least = Some((NAMES[wall], distance));
            }
        });
        least
    }

    /// The wall that is crossed farthest, by its name, and by how much, m; none where no part is beyond a wall.
    pub fn crossed(&self, positions: &[f64; AXES]) -> Option<(&'static str, f64)> {
        self.least_distance(positions).filter(|(_, distance)| *distance < 0.0).map(|(wall, d)| (wall, -d))
    }

    /// Least distance of a task from a wall, m: what a controller is off its way must not stop the task.
    pub fn margin(&self) -> f64 {
        let slowest = self.stops.iter().map(|stop| stop.hard).fold(0.0, f64::max);
        LEAST_MARGIN.max(ASTRAY * slowest)
    }

    /// The part by which speeds of the cylinders, m/s, have to become smaller at `positions` m, so that they stop
    /// `margin` m before all walls by the hard rule.
    pub fn factor(&self, positions: &[f64; AXES], speeds: &[f64; AXES], margin: f64) -> f64 {
        let mut least = 1.0_f64;
        let swings = self.swings(&dynamics_at_rest(&self.mechanism, positions), speeds);
        self.each(positions, |_, distance, rates| {
            let mut headway = Headway::default();
            for (i, stop) in self.stops.iter().enumerate() {
                headway.add(rates[i] * speeds[i], speeds[i], stop.hard, stop);
                headway.linear += shake(rates, &swings[i]);
            }
            least = least.min(headway.factor(distance - margin));
        });
        least
    }

    /// x_ij, m: how far axes i swing when axis j stops, which has these speeds, m/s; by j and i.
    fn swings(&self, CylinderDynamics { mass, .. }: &CylinderDynamics, speeds: &[f64; AXES]) -> [[f64; AXES]; AXES] {
        std::array::from_fn(|j| {
            std::array::from_fn(|i| match i == j {
                true => 0.0,
                false => RECOIL * (mass[i][j] * speeds[j]).abs() / (mass[i][i] * self.stops[i].swing),
            })
        })
    }

    /// What may be commanded in this tick.
    pub fn update(&mut self, wanted: &[Wanted; AXES]) -> Allowed {
        let mut allowed = Allowed { commands: wanted.map(|axis| axis.command), stopped: [false; AXES] };
        let known = wanted.each_ref().map(|axis| axis.motion);
        let mut faster = [1.0; AXES];
        if let [Some(boom), Some(arm), Some(telescope), Some(bucket)] = known {
            let motion = [boom, arm, telescope, bucket];
            let dynamics = dynamics_at_rest(&self.mechanism, &motion.map(|(position, _)| position));
            faster = std::array::from_fn(|i| {
                self.stops[i].overrun.factors(dynamics.load[i])[usize::from(wanted[i].command < 0.0)]
            });
            self.restrict(wanted, &motion, &dynamics, &faster, &mut allowed);
        } else {
            allowed = Allowed { commands: [0.0; AXES], stopped: wanted.map(|axis| axis.command != 0.0) };
        }
        for (i, stop) in self.stops.iter_mut().enumerate() {
            stop.come_to_rest(&mut allowed.commands[i], &mut allowed.stopped[i], wanted[i].command);
            let command = allowed.commands[i];
            stop.coming += stop.decay * (faster[i] * stop.speed(command, wanted[i].is_manual) - stop.coming);
        }
        allowed
    }

    fn restrict(
        &self,
        wanted: &[Wanted; AXES],
        motion: &[(f64, f64); AXES],
        dynamics: &CylinderDynamics,
        faster: &[f64; AXES],
        allowed: &mut Allowed,
    ) {
        let positions = motion.map(|(position, _)| position);
        let mut asked = [0.0; AXES];
        for i in 0..AXES {
            asked[i] = faster[i] * self.stops[i].speed(wanted[i].command, wanted[i].is_manual);
        }
        let fastest: [f64; AXES] = std::array::from_fn(|i| f64::max(motion[i].1.abs(), self.stops[i].coming.abs()));
        let swings = self.swings(dynamics, &fastest);
        let mut gentle: f64 = 1.0;
        self.each(&positions, |_, distance, rates| {
            let (mut by_hand, mut hard) = (Headway::default(), Headway::default());
            // What is under way whatever the person commands now.
            let (mut others, mut swing) = (0.0_f64, 0.0);
            for (i, stop) in self.stops.iter().enumerate() {
                // The greater speed towards the wall, the smaller one away from it.
                let (v, rate) = (motion[i].1, rates[i]);
                let worst = if rate * v > rate * stop.coming { v } else { stop.coming };
                hard.add(rate * worst, worst, stop.hard, stop);
                swing += shake(rates, &swings[i]);
                if wanted[i].is_manual {
                    by_hand.add(rate * asked[i], asked[i], stop.gentle, stop);
                } else {
                    let mut one = Headway::default();
                    one.add(rate * worst, worst, stop.hard, stop);
                    others += one.at(1.0);
                }
            }
            hard.linear += swing;
            gentle = gentle.min(by_hand.factor(distance - others.max(0.0) - swing));
            // Not a number is too far as well.
            let is_safe = hard.at(1.0) <= distance.max(0.0) + SLACK;
            for i in 0..AXES {
                // Within the dead band as well: a command that may only rise step by step has to cross it.
                let leads_away = rates[i] * wanted[i].command < 0.0;
                let way = rates[i].abs() * fastest[i] * self.stops[i].hard;
                let shakes = shake(rates, &swings[i]) > way + SLACK;
                allowed.stopped[i] |= !is_safe && (shakes || !leads_away);
            }
        });
        for i in 0..AXES {
            let command = wanted[i].command;
            if wanted[i].is_manual && gentle < 1.0 {
                let slower = self.stops[i].curve.command(gentle * asked[i] / faster[i]).abs() - UNSURE;
                allowed.commands[i] = command.abs().min(slower.max(0.0)).copysign(command);
            }
            allowed.stopped[i] &= command != 0.0;
            if allowed.stopped[i] {
                allowed.commands[i] = 0.0;
            }
        }
    }

    /// Calls `look` with wall, distance d in m and dP/dy . n of every part and every wall.
    fn each(&self, positions: &[f64; AXES], mut look: impl FnMut(usize, f64, &[f64; AXES])) {
        let pose = self.mechanism.pose(positions);
        for part in &self.parts {
            let place = self.place(&pose, part, positions[3]);
            let jacobian = pose.jacobian(place, part.last);
            let mut columns: [Vector; AXES] = std::array::from_fn(|i| pose.rate[i] * jacobian[i]);
            if part.frame == Frame::Rocker {
                let moved = self.place(&pose, part, positions[3] + STEP) - place;
                columns[3] = (1.0 / STEP) * moved;
            }
            for wall in (0..NAMES.len()).filter(|wall| self.limits[*wall].is_finite()) {
                let rates = columns.map(|column| NORMALS[wall].dot(column));
                look(wall, self.distance(wall, part, place), &rates);
            }
        }
    }

    fn distance(&self, wall: usize, part: &Part, place: Vector) -> f64 {
        self.limits[wall] - NORMALS[wall].dot(place) - part.radius
    }

    /// Where a part is, m; `bucket` is the position of the bucket's cylinder, m.
    fn place(&self, pose: &Pose, part: &Part, bucket: f64) -> Vector {
        let on = |from: Vector, rotation: Rotation| from + rotation * part.at;
        match part.frame {
            Frame::Boom => on(pose.boom_foot, pose.boom),
            Frame::Arm => on(pose.arm_pin, pose.arm),
            Frame::Inner => on(pose.bucket_pin, pose.arm),
            Frame::Bucket => on(pose.bucket_pin, pose.bucket),
            Frame::Rocker => pose.bucket_pin + pose.arm * self.linkage.rocker_end(self.retracted + bucket),
        }
    }
}

/// The parts of a machine.
fn parts(settings: &WallSettings, mechanism: &Mechanism) -> Vec<Part> {
    let geometry = &mechanism.geometry;
    let pin = |last, frame, at| Part { last, frame, at, radius: settings.clearance };
    let edge = |at| Part { last: 3, frame: Frame::Bucket, at, radius: 0.0 };
    let mut parts = vec![
        pin(0, Frame::Boom, Vector::new(geometry.boom_length, 0.0)),
        pin(0, Frame::Boom, geometry.boom_cylinder_rod),
        pin(0, Frame::Boom, geometry.arm_cylinder_base),
        pin(1, Frame::Arm, geometry.arm_cylinder_rod),
        pin(1, Frame::Arm, Vector::new(geometry.arm_length, 0.0)),
        pin(2, Frame::Inner, Vector::default()),
        pin(2, Frame::Inner, geometry.bucket.cylinder_base),
        pin(2, Frame::Inner, geometry.bucket.rocker_pin),
        pin(2, Frame::Rocker, Vector::default()),
        pin(3, Frame::Bucket, geometry.bucket.link_pin),
        edge(Vector::new(geometry.bucket_length, 0.0)),
    ];
    parts.extend(settings.corners.iter().map(|[x, z]| edge(Vector::new(*x, *z))));
    parts
}

#[cfg(test)]
mod tests;
