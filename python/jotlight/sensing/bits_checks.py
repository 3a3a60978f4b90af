"""The check that bits have the shape that a sensor requires."""

from jotlight.sensing.sensor_like import SensorLike


def check_fits(shape: tuple[int, ...], sensor: SensorLike, *, bit_depth: int = 1) -> None:
    """Raise ValueError unless readings of this shape and bit depth fit the sensor."""
    if sensor.bit_depth != bit_depth:
        own = f"readings of {sensor.bit_depth} bits" if sensor.bit_depth > 1 else "single bits"
        other = "single bits" if bit_depth == 1 else f"readings of {bit_depth} bits"
        raise ValueError(
            f"data: expected {own}, as the sensor states, got {other}; "
            "jotlight.Readings(array, sensor) are readings of several bits, and "
            "sensor.replace(bit_depth=1) is a sensor with single bits"
        )
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
