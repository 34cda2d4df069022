"""The package: the same bits as the command, errors with places, Ctrl-C, own constraints."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import pliant

FEW = {"frames": 3, "muscle.0.edge_length": "16 mm"}


def test_frames_have_the_bits_of_the_command(tmp_path: Path) -> None:
    result = pliant.run("cube", frames=5, out=tmp_path / "cube", lenient=True)
    simulation = pliant.load("cube", {"frames": 5})
    name = next(iter(simulation.triangles))
    frames = [frame.positions(name) for frame in simulation.frames()]
    assert len(frames) == 5 and simulation.finished
    with pytest.raises(StopIteration):
        simulation.step()
    written = sorted((tmp_path / "cube" / "frames").glob("*_0005.vtp"))
    vtk = pytest.importorskip("vtk")
    reader = vtk.vtkXMLPolyDataReader()
    body = [f for f in written if "bone" not in f.name][0]
    reader.SetFileName(str(body))
    reader.Update()
    from vtk.util.numpy_support import vtk_to_numpy

    points = vtk_to_numpy(reader.GetOutput().GetPoints().GetData())
    # Files of frames have the precision that they declare.
    assert np.array_equal(frames[-1].astype(points.dtype), points)
    assert result.folder == tmp_path / "cube" and result.summary["kind"] == "muscles"


def test_a_command_of_the_wheel_is_the_command(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "pliant"]
    listed = subprocess.run([*words, "scenes", "--json"], capture_output=True, text=True, check=True)
    names = json.dumps(json.loads(listed.stdout))
    assert "hip" in names and "cube" in names
    wrong = subprocess.run([*words, "run", "no-such-scene"], capture_output=True, text=True)
    assert wrong.returncode == 2 and "no-such-scene" in wrong.stderr


def test_errors_have_code_line_and_column(tmp_path: Path) -> None:
    scene = tmp_path / "wrong.toml"
    scene.write_text("frames = 3\nframe_rate = '60 Hz'\nfarmes = 2\n[[muscle]]\nname = 'm'\nshape = 'tetrahedron'\n")
    for attempt in (lambda: pliant.load(scene), lambda: pliant.run(scene, out=tmp_path / "out")):
        with pytest.raises(pliant.PliantError) as error:
            attempt()
        assert (error.value.code, error.value.line, error.value.column) == ("E052", 3, 1), error.value
    with pytest.raises(pliant.PliantError):
        pliant.load("cube", {"frames": -1})
    (tmp_path / "bad.obj").write_text("v 0 0 0\nv 1 0 x\n")
    with pytest.raises(pliant.PliantError) as error:
        pliant.read_mesh(tmp_path / "bad.obj")
    assert error.value.line == 2 and error.value.code


def test_ctrl_c_ends_a_long_frame_loop_and_a_command(tmp_path: Path) -> None:
    simulation = pliant.load("hip", {"frames": 10000})
    timer = threading.Timer(1.0, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        for _ in simulation.frames():
            pass
    assert time.monotonic() - begun < 30
    timer = threading.Timer(2.0, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        pliant.run("hip", frames=10000, out=tmp_path / "hip")
    assert (tmp_path / "hip" / "summary.json").exists(), "the command closed its files"


def test_the_interpreter_runs_while_a_frame_is_computed() -> None:
    simulation = pliant.load("cube", {"frames": 50})
    ticks = []
    stop = threading.Event()

    def tick() -> None:
        while not stop.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.001)

    ticker = threading.Thread(target=tick)
    ticker.start()
    for _ in simulation.frames():
        pass
    stop.set()
    ticker.join()
    assert len(ticks) > 3


def test_pyvista_has_a_block_for_each_body_and_bone() -> None:
    pytest.importorskip("pyvista")
    simulation = pliant.load("hip", FEW)
    blocks = simulation.step().to_pyvista()
    assert set(blocks.keys()) == set(simulation.triangles) | set(simulation.bones)
    with pytest.raises(KeyError, match="there are"):
        simulation.frame.positions("nobody")


class Length:
    """Two points at a distance."""

    def __init__(self, a: int, b: int, rest: float) -> None:
        self.points = (a, b)
        self.rest = rest

    def value(self, x):
        d = x[1] - x[0]
        return np.sqrt(d @ d) - self.rest

    def gradient(self, x):
        d = x[1] - x[0]
        n = d / np.sqrt(d @ d)
        return np.array([-n, n])


class WrongLength(Length):
    def gradient(self, x):
        return 1.01 * super().gradient(x)


class Broken(Length):
    def value(self, x):
        raise ZeroDivisionError("in value")


def test_own_constraints_are_checked_and_solved() -> None:
    pliant.check_constraint(Length(0, 1, 0.3), 2)
    with pytest.raises(pliant.PliantError, match="dual numbers"):
        pliant.check_constraint(WrongLength(0, 1, 0.3), 2)
    with pytest.raises(ZeroDivisionError):
        pliant.check_constraint(Broken(0, 1, 0.3), 2)
    x = np.array([[0.0, 0, 0], [1.5, 0, 0], [3.0, 0, 0]])
    masses = np.array([0.0, 1.0, 1.0])
    chain = [Length(0, 1, 1.0), Length(1, 2, 1.0)]
    y = pliant.project(x, masses, chain, steps=200)
    assert np.allclose(np.linalg.norm(np.diff(y, axis=0), axis=1), 1.0, atol=1e-9)
    assert np.array_equal(x[0], y[0])
    z, at_rest = pliant.minimise(x, masses, chain, stiffness=10.0)
    assert at_rest and np.allclose(np.linalg.norm(np.diff(z, axis=0), axis=1), 1.0, atol=1e-5)
    with pytest.raises(ZeroDivisionError):
        pliant.project(x, masses, [Broken(0, 1, 1.0)])
    with pytest.raises(pliant.PliantError, match="names point 7"):
        pliant.project(x, masses, [Length(0, 7, 1.0)])
    with pytest.raises(pliant.PliantError, match="shape"):
        pliant.project(x[:, :2].copy(), masses, chain)
    with pytest.raises(pliant.PliantError, match="inverse masses"):
        pliant.project(x, masses[:2].copy(), chain)


class Weight:
    """Gravity on points of 1 kg."""

    def energy(self, x):
        return 9.81 * x[:, 2].sum()

    def gradient(self, x):
        g = np.zeros_like(x)
        g[:, 2] = 9.81
        return g


def test_an_own_potential_hangs_a_mass_on_a_spring() -> None:
    x = np.array([[0.0, 0, 0], [0.0, 0, -1.0]])
    y, at_rest = pliant.minimise(x, np.array([0.0, 1.0]), [Length(0, 1, 1.0)], stiffness=100.0, potentials=[Weight()])
    assert at_rest and abs(y[1, 2] + 1.0 + 9.81 / 100) < 1e-5


def test_meshes_go_in_and_out(tmp_path: Path) -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    triangles = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.uint32)
    health = pliant.mesh_health(vertices, triangles)
    assert health["closed"] and abs(health["volume"] - 1 / 6) < 1e-15
    with pytest.raises(pliant.PliantError, match="beyond"):
        pliant.mesh_health(vertices, triangles + np.uint32(1))
    vertices[1, 1] = np.nan
    with pytest.raises(pliant.PliantError, match="row 1"):
        pliant.mesh_health(vertices, triangles)


def test_a_check_is_a_report(tmp_path: Path) -> None:
    file = tmp_path / "t.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    assert pliant.check(file, unit="m")["kind"]


def test_importing_is_quick() -> None:
    code = "import time; t = time.perf_counter(); import pliant; print(time.perf_counter() - t)"
    times = [float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout) for _ in range(3)]
    # Not a timed test of speed: ten times the time that it takes.
    assert min(times) < 3.0, times


def test_a_killed_command_says_so(tmp_path: Path) -> None:
    from pliant._commands import Killed

    def kill() -> None:
        children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children")
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline:
            for pid in children.read_text().split() if children.exists() else []:
                os.kill(int(pid), signal.SIGKILL)
                return
            time.sleep(0.05)

    if not Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").exists():
        pytest.skip("the system does not list processes")
    killer = threading.Timer(1.0, kill)
    killer.start()
    with pytest.raises(Killed, match="SIGKILL"):
        pliant.run("hip", frames=10000, out=tmp_path / "hip")
    killer.join()


def test_ctrl_c_ends_a_command_without_a_handler() -> None:
    child = subprocess.Popen([sys.executable, "-m", "pliant", "plan", "hip"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    time.sleep(0.5)
    child.send_signal(signal.SIGINT)
    assert child.wait(timeout=30) != 2
