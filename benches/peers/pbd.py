"""Pliant beside PositionBasedDynamics (package `pypbd`) on one hanging sheet: one thread each, alternately.

    python3 benches/peers/pbd.py [--test]

Both have the same vertices, masses, springs along edges, steps and sweeps of XPBD. Both start at rest and fall for as long.
The reference is the limit of both: Pliant with many more substeps. Errors are root mean squares of distances.
Without `pypbd` and `numpy` it says so and measures nothing. Prints lines for `benches/document.py`.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# Its OpenMP reads this when it is loaded.
os.environ["OMP_NUM_THREADS"] = "1"

try:
    import numpy
    import pypbd
except ImportError as missing:
    print(f"skipped: {missing} (pip install numpy pypbd)")
    sys.exit(0)

ROOT = Path(__file__).resolve().parent.parent.parent
PROGRAM = ["cargo", "run", "--release", "--quiet", "--manifest-path", "benches/peers/Cargo.toml", "--bin", "sheet", "--"]
TRIAL = "--test" in sys.argv
SIDE, FRAMES, ROUNDS = (12, 5, 2) if TRIAL else (100, 30, 5)
SETTINGS = [(4, 1), (16, 1), (64, 1), (4, 4), (16, 4)]
FINEST = 1024
# Of its methods for cloth, the springs of XPBD.
SPRINGS = 4


class Pliant:
    """The program `sheet`, which answers line by line."""

    def __init__(self, folder):
        self.folder = folder
        pipe = subprocess.PIPE
        self.process = subprocess.Popen([*PROGRAM, folder, str(SIDE)], cwd=ROOT, stdin=pipe, stdout=pipe, text=True)
        if self.process.stdout.readline() != "ready\n":
            sys.exit("the program `sheet` did not start")

    def fall(self, substeps, sweeps):
        print(substeps, sweeps, FRAMES, file=self.process.stdin, flush=True)
        seconds = float(self.process.stdout.readline())
        return seconds, numpy.fromfile(self.folder / "pliant.bin").reshape(-1, 3)


class Sheet:
    """What `sheet` wrote."""

    def __init__(self, path):
        with open(path, encoding="ascii") as lines:
            vertices, _, self.frame, self.inverse_mass, self.stiffness = map(float, next(lines).split())
            rows = [line.split() for line in lines]
        self.vertices = numpy.array(rows[: int(vertices)], dtype=float)
        self.triangles = numpy.array(rows[int(vertices) :], dtype=int)
        sides = numpy.sort(self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        self.springs = len(numpy.unique(sides, axis=0))


def theirs(sheet, substeps, sweeps):
    """Time and positions of PositionBasedDynamics."""
    simulation = pypbd.Simulation.getCurrent()
    simulation.initDefault()
    model = simulation.getModel()
    body = model.addTriangleModel(list(sheet.vertices), sheet.triangles.ravel().tolist(), testMesh=False)
    particles = model.getParticles()
    for v, y in enumerate(sheet.vertices[:, 1]):
        particles.setMass(v, 0.0 if y > -1e-9 else 1.0 / sheet.inverse_mass)
    model.addClothConstraints(body, SPRINGS, sheet.stiffness, 0.0, 0.0, 0.0, 0.0, 0.0, False, False)
    assert len(model.getConstraints()) == sheet.springs, "the same springs"
    step = simulation.getTimeStep()
    step.setValueUInt(pypbd.TimeStepController.NUM_SUB_STEPS, substeps)
    step.setValueUInt(pypbd.TimeStepController.MAX_ITERATIONS, sweeps)
    pypbd.TimeManager.getCurrent().setTimeStepSize(sheet.frame)
    begin = time.perf_counter()
    for _ in range(FRAMES):
        step.step(model)
    seconds = time.perf_counter() - begin
    positions = numpy.array(particles.getVertices())
    simulation.reset()
    model.cleanup()
    return seconds, positions


def measure(folder):
    pliant, sheet = Pliant(folder), Sheet(folder / "sheet.txt")
    _, reference = pliant.fall(FINEST, 1)

    def error(positions):
        return float(numpy.sqrt(((positions - reference) ** 2).sum(axis=1).mean()))

    fallen = error(sheet.vertices)
    print(f"NOTE pbd.sheet {len(sheet.vertices):,} vertices and {sheet.springs:,} springs")
    print(f"RESULT pbd.fallen {fallen * 1e3:.6e} mm")
    ratios = []
    for substeps, sweeps in SETTINGS:
        seconds = []
        for _ in range(ROUNDS):
            (b, other), (a, ours) = theirs(sheet, substeps, sweeps), pliant.fall(substeps, sweeps)
            seconds.append((a, b))
        own, peer = error(ours), error(other)
        # The order of the springs alone differs, which matters where they are far from converged.
        assert abs(own - peer) <= 0.2 * max(own, peer), f"{substeps} substeps: {own} and {peer} m"
        times = [statistics.median(each) / FRAMES * 1e3 for each in zip(*seconds)]
        ratios.append(statistics.median(b / a for a, b in seconds))
        cells = [substeps, sweeps, *(f"{ms:.2f}" for ms in times), *(f"{m * 1e3:.3f}" for m in (own, peer)), f"{ratios[-1]:.1f}"]
        print("ROW pbd | " + " | ".join(map(str, cells)) + " |")
    print(f"RESULT pbd.ratio.least {min(ratios):.6e} 1\nRESULT pbd.ratio.most {max(ratios):.6e} 1")
    pliant.process.stdin.close()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        measure(Path(folder))
