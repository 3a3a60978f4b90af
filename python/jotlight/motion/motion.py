"""The motion of a scene: displacements of the centers of tiles at some times."""

from __future__ import annotations

import dataclasses
import json
import os
from typing import TYPE_CHECKING, Self

import numpy as np
import numpy.typing as npt

from jotlight.arrays import HasReadOnlyArrays, frozen
from jotlight.checks import real_number, shown, to_array
from jotlight.motion.figure import draw_change, draw_paths
from jotlight.motion.labels import choose
from jotlight.motion.reference_time import move_labels, move_nodes
from jotlight.motion.tiles import interpolate, tile_counts
from jotlight.notebook import card
from jotlight.parameter_names import check_choice
from jotlight.paths import as_path, as_tensors_path
from jotlight.tensors import read_tensors, write_tensors

if TYPE_CHECKING:
    from jotlight.figures import Figure

MODELS = ("none", "affine", "segments", "tiles")
"""Models of motion: nothing moves; one affine motion; an affine motion of each segment of the
scene; and a motion of each tile."""

FORMAT = "jotlight motion"
"""Format of the files of motions, in their metadata."""

_VERSION = "1"

_TYPES = {"nodes": "float32", "labels": "uint8", "times": "float64", "information": "float32"}
"""The arrays of a file and their types."""

_PANEL = 4.2
"""Width of a panel of a figure in inches."""

MAX_DISPLACEMENT = np.float32(1e5)
"""Largest displacement in jots, also of extrapolated ones."""

_MAX_FIELDS = 256
"""Maximum number of fields, so that labels are bytes."""

_FIELDS = {
    "none": (1, 1),
    "affine": (1, 1),
    "segments": (2, _MAX_FIELDS),
    "tiles": (1, _MAX_FIELDS),
}
"""Minimum and maximum number of fields of each model."""


@dataclasses.dataclass(frozen=True, eq=False)
class Motion(HasReadOnlyArrays):
    """The motion of a scene, as seen from a reference time.

    The scene point that jot x shows at the time `reference` is at x + u(x, t) at time t.
    Displacements u are in jots, also if a pixel of the image has several. Times are numbers of
    frames, and need not be whole. Parts of the scene may move differently, so there are several
    fields of displacements, and each jot follows one.

    Parameters
    ----------
    nodes : ndarray of float32, shape (m, n, 2, rows, columns)
        u at the centers of tiles of 16 jots, in rows and columns, for each field and each of the
        `times`. It is interpolated linearly in space and time, and extrapolated beyond them.
    labels : ndarray of uint8, shape (H, W)
        Index of the field of each jot.
    times : ndarray of float, shape (n,)
        Increasing times in frames.
    reference : float
        Time at which u is 0.
    model : {"none", "affine", "segments", "tiles"}
        How the motion was estimated.
    information : ndarray of float32, shape (m, n, 3, rows, columns)
        Information about u of each tile in nats/jot²: the entries of the Fisher information for
        rows, for rows and columns, and for columns.

    Raises
    ------
    ValueError
        When the parts do not fit together or do not fit the model, or are not finite.

    Examples
    --------
    >>> nodes = np.zeros((1, 2, 2, 1, 1), np.float32)
    >>> nodes[0, 1] = 3
    >>> information = np.ones((1, 2, 3, 1, 1), np.float32)
    >>> labels = np.zeros((16, 16), np.uint8)
    >>> motion = jl.Motion(nodes, labels, np.array([0.0, 6.0]), 0.0, "affine", information)
    >>> motion.at(2)[:, 4, 4].tolist()  # a third of the way from frame 0 to frame 6
    [1.0, 1.0]
    """

    nodes: npt.NDArray[np.float32]
    labels: npt.NDArray[np.uint8]
    times: npt.NDArray[np.float64]
    reference: float
    model: str
    information: npt.NDArray[np.float32]

    def __post_init__(self) -> None:
        for name in _TYPES:
            object.__setattr__(self, name, frozen(to_array(name, getattr(self, name))))
        nodes, times = self.nodes, self.times
        if self.labels.ndim != 2 or self.labels.dtype != np.uint8 or self.labels.size == 0:
            raise ValueError(
                "labels: expected an array (H, W) of uint8, got "
                f"{self.labels.dtype} of shape {self.labels.shape}"
            )
        if times.ndim != 1 or times.dtype.kind != "f":
            raise ValueError(
                f"times: expected an array (n,) of float, got {times.dtype} of shape {times.shape}"
            )
        fields = nodes.shape[0] if nodes.ndim else 0
        shape = (fields, len(times), 2, *tile_counts(self.size))
        if nodes.shape != shape or len(times) < 2 or not 1 <= fields <= _MAX_FIELDS:
            raise ValueError(
                f"nodes: expected shape (m, n, 2, rows, columns) = {shape} with two times or more, "
                f"got {nodes.shape}"
            )
        if self.labels.max() >= fields:
            raise ValueError(
                f"labels: expected indices below {fields}, got up to {self.labels.max()}"
            )
        expected = (*shape[:2], 3, *shape[3:])
        if self.information.shape != expected:
            raise ValueError(
                f"information: expected shape {expected}, got {self.information.shape}"
            )
        if not np.isfinite(times).all() or not (np.diff(times) > 0).all():
            raise ValueError("times: expected finite numbers that increase")
        for name, values in (("nodes", nodes), ("information", self.information)):
            if values.dtype.kind != "f" or not np.isfinite(values).all():
                raise ValueError(f"{name}: expected finite numbers of float, got {values.dtype}")
        if abs(nodes).max() > MAX_DISPLACEMENT:
            raise ValueError(
                f"nodes: expected displacements of up to {MAX_DISPLACEMENT:g} jots, got "
                f"{abs(nodes).max():g}"
            )
        if not np.isfinite(self.reference):
            raise ValueError(f"reference: expected a finite time, got {self.reference}")
        check_choice("model", self.model, MODELS)
        self._check_model()

    def _check_model(self) -> None:
        """Raise ValueError for what no motion of the model has."""
        if self.information[:, :, [0, 2]].min() < 0:
            raise ValueError(
                "information: expected that for rows and for columns to be 0 or more, got "
                f"{self.information[:, :, [0, 2]].min():g}"
            )
        fields, needed = len(self.nodes), _FIELDS[self.model]
        if not needed[0] <= fields <= needed[1]:
            expected = "one field" if needed[1] == 1 else f"{needed[0]} fields or more"
            raise ValueError(
                f"nodes: expected {expected} for the model {self.model!r}, got {fields}"
            )
        if self.model == "none" and self.nodes.any():
            raise ValueError(
                "nodes: expected displacements of 0 for the model 'none', got up to "
                f"{abs(self.nodes).max():g} jots"
            )

    @property
    def size(self) -> tuple[int, int]:
        """H and W in jots."""
        height, width = self.labels.shape
        return height, width

    def nodes_at(self, time: float) -> npt.NDArray[np.float32]:
        """Return u at the centers of the tiles at a time, (m, 2, rows, columns)."""
        if not np.isfinite(real_number(time)):
            raise ValueError(f"time: expected one finite number of frames, got {shown(time)}")
        return self.nodes_at_times(np.array([time], np.float64))[:, 0]

    def nodes_at_times(self, times: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
        """Return u at the centers of the tiles at n times, (m, n, 2, rows, columns)."""
        known = np.clip(np.searchsorted(self.times, times, "right") - 1, 0, len(self.times) - 1)
        first = np.minimum(known, len(self.times) - 2)
        step = self.times[first + 1] - self.times[first]
        fraction = np.clip((times - self.times[known]) / step, -1e9, 1e9).astype(np.float32)
        # From the nearest known time, so that no known displacement is rounded.
        change = self.nodes[:, first + 1] - self.nodes[:, first]
        nodes = self.nodes[:, known] + fraction[:, None, None, None] * change
        return np.asarray(np.clip(nodes, -MAX_DISPLACEMENT, MAX_DISPLACEMENT))

    def at(self, time: float) -> npt.NDArray[np.float32]:
        """Return u of each jot at a time, (2, H, W): rows and columns in jots.

        Before the first and after the last of `times`, all points keep the velocities that they
        have there. `times` are the centers of blocks of frames, so this serves the half blocks at
        both ends of a burst. Farther away, u is a guess that no bits support.

        Parameters
        ----------
        time : float
            Time in frames; 0 is the first frame.

        Raises
        ------
        ValueError
            When the time is not one finite number.

        Examples
        --------
        >>> nodes = np.zeros((1, 2, 2, 1, 1), np.float32)
        >>> nodes[0, 1] = 3
        >>> parts = np.ones((1, 2, 3, 1, 1), np.float32)
        >>> labels = np.zeros((16, 16), np.uint8)
        >>> motion = jl.Motion(nodes, labels, np.array([0.0, 6.0]), 0.0, "affine", parts)
        >>> motion.at(2.0)[:, 4, 4].tolist()
        [1.0, 1.0]
        """
        return choose(self.labels, [interpolate(nodes, self.size) for nodes in self.nodes_at(time)])

    def check_frames(self, size: tuple[int, int], frames: int) -> None:
        """Raise ValueError unless the motion is that of a number of frames of a size in jots."""
        if self.size != size:
            raise ValueError(
                f"motion: expected that of {size[0]} x {size[1]} jots, got "
                f"{self.size[0]} x {self.size[1]}"
            )
        last, (first, end) = frames - 1, self.times[[0, -1]]
        margin = float(np.diff(self.times).max())
        # The motion of a single frame has two times, too.
        if first < 0 or first > margin or end > max(last, 1) or end < last - margin:
            if 0 <= first <= margin:  # the center of the first block, and the last is as long
                first, end = 0.0, end + first
            raise ValueError(
                f"motion: expected that of frames 0 to {last}, got that of frames {first:g} to "
                f"{end:g}; leave out motion= (--motion-file) to align these frames"
            )

    def seen_from(self, time: float) -> Motion:
        """Return the same motion as seen from another reference time.

        Examples
        --------
        >>> nodes = np.zeros((1, 2, 2, 1, 1), np.float32)
        >>> nodes[0, 1] = 3
        >>> parts = np.ones((1, 2, 3, 1, 1), np.float32)
        >>> labels = np.zeros((16, 16), np.uint8)
        >>> motion = jl.Motion(nodes, labels, np.array([0.0, 6.0]), 0.0, "affine", parts)
        >>> motion.seen_from(6).at(0)[:, 4, 4].tolist()
        [-3.0, -3.0]
        """
        now = self.nodes_at(time)
        nodes = np.stack([move_nodes(*pair) for pair in zip(self.nodes, now, strict=True)])
        labels = move_labels(self.labels, now)
        return dataclasses.replace(self, nodes=nodes, labels=labels, reference=time)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the motion to a `.safetensors` file."""
        path = as_tensors_path(path, 'motion.save("motion.safetensors")')
        tensors = {
            name: np.ascontiguousarray(getattr(self, name), dtype) for name, dtype in _TYPES.items()
        }
        other = {"reference": json.dumps(float(self.reference)), "model": self.model}
        write_tensors(path, tensors, {"format": FORMAT, "version": _VERSION, **other})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Return the motion in a file that :meth:`save` wrote. No code in the file is executed.

        Raises
        ------
        OSError
            When the file does not exist.
        ValueError
            When it is not a file of a motion, or is damaged.
        """
        path = as_path(path, 'jotlight.Motion.load("motion.safetensors")')
        if not path.is_file():
            raise FileNotFoundError(f"there is no file {path} of a motion")
        tensors, metadata = read_tensors(path, FORMAT, _VERSION)
        try:
            for name, dtype in _TYPES.items():
                if tensors[name].dtype != dtype:
                    raise ValueError(f"{name}: expected {dtype}, got {tensors[name].dtype}")
            return cls(
                **{name: tensors[name] for name in _TYPES},
                reference=float(real_number(json.loads(metadata["reference"]))),
                model=metadata["model"],
            )
        except (KeyError, ValueError, OverflowError, RecursionError) as error:
            raise ValueError(f"{path}: damaged file of a motion: {error}") from error

    def plot(self) -> Figure:
        """Return a figure of the displacements over time, and of where the scene moves how."""
        from jotlight.figures import Figure

        figure = Figure(2 * _PANEL, _PANEL)
        paths, field = figure.subplots(1, 2)
        draw_paths(paths, self.times, self.nodes, self.labels, self.reference)
        change = self.at(self.times[-1]) - self.at(self.times[0])
        title = f"motion from the first to the last time ({self.model})"
        draw_change(field, self.labels, change, title)
        return figure

    def facts(self) -> dict[str, str]:
        """Return texts that describe the motion, by their names.

        Examples
        --------
        >>> nodes = np.zeros((1, 2, 2, 1, 1), np.float32)
        >>> parts = np.ones((1, 2, 3, 1, 1), np.float32)
        >>> labels = np.zeros((16, 16), np.uint8)
        >>> motion = jl.Motion(nodes, labels, np.array([0.0, 6.0]), 3.0, "affine", parts)
        >>> motion.facts()["size"], motion.facts()["reference"]
        ('16 x 16 jots', 'frame 3')
        """
        longest = float(np.sqrt((self.nodes**2).sum(axis=2)).max())
        return {
            "model": self.model,
            "size": f"{self.size[0]} x {self.size[1]} jots",
            "frames": f"{len(self.times)} times from {self.times[0]:g} to {self.times[-1]:g}",
            "displacement": f"up to {longest:.3g} jots",
            "reference": f"frame {self.reference:g}",
        }

    def _repr_html_(self) -> str:
        return card("Motion", self.facts(), self.plot().thumbnail())

    def __repr__(self) -> str:
        model, size, frames, displacement, _ = self.facts().values()
        return f"<Motion: {model}, {size}, {frames}, {displacement}>"
