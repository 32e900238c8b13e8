#!/usr/bin/env python3
"""Whole renders with the Rust BVH beside the same with Embree.

    cargo build --release && python3 benches/whole_renders.py

Three integrators on four scenes, one of them a mesh of two million triangles, which is made first. The back ends take turns
in the same run, and each goes first every other time. Processor time is what other work on the machine disturbs least: the
ratio is the median over the rounds of the Rust BVH's over Embree's, both of the whole process, with loading and building.
Prints a table and writes benches/whole-renders.svg. Takes about ten minutes.
"""

import argparse
import os
import pathlib
import statistics
import subprocess
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
INTEGRATORS = ["path", "photonmapper", "sppm"]
# Samples per pixel, or passes of sppm, and photons where the default takes long, for 3 to 8 seconds on two threads.
SIZES = {
    "cornell-box": [(96,), (90,), (44,)],
    "cornell-spheres": [(80,), (48,), (24,)],
    "environment": [(112,), (8, 20_000), (18,)],
    "terrain": [(72,), (16, 50_000), (12,)],
}
AIM = 1.1
# Okabe and Ito, as the plots of `converge`.
COLORS = ["#0072b2", "#d55e00", "#009e73"]


def timed(command):
    """Processor and wall-clock seconds of a process."""
    started = time.perf_counter()
    child = subprocess.Popen([str(c) for c in command], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    wall = time.perf_counter() - started
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, command))}: exit code {child.returncode}")
    return usage.ru_utime + usage.ru_stime, wall


def measure(args, scene, integrator, amounts, mesh, image):
    """Seconds of each round by back end."""
    size = ["--width", args.size, "--height", args.size, "--threads", args.threads]
    command = [args.caustica, "render", ROOT / "scenes" / f"{scene}.xml", *size, "--quiet", "-o", image]
    command += ["--integrator", integrator]
    options = ["--passes" if integrator == "sppm" else "--spp", "--photons"]
    command += [word for option in zip(options, amounts) for word in option]
    if scene == "terrain":
        command += ["-D", f"mesh={mesh}"]
    times = {"embree": [], "bvh": []}
    for i in range(args.rounds):
        for accel in list(times)[:: 1 if i % 2 == 0 else -1]:
            times[accel].append(timed([*command, "--accel", accel]))
    return times


def plot(ratios):
    """Bars of the ratios, in groups by scene, as SVG."""
    bar, gap, left, top, height, most = 44, 30, 44, 52, 220, 1.3
    group = len(INTEGRATORS) * bar + gap
    width = left + len(ratios) * group + 12
    y = lambda ratio: top + height * (1 - min(ratio, most) / most)
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {top + height + 36}" role="img" '
        f'font-family="system-ui, sans-serif" font-size="14" fill="#282828"><title>Processor time of whole renders, '
        f'Rust BVH over Embree</title><rect width="100%" height="100%" fill="white"/>',
        f'<text x="{left}" y="20" font-size="15">Processor time of whole renders, Rust BVH / Embree</text>',
    ]
    for i, (name, color) in enumerate(zip(INTEGRATORS, COLORS)):
        x = left + sum(30 + 8 * len(n) for n in INTEGRATORS[:i])
        out.append(f'<rect x="{x}" y="30" width="11" height="11" fill="{color}"/><text x="{x + 16}" y="40">{name}</text>')
    for tick in (0, 0.5):
        out.append(f'<path d="M{left} {y(tick):.1f}H{width - 12}" stroke="#dedede"/>')
    for g, (scene, values) in enumerate(ratios.items()):
        x = left + gap / 2 + g * group
        for i, (ratio, color) in enumerate(zip(values, COLORS)):
            out.append(
                f'<rect x="{x + i * bar + 2:.0f}" y="{y(ratio):.1f}" width="{bar - 4}" height="{y(0) - y(ratio):.1f}" '
                f'fill="{color}"/><text x="{x + (i + 0.5) * bar:.0f}" y="{y(0) - 8:.1f}" fill="white" '
                f'text-anchor="middle">{ratio:.2f}</text>'
            )
        out.append(f'<text x="{x + (group - gap) / 2:.0f}" y="{y(0) + 22:.1f}" text-anchor="middle">{scene}</text>')
    # Over the bars, so that both lines can be followed.
    for line, dashes in ((1, ""), (AIM, ' stroke-dasharray="5 4"')):
        out.append(f'<path d="M{left} {y(line):.1f}H{width - 12}" stroke="#282828"{dashes}/>')
    for tick in (0, 0.5, 1, AIM):
        out.append(f'<text x="{left - 6}" y="{y(tick) + 5:.1f}" text-anchor="end">{tick:g}</text>')
    return "\n".join(out) + "\n</svg>\n"


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--caustica", default=ROOT / "target/release/caustica")
    p.add_argument("--rounds", type=int, default=5)
    p.add_argument("--size", default="256", help="width and height of the pictures")
    p.add_argument("--threads", default="2")
    p.add_argument("--triangles", default="2M", help="triangles of the large mesh")
    p.add_argument("--plot", type=pathlib.Path, default=ROOT / "benches/whole-renders.svg")
    args = p.parse_args()
    ratios = {}
    with tempfile.TemporaryDirectory() as folder:
        mesh, image = pathlib.Path(folder, "terrain.ply"), pathlib.Path(folder, "image.exr")
        timed([args.caustica, "scene", "terrain", "--triangles", args.triangles, "-o", mesh])
        print("| scene | integrator | processor s, Embree | Rust BVH | ratio | range | wall s, Embree | Rust BVH | ratio |")
        print("|---|---|---|---|---|---|---|---|---|", flush=True)
        for scene, sizes in SIZES.items():
            for integrator, amounts in zip(INTEGRATORS, sizes):
                times = measure(args, scene, integrator, amounts, mesh, image)
                cells = []
                for what in (0, 1):
                    embree, bvh = ([t[what] for t in times[accel]] for accel in ("embree", "bvh"))
                    pairs = [b / e for b, e in zip(bvh, embree)]
                    cells += [f"{statistics.median(embree):.2f}", f"{statistics.median(bvh):.2f}"]
                    cells.append(f"{statistics.median(pairs):.2f}")
                    if what == 0:
                        cells.append(f"{min(pairs):.2f} to {max(pairs):.2f}")
                        ratios.setdefault(scene, []).append(statistics.median(pairs))
                print("| " + " | ".join([scene, integrator, *cells]) + " |", flush=True)
    every = [r for values in ratios.values() for r in values]
    print(f"\nprocessor time, geometric mean {statistics.geometric_mean(every):.3f}, largest {max(every):.3f}, aim {AIM}")
    args.plot.write_text(plot(ratios))


if __name__ == "__main__":
    main()
