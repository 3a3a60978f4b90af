import dask
import dask.array as da
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jotlight as jl
from jotlight.dask import counting, pieces

SENSOR = jl.Sensor(frames=8)


def random_bits(frames, height=6, width=13, channels=(), seed=0):
    rng = np.random.default_rng(seed)
    return jl.Bits.from_array(rng.random((frames, height, width, *channels)) < 0.3)


def naive_counts(bits, window, step):
    """Return the counts of each window from unpacked bits."""
    frames = bits.to_array()
    starts = range(0, len(frames) - window + 1, step)
    return np.stack([frames[start : start + window].sum(0) for start in starts])


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """Return bits in a file."""
    path = tmp_path_factory.mktemp("bits") / "bits.npy"
    np.save(path, random_bits(40).packed)
    return jl.Bits(np.load(path, mmap_mode="r"), 13)


@pytest.mark.slow
@given(
    frames=st.integers(1, 40),
    window=st.integers(1, 40),
    step=st.integers(1, 50),
    chunk=st.integers(1, 45),
    images=st.integers(1, 50),
)
@settings(max_examples=40, deadline=None)
def test_counts_of_windows_do_not_depend_on_the_chunks(mapped, frames, window, step, chunk, images):
    window, bits = min(window, frames), mapped[:frames]
    expected = naive_counts(bits, window, step)
    with pytest.MonkeyPatch.context() as patch, dask.config.set(scheduler="sync"):
        patch.setattr(pieces, "PART_BYTES", chunk * bits.packed[:1].nbytes)
        patch.setattr(pieces, "MAX_BYTES", images * 4 * 6 * 13)
        for x in (bits.to_dask(chunk), bits, jl.Bits(np.array(bits.packed), 13)):
            counts = jl.dask.count(x, window, step, width=13)
            result = counts.compute()
            assert counts.shape == expected.shape
            assert result.dtype == np.int32
            np.testing.assert_array_equal(result, expected)


def test_each_chunk_of_the_result_has_the_stated_size():
    counts = jl.dask.count(random_bits(100).to_dask(30), 7, 3, width=13)
    blocks = [block.shape for block in dask.compute(*counts.to_delayed().ravel())]
    assert [shape[0] for shape in blocks] == list(counts.chunks[0])


def test_counts_cover_pixels_of_several_jots_and_channels():
    bits = random_bits(20, 8, 16, (3,))
    counts = jl.dask.count(bits, 10, oversampling=2)
    expected = naive_counts(bits, 10, 10).reshape(2, 4, 2, 8, 2, 3).sum((2, 4))
    np.testing.assert_array_equal(counts.compute(), expected)


def test_chunks_with_many_windows_are_divided(monkeypatch):
    bits = random_bits(64)
    monkeypatch.setattr(pieces, "MAX_BYTES", 4 * 6 * 13 * 15)
    counts = jl.dask.count(bits.to_dask(64), 4, 1, width=13)
    np.testing.assert_array_equal(counts.compute(), naive_counts(bits, 4, 1))
    assert max(counts.chunks[0]) <= 5


@pytest.mark.parametrize(
    ("x", "message"),
    [
        ("bits.npy", "expected jotlight.Bits, or a dask array"),
        (np.zeros((4, 4, 1), np.uint8), "expected jotlight.Bits, or a dask array"),
        (da.zeros((4, 4, 1), dtype=np.int32), "expected jotlight.Bits, or a dask array"),
        (da.zeros((4, 4), dtype=np.uint8), "expected shape"),
        (da.zeros((4, 4, 2), chunks=(4, 2, 2), dtype=np.uint8), "expected whole frames"),
        (da.zeros((4, 4, 2), chunks=(4, 4, 1), dtype=np.uint8), r"rechunk\(\(4, -1, -1\)\)"),
    ],
)
def test_bad_arrays_are_refused(x, message):
    with pytest.raises((TypeError, ValueError), match=message):
        jl.dask.count(x, 2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window": 41}, "window"),
        ({"window": 4, "step": 0}, "step"),
        ({"window": 4, "width": 17}, "width: expected 9 to 16"),
        ({"window": 4, "oversampling": 4}, "multiples of the oversampling"),
        ({"window": 4, "oversampling": 0}, "oversampling: expected at least 1, got 0"),
    ],
)
def test_bad_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        jl.dask.count(random_bits(40).to_dask(), **{"width": 13, **options})


@pytest.mark.parametrize(
    "function",
    [
        lambda x, **width: jl.dask.count(x, 8, **width),
        lambda x, **width: jl.dask.reconstruct(x, SENSOR, 8, method="mle", **width),
        lambda x, **width: jl.dask.calibrate(x, **width).mask,
    ],
)
def test_an_array_of_packed_bits_needs_the_width(function):
    bits = random_bits(40)
    with pytest.raises(TypeError, match=r"width: .* 9 to 16, .* pass width=bits\.width, or bits"):
        function(bits.to_dask())
    assert function(bits).shape[-2:] == (6, 13)
    assert function(bits.to_dask(), width=bits.width).shape[-2:] == (6, 13)
    with pytest.raises(ValueError, match="width: expected 13, that of the bits, got 12"):
        function(bits, width=12)


def test_a_worker_with_another_version_is_refused(monkeypatch):
    counts = counting.count(jl.Bits.from_array(np.ones((8, 4, 8), bool)), 4)
    monkeypatch.setattr("jotlight.runs.cluster.__version__", "0.0.1")
    with pytest.raises(RuntimeError, match=r"expected jotlight .* on each worker, got 0\.0\.1"):
        counts.compute()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (np.zeros((4, 6, 2), np.uint8), r"got an array of uint8; jotlight\.Bits\.from_array"),
        (np.zeros((4, 6, 13), bool), r"got an array of bool; jotlight\.Bits\.from_array"),
        (da.zeros((4, 6, 13), dtype=bool), r"got a dask array of bool; Bits\.to_dask\(\)"),
        ("capture.npy", r"got str; pass jotlight\.open\(path\)"),
        ([1, 2], r"got list; Bits\.to_dask\(\)"),
    ],
)
def test_other_data_are_refused_with_what_to_pass(data, message):
    with pytest.raises(TypeError, match=f"x: expected jotlight.Bits, or a dask array .*{message}"):
        jl.dask.count(data, 2)
