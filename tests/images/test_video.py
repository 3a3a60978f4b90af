"""Videos: each image comes from its own frames, and all share one tone curve."""

import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
import tifffile
from PIL import Image

import jotlight as jl
from folders import file_names, size_limit
from jotlight.chunks import windows
from jotlight.images.io import read_image
from jotlight.images.tone import Tone
from jotlight.images.video import video_writer
from jotlight.sensing.bits.frames import Frames

NAMES = ["a.npy", "a.tif", "a", "a.gif", "a.mp4"]
RAMP = np.linspace(0, 1, 35, dtype=np.float32).reshape(5, 7)


@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3)])
@pytest.mark.parametrize("length", [1, 4, 12])
@pytest.mark.parametrize("is_known", [True, False])
def test_a_stack_of_floats_is_exact_and_unclipped(tmp_path, shape, length, is_known):
    images = np.random.default_rng(0).random((length, *shape), np.float32) * 100
    for name in ("a.npy", "a.tif"):
        with video_writer(tmp_path / name, length if is_known else None) as add:
            for image in images:
                add(image)
    assert (np.load(tmp_path / "a.npy") == images).all()
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert len(file.pages) == length
        assert file.is_bigtiff == (not is_known)
        for page, image in zip(file.pages, images, strict=True):
            assert (page.asarray() == image).all()


@pytest.mark.parametrize("name", ["a.npy", "a.tif"])
def test_a_film_that_does_not_fit_on_the_disk_is_refused_at_its_first_image(tmp_path, name):
    with (
        pytest.raises(OSError, match=r"the results need up to .* TiB, but"),
        video_writer(tmp_path / name, 1 << 50) as add,
    ):
        add(RAMP)
    assert file_names(tmp_path) == []


def test_a_folder_of_images_has_one_curve(tmp_path):
    with video_writer(tmp_path / "a", 2, tone=Tone("gamma", 2.0), depth=16) as add:
        add(RAMP)
        add(2 * RAMP)
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["00000.png", "00001.png"]
    one, two = (read_image(tmp_path / "a" / f"0000{n}.png") for n in range(2))
    np.testing.assert_allclose(one, (RAMP / 2) ** (1 / 2.2), atol=1e-5)
    np.testing.assert_allclose(two, RAMP ** (1 / 2.2), atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(5, 7), (32, 48, 3)])
def test_an_mp4_contains_every_image(tmp_path, shape):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    with video_writer(tmp_path / "a.mp4", 6, fps=10) as add:
        for number in range(6):
            add(np.full(shape, number / 5, np.float32))
    words = [ffmpeg.get_ffmpeg_exe(), "-i", str(tmp_path / "a.mp4"), "-f", "rawvideo"]
    done = subprocess.run([*words, "-pix_fmt", "gray", "-"], capture_output=True, check=True)
    size = (6, shape[0] + shape[0] % 2, shape[1] + shape[1] % 2)
    levels = np.frombuffer(done.stdout, np.uint8).reshape(size).mean((1, 2))
    np.testing.assert_allclose(levels, np.arange(6) * 51, atol=6)


@pytest.mark.slow
@pytest.mark.parametrize("channels", [(), (3,)])
def test_an_mp4_states_its_colors(tmp_path, channels):
    program = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    colors = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [200, 120, 40]], np.float32) / 255
    image = colors.repeat(16, axis=0)[None].repeat(16, axis=0)[(..., *[0] * (not channels))]
    with video_writer(tmp_path / "a.mp4") as add:
        add(image)
    source = [program, "-i", str(tmp_path / "a.mp4")]
    described = subprocess.run(source, capture_output=True, check=False).stderr
    assert b"yuv420p(tv, bt709/bt709/iec61966-2-1" in described
    # Tags alone would change the colors of players that read them.
    for matrix in ([], ["-vf", "scale=in_color_matrix=bt709"]):
        words = [*source, *matrix, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
        done = subprocess.run(words, capture_output=True, check=True)
        levels = np.frombuffer(done.stdout, np.uint8).reshape(16, 64, 3)[8, 8::16]
        shown = np.broadcast_to(image[8, 8::16].reshape(4, -1), (4, 3))
        np.testing.assert_allclose(levels, 255 * shown, atol=3)


@pytest.mark.parametrize("shape", [(5, 7), (32, 48, 3)])
def test_a_gif_contains_every_image(tmp_path, shape):
    with video_writer(tmp_path / "a.gif", 4, fps=10) as add:
        for number in range(4):
            add(np.full(shape, number / 5, np.float32))
    with Image.open(tmp_path / "a.gif") as animation:
        assert animation.n_frames == 4
        for number in range(4):
            animation.seek(number)
            assert animation.info["duration"] == 100
            levels = np.asarray(animation.convert("RGB"))
            assert levels.shape == (*shape[:2], 3)
            np.testing.assert_allclose(levels, number * 51, atol=1)


@pytest.mark.parametrize("name", NAMES)
def test_an_interrupted_video_leaves_no_file(tmp_path, name):
    if name == "a.mp4":
        pytest.importorskip("imageio_ffmpeg")

    def stopped():
        with video_writer(tmp_path / name, 3) as add:
            add(RAMP)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", NAMES)
def test_images_of_different_shapes_and_empty_films_are_refused(tmp_path, name):
    if name == "a.mp4":
        pytest.importorskip("imageio_ffmpeg")

    def write(*images):
        with video_writer(tmp_path / name) as add:
            for image in images:
                add(image)

    with pytest.raises(ValueError, match=r"one shape for all, got \(5, 7\) and \(7, 5\)"):
        write(RAMP, RAMP.T)
    with pytest.raises(ValueError, match="at least one"):
        write()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.npy", "a.tif", "a", "a.gif"])
def test_a_full_disk_is_reported_and_leaves_no_file(tmp_path, name):
    pytest.importorskip("resource", reason="needs limits of the operating system")
    noise = np.random.default_rng(0).random((100, 100), np.float32)

    def write():
        with video_writer(tmp_path / name) as add:
            for _ in range(5):
                add(noise)

    with size_limit(8000), pytest.raises(OSError, match=f"cannot write .*{name}: File too large"):
        write()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.npy", "a.tif", "a", "a.gif"])
def test_a_long_film_takes_little_memory(tmp_path, name):
    image = np.random.default_rng(0).random((100, 100), np.float32)
    with video_writer(tmp_path / "first.tif", 1) as add:
        add(image)  # imports
    tracemalloc.start()
    with video_writer(tmp_path / name, 200) as add:
        for _ in range(200):
            add(image.copy())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e6  # The levels of all images have 2 MB.


@pytest.mark.parametrize(
    ("fps", "delays"), [(30, [3, 4, 3, 3, 4, 3]), (50, [2] * 6), (4, [25] * 6)]
)
def test_the_images_of_a_gif_have_the_mean_rate(tmp_path, fps, delays):
    with video_writer(tmp_path / "a.gif", fps=fps) as add:
        for number in range(6):
            add(RAMP * number / 6)
    with Image.open(tmp_path / "a.gif") as animation:
        assert animation.info["loop"] == 0
        found = []
        for number in range(6):
            animation.seek(number)
            found.append(animation.info["duration"])
    assert found == [10 * delay for delay in delays]


def test_the_levels_of_a_gray_gif_are_exact(tmp_path):
    images = np.random.default_rng(0).random((5, 40, 50), np.float32)
    with video_writer(tmp_path / "a.gif") as add:
        for image in images:
            add(image)
    with Image.open(tmp_path / "a.gif") as animation:
        for number, image in enumerate(images):
            animation.seek(number)
            found = np.asarray(animation.convert("L"))
            np.testing.assert_array_equal(found, np.rint(255 * image))


@pytest.mark.parametrize(
    ("name", "fps", "message"),
    [
        ("a.gif", 51, "up to 50 images"),
        ("a.gif", 0.001, "fps: expected 0.01 to 10000 images per second, got 0.001"),
        ("a.mp4", 1e-8, "expected 0.01 to 10000 images per second, got 1e-08"),
        ("a.mp4", 99999, "expected 0.01 to 10000 images per second, got 99999"),
        ("a.npy", 10, "fps: is for .mp4 and .gif; .*a.npy has no place for 10 images per second"),
        ("a.tif", 10, "fps: is for .mp4 and .gif; "),
        ("a", 10, "fps: is for .mp4 and .gif; "),
    ],
)
def test_a_wrong_rate_is_refused(tmp_path, name, fps, message):
    with pytest.raises(ValueError, match=message), video_writer(tmp_path / name, fps=fps):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.npy", "a.tif", "a.gif", "a.mp4"])
def test_only_a_folder_of_images_may_have_16_bits_per_value(tmp_path, name):
    if name == "a.mp4":
        pytest.importorskip("imageio_ffmpeg")
    suffix = f"got 16 for {name[1:]}"
    with pytest.raises(ValueError, match=suffix), video_writer(tmp_path / name, depth=16):
        pass
    with pytest.raises(ValueError, match=suffix):
        jl.save_film(tmp_path / name, [RAMP], depth=16)
    with pytest.raises(ValueError, match=r"depth: expected 8, or 16 for \.png, got 12"):
        jl.save_film(tmp_path / "a", [RAMP], depth=12)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("shape", [(2, 70_000), (70_000, 2, 3)])
@pytest.mark.parametrize(("name", "largest"), [("a.gif", 65_535), ("a.mp4", 16_384)])
def test_images_that_are_too_large_for_a_format_are_refused(tmp_path, name, largest, shape):
    if name == "a.mp4":
        pytest.importorskip("imageio_ffmpeg")
    message = f"expected up to {largest} rows and columns for a .{name[2:]}, got {shape[0]} x "
    with pytest.raises(ValueError, match=message), video_writer(tmp_path / name) as add:
        add(np.zeros(shape, np.float32))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", [".gif", ".MP4", ".npy", ".tif"])
def test_a_name_that_is_an_ending_alone_is_no_folder(tmp_path, name):
    message = f"expected a name before the ending, such as .*film{name.lower()}$"
    with pytest.raises(ValueError, match=message), video_writer(tmp_path / name):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("name", "fps"), [("a.gif", 0.01), ("a.mp4", 0.01), ("a.mp4", 10_000)])
def test_the_ends_of_the_range_are_written(tmp_path, name, fps):
    if name == "a.mp4":
        pytest.importorskip("imageio_ffmpeg")
    with video_writer(tmp_path / name, fps=fps) as add:
        for value in (0.2, 0.8):
            add(np.full((16, 16), value, np.float32))
    assert (tmp_path / name).stat().st_size > 100


@pytest.mark.filterwarnings("ignore::jotlight.PeriodicRatesWarning")
def test_the_video_of_a_large_capture_takes_little_memory(tmp_path):
    def read(start, stop):
        return np.full((stop - start, 256, 32), 0b01010101, np.uint8)

    bits = jl.Bits(Frames((20_000, 256, 32), read))  # 160 MB of bits
    spans = windows(len(bits), 1000)
    sensor = jl.Sensor(frames=1000, max_intensity=8.0)
    tracemalloc.start()
    with video_writer(tmp_path / "a.npy", len(spans)) as add:
        for span in spans:
            add(jl.mle(bits[span], sensor))
    assert tracemalloc.get_traced_memory()[1] < 40e6
    tracemalloc.stop()
    assert np.load(tmp_path / "a.npy", mmap_mode="r").shape == (20, 256, 256)


@pytest.mark.slow
def test_without_the_package_mp4_says_what_to_install(tmp_path):
    code = (
        "import sys, importlib.machinery; sys.modules['imageio_ffmpeg'] = None\n"
        "import importlib.util as u; real = u.find_spec\n"
        "u.find_spec = lambda n, *a: None if n == 'imageio_ffmpeg' else real(n, *a)\n"
        "from pathlib import Path\n"
        "from jotlight.images.video import is_floats; is_floats(Path('a.mp4'))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path
    )
    assert "pip install 'jotlight[video]'" in done.stderr
