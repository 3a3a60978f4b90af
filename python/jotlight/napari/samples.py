"""Sample data: captures of photographs that scikit-image ships, simulated."""

from jotlight.datasets.moving_scenes import moving
from jotlight.datasets.scenes import photograph
from jotlight.napari.lazy import LayerData, make_layer
from jotlight.sensing.sensor import Sensor
from jotlight.view.viewed import Viewed

_FRAMES = 256


def static_scene() -> list[LayerData]:
    """Return a layer of 256 frames of a still scene."""
    sensor = Sensor(frames=_FRAMES, gain=0.5 * _FRAMES, dark_counts=0.002, exposure_time=1e-5)
    bits = sensor.expose(photograph("camera"), rng=0)
    return [make_layer(Viewed.from_data(bits, "still scene"))]


def moving_scene() -> list[LayerData]:
    """Return a layer of 256 frames of a moving scene."""
    sensor = Sensor(frames=_FRAMES, exposure_time=1e-5)
    scene = moving(photograph("camera"), "shake", sensor=sensor, shape=(256, 256), rng=0)
    return [make_layer(Viewed.from_data(scene.bits, "moving scene"))]
