"""Calibrations in files: what is saved is loaded, and what is damaged is refused."""

import dataclasses
import json

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

import jotlight as jl
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.provenance import Provenance


@pytest.fixture(scope="module")
def calibration():
    rng = np.random.default_rng(0)
    dark = rng.binomial(4000, 0.008, (32, 40))
    dark[3, 4] = 4000
    flat = jl.Bits.from_array(rng.random((800, 32, 40)) < rng.uniform(0.4, 0.6, (32, 40)))
    return jl.calibrate(dark, flat, frames=4000, provenance={"dark": Provenance("npy", "dark.npy")})


def test_what_is_saved_is_loaded(calibration, tmp_path):
    calibration.save(tmp_path / "a.safetensors")
    again = jl.Calibration.load(tmp_path / "a.safetensors")
    assert again.metadata() == calibration.metadata()
    for name in ("dark_counts", "mask", "hot", "dead", "efficiency", "dark_ones", "flat_ones"):
        np.testing.assert_array_equal(getattr(again, name), getattr(calibration, name))
    np.testing.assert_array_equal(again.flat_steadiness.map, calibration.flat_steadiness.map)
    assert again.provenance == {"dark": Provenance("npy", "dark.npy")}
    assert again == calibration
    assert hash(again) == hash(calibration)
    again.save(tmp_path / "b.safetensors")
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()


def test_calibrations_that_differ_are_not_equal(calibration):
    hot = calibration.hot.copy()
    hot[0, 0] = not hot[0, 0]
    assert calibration != dataclasses.replace(calibration, hot=hot)
    assert calibration != dataclasses.replace(calibration, hot=hot[:-1])
    assert calibration != dataclasses.replace(calibration, scale=2 * calibration.scale)
    assert calibration != dataclasses.replace(calibration, provenance={})
    assert calibration != dataclasses.replace(calibration, flat_ones=None)
    assert calibration != "calibration"
    assert len({calibration, dataclasses.replace(calibration)}) == 1


HOSTILE = {
    "no json": lambda tensors, numbers: (tensors, "{"),
    "no object": lambda tensors, numbers: (tensors, []),
    "deep": lambda tensors, numbers: (tensors, "[" * 100_000),
    "a map too many": lambda tensors, numbers: ({**tensors, "x": tensors["mask"]}, numbers),
    "a map too few": lambda tensors, numbers: (
        {name: tensor for name, tensor in tensors.items() if name != "hot"},
        numbers,
    ),
    "another shape": lambda tensors, numbers: ({**tensors, "hot": tensors["hot"][:3]}, numbers),
    "another type": lambda tensors, numbers: (
        {**tensors, "dark_counts": tensors["dark_counts"].astype(np.float64)},
        numbers,
    ),
    "NaN": lambda tensors, numbers: (
        {**tensors, "dark_counts": np.full_like(tensors["dark_counts"], np.nan)},
        numbers,
    ),
    "an efficiency above 1": lambda tensors, numbers: (
        {**tensors, "efficiency": 2 * tensors["efficiency"]},
        numbers,
    ),
    "a text for a number": lambda tensors, numbers: (tensors, {**numbers, "scale": "1"}),
    "true for a number": lambda tensors, numbers: (tensors, {**numbers, "threshold": True}),
    "a huge number": lambda tensors, numbers: (tensors, {**numbers, "dark_frames": 10**30}),
    "an infinite number": lambda tensors, numbers: (tensors, {**numbers, "prnu": float("inf")}),
    "a number too many": lambda tensors, numbers: (tensors, {**numbers, "mask": 1}),
    "no probability": lambda tensors, numbers: (
        tensors,
        {name: value for name, value in numbers.items() if name != "hot_probability"},
    ),
    "no bulk": lambda tensors, numbers: (tensors, {**numbers, "bulk": None}),
    "a provenance of another type": lambda tensors, numbers: (
        tensors,
        {**numbers, "provenance": {"dark": 3}},
    ),
    "a provenance of another capture": lambda tensors, numbers: (
        tensors,
        {**numbers, "provenance": {"light": numbers["provenance"]["dark"]}},
    ),
    "an unknown orientation": lambda tensors, numbers: (
        tensors,
        {
            **numbers,
            "provenance": {"dark": {**numbers["provenance"]["dark"], "orientation": [4, False]}},
        },
    ),
    "a mosaic of text": lambda tensors, numbers: (tensors, {**numbers, "mosaic": "RGGB"}),
    "a mosaic without filters": lambda tensors, numbers: (
        tensors,
        {**numbers, "mosaic": {**Mosaic("RGGB").to_json(), "filters": 7}},
    ),
    "a mosaic of another size": lambda tensors, numbers: (
        tensors,
        {**numbers, "mosaic": Mosaic(np.indices((17, 20)).sum(0) % 3, "RGB").to_json()},
    ),
    "steadiness without map": lambda tensors, numbers: (
        tensors,
        {**numbers, "dark_steadiness": numbers["flat_steadiness"]},
    ),
}


def test_a_calibration_without_provenance_does_not_confirm_an_orientation(calibration):
    unknown = dataclasses.replace(calibration, provenance={})
    rotated = Provenance("npy", "seen.npy", orientation=(1, False))
    unknown.check_capture(unknown.shape, rotated)
    assert unknown.unconfirmed_reason(rotated) == "the orientation of the calibration is unknown"


@pytest.mark.parametrize("name", HOSTILE)
def test_damaged_calibrations_are_refused_by_name(calibration, tmp_path, name):
    path = tmp_path / "a.safetensors"
    calibration.save(path)
    tensors, numbers = HOSTILE[name](
        load_file(path), json.loads(json.dumps(calibration.metadata()))
    )
    numbers = numbers if isinstance(numbers, str) else json.dumps(numbers)
    metadata = {"format": "jotlight calibration", "version": "1", "numbers": numbers}
    save_file({key: np.ascontiguousarray(part) for key, part in tensors.items()}, path, metadata)
    with pytest.raises(ValueError, match=r"a\.safetensors: the calibration is damaged"):
        jl.Calibration.load(path)


def test_truncated_and_flipped_files_are_refused_or_read(calibration, tmp_path):
    path = tmp_path / "a.safetensors"
    calibration.save(path)
    whole = path.read_bytes()
    rng = np.random.default_rng(14)
    for _ in range(60):
        damaged = bytearray(whole[: rng.integers(0, len(whole) + 1)])
        if rng.random() < 0.7:
            damaged = bytearray(whole)
            damaged[rng.integers(0, 3000)] ^= 1 << rng.integers(0, 8)
        path.write_bytes(damaged)
        try:
            jl.Calibration.load(path)
        except ValueError as error:
            assert "a.safetensors" in str(error)  # noqa: PT017
    with pytest.raises(FileNotFoundError, match="there is no file"):
        jl.Calibration.load(tmp_path / "none.safetensors")


def test_a_dark_capture_leaves_what_else_is_stated_about_the_jots(calibration):
    dark = jl.calibrate(calibration.dark_ones, frames=4000)
    assert dark.mask[3, 4]
    mask = np.zeros(dark.shape, bool)
    mask[10, 20] = True
    efficiency = np.random.default_rng(2).uniform(0.5, 1, dark.shape).astype(np.float32)
    stated = jl.Sensor(frames=4, gain=2.0, mask=mask, efficiency=efficiency, dark_counts=0.5)
    applied = dark.applied_to(stated)
    np.testing.assert_array_equal(applied.efficiency, efficiency)
    np.testing.assert_array_equal(applied.mask, dark.mask | mask)
    np.testing.assert_array_equal(applied.dark_counts, dark.dark_counts)
    assert applied.gain == 2.0
    assert dark.applied_to(jl.Sensor(frames=4, efficiency=0.3)).efficiency == 0.3
    # Changes, and a response that was measured, replace what is stated.
    assert dark.applied_to(stated, efficiency=0.25, mask=None) == stated.replace(
        dark_counts=dark.dark_counts, efficiency=0.25, mask=None
    )
    np.testing.assert_array_equal(calibration.applied_to(stated).efficiency, calibration.efficiency)


def test_a_mask_of_another_shape_is_refused(calibration):
    with pytest.raises(ValueError, match=r"expected a mask of the shape of the calibration \(32"):
        calibration.applied_to(jl.Sensor(mask=np.zeros((1, 40), bool)))


def test_the_sensor_of_bits_has_their_frames_and_their_own_sensor(calibration):
    bits = jl.Bits.from_array(np.zeros((7, *calibration.shape), bool))
    assert calibration.sensor(bits) == calibration.sensor(7)
    own = jl.Sensor(frames=7, gain=21.0, max_intensity=3.0)
    carried = calibration.sensor(jl.Bits(bits.packed, bits.width, own), efficiency=1.0)
    assert carried == calibration.applied_to(own, efficiency=1.0)
    with pytest.raises(TypeError, match=r"frames: expected jotlight\.Bits or the number of frames"):
        calibration.sensor(np.zeros((7, *calibration.shape)))


def test_bits_of_another_size_or_orientation_are_refused(calibration):
    known = dataclasses.replace(
        calibration, provenance={"dark": Provenance("npy", "dark.npy", orientation=(0, False))}
    )
    bits = jl.Bits.from_array(np.zeros((7, *calibration.shape), bool))
    with pytest.raises(ValueError, match="calibration: it has 32 x 40 jots, and the capture has"):
        known.sensor(jl.Bits(bits.packed[:, :16], bits.width))
    turned = Provenance("npy", "seen.npy", orientation=(2, False))
    with pytest.raises(ValueError, match="open them in the same orientation"):
        known.sensor(jl.Bits(bits.packed, bits.width, provenance=turned))


def test_bits_of_another_region_are_refused(calibration):
    dark = jl.Bits(np.zeros((4, 64, 8), np.uint8), 64, provenance=Provenance("npy", "dark.npy"))
    known = dataclasses.replace(calibration, provenance={"dark": dark[:, 1:33, 3:43].provenance})
    known.sensor(dark[:, :, 3:][:, 1:33, :40])  # the same jots, selected in two steps
    with pytest.raises(ValueError, match=r"this capture is of rows 0:32 and .*\(--region\)$"):
        known.sensor(dark[:, :32, :40])
    with pytest.raises(ValueError, match=r"--rotate, --flip, --width, --region\)$"):
        known.sensor(dark)
    # The first row of a camera that crops may be any row of the whole sensor.
    cropped = jl.Bits(np.zeros((4, 32, 6), np.uint8), 48, provenance=Provenance("npy", "a.npy"))
    known.sensor(cropped[:, :, :40])
    for provenance, words in (
        (cropped[:, :, :40].provenance, "rows 0:32 and columns 0:40 of 32 x 48"),
        (Provenance("npy", "b.npy"), "an unknown region"),
    ):
        assert known.unconfirmed_reason(provenance) == (
            "the calibration is of rows 1:33 and columns 3:43 of 64 x 64, and the capture is of "
            + words
        )


def test_bits_of_another_region_that_were_turned_since_are_refused(calibration, tmp_path):
    jl.save(jl.Bits(np.zeros((4, 64, 8), np.uint8), 64), tmp_path / "all.npy")
    whole = jl.open(tmp_path / "all.npy")
    jl.save(whole[:, 1:33, 3:43], tmp_path / "dark.npy")
    jl.save(whole[:, :32, 3:43], tmp_path / "seen.npy")
    dark, seen = (jl.open(tmp_path / f"{name}.npy", rotate=180) for name in ("dark", "seen"))
    known = dataclasses.replace(calibration, provenance={"dark": dark.provenance})
    known.sensor(dark)
    with pytest.raises(ValueError, match=r"this capture is of rows 32:64 and columns 21:61 of 64"):
        known.sensor(seen)


def test_bits_whose_hot_jots_are_elsewhere_cause_a_warning():
    rng = np.random.default_rng(1)
    dark = np.where(rng.random((64, 64)) < 0.02, 1.0, 0.002)
    calibration = jl.calibrate(rng.binomial(2000, -np.expm1(-dark)), frames=2000, max_dark=10.0)
    seen = rng.random((64, *dark.shape)) < -np.expm1(-dark - 0.2)
    calibration.sensor(jl.Bits.from_array(seen))
    with pytest.warns(jl.JotlightWarning, match="calibration: .* do not show them in this capture"):
        calibration.sensor(jl.Bits.from_array(seen[:, ::-1]))
