"""Sensors: their parameters, rates, and probabilities."""

import copy
import json
import sys

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.sensing.sensor import KERNELS
from reference import sensing

RANDOM = np.random.default_rng(0)


def random_map(height, width, maximum=0.4):
    return RANDOM.uniform(0, maximum, (height, width)).astype(np.float32)


@pytest.mark.parametrize("oversampling", [1, 2, 3, 4, 5, 10])
@pytest.mark.parametrize("degree", range(4))
def test_taps_are_the_integrals_of_the_spline(degree, oversampling):
    np.testing.assert_allclose(
        engine.kernel_taps(degree, oversampling),
        sensing.kernel_taps(degree, oversampling),
        rtol=0,
        atol=1e-15,
    )


@pytest.mark.parametrize("oversampling", range(1, 6))
@pytest.mark.parametrize("kernel", KERNELS)
def test_the_rate_agrees_with_the_definition(kernel, oversampling):
    for shape in [(5, 7), (1, 1), (2, 1), (1, 9)]:
        sensor = jl.Sensor(oversampling=oversampling, frames=3, gain=40, kernel=kernel)
        image = RANDOM.random(shape)
        rate = sensor.rate(image)
        assert rate.dtype == np.float32
        np.testing.assert_allclose(rate, sensing.rate(sensor, image), rtol=1e-6)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("threshold", [1, 2, 7])
def test_the_probability_agrees_with_the_definition(kernel, threshold):
    height, width = 5, 7
    jots = (3 * height, 3 * width)
    sensor = jl.Sensor(
        oversampling=3,
        frames=2,
        gain=60,
        threshold=threshold,
        kernel=kernel,
        dark_counts=random_map(*jots),
        efficiency=0.3,
        mask=RANDOM.random(jots) < 0.3,
    )
    image = RANDOM.random((height, width, 3))
    probability = sensor.probability(image, channel_axis=-1)
    rate = sensor.rate(image, channel_axis=-1)
    assert probability.shape == rate.shape == (*jots, 3)
    for channel in range(3):
        plane = image[..., channel]
        expected = sensing.probability(sensor, plane)
        np.testing.assert_allclose(probability[..., channel], expected, rtol=1e-6, atol=1e-30)
        np.testing.assert_allclose(rate[..., channel], sensing.rate(sensor, plane), rtol=1e-6)


@pytest.mark.parametrize("oversampling", [1, 2, 3, 4])
@pytest.mark.parametrize("kernel", KERNELS)
def test_the_light_of_a_pixel_stays_centered_and_complete(kernel, oversampling):
    image = np.zeros((9, 11))
    image[4, 5] = 1
    sensor = jl.Sensor(oversampling=oversampling, kernel=kernel, gain=7)
    rate = sensor.rate(image).astype(float)
    rows, columns = np.indices(rate.shape) + 0.5
    half_a_jot = 0.5 * (KERNELS.index(kernel) * oversampling % 2)
    assert rate.sum() == pytest.approx(7)
    assert (rate * rows).sum() / 7 == pytest.approx(4.5 * oversampling + half_a_jot)
    assert (rate * columns).sum() / 7 == pytest.approx(5.5 * oversampling + half_a_jot)


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_constant_image_sheds_equal_light_on_all_jots(kernel):
    rate = jl.Sensor(oversampling=3, kernel=kernel, dark_counts=0.25).rate(np.full((4, 5), 0.5))
    np.testing.assert_allclose(rate, 0.75, rtol=1e-6)


@pytest.mark.parametrize("kernel", ["box", "cubic"])
@pytest.mark.parametrize(
    "view",
    [
        lambda image: image.astype(np.float32),
        np.asfortranarray,
        lambda image: np.repeat(image, 2, axis=1)[:, ::2],
        lambda image: image[::-1, ::-1].copy()[::-1, ::-1],
        lambda image: np.stack([image, image], axis=2)[..., 1],
        lambda image: image.astype(">f8"),
        lambda image: np.rec.fromarrays([np.zeros(image.shape, "i1"), image], names="a,b")["b"],
        lambda image: image.astype(np.longdouble),
        lambda image: image.tolist(),
    ],
    ids=["float32", "fortran", "strided", "reversed", "channel", "swapped", "odd", "long", "list"],
)
def test_the_layout_of_an_image_does_not_matter(kernel, view):
    image = RANDOM.integers(0, 256, (6, 5)) / 256
    sensor = jl.Sensor(oversampling=2, kernel=kernel)
    np.testing.assert_array_equal(sensor.rate(view(image)), sensor.rate(image))
    np.testing.assert_array_equal(
        sensor.expose(view(image), rng=0).packed, sensor.expose(image, rng=0).packed
    )


def test_half_floats_are_accepted():
    assert jl.Sensor().rate(np.full((2, 2), 0.5, np.float16)).tolist() == [[0.5, 0.5], [0.5, 0.5]]


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_rate_and_probability_are_the_same_for_any_number_of_threads(threads):
    image = RANDOM.random((20, 30))
    sensor = jl.Sensor(oversampling=3, kernel="quadratic", threshold=2)
    np.testing.assert_array_equal(sensor.rate(image, threads=threads), sensor.rate(image))
    np.testing.assert_array_equal(
        sensor.probability(image, threads=threads), sensor.probability(image)
    )


def test_zero_threads_are_refused():
    with pytest.raises(ValueError, match="threads: expected a whole number"):
        jl.Sensor().rate(np.ones((2, 2)), threads=0)


BAD_PARAMETERS = [
    *[
        (name, value)
        for name in ("oversampling", "frames", "threshold")
        for value in (0, -1, 1.5, np.nan, np.inf, 2**40, 10**30, True, np.True_, None, "2", 2j)
    ],
    *[
        (name, value)
        for name in ("gain", "efficiency", "max_intensity", "exposure_time")
        for value in (0, -1.0, np.nan, np.inf, True, "2", [2.0, 3.0], 1j)
    ],
    *[(name, [2, 3]) for name in ("oversampling", "frames", "threshold")],
    ("max_intensity", None),
    ("efficiency", None),
    ("efficiency", 1.0001),
    *[("kernel", value) for value in ("Box", "", "b-spline", 0, None, ["box"])],
    *[
        ("dark_counts", value)
        for value in (-0.1, np.nan, np.inf, True, None, "0", 1j, [0.1], [[[0.1]]], [[]], [[-1.0]])
    ],
    ("dark_counts", [[0.0, np.nan]]),
    ("dark_counts", [[0.0, np.inf]]),
    ("dark_counts", [[True, False]]),
    *[("mask", value) for value in (True, [True], [[0, 1]], [[0.0]], [[[True]]], "mask")],
]


@pytest.mark.parametrize(("name", "value"), BAD_PARAMETERS)
def test_a_bad_parameter_is_refused_and_named(name, value):
    with pytest.raises(ValueError, match=f"^{name}: expected"):
        jl.Sensor(**{name: value})


@pytest.mark.parametrize(
    "parameters",
    [{"oversampling": 4096, "frames": 128}, {"frames": 2**31 - 1, "oversampling": 2}],
)
def test_more_trials_than_a_count_can_hold_are_refused(parameters):
    with pytest.raises(ValueError, match="expected fewer than 2\\*\\*31 trials per pixel"):
        jl.Sensor(**parameters)


@pytest.mark.parametrize("name", ["mask", "dark_counts"])
def test_a_map_that_does_not_fit_the_image_is_refused(name):
    sensor = jl.Sensor(
        oversampling=2, **{name: np.zeros((6, 8), bool if name == "mask" else float)}
    )
    for image in (np.ones((4, 3)), np.ones((6, 8)), np.ones((3, 5, 3))):
        for use in (sensor.rate, sensor.probability, sensor.expose):
            with pytest.raises(ValueError, match=rf"{name}: .* got shape \(6, 8\)"):
                use(image)


def test_maps_of_different_shapes_are_refused():
    with pytest.raises(ValueError, match=r"mask: .*map of dark counts \(2, 2\), got \(2, 3\)"):
        jl.Sensor(dark_counts=np.zeros((2, 2)), mask=np.zeros((2, 3), bool))


def test_maps_are_copies_that_nobody_can_change():
    mask = np.zeros((2, 2), bool)
    dark = np.zeros((2, 2))
    sensor = jl.Sensor(mask=mask, dark_counts=dark)
    mask[:] = True
    dark[:] = 1
    assert not sensor.mask.any()
    assert not sensor.dark_counts.any()
    for map_ in sensor.maps().values():
        with pytest.raises(ValueError, match="read-only"):
            map_[0, 0] = 1


BAD_IMAGES = [
    (np.array([[0.0, np.nan]]), ValueError, "finite intensities"),
    (np.array([[0.0, np.inf]]), ValueError, "finite intensities"),
    (np.array([[0.0, -np.inf]]), ValueError, "finite intensities"),
    (np.array([[0.0, -1e-9]]), ValueError, "0 or more, got -1e-09"),
    (np.zeros((0, 4)), ValueError, "at least one pixel"),
    (np.zeros((4, 4, 0)), ValueError, "at least one pixel"),
    (np.zeros(4), ValueError, r"\(H, W\) or \(..., H, W\), and at least one pixel, got \(4,\)"),
    (np.array(0.5), ValueError, r"at least one pixel, got \(\)"),
    (np.zeros((2, 6, 8, 3)), ValueError, "looks like color; pass channel_axis=-1"),
    (np.zeros((6, 8, 4)), ValueError, "looks like color; pass channel_axis=-1"),
    (np.zeros((4, 4), np.uint8), TypeError, r"scale is unknown; divide by .*image / 255\.0"),
    (np.zeros((4, 4), int), TypeError, "scale is unknown"),
    (np.zeros((4, 4), bool), TypeError, "got bool; pass image.astype"),
    (np.zeros((4, 4), complex), TypeError, "expected floats in units of intensity, got complex128"),
    (np.zeros((4, 4), object), TypeError, "expected floats in units of intensity, got object"),
    ("image.png", TypeError, r"path 'image.png'; pass jotlight.read_image\(path\)"),
    (None, TypeError, "expected floats in units of intensity, got object"),
]


@pytest.mark.parametrize(("image", "error", "message"), BAD_IMAGES)
def test_a_bad_image_is_refused_with_advice(image, error, message):
    sensor = jl.Sensor(oversampling=2)
    for use in (sensor.rate, sensor.probability, sensor.expose):
        with pytest.raises(error, match=f"image: .*{message}"):
            use(image)


def test_replace_keeps_the_light_on_each_jot_unless_gain_changes():
    sensor = jl.Sensor(oversampling=2, gain=2, threshold=3)
    more = sensor.replace(frames=5, oversampling=3)
    image = np.full((2, 2), 0.5)
    assert more.rate(image).max() == sensor.rate(image).max() == 0.25
    assert more.threshold == 3
    assert sensor.replace(frames=5, gain=2).gain == 2
    assert sensor.replace(oversampling=3, gain=None).gain == 9
    with pytest.raises(TypeError, match=r"got color, q$"):
        sensor.replace(q=2, color=1)
    with pytest.raises(ValueError, match="frames"):
        sensor.replace(frames=0)


MAPS = {"dark_counts": np.full((4, 6), 0.1), "mask": np.eye(4, 6, dtype=bool)}
SENSORS = [
    jl.Sensor(),
    jl.Sensor(
        oversampling=2,
        frames=3,
        gain=4.5,
        threshold=6,
        kernel="cubic",
        dark_counts=0.25,
        efficiency=0.5,
        max_intensity=7.0,
    ),
    jl.Sensor(frames=9, **MAPS),
    jl.Sensor(frames=9, dark_counts=MAPS["dark_counts"]),
    jl.Sensor(frames=9, mask=MAPS["mask"]),
    jl.Sensor(frames=9, mask=~MAPS["mask"]),
    jl.Sensor(frames=9, mask=MAPS["mask"], dark_counts=np.full((4, 6), 0.2)),
]


@pytest.mark.parametrize("one", range(len(SENSORS)))
@pytest.mark.parametrize("other", range(len(SENSORS)))
def test_sensors_are_equal_if_all_their_parameters_are(one, other):
    assert (SENSORS[one] == SENSORS[other].replace()) is (one == other)


def test_a_sensor_equals_nothing_else():
    assert jl.Sensor() != 1
    assert jl.Sensor() != "Sensor()"


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_a_sensor_is_made_again_from_its_scalars_and_maps(sensor):
    scalars = json.loads(json.dumps(sensor.scalars()))
    assert jl.Sensor.from_parts(scalars, sensor.maps()) == sensor


@pytest.mark.parametrize(
    ("scalars", "maps", "message"),
    [
        ([1], None, "got list"),
        ({"oversampling": 2, "color": 3}, None, "unknown parameters color"),
        ({"oversampling": 0}, None, "oversampling"),
        ({}, {"q": np.zeros((2, 2))}, "q"),
    ],
)
def test_parts_that_do_not_describe_a_sensor_are_refused(scalars, maps, message):
    with pytest.raises(ValueError, match=message):
        jl.Sensor.from_parts(scalars, maps)


@pytest.mark.parametrize(
    ("sensor", "text"),
    [
        (jl.Sensor(), "Sensor()"),
        (jl.Sensor(oversampling=4), "Sensor(oversampling=4)"),
        (jl.Sensor(oversampling=4, frames=2, gain=16.0, threshold=2, kernel="cubic"),
         "Sensor(oversampling=4, frames=2, gain=16.0, threshold=2, kernel='cubic')"),
        (jl.Sensor(**MAPS), "Sensor(dark_counts=<4 x 6 map>, mask=<4 x 6 map>)"),
    ],
)  # fmt: skip
def test_repr_names_the_parameters_that_differ_from_their_defaults(sensor, text):
    assert repr(sensor) == text


def test_copy_replace_keeps_the_light_of_a_frame():
    sensor = jl.Sensor(frames=4)
    assert sensor.__replace__(frames=8) == sensor.replace(frames=8) == jl.Sensor(frames=8)
    if sys.version_info >= (3, 13):
        assert copy.replace(sensor, frames=8) == jl.Sensor(frames=8)
