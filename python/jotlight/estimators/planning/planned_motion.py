"""How many frames help if the scene moves at a known speed, with and without alignment.

The scene model: intensities have the standard deviation σ, and points at the distance r have the
correlation exp(-r/a), as if edges were scattered at random. Its power spectrum is S(f) =
2π σ² a²/(1 + (2π a f)²)^(3/2), up to half a cycle per pixel. The gradient energy G is the mean
square difference of neighboring pixels, ∫ 2 (1 - cos(2π f)) S df.

The image is estimated by the Wiener filter W = S/(S + N), which knows the noise N but not the blur.
With the response H of the blur to a frequency, the mean square error is

    MSE = ∫ (1 - W H)² S + W² N df,    N = 1/(I T)

Here I is the Fisher information of a reading about the light, and T the number of readings of a
pixel. Without alignment, T frames at the speed v blur as a box of length v T does: H = sinc(v T f)
along the motion. Without noise, the error is then σ² v T/(6 a) for paths v T of some pixels that
are much shorter than a.

With alignment, H consists of two parts. Rounding to whole pixels blurs as a box of a pixel in both
directions, and an error e of the displacements as a Gaussian of width e. The information of a
frame of M pixels about the displacement along one axis is M I G. A motion may change while the
scene moves by a pixel, so the 1/v frames of this path show it, with the error e = √(v/(M I G)).

Scene points are in view for a limited time. If the image shows the middle of a burst, pixels at a
border lose half of the frames. On average, L - L²/(4 W) frames of the path of L pixels remain, for
a width W of the view in the direction of the motion. From L = 2 W on, further frames show nothing
of the image.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.checks import real_number, shown, whole_number

_FREQUENCIES = 128
"""Number of frequencies along each half of an axis, from 0 to half a cycle per pixel."""

SCENE = 0.2, 12.0
"""σ in units of the largest intensity, and a in pixels."""

_ENOUGH = 0.1
"""More frames help if they gain this many dB."""

_MAX_SPEED = 1000.0
"""Largest speed in pixels per frame."""

MAX_SUM = 1 << 20
"""Largest number of frames whose sum is compared with others."""

MIN_FRAMES = 16
"""Minimum number of frames from which a motion can be estimated."""

_MAX_ERROR = 0.5
"""Largest error of the displacements in pixels with which frames can be aligned."""


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class MotionPlan:
    """The expected quality of a moving scene, with and without alignment.

    It assumes a filter that averages neighboring pixels as much as the noise requires. Maximum
    likelihood, which does not average, would overstate noise in comparison with blur.

    Attributes
    ----------
    speed : float
        Pixels per frame.
    size : (int, int)
        Rows and columns of the image in pixels. The scene moves along the shorter side.
    frames : ndarray of int64
        The numbers of frames, (M,).
    summed : ndarray of float64
        The PSNR in dB of the sum of all frames, (M,).
    aligned : ndarray of float64
        The PSNR in dB of the frames after alignment, (M,), if they can be aligned.
    best_sum : int
        The number of frames whose sum is best. Longer sums are worse, unless it is 2²⁰ = 1,048,576:
        no longer ones are compared.
    best_aligned : int, optional
        The smallest number of frames, 16 or more, for which twice as many improve the PSNR after
        alignment by less than 0.1 dB. None if frames cannot be aligned at this speed: there is too
        little light, so that the error exceeds half a pixel, or fewer than 16 frames show a part of
        the image.
    frames_in_view : int
        The number of frames after which the scene has left the view.
    registration_error : float
        The standard deviation of the displacements after alignment, in pixels.
    """

    speed: float
    size: tuple[int, int]
    frames: npt.NDArray[np.int64]
    summed: Array
    aligned: Array
    best_sum: int
    best_aligned: int | None
    frames_in_view: int
    registration_error: float


@dataclasses.dataclass(frozen=True)
class SceneModel:
    """A random scene whose intensities at a distance of r pixels have the covariance σ² exp(-r/a).

    Parameters
    ----------
    deviation : float
        σ: the standard deviation of the intensities, in units of the largest one.
    length : float
        a: the correlation length in pixels.
    """

    deviation: float = SCENE[0]
    length: float = SCENE[1]

    def spectrum(self, rows: Array, columns: Array) -> Array:
        """Return the mean power of each frequency in cycles per pixel, whose mean is σ²."""
        wave = 1 + (2 * np.pi * self.length) ** 2 * (rows**2 + columns**2)
        power = 2 * np.pi * self.length**2 * wave**-1.5
        return np.asarray(self.deviation**2 * power / power.mean())


def check_motion(speed: float, size: tuple[int, int]) -> None:
    """Raise TypeError or ValueError for a speed or a size that is out of range."""
    if not 0 <= real_number(speed) <= _MAX_SPEED:
        raise ValueError(
            f"speed: expected pixels per frame from 0 to {_MAX_SPEED:g}, got {shown(speed)}"
        )
    if np.shape(size) != (2,):
        raise ValueError(f"size: expected (H, W) in pixels, such as (256, 512), got {shown(size)}")
    for side in size:
        whole_number("size", side, 1)


def plan_motion(
    information: float,
    speed: float,
    size: tuple[int, int],
    frames: npt.NDArray[np.int64],
    scene: SceneModel | None = None,
) -> MotionPlan:
    """Return the expected quality of images of a moving scene from different numbers of frames.

    Parameters
    ----------
    information : float
        I: the Fisher information of a reading about the intensity, in units of the largest one.
    speed : float
        v in pixels per frame, 0 or more.
    size : (int, int)
        H and W in pixels.
    frames : ndarray of int, shape (M,)
        The numbers of frames.
    scene : SceneModel, optional
        The scene. Default: that of photographs.

    Returns
    -------
    MotionPlan
        PSNR in dB, numbers of frames, and the error of the alignment in pixels.

    Examples
    --------
    >>> plan = plan_motion(5.0, 0.5, (128, 128), np.array([1, 16, 256]))
    >>> plan.best_sum, plan.best_aligned, plan.frames_in_view
    (8, 512, 512)
    """
    film = _Film(information, speed, size, scene or SceneModel())
    in_view = film.frames_in_view
    search = np.unique(np.geomspace(1, min(in_view, MAX_SUM), 400).astype(np.int64))
    summed = np.array([film.summed(int(number)) for number in search])
    best_sum = int(search[np.argmax(summed)])
    error = film.registration_error
    return MotionPlan(
        speed=speed,
        size=size,
        frames=frames,
        summed=np.array([film.summed(int(number)) for number in frames]),
        aligned=np.array([film.aligned(int(number)) for number in frames]),
        best_sum=best_sum,
        best_aligned=(film.enough() if error <= _MAX_ERROR and in_view >= MIN_FRAMES else None),
        frames_in_view=in_view,
        registration_error=error,
    )


class _Film:
    """Frames of a scene that moves along the rows."""

    def __init__(
        self, information: float, speed: float, size: tuple[int, int], scene: SceneModel
    ) -> None:
        half = (np.arange(_FREQUENCIES) + 0.5) / (2 * _FREQUENCIES)
        self._rows, self._columns = np.meshgrid(half, half, indexing="ij")
        self._power = scene.spectrum(self._rows, self._columns)
        self._information, self._speed, self._width = information, speed, min(size)
        # Its mean over both axes is that of one.
        differences = 2 - np.cos(2 * np.pi * self._rows) - np.cos(2 * np.pi * self._columns)
        self._gradient_energy = float((self._power * differences).mean())
        self._pixels = size[0] * size[1]

    @property
    def frames_in_view(self) -> int:
        """The number of frames from which on further ones show nothing of the image."""
        if self._speed == 0:
            return 1 << 30
        return max(1, int(2 * self._width / self._speed))

    @property
    def registration_error(self) -> float:
        """The standard deviation of the displacements in pixels."""
        per_frame = self._pixels * self._information * self._gradient_energy
        return float(np.sqrt(self._speed / per_frame))

    def summed(self, frames: int) -> float:
        """Return the PSNR of a sum without alignment."""
        return self._psnr(frames, np.sinc(self._speed * frames * self._rows))

    def aligned(self, frames: int) -> float:
        """Return the PSNR after alignment, from the mean number of frames in view."""
        path = self._speed * frames
        seen = frames * (1 - path / (4 * self._width))
        if path > 2 * self._width:
            seen = self._width / self._speed
        response = np.ones_like(self._rows)
        if self._speed > 0:
            response = np.sinc(self._rows) * np.sinc(self._columns)
            wave = (2 * np.pi * self.registration_error) ** 2
            response = response * np.exp(-0.5 * wave * (self._rows**2 + self._columns**2))
        return self._psnr(seen, response)

    def enough(self) -> int:
        """Return the number of frames from which on twice as many gain little after alignment."""
        frames, last = MIN_FRAMES, self.frames_in_view
        while frames < last and self.aligned(2 * frames) - self.aligned(frames) >= _ENOUGH:
            frames *= 2
        return min(frames, last)

    def _psnr(self, trials: float, response: Array) -> float:
        """Return the PSNR of a number of trials per pixel, after a blur."""
        noise = 1 / (self._information * trials)
        filter_ = self._power / (self._power + noise)
        error = (1 - filter_ * response) ** 2 * self._power + filter_**2 * noise
        return float(-10 * np.log10(error.mean()))
