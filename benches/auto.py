#!/usr/bin/env python3
"""What `--integrator auto` picks, and how much later than the best method it has a small error.

    cargo build --release && python3 benches/auto.py

Measures the time of every method to a relMSE of 1e-2 on every scene in scenes/ (but those of `verify`), makes the choice, and
prints a table: the pilot's time plus the time of the method chosen, over the time of the best. Where a method is not there
within its time, the table has its error then and, if a slope tells it, about when (~) it will be.
Takes about three quarters of an hour: two and a quarter minutes a scene.

Cognac and sphereflake need references of 10 and 20 minutes (--reference-time): shorter ones miss the small images of the
lamp, and say nothing of it in their own error.
"""

import argparse
import json
import math
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


def make_reference(args, scene, reference, common):
    """The picture to measure by, from two methods that agree or, where no second one can, from one."""
    methods = REFERENCE.get(scene.stem, "")
    if methods and "," not in methods:
        alone = ["--integrator", methods, "--spp", "1000000", "--seed", "1000003", "--time", args.reference_time]
        run(args, "render", scene, "-o", reference, *common, *alone, "--float", "--aov", "variance")
    else:
        chosen = ["--methods", methods] if methods else []
        run(args, "reference", scene, "-o", reference, *common, "--time", args.reference_time, *chosen)


class Time:
    """When a method has the goal: measured or, where its time was too short, by the slope of its error."""

    def __init__(self, report):
        own = report["reference"]["relmse"] or 0.0
        series = report["series"][0]
        # The reference's noise is no part of the method's error.
        curve = [(point["seconds"], point["relmse"][1] - own) for point in series["curve"]]
        self.end, self.error = curve[-1]
        at = next((i for i, point in enumerate(curve) if point[1] <= GOAL), None)
        self.measured, self.seconds = at is not None, None
        slope = series["outcome"]["time_slope"]
        if at == 0:
            self.seconds = curve[0][0]
        elif self.measured:
            (t0, e0), (t1, e1) = curve[at - 1 : at + 1]
            self.seconds = t0 * (t1 / t0) ** (math.log(e0 / GOAL) / math.log(e0 / max(e1, 1e-3 * GOAL)))
        elif slope and slope["mean"] < -0.3 and self.error < 10 * GOAL:
            # Error falls with time to the power of -1 at best; where rare samples make it jump, the slope tells nothing.
            self.seconds = self.end * (self.error / GOAL) ** (1 / min(-slope["mean"], 1.0))

    def __str__(self):
        if self.measured:
            return f"{self.seconds:.2f} s"
        return f"{self.error:.2g} at {self.end:.0f} s" + (f", ~{self.seconds:.0f} s" if self.seconds else "")


def measure(args, scene, folder):
    """Time to the goal by method, the reference's own error, the choice, and the seconds that choosing took."""
    size = ["--width", args.size, "--height", args.size] if args.size else []
    common = [*size, *(["--threads", args.threads] if args.threads else [])]
    reference = folder / f"{scene.stem}.exr"
    if not reference.exists():
        make_reference(args, scene, reference, common)
    times, own = {}, None
    for method in args.methods.split(","):
        report = folder / f"{scene.stem}-{method}"
        if not (report / "report.json").exists():
            measured = ["--integrators", method, "--time", args.time, "--seeds", args.seeds]
            run(args, "converge", scene, "-o", report, *common, "--reference", reference, *measured)
        found = json.loads((report / "report.json").read_text())
        times[method], own = Time(found), found["reference"]["relmse"]
    # The median of a few pilots.
    pilots = []
    for _ in range(5):
        command = ["render", scene, "-o", folder / "pilot.exr", *common, "--integrator", "auto", "--time", "0.01s", "--json"]
        told = json.loads(run(args, *command))
        pilots.append(next(p["seconds"] for p in told["phases"] if p["name"] == "choose integrator"))
    choice = told["choice"]
    chosen, samples = choice["method"], choice.get("samples_per_pass") or 1
    if samples > 1:
        # As it is rendered then: the method alone takes one sample a pass.
        report = folder / f"{scene.stem}-{chosen}-{samples}"
        if not (report / "report.json").exists():
            measured = ["--integrators", chosen, "--time", args.time, "--seeds", args.seeds, "--samples-per-pass", samples]
            run(args, "converge", scene, "-o", report, *common, "--reference", reference, *measured)
        chosen = f"{chosen}, {samples} samples a pass"
        times[chosen] = Time(json.loads((report / "report.json").read_text()))
    return times, own, chosen, sorted(pilots)[2]


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("scenes", nargs="*", help="names of scenes in scenes/ and its folders gallery and smallvcm, all by default")
    p.add_argument("--caustica", default=ROOT / "target/release/caustica")
    p.add_argument("--threads", help="worker threads of everything that is timed")
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
        methods = args.methods.split(",")
        print("| scene | " + " | ".join(methods) + " | own error of the reference | chosen | pilot | with pilot over best |")
        print("|---" * (len(methods) + 5) + "|")
        for scene in (scene for name in FOLDERS for scene in sorted((ROOT / name).glob("*.xml"))):
            if args.scenes and scene.stem not in args.scenes:
                continue
            if scene.stem == "terrain" and not (scene.parent / "terrain.ply").exists():
                print(f"| {scene.stem} | needs its mesh: see the scene file |")
                continue
            times, own, method, pilot = measure(args, scene, folder)
            cells = [str(times[m]) for m in methods]
            best = min((t for t in times.values() if t.seconds), key=lambda t: t.seconds, default=None)
            chosen = times.get(method)
            ratio = "–"
            if best and chosen and chosen.seconds:
                ratio = "" if best.measured and chosen.measured else "~"
                ratio += f"{(chosen.seconds + pilot) / best.seconds:.2f}"
            elif best:
                ratio = "missed"
            known = "–" if own is None else f"{own:.1e}"
            print(f"| {scene.stem} | " + " | ".join(cells) + f" | {known} | {method} | {pilot:.2f} s | {ratio} |", flush=True)


if __name__ == "__main__":
    main()
