#!/usr/bin/env python3
"""Samples per second of `path` beside Mitsuba 3's, on one scene file and the same processors.

    pip install mitsuba numpy
    cargo build --release
    python3 benches/against_mitsuba.py scenes/cornell-box.xml --size 256 --spp 64 --runs 5

The two renderers take turns, so that a change of the machine's speed meets both. Loading is left out on both sides: of
Mitsuba only `render` is timed, of caustica the phase `render` of its own summary.
"""

import argparse
import json
import statistics
import subprocess
import tempfile
import time


def ours(args, out):
    command = [args.binary, "render", args.scene, "--integrator", "path", "--spp", str(args.spp), "--json", "--float"]
    command += ["--width", str(args.size), "--height", str(args.size), "--accel", args.accel, "-o", out]
    report = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    return sum(p["seconds"] for p in report["phases"] if p["name"] == "render"), report["mean"]


def theirs(mi, scene, spp, seed):
    import numpy

    started = time.perf_counter()
    image = numpy.array(mi.render(scene, spp=spp, seed=seed))
    return time.perf_counter() - started, [float(x) for x in image.mean(axis=(0, 1))]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--variant", default="scalar_rgb")
    parser.add_argument("--accel", default="auto")
    parser.add_argument("--binary", default="target/release/caustica")
    args = parser.parse_args()

    import mitsuba as mi

    mi.set_variant(args.variant)
    mi.set_log_level(mi.LogLevel.Error)
    scene = mi.load_file(args.scene)
    parameters = mi.traverse(scene)
    key = next(k for k in parameters.keys() if k.endswith("film.size"))
    parameters[key] = [args.size, args.size]
    parameters.update()
    samples = args.size * args.size * args.spp
    rates = {"caustica": [], args.variant: []}
    means = {}
    with tempfile.TemporaryDirectory() as folder:
        for run in range(args.runs + 1):
            a, means["caustica"] = ours(args, f"{folder}/a.exr")
            b, means[args.variant] = theirs(mi, scene, args.spp, run)
            if run > 0:  # The first pair warms up.
                rates["caustica"].append(samples / a)
                rates[args.variant].append(samples / b)
    for name, values in rates.items():
        print(f"{name:12} {statistics.median(values) / 1e6:8.3f} Msamples/s   mean {means[name]}")
    ratios = [a / b for a, b in zip(rates["caustica"], rates[args.variant])]
    print(f"ratio        {statistics.median(ratios):8.3f} (min {min(ratios):.3f}, max {max(ratios):.3f})")


if __name__ == "__main__":
    main()
