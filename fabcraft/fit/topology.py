"""`Topology`: the faces of a mesh and their edges, as the renderer walks them; made once for a connectivity."""

from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Int, Int32, Integer
from torch import Tensor

from fabcraft.fit.gather import Places


@dataclass(frozen=True, eq=False)
class DeviceTopology:
    """A topology as tensors of one device."""

    faces: Int[Tensor, "F 3"]
    edges: Int[Tensor, "E 4"]
    corners: Places
    """The vertex of every face's corner, (3 F)."""


@dataclass(frozen=True, eq=False)
class Topology:
    """Faces and their edges; made once for a connectivity, whatever the vertices do.

    faces : (F, 3) int32.
    edges : (E, 4) int32, the two ends, and the opposite corners of its first two faces (-1: no second one).
    """

    faces: Int32[np.ndarray, "F 3"]
    edges: Int32[np.ndarray, "E 4"]
    _placed: dict[tuple[torch.device, int], DeviceTopology] = field(
        default_factory=dict, init=False, repr=False
    )

    def __post_init__(self) -> None:
        for name in ("faces", "edges"):
            array = np.array(getattr(self, name), dtype=np.int32)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @staticmethod
    def of(faces: Integer[np.ndarray, "F 3"]) -> "Topology":
        """The topology of (F, 3) `faces`."""
        triangles = np.ascontiguousarray(faces, dtype=np.int32)
        ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        opposite = np.concatenate([triangles[:, 2], triangles[:, 0], triangles[:, 1]])
        ends.sort(axis=1)
        order = np.lexsort((ends[:, 1], ends[:, 0]))
        ends, opposite = ends[order], opposite[order]
        new = np.ones(len(ends), bool)
        new[1:] = (ends[1:] != ends[:-1]).any(1)
        first = np.flatnonzero(new)
        count = np.diff(np.append(first, len(ends)))
        second = np.where(count > 1, opposite[np.minimum(first + 1, len(ends) - 1)], -1)
        return Topology(triangles, np.column_stack([ends[first], opposite[first], second]).astype(np.int32))

    def on(self, device: torch.device, vertices: int) -> DeviceTopology:
        """The same on a device, for that many vertices; moved there once."""
        key = (device, vertices)
        if key not in self._placed:
            faces, edges = (
                torch.from_numpy(array.astype(np.int64)).to(device) for array in (self.faces, self.edges)
            )
            self._placed[key] = DeviceTopology(faces, edges, Places.of(faces.reshape(-1), vertices))
        return self._placed[key]
