"""Counts in TIFF and PNG files: channels that the formats hold, and those that they do not."""

import numpy as np
import pytest

import jotlight as jl

COUNTS = np.random.default_rng(0).integers(0, 200, (8, 12, 1), np.int32)


@pytest.mark.parametrize("name", ["a.tif", "a.png"])
def test_a_single_channel_is_written_as_gray(tmp_path, name):
    jl.save(COUNTS, tmp_path / name)
    np.testing.assert_array_equal(jl.open(tmp_path / name), COUNTS[..., 0])


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("a.tif", np.repeat(COUNTS, 2, axis=2), "expected one, three, or four channels, got 2"),
        ("a.png", np.repeat(COUNTS, 2, axis=2), "expected counts of one channel, got 2 channels"),
        ("a.png", np.repeat(COUNTS, 3, axis=2), "expected counts of one channel, got 3 channels"),
        ("a.png", COUNTS + (1 << 16), r"expected counts below 65536, .*\.tif holds them"),
    ],
)
def test_what_a_format_cannot_hold_is_refused(tmp_path, name, values, message):
    with pytest.raises(ValueError, match=message):
        jl.save(values, tmp_path / name)
    assert list(tmp_path.iterdir()) == []
