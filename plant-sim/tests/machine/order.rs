//! The place of an axis among the others does not change the bits of its motion.

use super::*;

/// Bits of the states of `machine`'s axes after 3 s, by the names of the axes. The flow of the pump suffices for all.
fn bits(mut machine: Machine) -> Vec<(String, [u64; 4])> {
    machine.hydraulics.as_mut().unwrap().supply.flow = 1.0;
    let mut sim = simulate(&machine);
    for command in [0.9, -0.4, 0.13] {
        hold(&mut sim, command, 1.0);
    }
    let states = machine.axes.iter().zip(sim.axes()).map(|(axis, state)| {
        let numbers = [state.position, state.velocity, state.piston_pressure, state.rod_pressure];
        (axis.name.clone(), numbers.map(f64::to_bits))
    });
    states.collect()
}

#[test]
fn an_axis_has_equal_bits_in_any_lane_and_with_any_other_axes() {
    let machine = under("everything");
    let expected = bits(machine.clone());
    let with = |order: &[usize]| {
        let mut other = machine.clone();
        other.axes = order.iter().map(|index| machine.axes[*index].clone()).collect();
        bits(other)
    };
    let orders: [&[usize]; 8] =
        [&[3, 2, 1, 0], &[0], &[1], &[2], &[3], &[2, 0], &[1, 3, 0, 2, 1], &[0, 1, 2, 3, 3, 2, 1, 0]];
    for order in orders {
        for (found, index) in with(order).into_iter().zip(order) {
            assert_eq!(found, expected[*index], "{order:?}");
        }
    }
}
