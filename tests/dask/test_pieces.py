import functools

import dask
import numpy as np
import pytest

import jotlight as jl
from jotlight.dask import pieces
from jotlight.dask.pieces import Pieces
from jotlight.runs import chunk_counting
from jotlight.runs.estimator import Estimator
from jotlight.runs.spans import Spans
from jotlight.sensing.bits.frames import Frames


def random_bits(frames, channels=()):
    rng = np.random.default_rng(0)
    return jl.Bits.from_array(rng.random((frames, 16, 24, *channels)) < 0.3)


@pytest.mark.parametrize(
    ("window", "step", "expected"),
    [
        (7, 7, (28, 28, 28)),
        (7, 9, (27, 27, 27)),
        (7, 3, (30, 30, 28)),
        (40, 40, (30, 30, 20)),
    ],
)
def test_chunks_of_bits_hold_whole_windows_where_these_do_not_overlap(
    window, step, expected, monkeypatch
):
    monkeypatch.setattr(pieces, "PART_BYTES", 30 * 16 * 3 + 5)
    found = Pieces.of(random_bits(90), window, step)
    assert found.x.chunks[0][:3] == expected
    is_whole = all(len(group.chunks) == 1 for group in found.groups)
    assert is_whole == (window <= step < 30)


@pytest.mark.parametrize("chunk", [7, 30, 90])
@pytest.mark.parametrize("step", [1, 4])
def test_a_task_has_few_images_of_windows_that_overlap(chunk, step, monkeypatch):
    """A window of 60 frames has up to 60 pieces, and all of them have more than the limit."""
    limit = 15
    monkeypatch.setattr(pieces, "MAX_BYTES", limit * 4 * 16 * 24)
    for spans, chunks in Pieces.of(random_bits(90).to_dask(chunk), 60, step, width=24).groups:
        images = sum(len(spans.pieces(frames)) for _, frames in chunks) + spans.number
        assert images <= limit + len(chunks)


def test_files_are_read_once_for_a_group_of_windows_that_overlap(tmp_path):
    np.save(tmp_path / "bits.npy", np.asarray(random_bits(90).packed))
    bits = jl.open(tmp_path / "bits.npy", counts=False)
    (group,) = Pieces.of(bits, 7, 3).groups
    assert group.chunks == [(0, range(88))]


def test_frames_that_cannot_be_mapped_are_read_once(monkeypatch):
    monkeypatch.setattr(pieces, "PART_BYTES", 30 * 16 * 3)
    monkeypatch.setattr(pieces, "MAX_BYTES", 15 * 4 * 16 * 24)
    packed, reads = random_bits(90).packed, np.zeros(90, int)

    def read(start, stop):
        reads[start:stop] += 1
        return packed[start:stop]

    frames = Frames(packed.shape, read)
    frames.set_origin(functools.partial(Frames, packed.shape, read))
    bits = jl.Bits(frames, 24)
    counts = jl.dask.count(bits, 40, 1).compute(scheduler="sync")
    np.testing.assert_array_equal(counts, [bits[a : a + 40].counts() for a in range(51)])
    reads[:] = 0
    jl.dask.count(bits, 40, 1).compute(scheduler="sync")
    assert reads.tolist() == [1] * 90


def test_only_images_that_leave_and_enter_a_window_are_added():
    class Images(list):
        added = 0

        def __getitem__(self, key):
            part = list.__getitem__(self, key)
            self.added += len(part) if isinstance(key, slice) else 0
            return part

    images = Images(np.random.default_rng(0).integers(0, 9, (100, 2, 3), np.int32))
    ranges = [(first, first + 60) for first in range(41)]
    sums = [total.copy() for total in chunk_counting._sums_of_ranges(images, ranges)]
    np.testing.assert_array_equal(sums, [sum(list(images)[a:b]) for a, b in ranges])
    assert images.added == 60 + 2 * 40


@pytest.mark.parametrize("channels", [(), (3,)])
@pytest.mark.parametrize("images", [1, 3, 100])
def test_estimates_are_those_of_the_counts_whatever_the_number_of_images_in_the_cache(
    channels, images, monkeypatch
):
    pixels = 16 * 24 * max(channels, default=1)
    monkeypatch.setattr(chunk_counting, "_CACHED_PIXELS", images * pixels)
    monkeypatch.setattr(Estimator, "has_table", False)
    bits = random_bits(80, channels)
    sensor = jl.Sensor(frames=8)
    video = jl.dask.reconstruct(
        bits.to_dask(40), sensor, 8, method="mle", width=bits.width
    ).compute()
    counts = jl.dask.count(bits.to_dask(40), 8, width=bits.width).compute()
    axis = -1 if channels else None
    expected = [jl.reconstruct(each, sensor, method="mle", channel_axis=axis) for each in counts]
    np.testing.assert_array_equal(video, expected)


@pytest.mark.parametrize("step", [3, 8, 10])
@pytest.mark.parametrize("frames", [1, 5, 8, 20, 1000])
def test_files_are_read_in_parts_of_whole_pieces(frames, step, tmp_path, monkeypatch):
    bits = random_bits(83)
    path = tmp_path / "bits.npy"
    np.save(path, np.asarray(bits.packed))
    monkeypatch.setattr(chunk_counting, "PART_BYTES", frames * 16 * 3)
    capture, sensor = jl.open(path, counts=False), jl.Sensor(frames=8)
    counts = jl.dask.count(capture, 8, step).compute(scheduler="sync")
    parts = [bits[start : start + 8].counts() for start in range(0, 76, step)]
    np.testing.assert_array_equal(counts, parts)
    video = jl.dask.reconstruct(capture, sensor, 8, step, method="mle").compute(scheduler="sync")
    expected = [jl.reconstruct(part, sensor, method="mle") for part in parts]
    np.testing.assert_array_equal(video, expected)


def test_only_fast_estimates_have_large_chunks(monkeypatch):
    monkeypatch.setattr(pieces, "PART_BYTES", 10 * 16 * 3)
    sensor, bits = jl.Sensor(frames=1), random_bits(80)
    assert jl.dask.count(bits, 1).numblocks[0] == 4
    assert jl.dask.reconstruct(bits, sensor, 1, method="mle").numblocks[0] == 4
    assert jl.dask.reconstruct(bits, sensor, 1, method="network-small").numblocks[0] == 8
    darker = sensor.replace(dark_counts=np.linspace(0, 0.1, 16 * 24).reshape(16, 24))
    assert jl.dask.reconstruct(bits, darker, 1, method="mle").numblocks[0] == 8


def test_mle_writes_the_counts_of_only_the_first_image(monkeypatch):
    counted, add_counts = [], chunk_counting.add_counts
    monkeypatch.setattr(
        chunk_counting,
        "add_counts",
        lambda packed, *others, **threads: (
            counted.append(len(packed)) or add_counts(packed, *others, **threads)
        ),
    )
    video = jl.dask.reconstruct(random_bits(32), jl.Sensor(frames=8), 8, method="mle")
    assert video.compute(scheduler="sync").shape == (4, 16, 24)
    assert len(counted) < 4


def bits_of(intensity, dark_counts, frames=64, **options):
    """Return bits of a white surface, without dark counts, and the sensor that they state."""
    sensor = jl.Sensor(frames=frames, dark_counts=dark_counts, **options)
    bright = sensor.replace(max_intensity=10.0, dark_counts=0.0)
    bits = bright.expose(np.full((32, 32), intensity), rng=0)
    return jl.Bits(bits.packed, width=32, sensor=sensor)


@pytest.mark.parametrize("step", [16, 4])
@pytest.mark.parametrize("method", ["mle", "noniterative-tv", "network-small"])
@pytest.mark.parametrize(
    ("bits", "message"),
    [
        (bits_of(3.0, 0.0), "brighter than the largest intensity"),
        (bits_of(0.0, 0.2), "dark_counts: expected detections"),
    ],
)
def test_data_that_contradict_the_sensor_cause_a_warning(bits, message, method, step):
    video = jl.dask.reconstruct(bits, window=16, step=step, method=method)
    with pytest.warns(jl.JotlightWarning, match=message):
        video.compute(scheduler="sync")


def test_tiles_that_contradict_the_sensor_cause_a_warning(monkeypatch):
    monkeypatch.setattr("jotlight.dask.reconstruction._MAX_PIXELS", 100)
    video = jl.dask.reconstruct(bits_of(3.0, 0.0), window=16, method="mle")
    with pytest.warns(jl.JotlightWarning, match="brighter than the largest intensity"):
        video.compute(scheduler="sync")


@pytest.mark.filterwarnings("error")
def test_data_that_fit_the_sensor_cause_no_warning():
    bits = jl.Sensor(frames=64, dark_counts=0.01).expose(np.full((32, 32), 0.9), rng=0)
    jl.dask.reconstruct(bits, window=16, method="mle").compute(scheduler="sync")


@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(frames=8),
        jl.Sensor(frames=8, threshold=3, dark_counts=0.01, efficiency=0.4),
        jl.Sensor(frames=8, oversampling=2),
        jl.Sensor(frames=8, oversampling=4),  # 128 trials for 24 pixels
        jl.Sensor(frames=8, dark_counts=np.linspace(0, 0.1, 16 * 24).reshape(16, 24)),
        jl.Sensor(frames=8, mask=np.eye(16, 24, dtype=bool)),
    ],
)
@pytest.mark.parametrize("channels", [(), (3,)])
@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
def test_estimates_from_a_table_are_those_of_reconstruct(sensor, channels):
    bits = random_bits(40, channels)
    video = jl.dask.reconstruct(
        bits.to_dask(16), sensor, 8, method="mle", width=bits.width
    ).compute()
    parts = [bits[start : start + 8] for start in range(0, 40, 8)]
    expected = [jl.reconstruct(part, sensor, method="mle") for part in parts]
    np.testing.assert_array_equal(video, expected)


def test_arrays_of_the_same_files_with_other_chunks_are_counted_together(tmp_path):
    bits = random_bits(40)
    np.save(tmp_path / "bits.npy", np.asarray(bits.packed))
    capture = jl.open(tmp_path / "bits.npy", counts=False)
    several = [
        jl.dask.count(capture.to_dask(chunks), 8, width=capture.width) for chunks in (10, 8, 20)
    ]
    expected = jl.dask.count(bits, 8).compute()
    for counts in dask.compute(*several, scheduler="sync"):
        np.testing.assert_array_equal(counts, expected)


def test_a_source_with_fewer_frames_than_its_chunk_is_refused():
    block = np.zeros((7, 16, 3), np.uint8)
    with pytest.raises(RuntimeError, match="expected frames 4 to 8 of a chunk, got 3"):
        chunk_counting.count_windows(block, range(8), Spans(4, 4, 2), 24, 1, jl.__version__, None)


@pytest.mark.parametrize("options", [{"oversampling": 0}, {"width": 0}])
def test_zero_is_not_a_default(options):
    with pytest.raises(ValueError, match="expected"):
        jl.dask.count(random_bits(8), 4, **options)


@pytest.mark.parametrize("width", ["24", 24.0, True])
def test_a_width_is_a_whole_number(width):
    for x in (random_bits(8), random_bits(8).to_dask(4)):
        with pytest.raises(TypeError, match="width: expected a whole number"):
            jl.dask.count(x, 4, width=width)


@pytest.mark.parametrize(
    "use",
    [
        lambda x: jl.dask.count(x, 4, width=24),
        lambda x: jl.dask.reconstruct(x, jl.Sensor(frames=8), width=24),
        lambda x: jl.dask.calibrate(x, width=24),
    ],
)
def test_chunks_of_unknown_size_are_refused(use):
    x = random_bits(8).to_dask(4)
    selected = x[x[:, 0, 0] >= 0]
    with pytest.raises(ValueError, match=r"got unknown ones, .*; x\.compute_chunk_sizes\(\)"):
        use(selected)
    use(selected.compute_chunk_sizes())
