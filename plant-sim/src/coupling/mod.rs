//! The coupling of the first four axes by the machine's linkage: one equation of motion for boom, arm, telescope and
//! bucket.
//!
//! ```text
//! (9')  M_l(y) dv/dt = F_c - J (h + M J' v^2 - J_tip^T f)          F_c = A1 p1 - A2 p2 - F - F_ext + F_stop
//! ```
//!
//! | symbol | unit | meaning |
//! |---|---|---|
//! | y, v | m, m/s | positions and speeds of the four pistons |
//! | M_l = J M J | kg | mass that the cylinders feel; its off-diagonal terms let one axis push the others |
//! | J, J' | rad/m, rad/m2 | rates of the joints per rate of the cylinders, and their derivatives ([`mechanism`]) |
//! | h | N m | gravity, centrifugal and Coriolis terms, with the payload |
//! | f | N | force of the soil on the teeth, [`soil`] |
//! | F_c | N | force of each cylinder, [`crate::actuator`] |
//!
//! (9') takes the place of (9) for the axes of the mechanism; it is solved at every stage of the Runge-Kutta step.
//!
//! Source: the crate [`mechanism`], which has equations and sources. Assumed: rigid bodies, pins without friction and
//! without play, and a machine that stands still.
//!
//! Traps: the linkage may not close beyond the strokes, but a piston moves into its end stop. The pose follows it as
//! far as the linkage is known to close, [`END_STOP_WAY`] or the way into softer stops; farther out the pose stays. A
//! payload that changes keeps the speeds: like every step of a parameter this changes the energy.

pub mod soil;

use mechanism::{AXES, END_STOP_WAY, Flaw, Mechanism, Pose, PreparedMechanism, Vector};
use pipeline::machine;

use crate::lanes::Lanes;
use soil::Soil;

/// The linkage of four axes, with payload and soil.
#[derive(Debug, Clone)]
pub struct Coupling {
    mechanism: Mechanism,
    prepared: PreparedMechanism,
    soil: Option<Soil>,
    /// L of each axis, m.
    strokes: [f64; AXES],
    /// Way beyond either end of each stroke up to which the pose follows the piston, m.
    ways: [f64; AXES],
}

impl Coupling {
    /// The linkage between cylinders with these `strokes`, m, and the soil.
    ///
    /// # Errors
    /// The number of an axis that the linkage does not let move over its stroke, and why.
    pub fn new(
        mechanism: &Mechanism,
        strokes: [f64; AXES],
        soil: Option<&machine::Soil>,
    ) -> Result<Self, (usize, Flaw)> {
        let ways = [END_STOP_WAY; AXES];
        match mechanism.flaws(&strokes, &ways).first() {
            Some(flaw) => Err(*flaw),
            None => Ok(Self {
                mechanism: *mechanism,
                prepared: mechanism.prepared(),
                soil: soil.map(Soil::new),
                strokes,
                ways,
            }),
        }
    }

    /// Lets the pose follow the pistons `depths`, m, into soft end stops.
    ///
    /// # Errors
    /// The number of an axis that the linkage does not let move so far, and why.
    pub fn sink(&mut self, depths: &[f64; AXES]) -> Result<(), (usize, Flaw)> {
        let ways = depths.map(|depth| depth.max(END_STOP_WAY));
        match self.mechanism.flaws(&self.strokes, &ways).first() {
            Some(flaw) => Err(*flaw),
            None => {
                self.ways = ways;
                Ok(())
            }
        }
    }

    /// Takes the payload, kg, and the strength of the soil as a part of that in the machine file.
    pub fn work(&mut self, payload: f64, soil: f64) {
        if payload != self.mechanism.masses.payload.mass {
            self.mechanism.masses.payload.mass = payload;
            self.prepared = self.mechanism.prepared();
        }
        if let Some(ground) = &mut self.soil {
            ground.strength = soil;
        }
    }

    /// dv/dt, m/s2, of the four axes at `position` m and `velocity` m/s under the forces `force` of their cylinders, N.
    #[inline]
    pub fn accelerations(&self, position: Lanes, velocity: Lanes, force: Lanes) -> Lanes {
        let (pose, rates) = (self.pose(&position.to_array()), velocity.to_array());
        let dynamics = self.prepared.dynamics(&pose, &rates, self.tip_force(&pose, &rates));
        // A state that is not a number stays one: it must not look like rest.
        Lanes::new(dynamics.acceleration(&force.to_array()).unwrap_or([f64::NAN; AXES]))
    }

    /// Forces of the cylinders, N, that hold the machine at rest at `positions`, m.
    pub fn holding_forces(&self, positions: &[f64; AXES]) -> [f64; AXES] {
        self.prepared.dynamics(&self.pose(positions), &[0.0; AXES], Vector::default()).load
    }

    /// M_l at `positions`, m, row by row, kg.
    pub fn mass(&self, positions: &[f64; AXES]) -> [[f64; AXES]; AXES] {
        self.prepared.dynamics(&self.pose(positions), &[0.0; AXES], Vector::default()).mass
    }

    /// Kinetic and potential energy, J. The potential energy is 0 where the centre of mass is as high as the boom foot.
    pub fn energy(&self, positions: &[f64; AXES], rates: &[f64; AXES]) -> (f64, f64) {
        self.prepared.energy(&self.pose(positions), rates)
    }

    /// Power that the soil takes from the machine, W; never negative.
    pub fn soil_power(&self, positions: &[f64; AXES], rates: &[f64; AXES]) -> f64 {
        let pose = self.pose(positions);
        -self.tip_force(&pose, rates).dot(pose.tip_velocity(rates))
    }

    /// The pose at `positions`, m; beyond the end stops it follows as far as the linkage is known to close.
    #[inline]
    pub fn pose(&self, positions: &[f64; AXES]) -> Pose {
        let within = |i: usize| positions[i].clamp(-self.ways[i], self.strokes[i] + self.ways[i]);
        self.prepared.pose(&std::array::from_fn(within))
    }

    /// f, N.
    #[inline]
    fn tip_force(&self, pose: &Pose, rates: &[f64; AXES]) -> Vector {
        match &self.soil {
            Some(soil) if soil.strength > 0.0 => soil.force(pose.tip, pose.tip_velocity(rates)),
            _ => Vector::default(),
        }
    }

    /// The soil, where the machine has one.
    pub fn soil(&self) -> Option<&Soil> {
        self.soil.as_ref()
    }

    /// L of each axis, m.
    pub fn strokes(&self) -> &[f64; AXES] {
        &self.strokes
    }
}
