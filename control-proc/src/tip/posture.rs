//! One posture of the machine: where its cylinders are with the teeth at a place, and what is left there.
//!
//! Place and pitch of the teeth are three coordinates, and four cylinders move them: one is free. The boom moves the
//! teeth most, and each of its millimetres is many at the teeth. So the boom or the telescope is given, and the others
//! follow:
//!
//! ```text
//! telescope = |bucket pin - arm pin(b)| - length of the arm
//! load      = max_i  F_i / (0.9 F_max,i)                          allowed: 1 at most
//! cost      = C_r max(0, 1 - room / R)  +  C_l max(0, (load - L) / (1 - L))
//! ```
//!
//! b position of the boom's cylinder in m; F_i force of a cylinder in N that holds bodies and payload, F_max,i the one
//! that the supply gives it that way; room the least distance of a cylinder from a soft limit in m. R, C_r, L and C_l:
//! `ROOM`, `ROOM_COST`, `EASY`, `LOAD_COST`.

use mechanism::{AXES, Joint, Linkage, Mechanism, Moments, Rotation, Vector};
use pipeline::machine::Machine;

use super::way::TipPlace;
use crate::protection::walls::Walls;

/// Part of a cylinder's largest force that may hold bodies and payload; the rest moves them.
const HOLDING: f64 = 0.9;
/// Way from a soft limit that costs as much as a way of the boom of [`ROOM_COST`], m: near it the soft stop slows the
/// axis.
const ROOM: f64 = 0.05;
/// m.
const ROOM_COST: f64 = 0.02;
/// Part of the allowed force up to which a load costs nothing. From there on the pressure that is left for the valve
/// falls below a third of the supply's.
const EASY: f64 = 0.75;
/// What the whole allowed force costs, as a way of the boom, m.
const LOAD_COST: f64 = 0.02;
/// Positions that are less far outside a soft limit are at it but for rounding, m.
const ROUNDING: f64 = 1e-9;
/// Distance from a wall where there is none, m.
const FAR: f64 = 1e3;

/// Why the teeth cannot be at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Short {
    /// Boom and arm do not reach it, or the bucket's linkage does not close.
    Reach,
    /// An axis would have to be at this position (m), outside its soft limits.
    Axis(usize, f64),
    /// A cylinder would have to hold this force (N).
    Force(usize, f64),
    /// A part of the machine would be this far (m) before this wall; negative beyond it.
    Wall(&'static str, f64),
}

/// Which axis is given, and where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Free {
    /// Position of the boom, m.
    Boom(f64),
    /// Position of the telescope, m.
    Telescope(f64),
}

/// A posture and what it asks of the machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Posture {
    /// Positions of the cylinders, m.
    pub positions: [f64; AXES],
    /// Forces that hold bodies and payload, N.
    pub forces: [f64; AXES],
    /// Distance from the nearest virtual wall, m.
    pub wall: f64,
}

impl Posture {
    /// Between this posture (0) and another one (1), all values evenly.
    pub fn towards(&self, other: &Self, part: f64) -> Self {
        let between = |a: f64, b: f64| a + (b - a) * part;
        Self {
            positions: std::array::from_fn(|i| between(self.positions[i], other.positions[i])),
            forces: std::array::from_fn(|i| between(self.forces[i], other.forces[i])),
            wall: between(self.wall, other.wall),
        }
    }
}

/// What is left at a posture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margins {
    /// Least distance of a cylinder from a soft limit, m, and its axis; negative outside.
    pub room: (f64, usize),
    /// Largest part of the allowed force of a cylinder, and its axis.
    pub load: (f64, usize),
    /// Distance from the nearest virtual wall beyond [`Walls::margin`], m.
    pub wall: f64,
}

impl Margins {
    /// Cost of what is missing to plenty, m.
    pub fn cost(&self) -> f64 {
        let load = (self.load.0 - EASY) / (1.0 - EASY);
        ROOM_COST * (1.0 - self.room.0 / ROOM).max(0.0) + LOAD_COST * load.max(0.0)
    }
}

/// Cylinders of a machine, and what they may do.
pub struct Cylinders<'m> {
    mechanism: &'m Mechanism,
    linkage: Linkage,
    moments: Moments,
    /// Soft limits, m.
    pub(super) limits: [(f64, f64); AXES],
    /// Allowed forces, pulling and pushing, N; both positive, infinite where the supply is not known.
    forces: [(f64, f64); AXES],
    walls: Option<Walls>,
}

impl<'m> Cylinders<'m> {
    /// Of the first four axes of a machine.
    pub fn new(machine: &Machine, mechanism: &'m Mechanism) -> Self {
        Self {
            mechanism,
            linkage: Linkage::new(&mechanism.geometry),
            moments: Moments::new(&mechanism.masses),
            limits: std::array::from_fn(|i| machine.axes[i].soft_limits),
            forces: std::array::from_fn(|i| allowed_forces(machine, i)),
            walls: Walls::of(machine),
        }
    }

    /// Positions of the cylinders with the teeth at a place, m, whatever the soft limits are.
    pub fn positions(&self, place: &TipPlace, free: Free) -> Option<[f64; AXES]> {
        let geometry = &self.mechanism.geometry;
        let pitch = Rotation::by(place.pitch);
        let telescope = match free {
            Free::Telescope(position) => self.mechanism.retracted[2] + position,
            Free::Boom(position) => {
                let boom = self.linkage.rotation(Joint::Boom, self.mechanism.retracted[0] + position);
                let arm_pin = geometry.boom_foot + geometry.boom_length * boom.axis();
                let bucket_pin = place.at - geometry.bucket_length * pitch.axis();
                (bucket_pin - arm_pin).norm() - geometry.arm_length
            }
        };
        let lengths = geometry.cylinder_lengths(place.at, pitch, telescope).ok()?;
        let mut positions = self.mechanism.positions(&lengths);
        let (axis, position) = match free {
            Free::Boom(position) => (0, position),
            Free::Telescope(position) => (2, position),
        };
        // The elbow is always up: with the boom where it is, the arm may have to be on the other side.
        let is_same = (positions[axis] - position).abs() < 1e-6;
        // An axis that stands has one position: who moves it sees its reference stand, and not its rounding.
        positions[axis] = position;
        (is_same && positions.iter().all(|position| position.is_finite())).then_some(positions)
    }

    /// The posture with the teeth at a place; none where they cannot be.
    pub fn posture(&self, place: &TipPlace, free: Free) -> Option<Posture> {
        self.positions(place, free).map(|positions| self.at(&positions))
    }

    /// The posture with the cylinders at these positions, m.
    pub fn at(&self, positions: &[f64; AXES]) -> Posture {
        let pose = self.linkage.pose(&self.mechanism.lengths(positions));
        let forces = self.moments.dynamics(&pose, &[0.0; AXES]).holding_force(&pose, Vector::default());
        let nearest = self.walls.as_ref().and_then(|walls| walls.least_distance(positions));
        Posture { positions: *positions, forces, wall: nearest.map_or(FAR, |(_, distance)| distance) }
    }

    /// What is left at a posture.
    pub fn margins(&self, posture: &Posture) -> Margins {
        let (mut room, mut load) = ((f64::INFINITY, 0), (0.0, 0));
        for i in 0..AXES {
            let ((low, high), position) = (self.limits[i], posture.positions[i]);
            let left = (position - low).min(high - position);
            let left = if left > -ROUNDING { left.max(0.0) } else { left };
            room = if left < room.0 { (left, i) } else { room };
            let ((pull, push), force) = (self.forces[i], posture.forces[i]);
            let part = if force > 0.0 { force / push } else { -force / pull };
            load = if part > load.0 { (part, i) } else { load };
        }
        Margins { room, load, wall: posture.wall - self.wall_margin() }
    }

    /// Expects that a cylinder is within its soft limits, holds no more than it may, and no part is at a wall.
    ///
    /// # Errors
    /// What is not so.
    pub fn expect_free(&self, place: &TipPlace, free: Free) -> Result<(), Short> {
        // A position that is given is to blame before those that follow from it.
        let (axis, position) = match free {
            Free::Boom(position) => (0, position),
            Free::Telescope(position) => (2, position),
        };
        if !(self.limits[axis].0..=self.limits[axis].1).contains(&position) {
            return Err(Short::Axis(axis, position));
        }
        let posture = self.posture(place, free).ok_or(Short::Reach)?;
        let Margins { room, load, wall } = self.margins(&posture);
        if room.0 < 0.0 {
            return Err(Short::Axis(room.1, posture.positions[room.1]));
        }
        if load.0 > 1.0 {
            return Err(Short::Force(load.1, posture.forces[load.1]));
        }
        match self.walls.as_ref().and_then(|walls| walls.least_distance(&posture.positions)) {
            Some((name, distance)) if wall < 0.0 => Err(Short::Wall(name, distance)),
            _ => Ok(()),
        }
    }

    /// How much is missing, to compare two of a kind; a kind that a person can do less about counts more.
    pub fn missing(&self, short: &Short) -> (u8, f64) {
        match short {
            Short::Reach => (2, 0.0),
            Short::Axis(i, position) => {
                let (low, high) = self.limits[*i];
                (1, (low - position).max(position - high))
            }
            Short::Force(i, force) => {
                let (pull, push) = self.forces[*i];
                (0, (force / push).max(-force / pull) - 1.0)
            }
            Short::Wall(_, distance) => (0, self.wall_margin() - distance),
        }
    }

    /// Least distance from a virtual wall, m.
    pub fn wall_margin(&self) -> f64 {
        self.walls.as_ref().map_or(0.0, Walls::margin)
    }

    /// Allowed forces of an axis, from pulling, which is negative, to pushing, N.
    pub fn allowed_forces(&self, axis: usize) -> (f64, f64) {
        let (pull, push) = self.forces[axis];
        (-pull, push)
    }
}

/// Allowed forces of an axis, pulling and pushing, N.
fn allowed_forces(machine: &Machine, axis: usize) -> (f64, f64) {
    let (Some(hydraulics), Some(plant)) = (&machine.hydraulics, &machine.axes[axis].plant) else {
        return (f64::INFINITY, f64::INFINITY);
    };
    let supply = &hydraulics.supply;
    let of = |filled: f64, drained: f64| HOLDING * (supply.pressure * filled - supply.return_pressure * drained);
    (of(plant.rod_area, plant.piston_area), of(plant.piston_area, plant.rod_area))
}
