"""What a sensor records of moving planes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.checks import as_image, number_in_range, whole_number_in_range
from jotlight.datasets.moving_scenes.drawn_frames import drawn_once
from jotlight.datasets.moving_scenes.kinds import MOTIONS
from jotlight.datasets.moving_scenes.paths import Path
from jotlight.datasets.moving_scenes.planes import Plane
from jotlight.datasets.moving_scenes.textures import Texture
from jotlight.datasets.scenes import photograph as scikit_image_photograph
from jotlight.errors import hide_warnings
from jotlight.parameter_names import check_choice, takes_rng
from jotlight.seeds import SeedLike, random_generator
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.parameters.intensity_scale import MEANING, warn_about_scale
from jotlight.sensing.sensor import Sensor

_MAX_HIDDEN = 0.1
"""Maximum opacity of the planes in front of a visible point."""


class MovingScene:
    """Moving planes in front of a sensor: their bits, and the exact image, motion, and occlusion.

    :func:`moving` makes the scenes. Times are numbers of frames from 0 to T - 1, and need not be
    whole.

    Attributes
    ----------
    sensor : Sensor
        The sensor that records the scene.
    shape : tuple of int
        (H, W) or (H, W, C), in pixels.
    reference : int
        The middle frame, T // 2.
    detail : int
        Samples of the light per pixel and dimension. A pixel integrates over all of them.
    bits : Bits or Readings
        The recorded bits, or readings of several bits. Each frame is drawn when it is read, and is
        the same each time. Frames of up to 128 MiB in total are kept. Others are drawn anew each
        time they are read, so save them to a file first.
    """

    def __init__(
        self,
        planes: Sequence[Plane],
        sensor: Sensor,
        size: tuple[int, int],
        seed: np.random.SeedSequence,
        samples_per_frame: int,
    ) -> None:
        self.detail = planes[0].texture.detail
        self.sensor = sensor
        self.shape = (*size, *planes[0].texture.channels)
        self.reference = sensor.frames // 2
        self._planes = planes
        self._seed = seed
        self._samples_per_frame = samples_per_frame
        self._grid = _centered_grid(size, 1)
        self._samples = _centered_grid(size, self.detail)
        sensor.check_map_shapes(*(length * sensor.oversampling for length in size))
        height, width = (length * sensor.oversampling for length in size)
        if sensor.mosaic is not None and self.shape[2:] != (3,):
            raise ValueError(
                "photograph: expected red, green, and blue, (H, W, 3), for a sensor with a mosaic, "
                f"got {len(self.shape) - 2 and self.shape[2]} channels"
            )
        channels = self.shape[2:] if sensor.mosaic is None else ()
        # Any, so that the usual case needs no cast.
        self.bits: Any
        if sensor.bit_depth > 1:
            shape = (sensor.frames, height, width, *channels)
            read = drawn_once(shape, np.uint16, self._draw)
            self.bits = Readings(Frames(shape, read, np.uint16), sensor)
        else:
            shape = (sensor.frames, height, math.ceil(width / 8), *channels)
            read = drawn_once(shape, np.uint8, self._draw)
            self.bits = Bits(Frames(shape, read), width, sensor, tested_for_periods=True)

    @property
    def has_objects(self) -> bool:
        """Whether there are planes in front of the background."""
        return len(self._planes) > 1

    def image(self, time: float | None = None, *, upsample: int = 1) -> npt.NDArray[np.float32]:
        """Return the image at a time, (H, W) or (H, W, C). Default: at the reference frame.

        Parameters
        ----------
        time : float, optional
            The time.
        upsample : int
            Pixels of the image per pixel of the sensor and dimension: a divisor of `detail`.

        Raises
        ------
        ValueError
            When the scene has no such detail.
        """
        if upsample < 1 or self.detail % upsample:
            raise ValueError(
                f"upsample: expected a divisor of the scene's detail, {self.detail}, got {upsample}"
            )
        time = self.reference if time is None else time
        height, width = self._samples.shape[1:]
        image = np.zeros((height, width, *self.shape[2:]), np.float32)
        for plane in self._planes:
            points = plane.points(time, self._samples)
            opacity = plane.opacity(time, points).astype(np.float32)
            opacity = opacity.reshape(*opacity.shape, *[1] * len(plane.texture.channels))
            image = (1 - opacity) * image + opacity * plane.intensities(time, points)
        side = self.detail // upsample
        if side == 1:
            return image
        blocks = image.reshape(height // side, side, width // side, side, *self.shape[2:])
        return np.asarray(blocks.mean(axis=(1, 3)))

    def motion(self, time: float, at: float | None = None) -> npt.NDArray[np.float32]:
        """Return how far each pixel's scene point has moved, (2, H, W): rows and columns.

        The scene point that pixel x shows at the time `at` is at x + motion at `time`, even if
        something hides it there.

        Parameters
        ----------
        time : float
            The time to which the points have moved.
        at : float, optional
            The time at which the pixels show the points. Default: the reference frame.
        """
        positions = self._moved(time, self._start(at))[1]
        return np.asarray(positions - self._grid, np.float32)

    def visible(self, time: float, at: float | None = None) -> npt.NDArray[np.bool_]:
        """Return whether each pixel's scene point is visible, (H, W). See :meth:`motion`.

        A point is visible if it lies inside the image, and no plane in front hides it.
        """
        shown, positions = self._moved(time, self._start(at))
        size = np.array(self.shape[:2]).reshape(2, 1, 1)
        visible = (abs(positions) <= size / 2).all(axis=0)
        for number, plane in enumerate(self._planes):
            opacity = plane.opacity(time, plane.points(time, positions))
            visible &= (shown >= number) | (opacity <= _MAX_HIDDEN)
            visible &= (shown != number) | (time >= plane.appears)
        return np.asarray(visible)

    def planes(self, time: float | None = None) -> npt.NDArray[np.intp]:
        """Return the number of the plane that each pixel shows at a time, (H, W).

        The background has the number 0, and planes in front have larger numbers. Default: at the
        reference frame.
        """
        time = self.reference if time is None else time
        return self._moved(time, time)[0]

    def with_photons(self, photons: float) -> MovingScene:
        """Return the same scene with another mean number of photons per jot and frame.

        The gain of the sensor is scaled, so that the image at the reference frame has this mean.
        The gains of a bracket keep their ratios.

        Examples
        --------
        >>> scene = moving(motion="static", shape=(16, 16), rng=0).with_photons(0.2)
        >>> round(float(scene.sensor.rate(scene.image()).mean()), 6)
        0.2
        """
        photons = number_in_range("photons", photons, 1e-9, 1e9)
        mosaic = self.sensor.mosaic
        mean = float((self.image() if mosaic is None else mosaic.light(self.image())).mean())
        if mean <= 0:
            raise ValueError("photons: expected a photograph that is not black")
        shares = self.sensor.gain / np.sum(self.sensor.gain)  # of the frames of a bracket
        sensor = self.sensor.replace(gain=photons / mean * self.sensor.trials * shares)
        height, width = self.shape[:2]
        return MovingScene(
            self._planes, sensor, (height, width), self._seed, self._samples_per_frame
        )

    def _start(self, at: float | None) -> float:
        return self.reference if at is None else at

    def _moved(self, time: float, at: float) -> tuple[npt.NDArray[np.intp], Array]:
        """Return the plane that each pixel shows at the time `at`, and where its point is then."""
        shown = np.zeros(self.shape[:2], np.intp)
        positions = np.zeros_like(self._grid)
        for number, plane in enumerate(self._planes):
            points = plane.points(at, self._grid)
            on_top = plane.opacity(at, points) > 0.5
            shown[on_top] = number
            positions[:, on_top] = plane.positions(time, points[:, on_top])
        return shown, positions

    def _draw(self, start: int, stop: int) -> npt.NDArray[Any]:
        """Return the packed bits or the readings of some frames."""
        parts = []
        offsets = (np.arange(self._samples_per_frame) + 0.5) / self._samples_per_frame - 0.5
        for frame in range(start, stop):
            image = np.mean([self.image(frame + offset) for offset in offsets], axis=0)
            axis, chosen = None if image.ndim == 2 else -1, slice(frame, frame + 1)
            with hide_warnings(MEANING):  # `moving` warned about the photographs
                exposed = self.sensor.expose(image, self._seed, channel_axis=axis, frames=chosen)
            is_several = isinstance(exposed, Readings)
            parts.append(exposed.to_array() if is_several else np.asarray(exposed.packed))
        return np.concatenate(parts)

    def __repr__(self) -> str:
        size = " x ".join(map(str, self.shape[:2]))
        planes = "1 plane" if len(self._planes) == 1 else f"{len(self._planes)} planes"
        return f"<MovingScene: {size} pixels, {planes}, {self.sensor!r}>"


def _centered_grid(size: tuple[int, int], detail: int) -> Array:
    """Return positions in pixels relative to the center, (2, rows, columns)."""
    axes = [(np.arange(detail * length) - (detail * length - 1) / 2) / detail for length in size]
    return np.stack(np.meshgrid(*axes, indexing="ij"))


@takes_rng
def moving(
    photograph: npt.ArrayLike | None = None,
    motion: str | npt.ArrayLike = "shake",
    *,
    sensor: Sensor | None = None,
    foreground: npt.ArrayLike | None = None,
    shape: tuple[int, int] | None = None,
    photons: float | None = None,
    samples_per_frame: int = 1,
    detail: int = 1,
    rng: SeedLike = None,
) -> MovingScene:
    """Return a moving scene: exact bits, and the exact image, motion, and occlusion at any time.

    Parameters
    ----------
    photograph : array_like of float, shape (H, W) or (H, W, C), optional
        The background. A blur of 0.6 pixels prevents aliasing. Beyond its borders it is mirrored.
        Default: scikit-image's photograph "camera".
    motion : str or array_like of shape (T, 2) or (T, 4)
        A named scene, or the pose of the photograph in each frame: its shift in rows and columns,
        and optionally its angle in degrees and its zoom. The named scenes are:

        - "static": nothing moves.
        - "shake": a smooth random path of 12 to 36 pixels.
        - "rotate": a rotation by about ±5°, a zoom of ±5 %, and a path of 8 pixels.
        - "fast": one pixel per frame.
        - "layers": an object of 104 pixels moves over a moving background.
        - "spin": a rotation by ±30°.
        - "parallax": three planes at different distances from a moving camera.
        - "sheet": waves of 5 pixels deform a moving background.
        - "flicker": as "shake", while the brightness changes five times by ±30 %.
        - "appear": as "layers", but the object appears after 60 % of the frames.
        - "two", "three", and "five": as many objects that move differently.
        - "small": as "layers", but the object is a disk of 32 pixels.
        - "stop": as "layers", but the object stops after 60 % of the frames.
        - "person": a figure walks, and its limbs swing.
    sensor : Sensor, optional
        The sensor. Its `frames` are the length T of the burst. Masks of dead jots, maps of dark
        counts (hot jots), maps of the efficiency, and a mosaic for a color photograph are possible.
        Default: ``Sensor(frames=256)``, or as many frames as the array `motion` has.
    foreground : array_like of float, shape (H, W) or (H, W, C), optional
        The photograph of the objects, and of a plane in "parallax". Scenes without objects do not
        show it. Default: the background, turned by 180°.
    shape : (int, int), optional
        Rows and columns of the recorded part, around the center. Default: those of the photograph,
        divided by `detail`.
    photons : float, optional
        The mean number of photons per jot and frame, at the reference time. The gain of the sensor
        is scaled to it, or all gains of a bracket.
    samples_per_frame : int
        The number of times at which the light of a frame is sampled. The default 1 lets the scene
        stand still during each frame; more samples blur fast motion as a real sensor does.
    detail : int
        Number of pixels of the photograph per pixel of the sensor, in each dimension. With 2, each
        pixel integrates over 2 x 2 pixels of the photograph, and ``image(upsample=2)`` is the
        exact image with twice as many rows and columns.
    rng : int, numpy.random.Generator, numpy.random.SeedSequence or None
        The seed of the path and of the bits. The same seed yields the same path for all exposures.

    Returns
    -------
    MovingScene

    Raises
    ------
    TypeError, ValueError
        When an argument is of the wrong type or out of range.

    Notes
    -----
    Frames are drawn when they are read, so the memory does not depend on their number.

    Examples
    --------
    >>> scene = moving(motion="shake", sensor=jl.Sensor(frames=16), shape=(32, 48), rng=0)
    >>> scene.bits.shape, scene.image().shape, scene.motion(0).shape
    ((16, 32, 48), (32, 48), (2, 32, 48))
    >>> bool(scene.visible(scene.reference).all())
    True
    """
    image = as_image(scikit_image_photograph() if photograph is None else photograph)
    front = image[::-1, ::-1] if foreground is None else as_image(foreground)
    if front.shape[2:] != image.shape[2:]:
        expected = "(H, W)" if image.ndim == 2 else f"(H, W, {image.shape[2]})"
        raise ValueError(
            f"foreground: expected as many channels as the photograph, shape {expected}, got shape "
            f"{front.shape}; read both with gray=True (--gray)"
        )
    detail = whole_number_in_range("detail", detail, 1, 16)
    back, front_texture = Texture(image, detail), Texture(front, detail)
    generator = random_generator(rng)
    if isinstance(motion, str):
        sensor = Sensor(frames=256) if sensor is None else sensor
        check_choice("motion", motion, MOTIONS, ", or an array")
        planes = MOTIONS[motion](back, front_texture, sensor.frames, generator)
    else:
        path = Path.from_table(motion)
        sensor = Sensor(frames=len(path)) if sensor is None else sensor
        if len(path) != sensor.frames:
            raise ValueError(
                f"motion: expected a line for each of the sensor's {sensor.frames} frames, "
                f"got {len(path)}"
            )
        planes = [Plane(back, path)]
    warn_about_scale("photograph", [image], sensor.max_intensity)
    if foreground is not None:
        warn_about_scale("foreground", [front], sensor.max_intensity)
    size = (image.shape[0] // detail, image.shape[1] // detail) if shape is None else shape
    if len(size) != 2 or min(size) < 1:
        raise ValueError(f"shape: expected rows and columns of at least 1, got {shape}")
    whole_number_in_range("samples_per_frame", samples_per_frame, 1, 1000)
    seed = np.random.SeedSequence(int.from_bytes(generator.bytes(32), "little"))
    scene = MovingScene(planes, sensor, size, seed, samples_per_frame)
    return scene if photons is None else scene.with_photons(photons)
