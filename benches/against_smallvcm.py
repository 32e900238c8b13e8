#!/usr/bin/env python3
"""How much error is left after the same wall time: caustica's `sppm`, `bdpt` and `vcm` against SmallVCM's.

    benches/against_smallvcm.py --smallvcm PATH --caustica PATH [--scenes sun,ceiling,point,background] [--size 512]
        [--time 15] [--references FOLDER] [--reference-spp 128] [--keep FOLDER]

SmallVCM is https://github.com/SmallVCM/SmallVCM, built with -O3 -march=native -fopenmp, two threads and the resolution in
config.hxx set to --size, its clock replaced by wall time (omp_get_wtime), and `.pfm` output allowed
(Framebuffer::SavePFM). Both stop after the iteration that is running when the time is over, and neither is scaled for
that; the table gives the times.

The reference is caustica's `vcm` from its 512th pass on, where the merging radius is small, with another seed; for `bdpt`
of lights without size also `bdpt`, which cannot find mirror images of caustics. The references' own noise is subtracted
by way of their two halves. With --references they are kept in that folder and made only once, so that the machine can be
left alone for the rest. relMSE = mean((x - r)^2 / (r^2 + (0.1 mean r)^2)), also without the worst 0.1 % of pixels.
"""
import argparse, os, subprocess, tempfile, time
import numpy as np

SCENES = ["sun", "ceiling", "point", "background"]
METHODS = {"sppm": "ppm", "bdpt": "bpt", "vcm": "vcm"}
DARK = ("sun", "point")
FIRST = 512
ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")


def read_pfm(path, upside_down):
    with open(path, "rb") as f:
        f.readline()
        w, h = map(int, f.readline().split())
        f.readline()
        rows = np.frombuffer(f.read(), "<f4").reshape(h, w, 3).astype(float)
    return rows if upside_down else rows[::-1]


def timed(command):
    before = time.monotonic()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.monotonic() - before


def errors(image, reference, noise):
    floor = (0.1 * reference.mean()) ** 2
    e = ((image - reference) ** 2 - noise) / (reference**2 + floor)
    e = e.mean(2).ravel()
    order = np.argsort(((image - reference) ** 2).mean(2).ravel() / (reference.mean(2).ravel() ** 2 + floor))
    return e.mean(), e[order[: int(0.999 * e.size)]].mean()


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--smallvcm", required=True)
    p.add_argument("--caustica", required=True)
    p.add_argument("--scenes", default=",".join(SCENES))
    p.add_argument("--size", type=int, default=512)
    p.add_argument("--time", type=float, default=15.0)
    p.add_argument("--references")
    p.add_argument("--reference-spp", type=int, default=128)
    p.add_argument("--keep", help="folder for the images")
    a = p.parse_args()
    folder = a.keep or tempfile.mkdtemp()
    references = a.references or folder
    for made in (folder, references):
        os.makedirs(made, exist_ok=True)

    def ours(scene, method, name, *options):
        path = os.path.join(folder, name + ".pfm")
        xml = os.path.join(ROOT, "scenes", "smallvcm", scene + ".xml")
        command = [a.caustica, "render", xml, "--integrator", method, "--width", str(a.size), "--threads", "2"]
        t = timed(command + [*options, "-o", path])
        return t, read_pfm(path, False)

    def theirs(scene, method, name):
        path = os.path.join(folder, name + ".pfm")
        scene = str(SCENES.index(scene))
        t = timed([a.smallvcm, "-s", scene, "-a", METHODS[method], "-t", str(a.time), "-o", path])
        return t, read_pfm(path, True)

    def reference(scene, method):
        path = os.path.join(references, f"ref_{scene}_{method}_{a.size}.npz")
        if not os.path.exists(path):
            last = FIRST + a.reference_spp // 2
            passes = ["--spp", str(last), "--passes", str(last), "--pass-range", f"{FIRST}..{last}"]
            x, y = (ours(scene, method, "half", *passes, "--seed", str(1000 + i))[1] for i in range(2))
            np.savez(path, r=(x + y) / 2, n=(x - y) ** 2 / 4)
        with np.load(path) as f:
            return f["r"], f["n"]

    print("| scene | method | reference | seconds (caustica, SmallVCM) | means | relMSE (caustica, SmallVCM) | ratio | trimmed | ratio |")
    print("|---|---|---|---|---|---|---|---|---|")
    for scene in a.scenes.split(","):
        for method in METHODS:
            kinds = ["vcm", "bdpt"] if method == "bdpt" and scene in DARK else ["vcm"]
            found = [(kind, *reference(scene, kind)) for kind in kinds]
            t1, mine = ours(scene, method, f"{scene}-{method}", "--time", f"{a.time}s", "--seed", "1")
            t2, other = theirs(scene, method, f"{scene}-{method}-smallvcm")
            for kind, r, noise in found:
                e1, e2 = errors(mine, r, noise), errors(other, r, noise)
                means = f"{mine.mean():.5f}, {other.mean():.5f} ({100 * (mine.mean() / other.mean() - 1):+.2f} %)"
                print(f"| {scene} | {method} | {kind} | {t1:.1f}, {t2:.1f} | {means} | {e1[0]:.3e}, {e2[0]:.3e} "
                      f"| {e2[0] / e1[0]:.2f} | {e1[1]:.3e}, {e2[1]:.3e} | {e2[1] / e1[1]:.2f} |", flush=True)


if __name__ == "__main__":
    main()
