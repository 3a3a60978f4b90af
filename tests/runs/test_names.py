from pathlib import Path

import pytest

from jotlight.runs import names
from jotlight.runs.names import Part, find_captures, name_captures, name_outputs


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "a/b", "-1/3", "1/0", "1/3/5", ""])
def test_bad_parts_are_refused(text):
    with pytest.raises(ValueError, match="part: expected a part such as 3/64"):
        Part.parse(text)


@pytest.mark.parametrize(("captures", "total"), [(1, 3), (1, 64), (10, 3), (3, 64), (64, 64)])
def test_each_unit_belongs_to_exactly_one_part(captures, total):
    parts = [Part(number, total) for number in range(1, total + 1)]
    for capture in range(captures):
        for unit in range(20):
            owners = [part for part in parts if part.has(capture, unit, captures)]
            assert len(owners) == 1
            assert owners[0].has_capture(capture, captures)


def slurm(**values):
    """Return the environment of a task of a Slurm job array."""
    return {f"SLURM_ARRAY_TASK_{name}": str(value) for name, value in values.items()}


def test_slurm_states_the_part():
    assert Part.requested("slurm", slurm(ID=0, MIN=0, MAX=3, COUNT=4)) == Part(1, 4)
    assert Part.requested("slurm", slurm(ID=8, MIN=4, MAX=10, STEP=2, COUNT=4)) == Part(3, 4)
    assert Part.requested("slurm", slurm(ID=2, COUNT=4)) == Part(2, 4)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({}, "SLURM_ARRAY_TASK_ID is not set"),
        ({"ID": 3}, "SLURM_ARRAY_TASK_COUNT is not set"),
        ({"ID": 3, "MIN": 1, "MAX": 4, "COUNT": 3}, "got 3 tasks from 1 to 4"),
        ({"ID": 12, "MIN": 7, "COUNT": 2}, "got 2 tasks from 7 to 12"),
    ],
)
def test_job_arrays_that_state_no_part_are_refused(values, message):
    with pytest.raises(ValueError, match=message):
        Part.requested("slurm", slurm(**values))


def test_a_task_of_a_job_array_does_not_guess_its_part():
    for count in (3, ""):
        with pytest.raises(ValueError, match=r"pass --part slurm .* or --part 1/1"):
            Part.requested(None, slurm(ID=2, COUNT=count))
    assert Part.requested("1/1", slurm(ID=2, COUNT=3)) == Part(1, 1)
    assert Part.requested(None, slurm(ID=2, COUNT=1)) is None
    assert Part.requested(None, {}) is None


def test_globs_are_expanded_and_sorted(tmp_path):
    for name in ("b/1.npy", "a/2.npy", "a/1.npy"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.touch()
    found = find_captures([f"{tmp_path}/*/1.npy", f"{tmp_path}/a/*.npy"])
    assert [Path(each).relative_to(tmp_path).as_posix() for each in found] == [
        "a/1.npy",
        "b/1.npy",
        "a/2.npy",
    ]
    with pytest.raises(FileNotFoundError, match="matches nothing"):
        find_captures([f"{tmp_path}/*.bin"])


def test_a_file_whose_name_looks_like_a_glob_is_a_file(tmp_path):
    path = tmp_path / "a[1].npy"
    path.touch()
    assert find_captures([str(path)]) == [str(path)]


def test_only_equal_names_keep_their_endings():
    captures = ["x/a.npy", "x/b.npy", "x/a.npy.gz"]
    assert name_captures(captures, ["x/*"]) == ["a.npy", "b", "a.npy.gz"]
    # `a.npy` would be the short name of the last one.
    captures = ["x/a.npy", "x/a.npy.gz", "x/a.npy.bin"]
    assert name_captures(captures, ["x/*"]) == ["a.npy", "a.npy.gz", "a.npy.bin"]


@pytest.mark.parametrize(
    "start", ["day", "/data/day", "../day", "s3://bucket/day", "https://h/day"]
)
@pytest.mark.parametrize(
    ("pattern", "capture", "name"),
    [
        ("*/*.npy", "a/1.npy", "a/1"),
        ("*/b/*.npy", "a/b/1.npy", "a/b/1"),
        ("a/*.npy", "a/1.npy", "1"),
        ("**/*.npy", "1.npy", "1"),
        ("a[12]/c/1.npy", "a1/c/1.npy", "a1/c/1"),
        ("a/1.npy", "a/1.npy", "1"),
    ],
)
def test_the_name_of_a_capture_does_not_depend_on_other_matches(start, pattern, capture, name):
    patterns, alone = [f"{start}/{pattern}"], [f"{start}/{capture}"]
    assert name_captures(alone, patterns) == [name]
    other = f"{start}/{capture.replace('1.npy', '2.npy')}"
    assert name_captures([*alone, other], patterns)[0] == name


def test_several_patterns_share_a_folder():
    assert name_captures(["x/a/1.npy", "x/b/1.npy"], ["x/a/*.npy", "x/b/*.npy"]) == ["a/1", "b/1"]
    assert name_captures(["x/a/1.npy", "x/1.npy"], ["x/a/1.npy", "x/1.npy"]) == ["a/1", "1"]


def test_a_protocol_of_two_names_does_not_change_names():
    assert name_captures(["gs://bucket/day/a/1.npy"], ["gcs://bucket/day/*/1.npy"]) == ["a/1"]


def test_several_captures_need_a_place_for_their_names():
    with pytest.raises(ValueError, match=r"such as out/\{name\}.zarr"):
        name_outputs(Path("out/video.zarr"), ["a", "b"])
    assert name_outputs(Path("video.zarr"), ["a"]) == [Path("video.zarr")]


def test_the_options_of_file_systems_reach_globs(monkeypatch):
    found = []
    monkeypatch.setattr(names, "find_matches", lambda *arguments: found.append(arguments) or ["a"])
    assert names.find_captures(["s3://b/*.npy"], {"anon": True}) == ["a"]
    assert found == [("s3://b/*.npy", {"anon": True})]


def test_names_do_not_lead_out_of_the_folder_of_the_results(tmp_path, monkeypatch):
    (tmp_path / "a").mkdir()
    monkeypatch.chdir(tmp_path / "a")
    paths = ["x.npy", "../b/y.npy"]
    assert name_captures(paths, paths) == ["a/x", "b/y"]
    assert name_captures(["../a/x.npy"], ["./../a/*.npy"]) == ["x"]
    urls = ["s3://bucket/a/1.npy", "s3://bucket/a/../../2.npy"]
    with pytest.raises(ValueError, match=r"2.npy: expected a path without \.\. in a run"):
        name_captures(urls, urls)


def test_paths_and_urls_are_named_by_their_files():
    both = ["x/1.npy", "s3://bucket/2.npy"]
    assert name_captures(both, both) == ["1", "2"]
    equal = ["x/1.npy", "s3://bucket/1.npy"]
    with pytest.raises(ValueError, match=r"expected different names .* got several 1\.npy"):
        name_captures(equal, equal)
