use super::*;

fn soil(unit_weight: f64, cohesion: f64, friction_angle: f64, steel_friction_angle: f64) -> machine::Soil {
    machine::Soil {
        level: 0.0,
        slope: 0.0,
        unit_weight,
        cohesion,
        friction_angle,
        steel_friction_angle,
        adhesion: 0.0,
        width: 1.05,
        rake_angle: 45.0,
        heap: 0.0,
        penetration_resistance: 0.0,
        teeth_area: 0.02,
    }
}

fn sand() -> machine::Soil {
    soil(17e3, 1e3, 32.0, 20.0)
}

/// Bounds of the published range of soils in which excavators dig: cohesion 0 to 105 kPa, friction 17 to 46 degrees, 17
/// to 22 kN/m3, friction on steel 11 to 23 degrees. Three soils within it, on a blade 1.05 m wide at 45 degrees.
#[test]
fn sand_loam_and_clay_resist_as_in_the_literature() {
    let mut off = 0.0f64;
    for (name, ground, expected) in [
        ("sand", sand(), [0.5e3, 3e3]),
        ("loam", soil(18e3, 10e3, 30.0, 20.0), [2.4e3, 9e3]),
        ("clay", soil(17e3, 40e3, 20.0, 11.0), [7e3, 22e3]),
    ] {
        let soil = Soil::new(&ground);
        for (depth, expected) in [0.1, 0.3].into_iter().zip(expected) {
            let found = soil.resistance(depth);
            println!("{name} at {depth} m: {found:.0} N for {expected:.0} N");
            off = off.max((found / expected - 1.0).abs());
        }
    }
    assert!(off < 0.1, "{off}");
}

#[test]
fn the_failure_plane_of_a_smooth_vertical_blade_is_rankines() {
    // With rho = 90 degrees and delta = 0 the wedge is Rankine's: b = 45 degrees - phi/2, and the force is
    // w gamma d^2/2 tan^2(45 degrees + phi/2) + 2 w c d tan(45 degrees + phi/2).
    let ground = machine::Soil { rake_angle: 90.0, ..soil(18e3, 5e3, 30.0, 0.0) };
    let found = Soil::new(&ground).resistance(0.4);
    let expected = 1.05 * (18e3 * 0.16 / 2.0 * 3.0 + 2.0 * 5e3 * 0.4 * 3f64.sqrt());
    assert!((found / expected - 1.0).abs() < 1e-5, "{found} for {expected}");
}

#[test]
fn heap_teeth_and_a_rising_ground_add_to_the_force() {
    let plain = Soil::new(&sand()).resistance(0.2);
    let more = [
        machine::Soil { heap: 0.4, ..sand() },
        machine::Soil { penetration_resistance: 5e5, ..sand() },
        machine::Soil { adhesion: 5e3, ..sand() },
        // The ground rises towards the machine.
        machine::Soil { slope: -10.0, ..sand() },
    ];
    for ground in more {
        assert!(Soil::new(&ground).resistance(0.2) > 1.02 * plain, "{ground:?}");
    }
    assert!(Soil::new(&machine::Soil { slope: 10.0, ..sand() }).resistance(0.2) < 0.98 * plain);
    // A tenth of a square metre at half a megapascal, half of it at half the depth of full penetration.
    let teeth = machine::Soil { penetration_resistance: 5e5, teeth_area: 0.1, ..sand() };
    let added = Soil::new(&teeth).resistance(HALF_PENETRATION) - Soil::new(&sand()).resistance(HALF_PENETRATION);
    assert!((added - 25e3).abs() < 1e-6, "{added}");
}

#[test]
fn the_force_opposes_the_motion_in_the_ground_and_is_zero_in_air_and_at_rest() {
    let mut soil = Soil::new(&machine::Soil { slope: 20.0, level: -1.0, ..sand() });
    soil.strength = 1.0;
    let surface = |x: f64| -1.0 + x * 20f64.to_radians().tan();
    for x in [3.0, 7.0] {
        let deep = Vector::new(x, surface(x) - 0.3);
        assert_eq!(soil.force(Vector::new(x, surface(x) + 1e-6), Vector::new(-1.0, 0.0)), Vector::new(0.0, 0.0));
        assert_eq!(soil.force(deep, Vector::default()), Vector::default());
        // The depth counts at right angles to the surface.
        let full = soil.resistance(0.3 * 20f64.to_radians().cos());
        // Along the ground and into it.
        let (along, into) = (Vector::new(-soil.out.z, soil.out.x), -soil.out);
        for velocity in [2.0 * along, along + 1.5 * into, 0.7 * into] {
            let force = soil.force(deep, velocity);
            assert!(force.dot(velocity) < -0.95 * full * velocity.norm(), "{force:?}");
            assert!(force.norm() < full && force.cross(velocity).abs() < 1e-9 * full, "{force:?}");
        }
        // Teeth that leave at right angles are free.
        let out = soil.force(deep, 3.0 * soil.out);
        assert!(out.norm() < 1e-3 * full, "{out:?}");
    }
}

#[test]
fn no_motion_has_more_damping_than_the_bound() {
    let mut soil = Soil::new(&machine::Soil { penetration_resistance: 5e5, heap: 0.3, ..sand() });
    soil.strength = 1.0;
    let (deep, step) = (Vector::new(5.0, -DEEPEST), 1e-6);
    let mut most = 0.0f64;
    for i in 0..40 {
        for j in 0..40 {
            let at = Vector::new(0.01 * f64::from(i - 20), 0.01 * f64::from(j - 20));
            for direction in [Vector::new(1.0, 0.0), Vector::new(0.0, 1.0), Vector::new(0.6, -0.8)] {
                let change = soil.force(deep, at + step * direction) - soil.force(deep, at);
                most = most.max(change.norm() / step);
            }
        }
    }
    println!("{most:.3e} N s/m for {:.3e} N s/m", soil.damping());
    assert!((0.999..1.001).contains(&(most / soil.damping())));
}
