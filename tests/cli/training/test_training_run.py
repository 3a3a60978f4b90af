"""The outputs of `jotlight train`, also those that are symbolic links."""

import pytest

import jotlight as jl
from folders import file_names
from jotlight.cli.options.sensor_options import TunedSensorOptions
from jotlight.cli.training.training_options import FineTuningOptions
from jotlight.cli.training.training_run import check_outputs_of_run
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


@pytest.mark.parametrize("number", range(4))
def test_no_output_of_a_run_is_a_file_that_it_reads(tmp_path, number):
    capture, calibration, mask, image = (tmp_path / f"{name}.svg" for name in "abcd")
    sensor = TunedSensorOptions(calibration=calibration, mask=mask)
    read = (capture, calibration, mask, image)[number]
    read.touch()
    options = FineTuningOptions(output=tmp_path / "m.safetensors", plot=read)
    with pytest.raises(ValueError, match=rf"{read.name}: this file is read"):
        check_outputs_of_run([capture], options, sensor, [image])


def test_the_figure_of_a_run_has_the_ending_of_a_figure(tmp_path):
    options = FineTuningOptions(output=tmp_path / "m.safetensors", plot=tmp_path / "a.txt")
    with pytest.raises(ValueError, match=r"a\.txt: expected .*\.png"):
        check_outputs_of_run([], options, TunedSensorOptions())
