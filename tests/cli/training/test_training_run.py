"""`jotlight train`: outputs that are symbolic links."""

import pytest

import jotlight as jl
from folders import file_names
from training_runs import interrupted_at

SMALL = ["--patch", 24, "--batch", 4, "--steps", 2, "--optimizer", "adam"]
CHECKPOINT = "real.checkpoint.safetensors"


@pytest.fixture
def disk(tmp_path):
    """Make a link to a network in another folder, which need not exist."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "link.safetensors").symlink_to("disk/real.safetensors")
    return tmp_path / "disk"


def test_a_stopped_run_is_known_by_all_names_of_its_output(run, photo_folder, disk):
    with interrupted_at(1, jl.training):
        output = run("train", photo_folder, "-o", "link.safetensors", *SMALL)[1]
    assert f"The run so far is kept in {disk / CHECKPOINT}" in output
    assert file_names(disk) == [CHECKPOINT]
    assert file_names(disk.parent) == ["disk", "link.safetensors", "photos"]
    output = run("train", photo_folder, "-o", "disk/real.safetensors", *SMALL)[1]
    assert "add --resume to continue it" in output
    assert run("train", photo_folder, "-o", "link.safetensors", *SMALL, "--resume")[0] == 0
    assert file_names(disk) == ["real.safetensors"]


def test_a_checkpoint_that_is_a_link_leaves_no_file(run, photo_folder, disk):
    (disk / CHECKPOINT).symlink_to("kept.safetensors")
    assert run("train", photo_folder, "-o", "link.safetensors", *SMALL)[0] == 0
    assert file_names(disk) == [CHECKPOINT, "real.safetensors"]


def test_a_run_removes_what_a_killed_one_left_where_its_output_leads(
    run, photo_folder, disk, monkeypatch
):
    monkeypatch.setattr("platform.node", lambda: "vm")
    for end in ("", ".lock"):
        (disk / f".real.jotlight-vm-0.safetensors{end}").touch()
    assert run("train", photo_folder, "-o", "link.safetensors", *SMALL, "--resume")[0] == 1
    assert file_names(disk) == []


@pytest.mark.parametrize("name", ["real", "real.npy", CHECKPOINT])
def test_links_to_files_that_are_no_networks_are_refused(run, photo_folder, disk, name):
    link = disk.parent / "link.safetensors"
    link.unlink()
    link.symlink_to(f"disk/{name}")
    status, output = run("train", photo_folder, "-o", link.name, *SMALL)
    assert status == 1
    assert output == (
        f"error: {disk / name}: expected a name that ends in .safetensors, but not in "
        ".checkpoint.safetensors, which is for stopped runs\n"
    )
