//! Mass matrix, gravity and Coriolis terms, in joint coordinates and in those of the cylinders.
//!
//! ```text
//! M   = sum m_i J_i^T J_i + I_i w_i^T w_i           h_g = sum m_i g z^T J_i
//! h_c = sum m_i J_i^T b_i                           b_i acceleration of the centre of mass at q'' = 0
//! M q'' + h_c + h_g = tau + J_tip^T f
//! M_l = J M J,   M_l l'' + J (h_c + h_g + M J' l'^2 - J_tip^T f) = F,   F = J tau
//! ```
//!
//! J_i velocity of body i's centre of mass per joint rate, w_i its angular rate per joint rate (1 for a turning joint in
//! front of it, else 0), m_i masses in kg, I_i moments of inertia about the centre of mass in kg m2, g gravity in m/s2, f
//! force on the teeth in N, F forces of the cylinders in N (positive extends), J and J' as in [`Pose`]. Angular
//! accelerations add nothing at q'' = 0, since all axes of rotation are parallel.
//!
//! Trap: rocker and link of the bucket have no mass of their own here; count them to the bucket.

use crate::{AXES, Pose, vector::Vector};

/// Acceleration of gravity, m/s2.
pub const GRAVITY: f64 = 9.81;

/// A rigid body.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Body {
    /// kg.
    pub mass: f64,
    /// Centre of mass in the frame of the body, m.
    pub center: Vector,
    /// Moment of inertia about the centre of mass, kg m2.
    pub inertia: f64,
}

/// What the bucket carries.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Payload {
    /// kg.
    pub mass: f64,
    /// Centre of mass in the frame of the bucket, m.
    pub center: Vector,
    /// Radius of gyration about the centre of mass, m.
    pub radius_of_gyration: f64,
}

impl Payload {
    fn body(&self) -> Body {
        let inertia = self.mass * self.radius_of_gyration * self.radius_of_gyration;
        Body { mass: self.mass, center: self.center, inertia }
    }
}

/// The bodies of the machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Masses {
    /// In the frame of the boom.
    pub boom: Body,
    /// The outer section of the arm, in the frame of the arm.
    pub arm: Body,
    /// The section that slides; its centre is given from the bucket pin, in the axes of the arm.
    pub inner: Body,
    /// In the frame of the bucket, with rocker and link.
    pub bucket: Body,
    /// What the bucket carries.
    pub payload: Payload,
}

/// The terms of the equation of motion at one state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dynamics {
    /// M in joint coordinates; kg m2, kg m and kg.
    pub mass: [[f64; AXES]; AXES],
    /// h_g, N m (N for the telescope).
    pub gravity: [f64; AXES],
    /// h_c, N m (N for the telescope).
    pub coriolis: [f64; AXES],
}

impl Dynamics {
    /// The terms at `pose` with rates of the joints, rad/s (m/s for the telescope).
    pub fn new(masses: &Masses, pose: &Pose, rates: &[f64; AXES]) -> Self {
        let mut terms = Self { mass: [[0.0; AXES]; AXES], gravity: [0.0; AXES], coriolis: [0.0; AXES] };
        let motion = Motion::new(pose, rates);
        terms.add(pose, 0, &masses.boom, pose.boom_foot + pose.boom * masses.boom.center, |at| motion.of_boom(at));
        terms.add(pose, 1, &masses.arm, pose.arm_pin + pose.arm * masses.arm.center, |at| motion.of_arm(at));
        let inner = pose.bucket_pin + pose.arm * masses.inner.center;
        terms.add(pose, 2, &masses.inner, inner, |at| motion.of_inner(at));
        for body in [masses.bucket, masses.payload.body()] {
            terms.add(pose, 3, &body, pose.bucket_pin + pose.bucket * body.center, |at| motion.of_bucket(at));
        }
        terms
    }

    /// Adds a body that joint `last` moves, with its centre of mass at `center` and the acceleration of a point of it.
    fn add(&mut self, pose: &Pose, last: usize, body: &Body, center: Vector, acceleration: impl Fn(Vector) -> Vector) {
        let jacobian = pose.jacobian(center, last);
        let bias = acceleration(center);
        for i in 0..=last {
            for j in 0..=last {
                let turns = i != TELESCOPE && j != TELESCOPE;
                let inertia = if turns { body.inertia } else { 0.0 };
                self.mass[i][j] += body.mass * jacobian[i].dot(jacobian[j]) + inertia;
            }
            self.gravity[i] += body.mass * GRAVITY * jacobian[i].z;
            self.coriolis[i] += body.mass * jacobian[i].dot(bias);
        }
    }

    /// M_l, kg: the mass that the cylinders feel.
    pub fn cylinder_mass(&self, pose: &Pose) -> [[f64; AXES]; AXES] {
        std::array::from_fn(|i| std::array::from_fn(|j| pose.rate[i] * self.mass[i][j] * pose.rate[j]))
    }

    /// Forces of the cylinders, N, that hold the machine at rest, with `tip_force`, N, on the teeth.
    pub fn holding_force(&self, pose: &Pose, tip_force: Vector) -> [f64; AXES] {
        let tip = pose.tip_jacobian();
        std::array::from_fn(|i| pose.rate[i] * self.gravity[i] - tip[i].dot(tip_force))
    }

    /// Accelerations of the cylinders, m/s2, at cylinder rates `rates`, m/s, forces `force`, N, and a force on the teeth
    /// `tip_force`, N. `None` where the mass matrix is not positive definite, as in a pose that does not close.
    pub fn acceleration(
        &self,
        pose: &Pose,
        rates: &[f64; AXES],
        force: &[f64; AXES],
        tip_force: Vector,
    ) -> Option<[f64; AXES]> {
        let tip = pose.jacobian(pose.tip, 3);
        let bent: [f64; AXES] = std::array::from_fn(|i| pose.curvature[i] * rates[i] * rates[i]);
        let excess = std::array::from_fn(|i| {
            let curvature: f64 = (0..AXES).map(|j| self.mass[i][j] * bent[j]).sum();
            let load = self.coriolis[i] + self.gravity[i] + curvature - tip[i].dot(tip_force);
            force[i] - pose.rate[i] * load
        });
        solve(&self.cylinder_mass(pose), &excess)
    }
}

const TELESCOPE: usize = 2;

/// Accelerations of points at q'' = 0.
struct Motion {
    boom_foot: Vector,
    arm_pin: Vector,
    bucket_pin: Vector,
    /// Squares of the angular rates of boom, arm and bucket, 1/s2.
    squares: [f64; 3],
    arm_pin_acceleration: Vector,
    bucket_pin_acceleration: Vector,
    /// Coriolis acceleration of the sliding section, m/s2.
    sliding: Vector,
}

impl Motion {
    fn new(pose: &Pose, rates: &[f64; AXES]) -> Self {
        let (boom, arm, bucket) = (rates[0], rates[0] + rates[1], rates[0] + rates[1] + rates[3]);
        let squares = [boom * boom, arm * arm, bucket * bucket];
        let arm_pin_acceleration = -(squares[0] * (pose.arm_pin - pose.boom_foot));
        let sliding = (2.0 * arm * rates[TELESCOPE]) * pose.arm.axis().normal();
        Self {
            boom_foot: pose.boom_foot,
            arm_pin: pose.arm_pin,
            bucket_pin: pose.bucket_pin,
            squares,
            arm_pin_acceleration,
            bucket_pin_acceleration: arm_pin_acceleration - squares[1] * (pose.bucket_pin - pose.arm_pin) + sliding,
            sliding,
        }
    }

    fn of_boom(&self, at: Vector) -> Vector {
        -(self.squares[0] * (at - self.boom_foot))
    }

    fn of_arm(&self, at: Vector) -> Vector {
        self.arm_pin_acceleration - self.squares[1] * (at - self.arm_pin)
    }

    fn of_inner(&self, at: Vector) -> Vector {
        self.of_arm(at) + self.sliding
    }

    fn of_bucket(&self, at: Vector) -> Vector {
        self.bucket_pin_acceleration - self.squares[2] * (at - self.bucket_pin)
    }
}

/// The solution of `matrix` x = `right` by Cholesky's decomposition; `None` where `matrix` is not positive definite.
fn solve(matrix: &[[f64; AXES]; AXES], right: &[f64; AXES]) -> Option<[f64; AXES]> {
    let mut lower = [[0.0; AXES]; AXES];
    let mut x = *right;
    for i in 0..AXES {
        for j in 0..i {
            let known: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            lower[i][j] = (matrix[i][j] - known) / lower[j][j];
        }
        let known: f64 = (0..i).map(|k| lower[i][k] * lower[i][k]).sum();
        let pivot = matrix[i][i] - known;
        // Written so that NaN is refused too.
        if !(pivot > 0.0) {
            return None;
        }
        lower[i][i] = pivot.sqrt();
        let known: f64 = (0..i).map(|k| lower[i][k] * x[k]).sum();
        x[i] = (x[i] - known) / lower[i][i];
    }
    for i in (0..AXES).rev() {
        let known: f64 = (i + 1..AXES).map(|k| lower[k][i] * x[k]).sum();
        x[i] = (x[i] - known) / lower[i][i];
    }
    Some(x)
}
