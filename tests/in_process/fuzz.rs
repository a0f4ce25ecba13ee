//! The fuzz targets on their seeds and on some mutations of them. The search with a fuzzer is in `fuzz/`.

#[path = "../../fuzz/src/lib.rs"]
mod targets;

use std::{fs, path::Path};

use rand_pcg::{
    Pcg64Mcg,
    rand_core::{Rng, SeedableRng},
};

/// Number of mutations for each target.
const MUTATIONS: usize = 300;

/// The seeds of a target, and `more` files.
fn seeds(target: &str, more: &[&str]) -> Vec<Vec<u8>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = fs::read_dir(root.join("fuzz/seeds").join(target)).unwrap();
    let mut files: Vec<_> =
        folder.map(|entry| entry.unwrap().path()).chain(more.iter().map(|file| root.join(file))).collect();
    files.sort();
    assert!(files.len() > 1);
    files.iter().map(|file| fs::read(file).unwrap()).collect()
}

/// Seeds with a few bytes changed, removed, inserted or doubled. The mutations are the same in every run.
fn mutations(seeds: &[Vec<u8>]) -> impl Iterator<Item = Vec<u8>> {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    (0..MUTATIONS).map(move |i| {
        let mut below = |bound: usize| (random.next_u64() % bound.max(1) as u64) as usize;
        let mut data = seeds[i % seeds.len()].clone();
        for _ in 0..1 + below(4) {
            let place = below(data.len());
            match below(4) {
                0 if !data.is_empty() => data[place] = below(256) as u8,
                1 if !data.is_empty() => drop(data.remove(place)),
                2 => data.insert(place, below(256) as u8),
                _ => {
                    let end = (place + below(40)).min(data.len());
                    let piece = data[place..end].to_vec();
                    let at = below(data.len());
                    data.splice(at..at, piece);
                }
            }
        }
        data
    })
}

fn try_all(target: fn(&[u8]), seeds: &[Vec<u8>]) {
    target(&[]);
    seeds.iter().for_each(|seed| target(seed));
    mutations(seeds).for_each(|data| target(&data));
}

#[test]
fn machine_files() {
    try_all(targets::machine_file, &seeds("machine_file", &["examples/four-axes.toml"]));
}

#[test]
fn recordings() {
    try_all(targets::csv, &seeds("csv", &[]));
}

#[test]
fn trajectories() {
    try_all(targets::trajectory, &seeds("trajectory", &[]));
}

#[test]
fn messages() {
    try_all(targets::messages, &seeds("messages", &[]));
}

#[test]
fn text_of_adapters() {
    try_all(targets::slcan, &seeds("slcan", &[]));
}

#[test]
fn logs_of_buses() {
    try_all(targets::candump, &seeds("candump", &[]));
}

#[test]
fn dialogues() {
    try_all(targets::sdo, &seeds("sdo", &[]));
}

#[test]
fn devices_and_their_master() {
    try_all(targets::devices, &seeds("devices", &[]));
}

#[test]
fn data_bases() {
    try_all(targets::dbc, &seeds("dbc", &["examples/excavator.dbc"]));
}

#[test]
fn recordings_in_mcap() {
    try_all(targets::recording, &seeds("recording", &[]));
}
