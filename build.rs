//! Passes what `sys/` found on to the renderer and records the git commit.
use std::process::Command;

fn main() {
    println!("cargo::rustc-check-cfg=cfg(embree)");
    // sys/build.rs publishes `cargo::metadata=VERSION=…` only when it has made bindings.
    println!("cargo::rerun-if-env-changed=DEP_EMBREE4_VERSION");
    if std::env::var_os("DEP_EMBREE4_VERSION").is_some() {
        println!("cargo::rustc-cfg=embree");
    }
    let commit = Command::new("git")
        .args(["describe", "--always", "--dirty", "--abbrev=12"])
        .output()
        .ok()
        .filter(|o| o.status.success())
        .and_then(|o| String::from_utf8(o.stdout).ok())
        .unwrap_or_default();
    println!("cargo::rustc-env=CAUSTICA_COMMIT={}", commit.trim());
    for watched in [".git/HEAD", ".git/logs/HEAD"] {
        if std::path::Path::new(watched).exists() {
            println!("cargo::rerun-if-changed={watched}");
        }
    }
}
