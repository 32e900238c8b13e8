#!/usr/bin/env python3
"""What `--integrator auto` picks, and how much later than the best method it has a small error.

    cargo build --release && python3 benches/auto.py

Measures the time of every method to a relMSE of 1e-2 on every scene in scenes/ (but those of `verify`), makes the choice, and prints a table: the
pilot's time plus the time of the method chosen, over the time of the best. Takes about half an hour.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
METHODS = ["path", "photonmapper", "sppm", "bdpt", "vcm"]
# Two methods that find the light of a scene; elsewhere the program's own pair. One alone, with a seed of its own, where the
# others come near too slowly to agree: only photon maps find what the ring mirrors of its caustic, and the light that the
# window lets in.
REFERENCE = {
    "pool": "sppm,vcm",
    "ring": "vcm",
    "environment": "path,bdpt",
    "terrain": "path,bdpt",
    "window": "sppm",
    "matterhorn": "path,bdpt",
    **dict.fromkeys(["cognac", "cube", "fractal-box", "glass-sphere", "glossy", "iced-water"], "vcm"),
    **dict.fromkeys(["poolhouse", "sphereflake", "sun", "ceiling", "point", "background"], "vcm"),
}
FOLDERS = ["scenes", "scenes/gallery", "scenes/smallvcm"]
GOAL = 1e-2


def run(args, *command):
    return subprocess.run([str(c) for c in (args.caustica, *command)], check=True, capture_output=True, text=True).stdout


def make_reference(args, scene, reference, size):
    """The picture to measure by, from two methods that agree or, where no second one can, from one."""
    methods = REFERENCE.get(scene.stem, "")
    if methods and "," not in methods:
        alone = ["--integrator", methods, "--spp", "1000000", "--seed", "1000003", "--time", args.reference_time]
        run(args, "render", scene, "-o", reference, *size, *alone)
    else:
        chosen = ["--methods", methods] if methods else []
        run(args, "reference", scene, "-o", reference, *size, "--time", args.reference_time, *chosen)


def measure(args, scene, folder):
    """Seconds to the goal by method, the choice, and the seconds that choosing took."""
    size = ["--width", args.size, "--height", args.size] if args.size else []
    reference = folder / f"{scene.stem}.exr"
    if not reference.exists():
        make_reference(args, scene, reference, size)
    report = folder / scene.stem
    if not (report / "report.json").exists():
        measured = ["--integrators", args.methods, "--time", args.time, "--seeds", args.seeds]
        run(args, "converge", scene, "-o", report, *size, "--reference", reference, *measured)
    found = json.loads((report / "report.json").read_text())
    times = {}
    for series in found["series"]:
        reached = [r["seconds"] for r in series["outcome"]["reached"] if abs(r["relmse"] - GOAL) < 1e-6 * GOAL]
        times[series["method"]] = reached[0] if reached else None
    # The median of a few pilots.
    pilots = []
    for _ in range(5):
        command = ["render", scene, "-o", folder / "pilot.exr", *size, "--integrator", "auto", "--spp", "1", "--json"]
        told = json.loads(run(args, *command))
        pilots.append(next(p["seconds"] for p in told["phases"] if p["name"] == "choose integrator"))
    return times, told["choice"]["method"], sorted(pilots)[2]


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("scenes", nargs="*", help="names of scenes in scenes/ and its folders gallery and smallvcm, all by default")
    p.add_argument("--caustica", default=ROOT / "target/release/caustica")
    p.add_argument("--size", help="width and height of the pictures; by default those of the scene files")
    p.add_argument("--methods", default=",".join(METHODS), help="the methods to measure, by commas")
    p.add_argument("--time", default="15s")
    p.add_argument("--reference-time", default="60s")
    p.add_argument("--seeds", default="1")
    p.add_argument("--keep", type=pathlib.Path, help="folder for references and reports, which are then not made again")
    args = p.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.keep or pathlib.Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        print("| scene | " + " | ".join(METHODS) + " | chosen | pilot | with pilot over best |")
        print("|---" * (len(METHODS) + 4) + "|")
        for scene in (scene for name in FOLDERS for scene in sorted((ROOT / name).glob("*.xml"))):
            if args.scenes and scene.stem not in args.scenes:
                continue
            if scene.stem == "terrain" and not (scene.parent / "terrain.ply").exists():
                print(f"| {scene.stem} | needs its mesh: see the scene file |")
                continue
            times, method, pilot = measure(args, scene, folder)
            cells = ["–" if times.get(m) is None else f"{times[m]:.2f} s" for m in METHODS]
            best = min((t for t in times.values() if t is not None), default=None)
            ratio = "–" if None in (best, times.get(method)) else f"{(times[method] + pilot) / best:.2f}"
            print(f"| {scene.stem} | " + " | ".join(cells) + f" | {method} | {pilot:.2f} s | {ratio} |", flush=True)


if __name__ == "__main__":
    main()
