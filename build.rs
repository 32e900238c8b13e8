//! Passes what `sys/` found on to the renderer and records the git commit.
use std::process::Command;

fn main() {
    println!("cargo::rustc-check-cfg=cfg(embree)");
    // sys/build.rs publishes `cargo::metadata=VERSION=…` only when it has made bindings.
    println!("cargo::rerun-if-env-changed=DEP_EMBREE4_VERSION");
    if std::env::var_os("DEP_EMBREE4_VERSION").is_some() {
        println!("cargo::rustc-cfg=embree");
    }
    let commit = git(&["describe", "--always", "--dirty", "--abbrev=12"]).unwrap_or_default();
    println!("cargo::rustc-env=CAUSTICA_COMMIT={commit}");
    // Asked for by name: in a linked work tree they are not in `.git`.
    for watched in ["HEAD", "logs/HEAD"].iter().filter_map(|file| git(&["rev-parse", "--git-path", file])) {
        if std::path::Path::new(&watched).exists() {
            println!("cargo::rerun-if-changed={watched}");
        }
    }
}

/// What a git command prints, if it succeeds.
fn git(args: &[&str]) -> Option<String> {
    let output = Command::new("git").args(args).output().ok().filter(|o| o.status.success())?;
    String::from_utf8(output.stdout).ok().map(|text| text.trim().to_string())
}
