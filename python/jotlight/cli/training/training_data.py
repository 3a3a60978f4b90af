"""The images and the sensor that a network is trained for."""

from pathlib import Path
from typing import Any

import numpy as np

from jotlight.calibration import Calibration
from jotlight.cli.captures.captured import add_sensor
from jotlight.cli.options.capture_options import CaptureOptions
from jotlight.cli.options.sensor_options import CalibratedSensorOptions
from jotlight.cli.terminal.console import progress, report
from jotlight.cli.training.training_options import ImageOptions
from jotlight.datasets import PHOTOGRAPHS, photograph, uniform_scenes
from jotlight.estimators.brightness import training_sensor
from jotlight.formats.opening.locations import is_url
from jotlight.images.sets import read_image_set
from jotlight.paths import pattern_advice
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.channels import last_channel_axis
from jotlight.sensing.sensor import Sensor
from jotlight.training.patches import patch_sensor

SYNTHETIC = "synthetic"
"""Word that stands for the random scenes of the paper."""

_TEST_SCENES = 512
"""Number of random scenes for tests."""


def read_training_images(
    images: str | None, options: ImageOptions, seed: int, max_intensity: float
) -> tuple[Any, Any]:
    """Return the images to train on and to test on, as `jotlight.train` takes them.

    Parameters
    ----------
    images : str or None
        A folder or file, the word `SYNTHETIC`, or None for the photographs of scikit-image.
    options : ImageOptions
        Keys, white level, and test images.
    seed : int
        Seed of synthetic test scenes.
    max_intensity : float
        Largest intensity of an estimate, above which files are reported as gray levels.
    """
    if options.test_key is not None and options.test is None:
        raise ValueError("test-key: names an array of --test, which is missing")
    is_synthetic = images == SYNTHETIC and not Path(images).exists()
    if options.white is not None and options.test is None and (images is None or is_synthetic):
        raise ValueError("white: is a level of images in files, and there are none; leave it out")
    if images is None:
        if options.key is not None:
            raise ValueError(
                "key: names an array of images, which are missing; --sensor-key names an array of "
                "the capture"
            )
        return [photograph(name, gray=True) for name in PHOTOGRAPHS], _read_tests(
            options, max_intensity
        )
    if is_synthetic:
        if options.key is not None:
            raise ValueError("key: names an array in a .npz, and synthetic scenes are no file")
        tests = _read_tests(options, max_intensity)
        if tests is None:
            tests = uniform_scenes(np.random.default_rng([seed, 1]), _TEST_SCENES)
        return uniform_scenes, tests
    if not is_url(images) and not Path(images).exists():
        advice = pattern_advice(images, "name the folder of the images")
        word = f"; the word {SYNTHETIC} stands for random scenes"
        raise FileNotFoundError(f"there is no folder or file {images}{advice or word}")
    with progress(2) as begin:
        update = begin("reading the images")
        scenes = _read(images, options.key, options.white, max_intensity, update)
        return scenes, _read_tests(options, max_intensity, begin("reading the test images"))


def _read_tests(options: ImageOptions, max_intensity: float, update: Any = None) -> Any:
    """Return the images to test on, or None without the option."""
    if options.test is None:
        return None
    return _read(options.test, options.test_key, options.white, max_intensity, update)


def _read(
    source: str | Path, key: str | None, white: float | None, max_intensity: float, update: Any
) -> Any:
    _names, images = read_image_set(
        source, key=key, white=white, max_intensity=max_intensity, progress=update
    )
    return images


def scale_scenes(scenes: Any, scale: float) -> Any:
    """Return scenes, or the function that draws them, with all intensities times a scale."""
    if callable(scenes):

        def scaled(rng: np.random.Generator, number: int) -> Any:
            return np.float32(scale) * scenes(rng, number)

        return scaled
    return None if scenes is None else [np.float32(scale) * scene for scene in scenes]


def files_of(images: str | Path | None) -> list[Path]:
    """Return the files of an image set, which must not be overwritten."""
    if images is None or not Path(images).exists():
        return []
    return list(Path(images).iterdir()) if Path(images).is_dir() else [Path(images)]


def read_training_sensor(
    path: Path,
    options: CaptureOptions,
    sensor_options: CalibratedSensorOptions,
    threads: int | None,
) -> tuple[Sensor, float]:
    """Return a sensor of the median jot of a capture, and the brightness of its scene.

    `path` may be the .json beside the bits.
    """
    path = _bits_beside(path)
    capture = options.open(path)
    kwargs = sensor_options.to_kwargs()
    chosen = {name: kwargs[name] for name in ("frames", "max_intensity") if name in kwargs}
    if isinstance(capture, Bits):
        # The capture states its own number of frames. The option states that of a film's windows.
        kwargs.pop("frames", None)
    calibration = sensor_options.calibration
    captured = add_sensor(
        capture, path, kwargs, None if calibration is None else Calibration.load(calibration)
    )
    report(*captured.notes())
    data = captured.summed()
    axis = last_channel_axis(data)
    sensor, scale = training_sensor(data, captured.sensor, channel_axis=axis, threads=threads)
    sensor = patch_sensor(sensor.replace(**chosen))
    report(f"{path}: the brightness of the scene is {scale:.3g}; training for {sensor!r}")
    return sensor, scale


def _bits_beside(path: Path) -> Path:
    """Return the bits that a .json describes, or the path itself for other files."""
    if path.suffix.lower() != ".json" or not path.is_file():
        return path
    is_packed = path.stem.lower().endswith(".gz")
    candidates = [path.with_suffix(end) for end in ([""] if is_packed else [".npy", ".npy.gz"])]
    for candidate in candidates:
        if candidate.exists():
            return candidate
    raise FileNotFoundError(
        f"{path}: expected the bits beside it, {candidates[0].name}, which show the brightness of "
        "the scene"
    )
