//! Mass matrix, gravity and Coriolis terms, in joint coordinates and in those of the cylinders.
//!
//! ```text
//! M   = sum m_i J_i^T J_i + I_i w_i^T w_i           h_g = sum m_i g z^T J_i
//! h_c = sum m_i J_i^T b_i                           b_i acceleration of the centre of mass at q'' = 0
//! M q'' + h_c + h_g = tau + J_tip^T f
//! M_l = J M J,   M_l l'' + J (h_c + h_g + M J' l'^2 - J_tip^T f) = F,   F = J tau
//! ```
//!
//! J_i velocity of body i's centre of mass per joint rate, w_i its angular rate per joint rate (1 for a turning joint
//! in front of it, else 0), m_i masses in kg, I_i moments of inertia about the centre of mass in kg m2, g gravity in
//! m/s2, f force on the teeth in N, F forces of the cylinders in N (positive extends), J and J' as in [`Pose`]. Angular
//! accelerations add nothing at q'' = 0, since all axes of rotation are parallel.
//!
//! The sums run from the bucket inwards. Each joint carries all bodies behind it, and these are described by their mass
//! m, first moment S = sum m_i (c_i - O) and second moment A = sum m_i |c_i - O|^2 + I_i about the joint's pin O:
//!
//! ```text
//! about another pin, d = O - O'            S' = S + m d,  A' = A + 2 d S + m d^2
//! turning joints k in front of j           M_jj = A,  M_kj = A + (O_j - O_k) S,  h_g = g S_x
//! telescope along a, joint k               M_ss = m,  M_ks = a n(S + m (O - O_k)),  h_g = g m a_z
//! force and moment at q'' = 0              f = m a_O - w^2 S,  N = S x a_O,  N' = N + d x f
//! ```
//!
//! c_i centres of mass, a_O acceleration of the pin in m/s2, w angular rate in rad/s, n(v) the vector v turned by +90
//! degrees. This is the composite-body method for M and the recursive Newton-Euler method for h (R. Featherstone, Rigid
//! Body Dynamics Algorithms, Springer 2008, chapters 5 and 6), in the plane.
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

/// The bodies of the machine by their moments, which no pose changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    /// About the boom foot.
    boom: Moment,
    /// About the arm pin.
    arm: Moment,
    /// About the bucket pin.
    inner: Moment,
    /// Bucket with payload, about the bucket pin.
    bucket: Moment,
}

/// Moments of mass of a body about the origin of its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Moment {
    /// kg.
    mass: f64,
    /// kg m.
    first: Vector,
    /// kg m2.
    second: f64,
}

impl Moment {
    fn new(body: &Body) -> Self {
        let first = body.mass * body.center;
        Self { mass: body.mass, first, second: body.inertia + first.dot(body.center) }
    }

    /// With another body, whose first moment in the same axes is `first`.
    #[inline]
    fn with(self, body: &Self, first: Vector) -> Self {
        Self { mass: self.mass + body.mass, first: self.first + first, second: self.second + body.second }
    }

    /// About a point that lies by -`d` away.
    #[inline]
    fn moved(self, d: Vector) -> Self {
        Self {
            mass: self.mass,
            first: self.first + self.mass * d,
            second: self.second + 2.0 * d.dot(self.first) + self.mass * d.dot(d),
        }
    }
}

impl Moments {
    /// From the bodies.
    pub fn new(masses: &Masses) -> Self {
        let (bucket, payload) = (Moment::new(&masses.bucket), Moment::new(&masses.payload.body()));
        Self {
            boom: Moment::new(&masses.boom),
            arm: Moment::new(&masses.arm),
            inner: Moment::new(&masses.inner),
            bucket: bucket.with(&payload, payload.first),
        }
    }

    /// The terms at `pose` with rates of the joints, rad/s (m/s for the telescope).
    #[inline]
    pub fn dynamics(&self, pose: &Pose, rates: &[f64; AXES]) -> Dynamics {
        let [boom_rate, arm_rate, sliding, bucket_rate] = *rates;
        let arm_rate = boom_rate + arm_rate;
        let bucket_rate = arm_rate + bucket_rate;
        let (axis, across) = (pose.arm.axis(), pose.arm.axis().normal());
        let (boom_vector, arm_vector) = (pose.arm_pin - pose.boom_foot, pose.bucket_pin - pose.arm_pin);

        // What each joint carries, about its pin: the bucket, with the inner section, with the arm, with the boom.
        let first = pose.bucket * self.bucket.first;
        let bucket = Moment { first, ..self.bucket };
        let inner_first = pose.arm * self.inner.first;
        let inner = bucket.with(&self.inner, inner_first);
        let arm_first = pose.arm * self.arm.first;
        let arm = inner.moved(arm_vector).with(&self.arm, arm_first);
        let boom_first = pose.boom * self.boom.first;
        let boom = arm.moved(boom_vector).with(&self.boom, boom_first);

        let bucket_arm = bucket.second + arm_vector.dot(bucket.first);
        let bucket_boom = bucket_arm + boom_vector.dot(bucket.first);
        let arm_boom = arm.second + boom_vector.dot(arm.first);
        let telescope_bucket = axis.dot(bucket.first.normal());
        let telescope_arm = axis.dot(inner.first.normal());
        let telescope_boom = telescope_arm + inner.mass * axis.dot(boom_vector.normal());

        let centripetal = |rate: f64, vector: Vector| -(rate * rate * vector);
        let arm_pin = centripetal(boom_rate, boom_vector);
        let bucket_pin = arm_pin + centripetal(arm_rate, arm_vector) + 2.0 * arm_rate * sliding * across;
        let bucket_force = bucket.mass * bucket_pin + centripetal(bucket_rate, bucket.first);
        let inner_force = bucket_force + self.inner.mass * bucket_pin + centripetal(arm_rate, inner_first);
        let arm_force = inner_force + self.arm.mass * arm_pin + centripetal(arm_rate, arm_first);
        let bucket_moment = bucket.first.cross(bucket_pin);
        let arm_moment = inner.first.cross(bucket_pin) + arm_vector.cross(inner_force) + arm_first.cross(arm_pin);
        let boom_moment = arm_moment + boom_vector.cross(arm_force);

        Dynamics {
            mass: [
                [boom.second, arm_boom, telescope_boom, bucket_boom],
                [arm_boom, arm.second, telescope_arm, bucket_arm],
                [telescope_boom, telescope_arm, inner.mass, telescope_bucket],
                [bucket_boom, bucket_arm, telescope_bucket, bucket.second],
            ],
            gravity: [boom.first.x, arm.first.x, inner.mass * axis.z, bucket.first.x].map(|moment| GRAVITY * moment),
            coriolis: [boom_moment, arm_moment, axis.dot(inner_force), bucket_moment],
            potential_energy: GRAVITY * boom.first.z,
        }
    }
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
    /// Potential energy in the field of gravity; 0 where the centre of mass is as high as the boom foot, J.
    pub potential_energy: f64,
}

impl Dynamics {
    /// The terms at `pose` with rates of the joints, rad/s (m/s for the telescope). [`Moments::dynamics`] is faster for
    /// many poses.
    pub fn new(masses: &Masses, pose: &Pose, rates: &[f64; AXES]) -> Self {
        Moments::new(masses).dynamics(pose, rates)
    }

    /// M_l, kg: the mass that the cylinders feel.
    #[inline]
    pub fn cylinder_mass(&self, pose: &Pose) -> [[f64; AXES]; AXES] {
        std::array::from_fn(|i| std::array::from_fn(|j| pose.rate[i] * self.mass[i][j] * pose.rate[j]))
    }

    /// Forces of the cylinders, N, that hold the machine at rest, with `tip_force`, N, on the teeth.
    pub fn holding_force(&self, pose: &Pose, tip_force: Vector) -> [f64; AXES] {
        let tip = pose.tip_jacobian();
        std::array::from_fn(|i| pose.rate[i] * self.gravity[i] - tip[i].dot(tip_force))
    }

    /// Forces of the cylinders, N, under which their rates `rates`, m/s, do not change, with a force on the teeth
    /// `tip_force`, N: J (h_c + h_g + M J' l'^2 - J_tip^T f).
    #[inline]
    pub fn cylinder_load(&self, pose: &Pose, rates: &[f64; AXES], tip_force: Vector) -> [f64; AXES] {
        let tip = pose.jacobian(pose.tip, 3);
        let bent: [f64; AXES] = std::array::from_fn(|i| pose.curvature[i] * rates[i] * rates[i]);
        std::array::from_fn(|i| {
            let curvature: f64 = (0..AXES).map(|j| self.mass[i][j] * bent[j]).sum();
            pose.rate[i] * (self.coriolis[i] + self.gravity[i] + curvature - tip[i].dot(tip_force))
        })
    }

    /// The equation of motion of the cylinders at their rates `rates`, m/s, with a force on the teeth `tip_force`, N.
    #[inline]
    pub fn of_cylinders(&self, pose: &Pose, rates: &[f64; AXES], tip_force: Vector) -> CylinderDynamics {
        CylinderDynamics { mass: self.cylinder_mass(pose), load: self.cylinder_load(pose, rates, tip_force) }
    }
}

/// The equation of motion in cylinder coordinates: M_l l'' + load = F.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CylinderDynamics {
    /// M_l, kg.
    pub mass: [[f64; AXES]; AXES],
    /// Forces of the cylinders at which nothing accelerates, N.
    pub load: [f64; AXES],
}

impl CylinderDynamics {
    /// Accelerations of the cylinders, m/s2, under their forces `force`, N. `None` where the mass matrix is not
    /// positive definite, as in a pose that does not close.
    #[inline]
    pub fn acceleration(&self, force: &[f64; AXES]) -> Option<[f64; AXES]> {
        solve(&self.mass, &std::array::from_fn(|i| force[i] - self.load[i]))
    }
}

/// The solution of `matrix` x = `right` by the decomposition L D L^T; `None` where `matrix` is not positive definite.
#[inline]
pub(crate) fn solve(matrix: &[[f64; AXES]; AXES], right: &[f64; AXES]) -> Option<[f64; AXES]> {
    // `scaled` is L D.
    let (mut lower, mut scaled, mut inverse) = ([[0.0; AXES]; AXES], [[0.0; AXES]; AXES], [0.0; AXES]);
    let mut x = *right;
    for i in 0..AXES {
        for j in 0..i {
            let known: f64 = (0..j).map(|k| scaled[i][k] * lower[j][k]).sum();
            scaled[i][j] = matrix[i][j] - known;
            lower[i][j] = scaled[i][j] * inverse[j];
        }
        let known: f64 = (0..i).map(|k| scaled[i][k] * lower[i][k]).sum();
        let pivot = matrix[i][i] - known;
        // NaN is not positive either.
        let is_positive = pivot > 0.0;
        if !is_positive {
            return None;
        }
        inverse[i] = 1.0 / pivot;
        x[i] -= (0..i).map(|k| lower[i][k] * x[k]).sum::<f64>();
    }
    for i in (0..AXES).rev() {
        x[i] = x[i] * inverse[i] - (i + 1..AXES).map(|k| lower[k][i] * x[k]).sum::<f64>();
    }
    Some(x)
}
