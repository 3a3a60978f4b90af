"""The state of the files of a capture, and the captures that a pattern matches."""

from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.opening.locations import expand, files_state, without_companions
from jotlight.runs.names import find_captures


def test_links_to_nothing_in_a_folder_do_not_count(tmp_path):
    (tmp_path / "a.png").write_bytes(b"123")
    number, size, latest = files_state(tmp_path)
    (tmp_path / ".#a.png").symlink_to("nothing")
    assert (number, size) == (1, 3)
    assert files_state(tmp_path) == (number, size, latest)


def test_a_missing_capture_has_no_state(tmp_path):
    with pytest.raises(FileNotFoundError):
        files_state(tmp_path / "a.npy")


def test_links_that_lead_to_no_file_are_named(tmp_path):
    for name, target in {"loop.npy": "loop.npy", "lost.npy": "gone.npy"}.items():
        (tmp_path / name).symlink_to(target)
    with pytest.raises(FileNotFoundError, match=r"loop\.npy: the symbolic links .* form a loop"):
        jl.open(tmp_path / "loop.npy")
    with pytest.raises(FileNotFoundError, match=r"lost\.npy: it is a symbolic link to gone\.npy"):
        jl.open(tmp_path / "lost.npy")


def test_a_pattern_where_one_file_is_expected_has_advice(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"a\*\.npy; a pattern of several.*: name one; "):
        jl.open(tmp_path / "a*.npy")
    with pytest.raises(FileNotFoundError, match=r"a\.npy$"):
        jl.open(tmp_path / "a.npy")


def test_a_url_as_a_path_has_advice():
    with pytest.raises(
        FileNotFoundError,
        match=r"no file s3://bucket/a\.npy; .*jotlight\.open with a text take a URL$",
    ):
        jl.open(Path("s3://bucket/a.npy"))


@pytest.mark.parametrize("ending", ["npy", "npy.gz"])
def test_patterns_leave_out_the_files_that_belong_to_a_match(tmp_path, ending):
    mask = np.zeros((4, 8), bool)
    mask[1, 2] = True
    sensor = jl.Sensor(frames=3, dark_counts=np.full((4, 8), 0.01, np.float32), mask=mask)
    bits = sensor.expose(np.ones((4, 8)), rng=0)
    jl.save(bits, tmp_path / f"a.{ending}")
    np.save(tmp_path / "b.mask.npy", bits.packed)
    opened = jl.open(f"{tmp_path}/*")
    assert [capture.shape for capture in opened] == [(3, 4, 8)] * 2
    assert opened[0].sensor == sensor
    names = sorted(map(str, tmp_path.iterdir()))
    assert len(names) == 5
    expected = [str(tmp_path / f"a.{ending}"), str(tmp_path / "b.mask.npy")]
    assert find_captures(names) == find_captures([f"{tmp_path}/*"]) == expected


def test_a_map_that_alone_matches_is_kept(tmp_path, monkeypatch):
    mask = np.zeros((4, 8), bool)
    jl.save(jl.Sensor(mask=mask).expose(np.ones((4, 8)), rng=0), tmp_path / "a.npy")
    assert expand(f"{tmp_path}/*.mask.npy") == [str(tmp_path / "a.mask.npy")]
    monkeypatch.chdir(tmp_path)
    named = ["a.npy", str(tmp_path / "a.mask.npy")]
    assert without_companions(named) == ["a.npy"]


@pytest.mark.parametrize("ending", ["npy", "npy.gz"])
def test_a_pattern_leaves_out_maps_of_captures_that_it_does_not_match(tmp_path, ending):
    sensor = jl.Sensor(dark_counts=np.full((4, 8), 0.01), mask=np.eye(4, 8, dtype=bool))
    bits = sensor.expose(np.ones((4, 8)), rng=0)
    jl.save(bits, tmp_path / f"a_maps.{ending}")
    jl.save(jl.Bits(bits.packed), tmp_path / "b_other.npy")
    np.save(tmp_path / "c_other.mask.npy", bits.packed)
    names = [tmp_path / "b_other.npy", tmp_path / "c_other.mask.npy"]
    maps = sorted(tmp_path.glob("a_maps*.*.npy"))
    assert len(maps) == 2
    pattern = f"{tmp_path}/*_*[rsk].npy"
    if ending == "npy":
        names.insert(0, tmp_path / "a_maps.npy")
    assert find_captures([pattern]) == expand(pattern) == list(map(str, names))
    # A damaged description names nothing, and the map is not passed over in silence.
    description = tmp_path / ("a_maps.json" if ending == "npy" else "a_maps.npy.gz.json")
    description.write_text(description.read_text().replace("sha256", "sha255", 1))
    assert set(map(str, maps)) < set(expand(f"{tmp_path}/*.npy"))
