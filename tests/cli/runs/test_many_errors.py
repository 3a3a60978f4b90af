"""Runs that are refused, and captures that fail."""

from pathlib import Path

import numpy as np
import pytest

import jotlight as jl


@pytest.mark.parametrize("window", [(), ("--window", 16)])
def test_results_are_not_written_to_urls(run, captures, window):
    ending = "zarr" if window else "png"
    output = f"s3://bucket/{{name}}.{ending}"
    code, err = run("reconstruct", *captures, "-o", output, "-m", "mle", *window)
    assert code == 1
    refused = "results are written to files of this machine, not to URLs"
    assert f"s3://bucket/a/1.{ending}: {refused}" in err
    code, err = run("reconstruct", captures[0], "-o", f"s3://bucket/a.{ending}", *window)
    assert code == 1
    assert "not to URLs" in err
    assert not Path("s3:").exists()


@pytest.mark.parametrize(
    ("number", "message"), [(1, "error: 1: "), (2, "error: 1 of 2 captures failed: 1: ")]
)
def test_failed_captures_are_counted_if_there_are_several(run, captures, number, message):
    Path("1").write_text("a file, so it contains no v.zarr")
    base = ("reconstruct", *captures[:number], "-m", "mle", "--window", 16)
    code, err = run(*base, "-o", "{name}/v.zarr")
    assert code == 1
    assert message in err
    assert err.count("error:") == 1
    assert "cannot write 1/v.zarr: " in err


@pytest.mark.parametrize(
    ("command", "number", "options"),
    [
        ("reconstruct", 1, ("-o", "1.npy", "-m", "mle")),
        ("reconstruct", 2, ("-o", "{name}.npy", "-m", "mle")),
        ("film", 1, ("-o", "1.npy", "-m", "mle", "--window", 16)),
        ("convert", 1, ("-o", "1.npy")),
        ("convert", 2, ("-o", "{name}.npy")),
    ],
)
def test_a_folder_that_is_not_writable_is_an_error_of_the_output(
    run, captures, monkeypatch, command, number, options
):
    def refuse(*arguments):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("jotlight.files.reserve_temporary", refuse)
    code, err = run(command, *captures[:number], *options)
    assert code == 1
    assert "cannot write 1.npy: Permission denied in folder" in err


def test_results_of_another_run_are_refused(run, captures):
    base = ("reconstruct", captures[0], "-o", "v.zarr", "-m", "mle", "--window")
    assert run(*base, 16)[0] == 0
    code, err = run(*base, 32)
    assert code == 1
    differing = "its step was 16, and is 32 now, and its window was 16, and is 32 now;"
    assert f"v.zarr: belongs to another run: {differing}" in err
    code, err = run(*base, 16, "--efficiency", 0.5)
    assert code == 1
    assert "v.zarr: belongs to another run: its sensor efficiency was 1.0, and is 0.5 now;" in err


def test_another_capture_is_named(run, captures):
    base = ("-o", "v.zarr", "--window", 16)
    assert run("convert", captures[0], *base)[0] == 0
    code, err = run("convert", captures[1], *base)
    assert code == 1
    assert "changed since" not in err
    assert f'{captures[0].name}", and is ' in err


def test_a_capture_that_changed_is_another_run(run, captures):
    base = ("convert", captures[0], "-o", "v.zarr", "--window", 16)
    assert run(*base)[0] == 0
    jl.save(jl.Bits.from_array(np.ones((64, 16, 24), bool), jl.Sensor(frames=64)), captures[0])
    code, err = run(*base)
    assert code == 1
    changed = "belongs to another run: the capture has changed since; delete it"
    assert f"v.zarr: {changed}, or choose" in err
    base = ("reconstruct", *captures[1:], "-o", "{name}.tif", "-m")
    assert run(*base, "mle")[0] == 0
    code, err = run(*base, "network-small")
    assert code == 1
    differing = 'its method was "mle", and is "network-small" now; delete it and 2.tif.json'
    assert f"a/2.tif: belongs to another run: {differing}" in err
    captures[1].touch()
    code, err = run(*base, "mle")
    assert code == 1
    assert f"a/2.tif: {changed} and 2.tif.json, or choose" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "v.zarr"), "expected a name with {name} for the 3 captures"),
        (("-o", "{name}.png", "-m", "wrong"), "method: there is no 'wrong'"),
        (("-o", "{name}.png", "-m", "mle", "--weight", 3), "weight: is an option of admm-tv"),
        (("-o", "{name}.gif"), "{name}.gif: expected a name that ends in .png"),
        (("-o", "{name}.png", "--efficiency", 3), "efficiency: expected a number from"),
        (("-o", "{name}.png", "--model", "no.safetensors"), "no network file no.safetensors"),
        (("-o", "{name}.png", "--format", "wrong"), "format: expected one of"),
        (("-o", "{name}.png", "--trials", 3), "trials: are for one capture of counts"),
        (("-o", "{name}.png", "--frame-range", "x"), "frame-range: expected A:B"),
        (("-o", "v/{name}.npy", "--window", 16), "expected a name that ends in .zarr"),
        (("-o", "v/{name}.zarr"), "pass --window"),
        (("-o", "v/{name}.zarr", "--window", 65), "expected 1 to the capture's 64 frames"),
        (("-o", "v/{name}.zarr", "--window", 16, "--chunks", "7B"), "which is one frame"),
        (("-o", "v/{name}.zarr", "--window", 16, "--part", "4/3"), "expected a part such as"),
        (("-o", "v/{name}.zarr", "--window", 16, "--workers", 0), "workers: expected 1 or more"),
        (("-o", "{name}.tif", "--motion"), "motion: is for one image of one capture, but --wind"),
        (("-o", "{name}.png", "--curve", "wrong"), "curve: expected one of linear, gamma"),
        (("-o", "{name}.png", "--white", 0), "white: expected a finite intensity above 0, got 0"),
        (("-o", "{name}.tif", "--white", 2), "white: is for a .png or .jpg, not for the floats"),
        (("-o", "{name}.zarr", "--window", 9, "--white", 2), "which takes --window and --white"),
        (("-o", "{name}.png", "--preview", "p.png"), "preview: is for one image of one capture"),
        (
            ("-o", "v/{name}.zarr", "--window", 16, "--part", "1/3", "--workers", 2),
            "for job arrays without dask",
        ),
    ],
)
def test_bad_options_are_refused_before_work(run, captures, arguments, message):
    code, err = run("reconstruct", "captures/*/*.npy", *arguments)
    assert code == 1
    assert message in " ".join(err.split())
    assert err.startswith("error: ")
    assert len(err.splitlines()) == 1
    assert sorted(path.name for path in Path.cwd().iterdir()) == ["captures"]


@pytest.mark.parametrize("options", [("-o", "{name}.wrong"), ("-o", "{name}.npy", "--to", "wrong")])
def test_a_wrong_format_of_all_copies_is_one_error(run, captures, options):
    code, err = run("convert", *captures, *options)
    assert code == 1
    assert err.startswith("error: ")
    assert len(err.splitlines()) == 1


def test_an_option_that_fits_no_capture_is_one_error_beside_a_damaged_capture(run, captures):
    captures[0].write_bytes(captures[0].read_bytes()[:200])
    base = ("reconstruct", *captures, "-m", "mle", "-o", "{name}.zarr", "--window")
    code, err = run(*base, 65)
    assert code == 1
    damage, error = err.splitlines()
    assert damage.startswith("failed: a/1: ")
    assert "expected a complete .npy file" in damage
    assert error == "error: window: expected 1 to the capture's 64 frames, got 65"
    assert not Path("a").exists()


def test_captures_that_fail_for_different_reasons_are_all_named(run, captures):
    captures[0].write_bytes(captures[0].read_bytes()[:200])
    captures[1].write_bytes(b"nothing")
    code, err = run("reconstruct", *captures[:2], "-m", "mle", "-o", "{name}.png")
    assert code == 1
    assert err.startswith("error: 2 of 2 captures failed: 1: ")
    assert "; 2: " in err


def test_an_option_that_does_not_fit_some_captures_does_not_stop_the_others(run, captures):
    jl.save(jl.Bits.from_array(np.zeros((32, 16, 24), bool), jl.Sensor(frames=32)), captures[0])
    base = ("reconstruct", *captures, "-m", "mle", "-o", "{name}.zarr", "--window")
    code, err = run(*base, 64)
    assert code == 1
    assert "failed: a/1: window: expected 1 to the capture's 32 frames, got 64" in err
    assert "3 captures: 2 made, 1 failed" in err


def test_a_glob_that_matches_nothing_is_named(run):
    code, err = run("reconstruct", "*.nothing", "-o", "a.tif", "--motion")
    assert code == 1
    assert "there is no file *.nothing: the pattern matches nothing" in err


def test_a_capture_is_never_overwritten(run, captures):
    before = captures[0].read_bytes()
    code, err = run("convert", *captures, "-o", "captures/{name}.npy")
    assert code == 1
    assert "is read, so it is not overwritten" in err
    assert captures[0].read_bytes() == before


def test_no_capture_is_an_error(run):
    assert run("reconstruct", "-o", "a.png")[0] == 1
    assert run("convert", "-o", "a.npy")[0] == 1
    assert run("gather")[0] == 1
    code, err = run("gather", "*.part")
    assert (code, err) == (1, "error: there is no file *.part: the pattern matches nothing\n")


def test_a_wrong_number_of_threads_is_refused_before_anything_is_written(run, captures):
    code, out = run("reconstruct", captures[0], "-o", "v.zarr", "--window", 16, "--threads", 0)
    assert code == 1
    expected = "error: threads: expected a whole number from 1 to 1024, got 0; leave it out for all"
    assert out.startswith(expected)
    assert [path.name for path in Path().iterdir()] == ["captures"]


@pytest.mark.parametrize("command", ["reconstruct", "convert"])
def test_a_step_without_a_window_is_refused(run, captures, command):
    code, out = run(command, captures[0], "-o", "v.zarr", "--step", 4)
    assert code == 1
    assert out.startswith("error: step: is for the windows of a capture; add --window 4")


@pytest.mark.parametrize("kind", ["counts", "readings of several bits"])
def test_a_run_over_captures_says_which_one_has_no_bits(run, captures, kind):
    sensor = jl.Sensor(frames=64, bit_depth=1 if kind == "counts" else 4)
    data = sensor.expose(np.full((16, 24), 0.5), rng=0)
    jl.save(data.counts() if kind == "counts" else data, "captures/other.npy")
    code, out = run("reconstruct", "captures/other.npy", captures[0], "-o", "{name}.tif", "-t", 64)
    assert code == 1
    assert f"other.npy: expected bits in a run over captures or windows, got {kind}; run" in out
    assert "--window" not in out
    assert run("reconstruct", "captures/other.npy", "-o", "o.tif", "-t", 64)[0] == 0


def test_the_windows_of_counts_are_those_of_a_film(run, captures):
    np.save("stack.npy", np.full((8, 16, 24), 3, np.uint16))
    np.save("image.npy", np.full((16, 24), 3, np.uint16))
    options = ("-t", 64, "--window", 4, "-m", "mle")
    for name, proposed in (("stack.npy", True), ("image.npy", False)):
        code, out = run("reconstruct", name, "-o", "v.zarr", *options)
        assert code == 1
        assert f"{name}: expected bits in a run over captures or windows, got counts" in out
        assert ("use `jotlight film` for windows of its images" in out) == proposed
    assert run("film", "stack.npy", "-o", "film.npy", *options)[0] == 0
    assert len(np.load("film.npy")) == 2


@pytest.mark.parametrize(("gain", "is_film"), [("64,8,1", False), ("64,8,1,...", True)])
def test_a_film_is_proposed_only_for_a_bracket_that_repeats(run, captures, photo, gain, is_film):
    run("simulate", photo, "-o", "captures/bracket.npy", "-k", 1, "-t", 48, "--gain", gain)
    code, out = run("reconstruct", "captures/bracket.npy", captures[0], "-o", "{name}.tif")
    assert code == 1
    assert "`jotlight reconstruct` of this capture by itself" in out
    assert "--window" not in out
    assert ("`jotlight film`" in out) == is_film
    film = run("film", "captures/bracket.npy", "--window", 12, "-o", "film.npy", "-m", "mle")
    assert (film[0] == 0) == is_film
    assert run("reconstruct", "captures/bracket.npy", "-o", "a.tif")[0] == 0
