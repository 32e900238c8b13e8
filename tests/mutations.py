#!/usr/bin/env python3
"""Plants the faults of mutations.json, one at a time, and tells which rows of `caustica verify --fast` notice each.

    tests/mutations.py [--accel both] [DIR]

All faults are compiled at once into a scratch copy of the checkout, each behind a number in the environment, so that one
build does; DIR is where, a temporary folder unless given. CARGO may name another cargo. Every fault is put to the cases
that are said to catch it. What came out of it last is in mutations.md. Exit code 1 when a case misses its fault.
"""
import argparse
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
FAULTS = json.loads((HERE / "mutations.json").read_text())

SWITCH = """
/// Whether fault `n` is to be seen; 0 is none.
#[doc(hidden)]
pub fn fault(n: u32) -> bool {
    static WANTED: std::sync::OnceLock<u32> = std::sync::OnceLock::new();
    *WANTED.get_or_init(|| std::env::var("CAUSTICA_FAULT").ok().and_then(|v| v.parse().ok()).unwrap_or(0)) == n
}
"""


def plant(copy):
    """Writes a copy of the checkout with all faults in it."""
    for part in ["src", "sys", "benches", "tests", "Cargo.toml", "Cargo.lock", "build.rs", "README.md"]:
        source, target = HERE.parent / part, copy / part
        if source.is_dir():
            shutil.copytree(source, target, dirs_exist_ok=True, ignore=shutil.ignore_patterns("target"))
        else:
            shutil.copy2(source, target)
    for fault in FAULTS:
        path = copy / fault["file"]
        text = path.read_text()
        if text.count(fault["old"]) != 1:
            sys.exit(f"{fault['file']}: the place of {fault['fault']!r} has changed")
        path.write_text(text.replace(fault["old"], fault["new"]))
    lib = copy / "src/lib.rs"
    lib.write_text(lib.read_text() + SWITCH)


def build(copy):
    cargo = os.environ.get("CARGO", "cargo")
    subprocess.run([cargo, "build", "--release", "--bin", "caustica"], cwd=copy, check=True)
    return str(copy / "target/release/caustica")


def bad_rows(program, number, cases, accel):
    """The rows that fail with fault `number`."""
    command = [program, "verify", "--fast", "--json", "--accel", accel]
    command += [a for c in cases for a in ("--case", c)]
    done = subprocess.run(command, env={**os.environ, "CAUSTICA_FAULT": str(number)}, capture_output=True, text=True)
    try:
        rows = json.loads(done.stdout)["rows"]
    except (ValueError, KeyError):
        sys.exit(f"{' '.join(command)}: {done.stderr.strip() or done.stdout[:200]}")
    return [r for r in rows if r["verdict"] == "fail"]


def sign(row):
    """How far off a row is, in the way that says most."""
    if row["relative_error"] is not None:
        text = f"{row['relative_error']:+.1%}"
    elif row["measured"] is not None:
        text = f"{row['measured']:.2g} for 0"
    else:
        text = "no number"
    return text + (f", z = {row['z']:.0f}" if row["z"] else "")


def line(fault, rows):
    """A line of the table: for each case the row that is furthest off."""
    def off(row):
        return abs(row["relative_error"] or row["measured"] or 0)

    found = []
    for case in fault["cases"]:
        of_case = [r for r in rows if r["case"] == case]
        if of_case:
            worst = max(of_case, key=off)
            where = " ".join(filter(None, [worst["method"], worst["accel"]]))
            found.append(f"`{case}`: {len(of_case)} rows, as {worst['parameter']} by {where} ({sign(worst)})")
        else:
            found.append(f"`{case}`: **nothing**")
    return f"| {fault['fault']} | `{fault['file']}` | {'; '.join(found)} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dir", nargs="?", help="scratch copy of the checkout")
    parser.add_argument("--accel", default="both")
    args = parser.parse_args()
    copy = pathlib.Path(args.dir or tempfile.mkdtemp(prefix="mutations-"))
    copy.mkdir(parents=True, exist_ok=True)
    plant(copy)
    program = build(copy)
    # Without a fault every case is content.
    sound = bad_rows(program, 0, sorted({c for f in FAULTS for c in f["cases"]}), args.accel)
    for row in sound:
        print(f"fails without any fault: {row['case']} {row['parameter']} {row['method']} {row['accel']}")
    missed = len(sound)
    print("| fault | planted in | caught by |\n|---|---|---|")
    for number, fault in enumerate(FAULTS, 1):
        rows = bad_rows(program, number, fault["cases"], args.accel)
        missed += any(all(r["case"] != c for r in rows) for c in fault["cases"])
        print(line(fault, rows), flush=True)
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
