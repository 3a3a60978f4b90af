"""The motion of a scene: displacements of the centers of tiles at some times."""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.motion.tiles import interpolate, tile_counts

MODELS = ("none", "affine", "tiles")
"""Models of motion: nothing moves; a global affine motion; a motion of each tile."""


@dataclasses.dataclass(frozen=True, eq=False)
class Motion:
    """The motion of a scene, as seen from a reference time.

    The scene point that pixel x shows at the time `reference` is at x + u(x, t) at time t. Times
    are numbers of frames, and need not be whole.

    Parameters
    ----------
    nodes : ndarray of float32, shape (n, 2, rows, columns)
        u at the centers of tiles of 16 pixels, in rows and columns, at each of the `times`. It is
        interpolated linearly in space and time, and extrapolated beyond the first and last.
    times : ndarray of float, shape (n,)
        Increasing times in frames.
    size : (int, int)
        H and W in jots.
    reference : float
        Time at which u is 0.
    model : {"none", "affine", "tiles"}
        How the motion was estimated.
    information : ndarray of float32, shape (n, 3, rows, columns)
        Information about u of each tile in nats/px²: the entries of the Fisher information for
        rows, for rows and columns, and for columns.
    """

    nodes: npt.NDArray[np.float32]
    times: npt.NDArray[np.float64]
    size: tuple[int, int]
    reference: float
    model: str
    information: npt.NDArray[np.float32]

    def __post_init__(self) -> None:
        nodes, times = self.nodes, self.times
        shape = (len(times), 2, *tile_counts(self.size))
        if nodes.shape != shape or len(times) < 2:
            raise ValueError(
                f"nodes: expected shape (n, 2, rows, columns) = {shape} with two times or more, "
                f"got {nodes.shape}"
            )
        if self.information.shape != (shape[0], 3, *shape[2:]):
            raise ValueError(
                f"information: expected shape {(shape[0], 3, *shape[2:])}, "
                f"got {self.information.shape}"
            )
        if not (np.diff(times) > 0).all() or not np.isfinite(times).all():
            raise ValueError("times: expected finite numbers that increase")
        if not np.isfinite(nodes).all() or not np.isfinite(self.information).all():
            raise ValueError("nodes and information: expected finite numbers")
        if self.model not in MODELS:
            raise ValueError(f"model: expected one of {', '.join(MODELS)}, got {self.model!r}")

    def nodes_at(self, time: float) -> npt.NDArray[np.float32]:
        """Return u at the centers of the tiles at a time, (2, rows, columns)."""
        index = self.interval(time)
        first, last = self.times[index], self.times[index + 1]
        fraction = np.float32((time - first) / (last - first))
        change = self.nodes[index + 1] - self.nodes[index]
        return np.asarray(self.nodes[index] + fraction * change)

    def at(self, time: float) -> npt.NDArray[np.float32]:
        """Return u of each pixel at a time, (2, H, W): rows and columns in pixels."""
        return interpolate(self.nodes_at(time), self.size)

    def interval(self, time: float) -> int:
        """Return the index of the time before, of the two from which u is interpolated."""
        return int(np.clip(np.searchsorted(self.times, time, "right") - 1, 0, len(self.times) - 2))

    def __repr__(self) -> str:
        longest = float(np.sqrt((self.nodes**2).sum(axis=1)).max())
        size = " x ".join(map(str, self.size))
        return (
            f"<Motion: {self.model}, {size} jots, {len(self.times)} times from "
            f"{self.times[0]:g} to {self.times[-1]:g}, up to {longest:.3g} pixels>"
        )
