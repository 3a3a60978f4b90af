"""Functions of the caller, named as MODULE:FUNCTION."""

import sys

import numpy as np
import pytest

import jotlight as jl
from jotlight.errors import error_message
from jotlight.evaluation.own_method import arguments_of, checksum_of_module, import_method

CODE = """
import numpy as np

number = 3

def mean(bits, sensor):
    return bits.counts(sensor.oversampling) / np.float32(sensor.trials)

def fails(bits):
    values = {}
    return values["missing"]

def exits(bits):
    raise SystemExit(3)

def fails_in_two_lines(bits):
    raise ValueError("first line\\nsecond line")

def is_stopped(bits):
    from jotlight.cli.terminal.signals import StoppedBySignalError
    raise StoppedBySignalError(143)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return the current folder, whose modules are forgotten afterward."""
    (tmp_path / "own_module.py").write_text(CODE)
    (tmp_path / "own_package").mkdir()
    (tmp_path / "own_package" / "inner.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if name.startswith("own_"):
            del sys.modules[name]


@pytest.mark.parametrize("reference", ["own_module:mean", "own_package.inner:mean"])
def test_a_function_in_the_current_folder_is_a_method(folder, reference):
    sensor = jl.Sensor(oversampling=2)
    image = np.full((16, 16), 0.5, np.float32)
    result = jl.evaluate(import_method(reference), [image], sensor)
    counts = sensor.expose(image, rng=0).counts()
    assert result.values("psnr") == [jl.metrics.psnr(np.float32(counts / 4), image)]


def test_a_function_of_an_installed_module_is_found():
    assert import_method("numpy.linalg:norm")([3.0, 4.0]) == 5


def test_the_arguments_follow_the_signature_of_the_function(folder):
    bits, sensor = object(), object()
    assert arguments_of(import_method("own_module:mean"), bits, sensor, None)[1] == {
        "sensor": sensor
    }
    assert arguments_of(import_method("own_module:fails"), bits, sensor, None) == ((bits,), {})


def test_an_exception_names_the_function_and_its_line(folder):
    line = CODE.splitlines().index('    return values["missing"]') + 1
    message = rf"own_module:fails raised KeyError: 'missing' \(.*own_module.py, line {line}\)"
    with pytest.raises(ValueError, match=message):
        import_method("own_module:fails")(None)


def test_an_exit_of_the_function_is_an_error_of_one_line(folder):
    with pytest.raises(ValueError, match=r"own_module:exits raised SystemExit: 3 \("):
        import_method("own_module:exits")(None)
    with pytest.raises(ValueError, match=r"raised ValueError: first line \(") as caught:
        import_method("own_module:fails_in_two_lines")(None)
    assert "\n" not in str(caught.value)


def test_a_signal_during_the_function_ends_the_process(folder):
    with pytest.raises(SystemExit) as caught:
        import_method("own_module:is_stopped")(None)
    assert caught.value.code == 143


def test_a_function_that_takes_bits_for_an_array_gets_a_note():
    def mine(data):
        return data / 16

    image, sensor = np.full((16, 16), 0.5), jl.Sensor(frames=4)
    bits = sensor.expose(image, rng=0)
    ones = bits.counts()
    merged = jl.Merged(ones, np.full(ones.shape, 4), sensor)
    calls = [
        (lambda: jl.compare({"own": mine}, image, sensor), r"mine received Bits; bits.counts() is"),
        (lambda: jl.reconstruct(bits, method=mine), r"mine received Bits; bits.counts() is"),
        (lambda: jl.reconstruct(merged, method=mine), "mine received Merged; merged.ones is"),
    ]
    for call, expected in calls:
        with pytest.raises(TypeError) as caught:
            call()
        assert expected in caught.value.__notes__[0]
    with pytest.raises(AttributeError) as caught:
        jl.reconstruct(ones, sensor, method=lambda bits: bits.counts())
    assert "received counts, an array (16, 16), which has no" in caught.value.__notes__[0]


@pytest.mark.parametrize(
    ("method", "reason"),
    [
        (lambda: 0, "too many positional arguments"),
        (lambda bits, sensor, scale: bits, "missing a required argument: 'scale'"),
        (lambda bits, *, scale: bits, "missing a required.* argument: 'scale'"),
    ],
)
def test_a_function_with_other_parameters_is_refused(method, reason):
    counts, sensor = np.ones((8, 8), int), jl.Sensor(frames=4)
    with pytest.raises(TypeError, match=rf"expected a function f\(data, sensor\) .*: {reason}"):
        jl.reconstruct(counts, sensor, method=method)
    scaled = jl.reconstruct(counts, sensor, method=lambda data, *, scale: data * scale, scale=0.25)
    np.testing.assert_array_equal(scaled, np.full((8, 8), 0.25))
    with pytest.raises(TypeError, match="got an unexpected keyword argument 'other'"):
        jl.reconstruct(counts, sensor, method=lambda data: data / 4, other=2)


def test_a_function_that_takes_a_plane_of_a_mosaic_for_the_image_gets_a_note():
    sensor = jl.Sensor(frames=4, mosaic="RGGB")
    bits = sensor.expose(np.full((16, 24, 3), 0.5), rng=0)

    def reshaped(counts):
        return counts.reshape(16, 24)

    def whole(counts):
        return np.zeros((16, 24))

    for method in (reshaped, whole, lambda bits: bits.counts()):
        with pytest.raises((ValueError, AttributeError)) as caught:
            jl.reconstruct(bits, method=method)
        note = caught.value.__notes__[-1]
        expected = "receives the counts (h, w) of each plane of the mosaic, the pixels behind one"
        assert note.startswith(f"{method.__name__} {expected}")
        assert "jotlight.metrics.psnr(function(bits), image)" in note
        assert error_message(caught.value).endswith(note)
    with pytest.raises(ValueError, match="weight") as caught:
        jl.reconstruct(bits, method="mle", weight=1)
    assert not hasattr(caught.value, "__notes__")


@pytest.mark.parametrize(
    ("reference", "error", "message"),
    [
        ("own_module:meen", ValueError, "has no function meen; did you mean own_module:mean"),
        ("own_module:number", TypeError, "expected a function, but own_module:number is of type"),
        ("own_missing:f", ImportError, "there is no module own_missing, neither own_missing.py in"),
        ("own_module.inner:f", ImportError, "there is no module own_module.inner"),
        ("own_broken:f", ImportError, "the import of own_broken failed: No module named 'nothing"),
        ("own_syntax:f", ImportError, "the import of own_syntax failed: SyntaxError"),
        ("own_exit:f", ImportError, "the import of own_exit failed: SystemExit: bye"),
        ("own_module:", ValueError, "expected MODULE:FUNCTION"),
        (":mean", ValueError, "expected MODULE:FUNCTION"),
        ("../own_module:mean", ValueError, "expected MODULE:FUNCTION"),
        ("own_module.py:mean", ImportError, "did you mean own_module:mean"),
        ("mle", ValueError, "expected MODULE:FUNCTION, such as mine:denoise"),
    ],
)
def test_a_reference_to_no_function_is_refused(folder, reference, error, message):
    (folder / "own_broken.py").write_text("import nothing_of_this_name")
    (folder / "own_exit.py").write_text("raise SystemExit('bye')")
    (folder / "own_syntax.py").write_text("def f(:")
    with pytest.raises(error, match=message):
        import_method(reference)


def test_the_checksum_changes_with_the_module(folder):
    (folder / "own_other.py").write_text(CODE + "# changed\n")
    first, second = map(checksum_of_module, ("own_module:mean", "own_other:mean"))
    assert len(first) == len(second) == 64
    assert first != second


def test_a_function_that_returns_nothing_is_asked_about_its_return():
    bits = jl.Sensor(frames=4).expose(np.full((5, 6), 0.5), rng=0)
    with pytest.raises(TypeError, match="from <lambda>, got None; does it return its image"):
        jl.reconstruct(bits, method=lambda bits: None)


def test_counts_in_place_of_intensities_are_reported():
    bits = jl.Sensor(frames=4).expose(np.full((5, 6), 0.5), rng=0)
    with pytest.warns(
        jl.JotlightWarning, match=r"whole numbers up to \d, .*counts / sensor.trials"
    ):
        jl.reconstruct(bits, method=lambda bits: bits.counts())
    jl.reconstruct(bits, method=lambda bits: bits.counts() / bits.sensor.trials)
    jl.reconstruct(bits, method=lambda bits: (bits.counts() > 2).astype(int))


def test_a_function_cannot_change_the_data_of_others():
    sensor = jl.Sensor(frames=8)
    bits = sensor.expose(np.full((4, 4), 0.5), rng=0)
    counts = bits.counts()
    before = counts.copy()

    def change_counts(own):
        own[:] = 0
        return own / 8.0

    jl.reconstruct(counts, sensor, method=change_counts)
    np.testing.assert_array_equal(counts, before)

    def change_bits(own):
        own.packed[:] = 0

    with pytest.raises(ValueError, match="read-only"):
        jl.reconstruct(bits, method=change_bits)
    readings = jl.Readings(np.ones((2, 4, 4), np.uint16), jl.Sensor(frames=2, bit_depth=2))

    def change_readings(own):
        own.frames[:] = 0

    with pytest.raises(ValueError, match="read-only"):
        jl.reconstruct(readings, method=change_readings)
