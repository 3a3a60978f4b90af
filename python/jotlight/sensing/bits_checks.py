"""The check that bits have the shape that a sensor requires."""

from jotlight.sensing.sensor_like import SensorLike


def check_fits(shape: tuple[int, ...], sensor: SensorLike) -> None:
    """Raise ValueError unless bits of this shape fit the sensor."""
    frames, height, width = shape[:3]
    if frames != sensor.frames:
        some = f"bits[:{sensor.frames}] (--frame-range 0:{sensor.frames}), or "
        raise ValueError(
            f"bits: expected the sensor's {sensor.frames} frames, got {frames}; take "
            f"{some if sensor.frames < frames else ''}"
            f"sensor.replace(frames={frames}) (--frames {frames})"
        )
    if height % sensor.oversampling or width % sensor.oversampling:
        raise ValueError(
            f"bits: expected rows and columns of jots that are multiples of the oversampling "
            f"{sensor.oversampling}, got {height} x {width}"
        )
    sensor.check_map_shapes(height, width)
