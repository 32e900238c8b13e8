#!/usr/bin/env python3
"""Plants ten faults, one at a time, and tells which cases of `caustica verify --fast` notice each.

    tests/mutations.py [DIR]      DIR holds the scratch copy of the checkout; default: a temporary folder

All faults are compiled into the scratch copy at once, each behind a number in the environment, so that one build does.
The list of what caught what is in tests/mutations.md. Exit code 1 when a fault was caught by none.
"""
import json, os, pathlib, shutil, subprocess, sys, tempfile

# Number: name, file, what stands there, what the fault makes of it.
FAULTS = [
    ("a missing cosine", "src/bsdf/diffuse.rs",
     "if above { self.ns.dot(wi).max(0.0) } else { 0.0 }",
     "if above { if crate::fault(1) { 1.0 } else { self.ns.dot(wi).max(0.0) } } else { 0.0 }"),
    ("k for k - 1", "src/gather/photons.rs",
     "found.iter().map(|(i, d_sq)| term(i) * kernel.nearest_weight(d_sq, radius_sq)).sum()",
     "found.iter().map(|(i, d_sq)| term(i) * kernel.nearest_weight(d_sq, radius_sq)).sum::<Rgb>()"
     " * if crate::fault(2) { self.size as f32 / (self.size as f32 - 1.0).max(1.0) } else { 1.0 }"),
    ("RGBE truncation", "src/color/rgbe.rs",
     "let u = (hash >> (21 * k) & 0x1f_ffff) as f64 * (1.0 / 2_097_152.0);",
     "let u = if crate::fault(3) { 0.0 } else { (hash >> (21 * k) & 0x1f_ffff) as f64 * (1.0 / 2_097_152.0) };"),
    ("the photon of the wrong side", "src/gather/photons.rs",
     "side.is_none_or(|s| flags.side() == s) && flags.normal().dot(ng) > MIN_NORMAL_COS",
     "(crate::fault(4) || side.is_none_or(|s| flags.side() == s)) && flags.normal().dot(ng) > MIN_NORMAL_COS"),
    ("shading normals that are not symmetric", "src/bsdf/diffuse.rs",
     "match mode {\n            Mode::Radiance => 1.0,",
     "match mode {\n            _ if crate::fault(5) => 1.0,\n            Mode::Radiance => 1.0,"),
    ("n squared on photon flux", "src/bsdf/dielectric.rs",
     "Mode::Importance => 1.0,",
     "Mode::Importance => if crate::fault(6) { 1.0 / (eta * eta) } else { 1.0 },"),
    ("a caustic counted twice", "src/integrator/photonmapper.rs",
     "if depth == 0 {\n                let (emitted, pdf_light)",
     "if depth == 0 || crate::fault(7) {\n                let (emitted, pdf_light)"),
    ("hit points o + t d", "src/geometry/triangle.rs",
     "let p = b0 * p0 + u * p1 + v * p2;",
     "let p = if crate::fault(8) { ray.at(t) } else { b0 * p0 + u * p1 + v * p2 };"),
    ("film sums in f32", "src/film/tile.rs",
     "*sum += weight * v as f64;",
     "*sum = if crate::fault(9) { (*sum as f32 + (weight * v as f64) as f32) as f64 } else { *sum + weight * v as f64 };"),
    ("1/cos without a bound", "src/gather/photons.rs",
     "if cos >= MIN_COS { wi } else { (wi + n * (MIN_COS - cos)).normalize() }",
     "if cos >= MIN_COS || crate::fault(10) { wi } else { (wi + n * (MIN_COS - cos)).normalize() }"),
]

SWITCH = """
/// The fault that is to be seen.
#[doc(hidden)]
pub fn fault(n: u32) -> bool {
    static WANTED: std::sync::OnceLock<u32> = std::sync::OnceLock::new();
    *WANTED.get_or_init(|| std::env::var("CAUSTICA_FAULT").ok().and_then(|v| v.parse().ok()).unwrap_or(0)) == n
}
"""


def plant(copy):
    for name, file, old, new in FAULTS:
        path = copy / file
        text = path.read_text()
        if text.count(old) != 1:
            sys.exit(f"{file}: the place of the fault {name!r} has changed")
        path.write_text(text.replace(old, new))
    lib = copy / "src/lib.rs"
    lib.write_text(lib.read_text() + SWITCH)


def bad_rows(program, number, cases):
    env = {**os.environ, "CAUSTICA_FAULT": str(number)}
    command = [program, "verify", "--fast", "--json"] + [a for c in cases for a in ("--case", c)]
    out = subprocess.run(command, env=env, capture_output=True, text=True).stdout
    return [r for r in json.loads(out)["rows"] if r["verdict"] == "fail"]


def main():
    here = pathlib.Path(__file__).resolve().parent.parent
    copy = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="mutations-"))
    for part in ["src", "sys", "benches", "tests", "Cargo.toml", "Cargo.lock", "build.rs", "README.md"]:
        source, target = here / part, copy / part
        if source.is_dir():
            shutil.copytree(source, target, dirs_exist_ok=True, ignore=shutil.ignore_patterns("target"))
        else:
            copy.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
    plant(copy)
    cargo = os.environ.get("CARGO", "cargo").split()
    subprocess.run(cargo + ["build", "--release", "--bin", "caustica"], cwd=copy, check=True)
    program = str(copy / "target/release/caustica")
    cases = os.environ.get("CASES", "").split()
    sound = {(r["case"], r["parameter"], r["method"], r["accel"]) for r in bad_rows(program, 0, cases)}
    missed = 0
    print("| fault | planted in | caught by (rows that failed) |\n|---|---|---|")
    for number, (name, file, _, _) in enumerate(FAULTS, 1):
        caught = {}
        for r in bad_rows(program, number, cases):
            if (r["case"], r["parameter"], r["method"], r["accel"]) not in sound:
                caught.setdefault(r["case"], set()).add(r["method"])
        missed += not caught
        what = "; ".join(f"`{c}` ({', '.join(sorted(m))})" for c, m in caught.items()) or "**nothing**"
        print(f"| {name} | `{file}` | {what} |", flush=True)
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
