//! The page about a recorded run.

use std::{collections::BTreeMap, fs, io::BufWriter, path::Path, process::Command};

use mcap::{Writer, records::MessageHeader};
use rustix::process::Signal;

use crate::harness::{
    FOUR_AXES, hydraxis,
    running::{Running, text},
    shared, signal, wait_for,
};

/// Largest page about a short run, bytes.
const MOST_BYTES: usize = 2_000_000;

/// Records a part of a run that has at least so many bytes.
fn recorded(test: &str, file: &Path, bytes: u64) -> Running {
    let running = Running::start_with(test, &["--duration", "600s"]);
    let mut command = hydraxis();
    command.args(["record", "--prefix", &running.group.prefix.to_string(), "--output"]).arg(file);
    let mut recorder = command.spawn().unwrap();
    wait_for("a recording", || (fs::metadata(file).ok()?.len() > bytes).then_some(()));
    signal(recorder.id(), Signal::INT);
    assert!(recorder.wait().unwrap().success());
    running
}

fn report(file: &Path, arguments: &[&str]) -> Command {
    let mut command = hydraxis();
    command.arg("report").arg(file).args(arguments);
    command
}

#[test]
fn a_recorded_run_becomes_a_page_that_needs_nothing_else() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let running = recorded("report", &file, 400_000);
    drop(running);
    let output = report(&file, &[]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let page = fs::read_to_string(folder.path().join("run.html")).unwrap();
    assert!(page.len() < MOST_BYTES, "{}", page.len());
    let said = text(Some(&*output.stdout));
    assert!(said.contains("run.html: "), "{said}");
    // The verdict comes before everything else.
    let place = |part: &str| page.find(part).unwrap_or_else(|| panic!("{part} is not on the page"));
    let parts = ["class=\"verdict", "following error rms", "What ran", "Who commanded", "Axis boom", "Latencies"];
    assert!(parts.windows(2).all(|pair| place(pair[0]) < place(pair[1])));
    for axis in ["boom", "arm", "telescope", "bucket"] {
        assert!(
            page.contains(&format!("<h2>Axis {axis}</h2>")) && page.contains(&format!("<td>{axis}</td>")),
            "{axis}"
        );
    }
    for part in ["Reference and position", "Following error", "Valve command", "by release", "release jitter"] {
        assert!(page.contains(part), "{part}");
    }
    assert_eq!(page.matches("<svg").count(), page.matches("</svg>").count());
    // No script, and no address but the names of XML.
    let without_names = page.replace("http://www.w3.org/2000/svg", "");
    for part in ["<script", "http:", "https:", "src=", "url(", "@import", "javascript:", "onload="] {
        assert!(!without_names.contains(part), "{part}");
    }
    assert!(!page.contains("NaN") && !page.contains("inf,"), "a picture has a place that is no number");
}

#[test]
fn a_cut_recording_gives_a_page_that_says_so_and_something_else_gives_none() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    drop(recorded("report-cut", &file, 400_000));
    let bytes = fs::read(&file).unwrap();
    let cut = folder.path().join("cut<b>.mcap");
    fs::write(&cut, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let output = report(&cut, &["--output", "-"]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let page = text(Some(&*output.stdout));
    assert!(page.contains("before its end: the file"), "{}", &page[..4000]);
    assert!(page.contains("cut&lt;b&gt;.mcap") && !page.contains("cut<b>"));
    assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>\n"));

    let other = folder.path().join("other.mcap");
    fs::write(&other, "no recording").unwrap();
    let output = report(&other, &[]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(text(Some(&*output.stderr)).contains("other.mcap: found no MCAP file"));
    assert!(!folder.path().join("other.html").exists());
}

/// Regression: messages without a field of ours were messages of zeros, and the run was in order.
#[test]
fn channels_of_another_program_under_our_names_are_no_recording() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("other.mcap");
    for (encoding, schema, message) in [("jsonschema", "{}", "json"), ("ros2msg", "float64 other\n", "cdr")] {
        let mut writer = Writer::new(BufWriter::new(fs::File::create(&file).unwrap())).unwrap();
        for name in ["encoder-sample", "valve-command"] {
            let schema = writer.add_schema(name, encoding, schema.as_bytes()).unwrap();
            let channel_id = writer.add_channel(schema, name, message, &BTreeMap::new()).unwrap();
            for sequence in 0..100 {
                let header = MessageHeader { channel_id, sequence, log_time: 0, publish_time: 0 };
                writer.write_to_known_channel(&header, b"{\"some\": \"text\"}").unwrap();
            }
        }
        writer.finish().unwrap();
        drop(writer);
        let output = report(&file, &[]).output().unwrap();
        let said = text(Some(&*output.stdout)) + &text(Some(&*output.stderr));
        assert_eq!(output.status.code(), Some(2), "{message}: {said}");
        assert!(said.contains("found neither samples nor commands"), "{message}: {said}");
        assert!(!folder.path().join("other.html").exists());
    }
}

/// Regression: a recording in lock-step was as long as the computer had taken for it.
#[test]
fn a_run_in_lock_step_has_a_page_with_the_times_of_the_machine() {
    let folder = tempfile::tempdir().unwrap();
    let (file, page) = (folder.path().join("run.mcap"), folder.path().join("run.html"));
    let run = || {
        let mut command = hydraxis();
        command.args(["run", FOUR_AXES, "--lockstep", "--duration", "5s", "--record"]).arg(&file);
        command.arg("--report").arg(&page).output().unwrap()
    };
    let output = run();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && said.contains("run.html: "), "{said}");
    let text = fs::read_to_string(&page).unwrap();
    assert!(text.contains("<td>4s 990ms</td>"), "{}", &text[..6000]);
    // Neither the recording nor the page is overwritten.
    let again = run();
    let said = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(!again.status.success() && said.contains("--record") && said.contains("--report"), "{said}");
}

#[test]
fn a_recorded_task_of_the_teeth_has_its_errors_and_its_cut_on_the_page() {
    let folder = tempfile::tempdir().unwrap();
    let (file, page) = (folder.path().join("run.mcap"), folder.path().join("run.html"));
    let mut command = hydraxis();
    command.args(["run", "--lockstep", "--duration", "14s"]);
    for axis in ["boom", "arm", "telescope", "bucket"] {
        command.args(["--set", &format!("axis.{axis}.reference.kind=tip")]);
    }
    let output = command.arg("--record").arg(&file).arg("--report").arg(&page).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = fs::read_to_string(&page).unwrap();
    let section = &text[text.find("<h2>The bucket's teeth</h2>").expect("no section of the teeth")..];
    // The way begins after 8 s at 7.2 m; the teeth stand below the ground before.
    for part in ["on their way", "mm rms", "degrees rms", " m at most, ", "The teeth from the side", "Pitch minus"] {
        assert!(section.contains(part), "{part}");
    }
    assert!(!section.contains("never") && !section.contains("NaN"));
}
