#!/usr/bin/env python3
"""Which code a render of a diffuse scene executes, by instructions counted with callgrind.

    sudo apt-get install valgrind
    cargo build --release
    python3 benches/instructions.py scenes/cornell-box.xml --integrator path photonmapper

One pass of three is counted, and all of them; loading, planning and writing are the same in both
and cancel out, so that the difference is what further passes execute. Instructions are credited to the source line that
they were compiled from, inlined code included, and summed up by file and by function of that file.
"""

import argparse
import bisect
import collections
import os
import re
import subprocess
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))

# What a scene of diffuse surfaces without textures has no use for: title, file, functions ("" for the whole file).
IDLE = [
    ("texture look-ups", "src/texture/bitmap.rs", ""),
    ("texture look-ups", "src/texture/procedural.rs", ""),
    ("texture look-ups", "src/texture/range.rs", ""),
    ("texture look-ups", "src/texture/mod.rs", "eval eval_scalar scalar gradient get"),
    ("asking whether a colour is a texture", "src/texture/mod.rs", "color float"),
    ("texture coordinates", "src/geometry/triangle.rs", "uv_derivatives"),
    ("direction decode", "src/photon/direction.rs", "decode"),
    ("direction decode", "src/photon/map.rs", "direction"),
    ("direction decode", "src/gather/photons.rs", "above_horizon flux_cosine"),
    ("spectra", "src/color/spectrum.rs", ""),
    ("general materials", "src/bsdf/evaluate.rs", "evaluate_lobes flatten two_sided bump_normal bend transmissive reflective"),
    ("general materials", "src/bsdf/lobe.rs", "eval pdf sample"),
    ("general materials", "src/bsdf/microfacet.rs", ""),
    ("general materials", "src/bsdf/fresnel.rs", ""),
    ("general materials", "src/bsdf/dielectric.rs", ""),
    ("general materials", "src/bsdf/conductor.rs", ""),
    ("general materials", "src/bsdf/rough.rs", ""),
    ("general materials", "src/bsdf/principled.rs", ""),
]


def count(args, integrator, passes, out):
    """Instructions by (file, line) of the first passes of three."""
    profile = os.path.join(out, f"{integrator}-{passes}")
    command = ["valgrind", "--tool=callgrind", "--compress-strings=no", "--compress-pos=no"]
    command += [f"--callgrind-out-file={profile}", args.binary, "render", args.scene, "-q", "--integrator", integrator]
    command += ["--accel", args.accel, "--threads", "1", "--width", str(args.size), "--height", str(args.size)]
    # Of the same plan: numbers of gather rays follow from that of all samples.
    command += ["--passes", "3", "--spp", str(args.spp * 3), "--photons", str(args.photons)]
    command += ["--pass-range", f"0..{passes}"]
    command += ["-o", os.path.join(out, "picture.exr")]
    subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
    lines = collections.Counter()
    file, inclusive = "", False
    with open(profile, encoding="utf-8", errors="replace") as f:
        for line in f:
            key, _, value = line.rstrip("\n").partition("=")
            if key in ("fl", "fi", "fe"):
                file = value
            elif key == "calls":
                inclusive = True
            elif line[:1].isdigit():
                number, cost = line.split()[:2]
                # The line after a call holds what the callee took, which has lines of its own.
                if not inclusive:
                    lines[file, int(number)] += int(cost)
                inclusive = False
    return lines


def functions(path):
    """Where the functions of a source file begin: line numbers and names."""
    starts, names = [], []
    with open(os.path.join(ROOT, path), encoding="utf-8") as f:
        for number, text in enumerate(f, 1):
            found = re.match(r"\s*(?:pub(?:\([a-z]+\))? )?(?:const |unsafe )*fn (\w+)", text)
            if found:
                starts.append(number)
                names.append(found.group(1))
    return starts, names


def by_function(lines):
    """Instructions by (file, function) of this crate, and those of other code by "elsewhere"."""
    known, result = {}, collections.Counter()
    for (file, number), cost in lines.items():
        at = file.find("src/")
        path = file[at:]
        if at < 0 or "/.cargo/" in file or "/rustc/" in file or not os.path.exists(os.path.join(ROOT, path)):
            result["elsewhere", ""] += cost
            continue
        if path not in known:
            known[path] = functions(path)
        starts, names = known[path]
        i = bisect.bisect_right(starts, number) - 1
        result[path, names[i] if i >= 0 else ""] += cost
    return result


def check_idle():
    """What is looked for must exist: a name that has changed would count as nothing."""
    for _, file, names in IDLE:
        known = functions(file)[1]
        missing = [name for name in names.split() if name not in known]
        if missing:
            raise SystemExit(f"{file} has no function {', '.join(missing)}: bring the list up to date")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--integrator", nargs="+", default=["path", "photonmapper"])
    parser.add_argument("--binary", default="target/release/caustica")
    parser.add_argument("--accel", default="bvh")
    parser.add_argument("--size", type=int, default=32)
    parser.add_argument("--spp", type=int, default=4, help="of each pass")
    parser.add_argument("--photons", type=int, default=5000)
    parser.add_argument("--top", type=int, default=12, help="how many of the busiest functions to list")
    args = parser.parse_args()
    check_idle()
    for integrator in args.integrator:
        with tempfile.TemporaryDirectory() as out:
            few, many = (count(args, integrator, passes, out) for passes in (1, 3))
        lines = {key: many[key] - few[key] for key in many.keys() | few.keys()}
        found = by_function(lines)
        total = sum(found.values())
        # Without signs, so that no line hides another.
        unsigned = by_function({key: abs(c) for key, c in lines.items()})
        idle = collections.Counter()
        for title, file, names in IDLE:
            wanted = names.split()
            idle[title] += sum(c for (f, name), c in unsigned.items() if f == file and (not wanted or name in wanted))
        print(f"`{integrator}`: {total:.4g} instructions in two further passes\n")
        print("| work | instructions |\n|---|---|")
        for title, cost in idle.items():
            print(f"| {title} | {cost} |")
        for (file, name), cost in found.most_common(args.top):
            print(f"| {file} {name} | {100 * cost / total:.1f} % |")
        print()


if __name__ == "__main__":
    main()
