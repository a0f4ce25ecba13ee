//! The machine seen from the side: corners of its bodies and ends of its cylinders in one pose.

use mechanism::{AXES, Mechanism, Pose, PreparedMechanism, Vector};

/// The side view of a machine.
pub struct Side {
    mechanism: Mechanism,
    prepared: PreparedMechanism,
}

/// What is drawn of one pose; x forward and z up, m.
#[derive(Debug)]
pub struct Drawn {
    /// Corners of boom, arm and bucket.
    pub bodies: Vec<Vec<Vector>>,
    /// Both ends of each cylinder.
    pub cylinders: Vec<Vec<Vector>>,
    /// Rocker and link between bucket cylinder and bucket.
    pub links: Vec<Vector>,
    /// The teeth.
    pub tip: Vector,
}

impl Side {
    /// Of this machine.
    pub fn new(mechanism: &Mechanism) -> Self {
        Self { mechanism: *mechanism, prepared: mechanism.prepared() }
    }

    /// The teeth at these positions of the pistons, m.
    pub fn tip(&self, positions: &[f64; AXES]) -> Vector {
        self.prepared.pose(positions).tip
    }

    /// Bodies and cylinders at these positions of the pistons, m.
    pub fn drawn(&self, positions: &[f64; AXES]) -> Drawn {
        let pose: Pose = self.prepared.pose(positions);
        let pins = &self.mechanism.geometry;
        let on_boom = |at: Vector| pose.boom_foot + pose.boom * at;
        let on_arm = |at: Vector| pose.arm_pin + pose.arm * at;
        let by_bucket = |at: Vector| pose.bucket_pin + pose.arm * at;
        let rocker_end = by_bucket(pins.bucket.rocker_end(self.mechanism.lengths(positions)[3]));
        let link_pin = pose.bucket_pin + pose.bucket * pins.bucket.link_pin;
        let (boom_rod, arm_rod) = (on_boom(pins.boom_cylinder_rod), on_arm(pins.arm_cylinder_rod));
        let (arm_base, bucket_base) = (on_boom(pins.arm_cylinder_base), by_bucket(pins.bucket.cylinder_base));
        let boom_base = pose.boom_foot + pins.boom_cylinder_base;
        Drawn {
            bodies: vec![
                vec![pose.boom_foot, boom_rod, arm_base, pose.arm_pin],
                vec![pose.arm_pin, arm_rod, bucket_base, pose.bucket_pin],
                vec![pose.bucket_pin, link_pin, pose.tip],
            ],
            cylinders: vec![vec![boom_base, boom_rod], vec![arm_base, arm_rod], vec![bucket_base, rocker_end]],
            links: vec![by_bucket(pins.bucket.rocker_pin), rocker_end, link_pin],
            tip: pose.tip,
        }
    }
}

impl Drawn {
    /// All points.
    pub fn points(&self) -> impl Iterator<Item = &Vector> {
        self.bodies.iter().chain(&self.cylinders).flatten().chain(&self.links)
    }
}
