"""Simulations step by step."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _pliant


@dataclass(frozen=True)
class Frame:
    """A frame of a simulation.

    Attributes:
        number: number of the frame; 0 is the start.
        time: its time [s].
        bodies: positions of each body by its name, shape (n, 3) [m].
        velocities: velocities of each body by its name, shape (n, 3) [m/s].
        bones: pose of each bone by its name, shape (4, 4): from the mesh to the scene [m].
    """

    number: int
    time: float
    bodies: dict[str, NDArray[np.float64]]
    velocities: dict[str, NDArray[np.float64]]
    bones: dict[str, NDArray[np.float64]]
    _of: Simulation

    def positions(self, name: str) -> NDArray[np.float64]:
        """Positions of a body, shape (n, 3) [m]."""
        try:
            return self.bodies[name]
        except KeyError:
            known = ", ".join(self.bodies)
            raise KeyError(f"no body {name!r}; there are {known}") from None

    def to_pyvista(self) -> Any:
        """Bodies and bones as a `pyvista.MultiBlock`, whose blocks have their names."""
        import pyvista

        blocks = pyvista.MultiBlock()
        for name, positions in self.bodies.items():
            blocks[name] = _surface(pyvista, positions, self._of.triangles[name])
        for name, (vertices, triangles) in self._of.bones.items():
            pose = self.bones[name]
            blocks[name] = _surface(pyvista, vertices @ pose[:3, :3].T + pose[:3, 3], triangles)
        return blocks


def _surface(pyvista: Any, positions: NDArray[np.float64], triangles: NDArray[np.uint32]) -> Any:
    if len(triangles) == 0:
        return pyvista.PolyData(positions)
    faces = np.column_stack([np.full(len(triangles), 3), triangles]).ravel()
    return pyvista.PolyData(positions, faces)


class Simulation:
    """A scene that runs frame by frame; `load` makes one."""

    def __init__(self, native: _pliant.Simulation) -> None:
        self._native = native
        #: Triangles of each body by its name, shape (m, 3).
        self.triangles: dict[str, NDArray[np.uint32]] = dict(zip(native.names, native.triangles(), strict=True))
        #: Vertices (n, 3) [m] in its own frame and triangles (m, 3) of each bone by its name.
        self.bones: dict[str, tuple[NDArray[np.float64], NDArray[np.uint32]]] = dict(
            zip(native.bone_names, native.bone_meshes(), strict=True)
        )

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self._native.name

    @property
    def frame_count(self) -> int:
        """Number of the scene's last frame."""
        return self._native.frame_count

    @property
    def finished(self) -> bool:
        """True after the last frame."""
        return self._native.finished

    @property
    def converged(self) -> bool:
        """True if every frame that must be at rest is at rest."""
        return self._native.converged

    @property
    def frame(self) -> Frame:
        """The last frame that was computed; at first the start."""
        number, time, positions, velocities, poses = self._native.state()
        names = self._native.names
        return Frame(
            number,
            time,
            dict(zip(names, positions, strict=True)),
            dict(zip(names, velocities, strict=True)),
            dict(zip(self._native.bone_names, poses, strict=True)),
            self,
        )

    def step(self) -> Frame:
        """Computes the next frame. Raises StopIteration after the last one."""
        if not self._native.compute():
            raise StopIteration(f"{self.name} ended with frame {self._native.frame}")
        return self.frame

    def frames(self) -> Iterator[Frame]:
        """Computes and yields the frames that are left."""
        while self._native.compute():
            yield self.frame

    def measures(self) -> dict[str, float]:
        """Measures up to the last frame, with the names of `summary.json`."""
        return self._native.measures()

    def __repr__(self) -> str:
        return f"<pliant.Simulation {self.name}: frame {self._native.frame} of {self.frame_count}>"


def load(scene: str | os.PathLike[str], set: Mapping[str, Any] | None = None) -> Simulation:
    """Loads a scene file, or a built-in scene by its name.

    Args:
        scene: path or name; `pliant scenes` lists the names.
        set: changes of the scene, such as {"frames": 10, "effects.contact": "off"}.

    Raises:
        PliantError: the scene is wrong; `line` and `column` tell where.
    """
    return Simulation(_pliant.load(os.fspath(scene), dict(set) if set else None))
