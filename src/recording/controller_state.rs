//! The state of the controllers under the names that controllers of ROS have, for each axis by its name.
//!
//! | field | is |
//! |---|---|
//! | `reference` | where the axis should be, m |
//! | `feedback` | where it was measured, m; NaN where the sample is not in the recording |
//! | `error` | following error, reference - feedback, m |
//! | `output` | valve command in [-1, 1] |
//!
//! One message follows each command, and has its header. All of it stands in the commands and samples as well; other
//! programs find it here without a table of the axes.
//!
//! Source of the names: `control_msgs/JointTrajectoryControllerState` of ros2_control.

use std::collections::VecDeque;

use mcap::McapResult;
use pipeline::message::{EncoderSample, Header, ValveCommand};

use super::{
    cdr, checksum,
    file::{Encoded, RecordingFile},
};

/// The channel in recordings. No process sends on it.
pub const CHANNEL: &str = "controller-state";
/// Name of the type.
const TYPE_NAME: &str = "hydraxis/msg/ControllerState";
/// Samples that wait for their command at most: those that a channel keeps.
const WAITING: usize = 256;

/// Makes the states of commands and their samples.
#[derive(Debug)]
pub struct ControllerStates {
    axes: usize,
    samples: VecDeque<EncoderSample>,
}

impl ControllerStates {
    /// Of a machine with so many axes.
    pub fn new(axes: usize) -> Self {
        Self { axes, samples: VecDeque::with_capacity(WAITING) }
    }

    /// Takes in a sample.
    pub fn sample(&mut self, sample: &EncoderSample) {
        if self.samples.len() == WAITING {
            self.samples.pop_front();
        }
        self.samples.push_back(*sample);
    }

    /// The state of a command that was read at this time.
    pub fn state(&mut self, read_ns: u64, command: &ValveCommand) -> Encoded {
        let tick = command.header.sequence;
        while self.samples.front().is_some_and(|sample| sample.header.sequence < tick) {
            self.samples.pop_front();
        }
        let sample = self.samples.front().filter(|sample| sample.header.sequence == tick);
        let mut bytes = Vec::new();
        cdr::encode(&command.header, &mut bytes);
        for (i, axis) in command.axes.iter().enumerate().take(self.axes) {
            let feedback = sample.map_or(f64::NAN, |sample| sample.axes[i].position);
            cdr::append(&[axis.reference, feedback, axis.error, axis.command], &mut bytes);
        }
        checksum::seal(&mut bytes);
        Encoded { channel: CHANNEL, read_ns, header: command.header, bytes }
    }
}

/// Adds the channel to a file, for axes of these names.
///
/// # Errors
/// The file cannot be written.
pub fn add_to(file: &mut RecordingFile, axes: &[String]) -> McapResult<()> {
    file.add(CHANNEL, TYPE_NAME, &schema(axes))
}

/// The schema for axes of these names.
fn schema(axes: &[String]) -> String {
    let ruler = "=".repeat(80);
    let mut taken = vec!["header".to_owned(), "checksum".to_owned()];
    let mut fields = String::new();
    for axis in axes {
        let name = field_name(axis, &taken);
        fields += &format!("hydraxis/AxisControl {name}\n");
        taken.push(name);
    }
    let header = cdr::schema::<Header>();
    checksum::schema(format!(
        "hydraxis/Header header\n{fields}{ruler}\nMSG: hydraxis/Header\n{header}{ruler}\nMSG: \
         hydraxis/AxisControl\nfloat64 reference\nfloat64 feedback\nfloat64 error\nfloat64 output\n"
    ))
}

/// The name of an axis as a field of ROS: small letters, digits and single underscores, a letter first; none that is
/// taken.
fn field_name(axis: &str, taken: &[String]) -> String {
    let plain = |letter: char| if letter.is_ascii_alphanumeric() { letter.to_ascii_lowercase() } else { '_' };
    let parts: String = axis.chars().map(plain).collect();
    let mut name = parts.split('_').filter(|part| !part.is_empty()).collect::<Vec<_>>().join("_");
    if !name.starts_with(|letter: char| letter.is_ascii_lowercase()) {
        name = format!("axis_{name}").trim_end_matches('_').to_owned();
    }
    let numbered = (2..).map(|number| format!("{name}_{number}"));
    [name.clone()].into_iter().chain(numbered).find(|name| !taken.contains(name)).unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::schema::columns;

    #[test]
    fn a_state_has_the_names_of_ros_and_of_the_axes() {
        let axes = ["boom", "Left-Arm"].map(str::to_owned);
        let mut states = ControllerStates::new(axes.len());
        let (mut sample, mut command) = (EncoderSample::default(), ValveCommand::default());
        for tick in 0..3 {
            sample.header.sequence = tick;
            sample.axes[1].position = 0.5 + tick as f64;
            states.sample(&sample);
        }
        (command.header.sequence, command.header.number) = (1, 9);
        (command.axes[1].reference, command.axes[1].error, command.axes[1].command) = (1.75, 0.25, -0.5);
        let columns = columns(&schema(&axes)).unwrap();
        let value = |state: &Encoded, name: &str| {
            let column = columns.iter().find(|column| column.name == name).unwrap_or_else(|| panic!("{name}"));
            column.value(&state.bytes).unwrap().to_string()
        };
        let state = states.state(0, &command);
        let fields = ["reference", "feedback", "error", "output"].map(|field| format!("left_arm.{field}"));
        assert_eq!(fields.map(|field| value(&state, &field)), ["1.75", "1.5", "0.25", "-0.5"]);
        assert_eq!((value(&state, "header.number"), value(&state, "boom.feedback")), ("9".to_owned(), "0".to_owned()));
        assert_eq!(columns.last().unwrap().bytes().end, state.bytes.len());
        assert!(checksum::is_whole(&state.bytes));
        // A command that repeats one after its sample has gone by, and one whose sample was lost.
        assert_eq!(value(&states.state(0, &command), "left_arm.feedback"), "1.5");
        command.header.sequence = 7;
        assert_eq!(value(&states.state(0, &command), "left_arm.feedback"), "NaN");
    }

    #[test]
    fn names_of_axes_are_fields_of_ros() {
        let mut taken = vec!["header".to_owned()];
        for (axis, expected) in [
            ("boom", "boom"),
            ("Boom", "boom_2"),
            ("left--arm_", "left_arm"),
            ("4th", "axis_4th"),
            ("-", "axis"),
            ("header", "header_2"),
        ] {
            assert_eq!(field_name(axis, &taken), expected, "{axis}");
            taken.push(expected.to_owned());
        }
    }
}
