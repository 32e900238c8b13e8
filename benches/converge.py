#!/usr/bin/env python3
"""Error against run time on a diffuse room, on caustics and under water: one report each, and one plot of all three.

    cargo build --release && python3 benches/converge.py

writes target/converge/SCENE/report.html and benches/error-time.svg, and prints a table. A scene that has a finished
report is not measured again. Takes seventeen minutes; leave the machine alone meanwhile.
"""

import argparse
import json
import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent
SCENES = ["cornell-box", "cornell-spheres", "pool"]
# Path tracing hardly finds the light of the pool: two others that must agree.
REFERENCE_METHODS = {"pool": "sppm,vcm"}
WIDTH, HEIGHT, TITLE = 560, 440, 34


def measure(args, scene, folder):
    folder.mkdir(parents=True, exist_ok=True)
    run = lambda *command: subprocess.run([str(c) for c in (args.caustica, *command)], check=True)
    file, size = ROOT / "scenes" / f"{scene}.xml", ["--width", args.size, "--height", args.size]
    reference = folder / "reference.exr"
    methods = ["--methods", REFERENCE_METHODS[scene]] if scene in REFERENCE_METHODS else []
    run("reference", file, "-o", reference, *size, "--time", args.reference_time, *methods)
    measured = ["--integrators", args.integrators, "--time", args.time, "--seeds", args.seeds]
    run("converge", file, "-o", folder, *size, "--reference", reference, *measured)


def join(plots):
    """The plots side by side, each under the name of its scene."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH * len(plots)} {HEIGHT + TITLE}" '
        f'font-family="sans-serif"><rect width="100%" height="100%" fill="white"/>'
    ]
    for i, (scene, svg) in enumerate(plots):
        place = f'<svg x="{i * WIDTH}" y="{TITLE}" width="{WIDTH}" height="{HEIGHT}" '
        svg = re.sub(r"<\?xml[^>]*>", "", svg).replace("<svg ", place, 1)
        parts.append(f'<text x="{(i + 0.5) * WIDTH}" y="26" font-size="22" text-anchor="middle">{scene}</text>{svg}')
    return "\n".join(parts) + "</svg>\n"


def row(series):
    o = series["outcome"]
    relmse = next(m for name, m in o["metrics"] if name == "relMSE")[0]
    reached = ["–" if r["seconds"] is None else f"{r['seconds']:.2f} s" for r in o["reached"]]
    slope = o["slope"]
    slope = "–" if slope is None else f"{slope['mean']:.2f} ± {slope['half_width'] or float('nan'):.2f}"
    cells = [series["method"], f"{o['passes']:.0f}", f"{'≲ ' if o['hidden'] else ''}{relmse:.2e}", *reached, slope]
    return cells + [f"{100 * o['overhead']['clock_stopped']:.1f} %"]


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--caustica", default=ROOT / "target/release/caustica")
    p.add_argument("--output", type=pathlib.Path, default=ROOT / "target/converge")
    p.add_argument("--plot", type=pathlib.Path, default=ROOT / "benches/error-time.svg")
    p.add_argument("--integrators", default="path,photonmapper,sppm")
    p.add_argument("--size", default="128")
    p.add_argument("--time", default="15s")
    p.add_argument("--reference-time", default="180s")
    p.add_argument("--seeds", default="3")
    args = p.parse_args()
    plots = []
    for scene in SCENES:
        folder = args.output / scene
        report = folder / "report.json"
        if not report.exists() or not json.loads(report.read_text())["finished"]:
            measure(args, scene, folder)
        found = json.loads(report.read_text())
        print(f"\n{scene}: reference relMSE {found['reference']['relmse']:.1e}\n")
        print("| method | passes | relMSE | to 1e-1 | to 1e-2 | to 1e-3 | slope | clock stopped |\n|---|---|---|---|---|---|---|---|")
        for series in found["series"]:
            print("| " + " | ".join(row(series)) + " |")
        plots.append((scene, (folder / "error-time.svg").read_text()))
    args.plot.write_text(join(plots))


if __name__ == "__main__":
    main()
