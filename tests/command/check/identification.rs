//! Options of the structure of the identified model.

use super::{
    EXCAVATOR,
    cli::{expect_refusal, success},
    expect_four_axes, folder_with, line_of, replaced,
};

/// Expects a refusal of the example with `line` added to the boom's table of identification.
fn expect_broken_option(line: &str, expected: &str) {
    let folder = folder_with(&replaced(EXCAVATOR, "training = \"8s\" ", &format!("{line}\ntraining = \"8s\" ")));
    let place = format!("m.toml:{}: axis.boom.identification.{expected}", line_of("training = \"8s\" "));
    expect_refusal(folder.path(), &["check", "m.toml"], &[&place]);
}

#[test]
fn the_options_of_the_structure_are_accepted() {
    let options = "training = \"8s\"\nintegrator = true\ndrift = true\ndead_band = [0.07, 0.1]\n\
                   knots = [0, 0.2, 0.5]\norder = 3\noutput = \"velocity\" ";
    let folder = folder_with(&replaced(EXCAVATOR, "training = \"8s\" ", options));
    expect_four_axes(&success(folder.path(), &["check", "m.toml"]));
}

#[test]
fn a_number_in_the_place_of_a_flag_is_refused() {
    expect_broken_option("integrator = 1", "integrator: found 1; allowed: true or false");
    expect_broken_option("drift = \"yes\"", "drift: found \"yes\"; allowed: true or false");
}

#[test]
fn a_dead_band_that_is_none_is_refused() {
    for (typed, found) in [("-0.1", "-0.1"), ("0.95", "0.95"), ("nan", "nan"), ("[0.1]", "[0.1]"), ("true", "true")] {
        let expected = format!("dead_band: found {found}; allowed: a number from 0 to 0.9, or [low, high] of two");
        expect_broken_option(&format!("dead_band = {typed}"), &expected);
    }
}

#[test]
fn knots_that_do_not_rise_or_are_out_of_range_are_refused() {
    for (typed, found) in [
        ("[0.2, 0.1]", "[0.2, 0.1]"),
        ("[0.1, 0.1]", "[0.1, 0.1]"),
        ("[]", "[]"),
        ("[0, 0.1, 0.2, 0.3, 0.4, 0.5]", "[0.0, 0.1, 0.2, 0.3, 0.4, 0.5]"),
        ("[-0.1, 0.2]", "[-0.1, 0.2]"),
        ("[0.5, 1.1]", "[0.5, 1.1]"),
        ("0.2", "0.2"),
    ] {
        let expected = format!("knots: found {found}; allowed: a list of 1 to 5 rising numbers from 0 to 1");
        expect_broken_option(&format!("knots = {typed}"), &expected);
    }
}

#[test]
fn an_order_that_is_not_the_number_of_knots_is_refused() {
    let expected = "order: found 3 with 2 knots; allowed: 2, the number of knots, or no order";
    expect_broken_option("order = 3\nknots = [0, 0.2]", expected);
}

#[test]
fn an_output_that_is_neither_position_nor_velocity_is_refused() {
    let expected = "output: found \"speed\"; allowed: \"position\" or \"velocity\"";
    expect_broken_option("output = \"speed\"", expected);
}
