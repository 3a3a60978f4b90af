"""Runs in parts, as those of job arrays, and `jotlight gather`."""

import shutil
from pathlib import Path

import pytest
import zarr


def test_a_slurm_job_array_computes_parts(run, captures, monkeypatch):
    base = ("reconstruct", captures[0], "-o", "v.zarr", "--window", 4, "-m", "mle")
    base += ("--chunks", "1KiB", "--part", "slurm")
    monkeypatch.setenv("SLURM_ARRAY_TASK_COUNT", "3")
    for task in (1, 2, 3):
        monkeypatch.setenv("SLURM_ARRAY_TASK_ID", str(task))
        code, out = run(*base)
        assert code == 0
        assert f"part {task} of 3" in out
        if task == 2:
            code, err = run("gather", ".")
            assert code == 1
            assert "groups are missing" in err
    code, out = run("gather", "*.part")
    assert (code, out) == (0, "1 of 1 result completed\n")
    assert zarr.open_array("v.zarr", mode="r").shape == (16, 16, 24)


@pytest.mark.parametrize("output", ["v/{name}.zarr", "v/{name}.tif"])
def test_gather_names_results_that_no_part_has_made(run, captures, output):
    window = ("--window", 16) if output.endswith(".zarr") else ()
    base = ("reconstruct", "captures/*/*.npy", "-o", output, "-m", "mle", *window, "--part")
    assert run(*base, "1/2")[0] == 0
    code, out = run("gather", "v")
    missing = output.format(name="a/2")
    assert code == 1
    assert "2 of 3 captures have results" in out
    assert f"1 result not complete: {missing}: no part has made it, or its part failed" in out
    assert run(*base, "2/2")[0] == 0
    assert run("gather", "v") == (0, "3 of 3 captures have results\n")
    assert "nothing to complete" in run("gather", "v")[1]


@pytest.mark.parametrize("total", [2, 4])
def test_captures_that_appear_between_parts_are_left_out_until_the_next_run(run, captures, total):
    base = ("reconstruct", "captures/*/*.npy", "-o", "v/{name}.zarr", "-m", "mle")
    base += ("--window", 16, "--chunks", "1KiB", "--part")
    assert run(*base, f"1/{total}")[0] == 0
    new = Path("captures/a/0.npy")
    for ending in (".npy", ".json"):
        new.with_suffix(ending).write_bytes(captures[0].with_suffix(ending).read_bytes())
    for number in range(2, total + 1):
        code, out = run(*base, f"{number}/{total}")
        assert code == 0
        assert (
            "1 capture appeared after the first part of this run began, and is left out: a/0" in out
        )
    code, out = run("gather", "v")
    assert (code, "3 of 3 captures have results" in out) == (0, True)
    for number in range(1, total + 1):
        assert run(*base, f"{number}/{total}")[0] == 0
    code, out = run("gather", "v")
    assert (code, "4 of 4 captures have results" in out) == (0, True)


def test_gather_names_the_list_of_captures_if_one_has_vanished(run, captures):
    base = ("reconstruct", "captures/a/*.npy", "-o", "v/{name}.tif", "-m", "mle", "--part")
    assert run(*base, "1/2")[0] == 0
    Path("captures/a/2.npy").unlink()
    code, out = run("gather", "v")
    (folder,) = Path("v").glob(".captures-*")
    assert code == 1
    assert f"run the parts again; if a capture no longer exists, first delete {folder}" in out
    shutil.rmtree(folder)
    for part in ("1/2", "2/2"):
        assert run(*base, part)[0] == 0
    assert run("gather", "v") == (0, "1 of 1 capture has a result\n")


def test_gather_completes_results_that_are_links(run, captures):
    Path("v").mkdir()
    Path("v/1.zarr").symlink_to(Path("large").absolute() / "one.zarr")
    base = ("reconstruct", captures[0], "-o", "v/1.zarr", "--window", 4, "-m", "mle")
    base += ("--chunks", "1KiB", "--part")
    assert run(*base, "1/2")[0] == 0
    code, out = run("gather", "v")
    assert (code, "one.zarr.part: " in out, "no part has made it" in out) == (1, True, False)
    assert run(*base, "2/2")[0] == 0
    assert run("gather", "v")[0] == 0
    assert zarr.open_array("v/1.zarr", mode="r").shape == (16, 16, 24)


def test_tasks_of_a_slurm_job_array_process_captures_of_their_own(run, captures, monkeypatch):
    monkeypatch.setenv("SLURM_ARRAY_TASK_COUNT", "3")
    for task, path in enumerate(captures, 1):
        monkeypatch.setenv("SLURM_ARRAY_TASK_ID", str(task))
        base = ("reconstruct", path, "-o", f"{task}.zarr", "--window", 16, "-m", "mle")
        code, err = run(*base)
        assert (code, "error: part: is needed in a Slurm job array" in err) == (1, True)
        assert not Path(f"{task}.zarr.part").exists()
        assert run(*base, "--part", "1/1")[0] == 0
        assert zarr.open_array(f"{task}.zarr", mode="r").shape == (4, 16, 24)


def test_parts_without_a_capture_make_no_image(run, captures):
    base = ("reconstruct", *captures, "-o", "{name}.png", "-m", "mle", "--part")
    code, out = run(*base, "2/64")
    assert (code, "1 made" in out, "gather" in out) == (0, True, False)
    code, out = run(*base, "7/64")
    assert (code, "0 made" in out, "gather" in out) == (0, True, False)
