#!/usr/bin/env python3
"""How much error is left after the same processor time: caustica's `bdpt` and `vcm` against SmallVCM's.

    benches/against_smallvcm.py --smallvcm PATH --caustica PATH [--size 512] [--cpu 30] [--reference-spp 256]

SmallVCM is https://github.com/SmallVCM/SmallVCM, built with -O3 -march=native -fopenmp, the resolution in config.hxx set
to --size, and `.pfm` output allowed (Framebuffer::SavePFM). Processor time rather than wall clock: it is what other
programs on the machine disturb least. Both render the number of samples that fits into --cpu seconds, and the error is
scaled to exactly that time. The reference is `vcm` where light has no size, else `bdpt`, with another seed; its own noise
is subtracted by way of its two halves. relMSE = mean((x - r)^2 / (r^2 + (0.1 mean r)^2)), also without the worst 0.1 % of
pixels.
"""
import argparse, os, resource, subprocess, tempfile
import numpy as np

SCENES = ["sun", "ceiling", "point", "background"]
METHODS = {"bdpt": "bpt", "vcm": "vcm"}
ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")


def read_pfm(path, upside_down):
    with open(path, "rb") as f:
        f.readline()
        w, h = map(int, f.readline().split())
        f.readline()
        rows = np.frombuffer(f.read(), "<f4").reshape(h, w, 3).astype(float)
    return rows if upside_down else rows[::-1]


def timed(command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


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
    p.add_argument("--size", type=int, default=512)
    p.add_argument("--cpu", type=float, default=30.0)
    p.add_argument("--reference-spp", type=int, default=256)
    p.add_argument("--keep", help="folder for the images")
    a = p.parse_args()
    folder = a.keep or tempfile.mkdtemp()
    os.makedirs(folder, exist_ok=True)

    def ours(scene, method, spp, seed, name):
        path = os.path.join(folder, name + ".pfm")
        xml = os.path.join(ROOT, "scenes", "smallvcm", scene + ".xml")
        command = [a.caustica, "render", xml, "--integrator", method, "--spp", str(spp), "--seed", str(seed)]
        t = timed(command + ["--width", str(a.size), "--threads", "2", "-o", path])
        return t, read_pfm(path, False)

    def theirs(scene, method, iterations, name):
        path = os.path.join(folder, name + ".pfm")
        command = [a.smallvcm, "-s", str(SCENES.index(scene)), "-a", METHODS[method], "-i", str(iterations), "-o", path]
        t = timed(command)
        return t, read_pfm(path, True)

    print("| scene | method | samples (caustica, SmallVCM) | means | relMSE (caustica, SmallVCM) | ratio | trimmed | ratio |")
    print("|---|---|---|---|---|---|---|---|")
    for scene in SCENES:
        reference = "vcm" if scene in ("sun", "point") else "bdpt"
        half = a.reference_spp // 2
        halves = [ours(scene, reference, half, 1000 + i, f"{scene}-reference-{i}")[1] for i in range(2)]
        r = sum(halves) / 2
        noise = (halves[0] - halves[1]) ** 2 / 4
        for method in METHODS:
            cost, _ = ours(scene, method, 4, 1, "trial")
            n = max(1, round(4 * a.cpu / cost))
            t1, mine = ours(scene, method, n, 1, f"{scene}-{method}")
            cost, _ = theirs(scene, method, 4, "trial")
            m = max(1, round(4 * a.cpu / cost))
            t2, other = theirs(scene, method, m, f"{scene}-{method}-smallvcm")
            e1, e2 = errors(mine, r, noise), errors(other, r, noise)
            e1, e2 = [e * t1 / a.cpu for e in e1], [e * t2 / a.cpu for e in e2]
            means = f"{mine.mean():.5f}, {other.mean():.5f} ({100 * (mine.mean() / other.mean() - 1):+.2f} %)"
            print(f"| {scene} | {method} | {n}, {m} | {means} | {e1[0]:.3e}, {e2[0]:.3e} | {e2[0] / e1[0]:.2f} "
                  f"| {e1[1]:.3e}, {e2[1]:.3e} | {e2[1] / e1[1]:.2f} |", flush=True)


if __name__ == "__main__":
    main()
