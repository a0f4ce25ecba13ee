//! The version that `hydraxis --version` prints: that of Cargo.toml, with the commit that the program was built from.
//!
//! | build | version |
//! |---|---|
//! | with `HYDRAXIS_COMMIT` in the environment, as a build of a package sets it | `0.1.0 (that text)` |
//! | release, in a clone of the repository | `0.1.0 (first 12 digits of the commit)` |
//! | release, in sources without a repository | `0.1.0` |
//! | debug | `0.1.0 (debug)` |
//!
//! Nothing else of the computer or of the time gets into the version, so the same commit gives the same one. A debug
//! build does not name its commit: each commit would compile the command and all of its tests anew.

use std::{env, path::Path, process::Command};

/// Digits of a commit that are shown.
const DIGITS: usize = 12;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=HYDRAXIS_COMMIT");
    let given = env::var("HYDRAXIS_COMMIT").ok().filter(|commit| !commit.is_empty());
    let is_release = env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let origin = match given {
        Some(commit) => Some(commit),
        None if is_release => commit(),
        None => Some("debug".to_owned()),
    };
    let version = env::var("CARGO_PKG_VERSION").unwrap_or_default();
    let version = origin.map_or_else(|| version.clone(), |origin| format!("{version} ({origin})"));
    println!("cargo::rustc-env=HYDRAXIS_VERSION={version}");
}

/// The commit of the repository whose top is this folder. Sources inside of another repository have none.
fn commit() -> Option<String> {
    let folder = Path::new(&env::var_os("CARGO_MANIFEST_DIR")?).canonicalize().ok()?;
    if Path::new(&git(&folder, &["rev-parse", "--show-toplevel"])?).canonicalize().ok()? != folder {
        return None;
    }
    // The log of HEAD grows with every commit and every checkout. A file that is absent would run this program at each
    // build.
    let watched = ["logs/HEAD", "HEAD"].map(|name| git(&folder, &["rev-parse", "--git-path", name]));
    for path in watched.into_iter().flatten().map(|path| folder.join(path)).filter(|path| path.exists()) {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    let mut commit = git(&folder, &["rev-parse", "HEAD"])?;
    commit.truncate(DIGITS);
    Some(commit)
}

/// What git prints; `None` without git, and where git fails.
fn git(folder: &Path, arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").arg("-C").arg(folder).args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok().filter(|_| output.status.success())?;
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}
