import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from jotlight.runs.shared_runs import SharedRun, check_results, find_runs, read_run


@pytest.mark.parametrize(
    ("output", "folder", "rest"),
    [
        ("v/{name}.zarr", "v", "{name}.zarr"),
        ("{name}.zarr", ".", "{name}.zarr"),
        ("v/{name}/a/video.zarr", "v", "{name}/a/video.zarr"),
        ("v/day-{name}/video.zarr", "v", "day-{name}/video.zarr"),
        ("v/one.zarr", "v", "one.zarr"),
    ],
)
def test_the_captures_lie_in_the_folder_of_all_results(output, folder, rest):
    run = SharedRun.of(Path(output), ["a"])
    assert (run.folder, run.output) == (Path(folder), rest)
    assert run.outputs() == [Path(output.replace("{name}", "a"))]


def test_all_parts_divide_the_captures_of_the_first_one(tmp_path):
    output = tmp_path / "new" / "v" / "{name}.zarr"
    first, folder = SharedRun.of(output, ["b", "c"]).join(["data/*.npy"])
    assert first.captures == ["b", "c"]
    for names in (["a", "b", "c"], ["c"]):
        assert SharedRun.of(output, names).join(["data/*.npy"]) == (first, folder)
    other, _ = SharedRun.of(output, ["a"]).join(["other/*.npy"])
    assert other.captures == ["a"]
    assert SharedRun.of(tmp_path / "new/v/{name}.tif", ["a"]).join(["data/*.npy"])[0] != first


def test_parts_that_begin_together_agree(tmp_path):
    def join(number):
        names = [f"c{each}" for each in range(number + 1)]
        return SharedRun.of(tmp_path / "{name}.zarr", names).join(["*.npy"])

    with ThreadPoolExecutor(16) as threads:
        runs = list(threads.map(join, range(16)))
    assert all(run == runs[0] for run in runs)
    assert len(list(tmp_path.iterdir())) == 1


def test_results_that_do_not_exist_are_found(tmp_path):
    run, folder = SharedRun.of(tmp_path / "v/{name}.tif", ["a", "b"]).join(["*.npy"])
    (tmp_path / "v/a.tif").touch()
    assert find_runs([tmp_path, tmp_path / "v"]) == [folder]
    assert check_results([folder]) == (2, [tmp_path / "v/b.tif"])
    assert read_run(folder) == run
    (tmp_path / "v/b.tif").touch()
    assert check_results([folder]) == (2, [])
    assert find_runs([tmp_path]) == []


@pytest.mark.parametrize("content", [{}, {"output": "a.tif", "captures": [1]}, {"captures": ["a"]}])
def test_a_damaged_list_is_refused(content, tmp_path):
    folder = tmp_path / ".captures-0"
    folder.mkdir()
    (folder / "captures.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match="is damaged; delete it, and run all parts again"):
        read_run(folder)
