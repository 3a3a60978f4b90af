"""Calibrations in files: what is saved is loaded, and what is damaged is refused."""

import json

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

import jotlight as jl
from jotlight.sensing.provenance import Provenance


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
    assert again.numbers() == calibration.numbers()
    for name in ("dark_counts", "mask", "hot", "dead", "efficiency", "dark_ones", "flat_ones"):
        np.testing.assert_array_equal(getattr(again, name), getattr(calibration, name))
    np.testing.assert_array_equal(again.flat_steadiness.map, calibration.flat_steadiness.map)
    assert again.provenance == {"dark": Provenance("npy", "dark.npy")}
    again.save(tmp_path / "b.safetensors")
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()


HOSTILE = {
    "no json": lambda tensors, told: (tensors, "{"),
    "no object": lambda tensors, told: (tensors, []),
    "deep": lambda tensors, told: (tensors, "[" * 100_000),
    "a map too many": lambda tensors, told: ({**tensors, "x": tensors["mask"]}, told),
    "a map too few": lambda tensors, told: (
        {name: tensor for name, tensor in tensors.items() if name != "hot"},
        told,
    ),
    "another shape": lambda tensors, told: ({**tensors, "hot": tensors["hot"][:3]}, told),
    "another type": lambda tensors, told: (
        {**tensors, "dark_counts": tensors["dark_counts"].astype(np.float64)},
        told,
    ),
    "NaN": lambda tensors, told: (
        {**tensors, "dark_counts": np.full_like(tensors["dark_counts"], np.nan)},
        told,
    ),
    "an efficiency above 1": lambda tensors, told: (
        {**tensors, "efficiency": 2 * tensors["efficiency"]},
        told,
    ),
    "a text for a number": lambda tensors, told: (tensors, {**told, "scale": "1"}),
    "true for a number": lambda tensors, told: (tensors, {**told, "threshold": True}),
    "a huge number": lambda tensors, told: (tensors, {**told, "dark_frames": 10**30}),
    "an infinite number": lambda tensors, told: (tensors, {**told, "prnu": float("inf")}),
    "a number too many": lambda tensors, told: (tensors, {**told, "mask": 1}),
    "no bulk": lambda tensors, told: (tensors, {**told, "bulk": None}),
    "a provenance that is none": lambda tensors, told: (
        tensors,
        {**told, "provenance": {"dark": 3}},
    ),
    "a provenance of another capture": lambda tensors, told: (
        tensors,
        {**told, "provenance": {"light": told["provenance"]["dark"]}},
    ),
    "a turn that is none": lambda tensors, told: (
        tensors,
        {**told, "provenance": {"dark": {**told["provenance"]["dark"], "orientation": [4, False]}}},
    ),
    "steadiness without map": lambda tensors, told: (
        tensors,
        {**told, "dark_steadiness": told["flat_steadiness"]},
    ),
}


def test_earlier_files_without_a_record_of_their_captures_are_read(calibration, tmp_path):
    path = tmp_path / "a.safetensors"
    calibration.save(path)
    told = calibration.numbers()
    del told["provenance"], told["hot_chance"]
    told["files"] = {"dark": "dark.npy"}
    metadata = {"format": "jotlight calibration", "version": "1", "numbers": json.dumps(told)}
    save_file(load_file(path), path, metadata)
    again = jl.Calibration.load(path)
    assert again.sensor(4) == calibration.sensor(4)
    assert again.hot_chance == calibration.hot_chance
    turned = Provenance("npy", "seen.npy", orientation=(1, False))
    again.check_capture(again.shape, turned)
    assert again.unsure(turned) == "how the captures of the calibration were turned is not known"


@pytest.mark.parametrize("name", HOSTILE)
def test_damaged_calibrations_are_refused_by_name(calibration, tmp_path, name):
    path = tmp_path / "a.safetensors"
    calibration.save(path)
    tensors, told = HOSTILE[name](load_file(path), json.loads(json.dumps(calibration.numbers())))
    told = told if isinstance(told, str) else json.dumps(told)
    metadata = {"format": "jotlight calibration", "version": "1", "numbers": told}
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
