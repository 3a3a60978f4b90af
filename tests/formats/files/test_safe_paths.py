"""Symbolic links in captures: they may not lead out of the folder that was passed."""

import errno
import os
import shutil

import numpy as np
import pytest

import jotlight as jl
from examples.captures import BITS, BITS_WITH_MAPS, COUNTS, FULL_FRAMES
from jotlight.datasets.cifar10_files import read_folder
from jotlight.formats.files.safe_paths import LINK_FOLDERS, MAX_SEARCHED, list_below
from jotlight.formats.writing import write_capture
from jotlight.images.sets import read_image_set


def write_npy(folder):
    write_capture(BITS_WITH_MAPS, folder / "a.npy", name="npy")
    return folder / "a.npy"


def write_folder(name, capture):
    def write(folder):
        write_capture(capture, folder / "a", name=name)
        return folder / "a"

    return write


def write_files(name, capture, extension):
    def write(folder):
        (folder / "a").mkdir()
        for number in (1, 2):
            write_capture(capture, folder / "a" / f"{number}{extension}", name=name)
        return folder / "a"

    return write


def open_raw(path):
    return jl.open(path, format="swissspad2-full")


def write_cifar(folder):
    (folder / "a").mkdir()
    (folder / "a" / "test_batch.bin").write_bytes(bytes(3073))
    return folder / "a"


def read_cifar(path):
    return list(read_folder(path, "test", ["test_batch"]))


CAPTURES = {
    "the description of a cube": (write_npy, jl.open, "a.json"),
    "a map of a cube": (write_npy, jl.open, "a.mask.npy"),
    "the JSON file of visionsim": (write_folder("visionsim", BITS), jl.open, "a/transforms.json"),
    "the frames of visionsim": (write_folder("visionsim", BITS), jl.open, "a/frames.npy"),
    "a part of MATLAB": (write_folder("matlab", BITS), jl.open, "a/part_1.mat"),
    "the JSON file of MATLAB": (write_folder("matlab", BITS), jl.open, "a/info.json"),
    "a raw file": (write_files("swissspad2-full", FULL_FRAMES, ".bin"), open_raw, "a/2.bin"),
    "a detected raw file": (write_files("spad512s", FULL_FRAMES, ".bin"), jl.open, "a/1.bin"),
    "a TIFF": (write_files("tiff", COUNTS, ".tif"), jl.open, "a/1.tif"),
    "a PNG": (write_files("png", COUNTS, ".png"), jl.open, "a/1.png"),
    "an image of a set": (
        write_files("png", COUNTS % 256, ".png"),
        lambda path: read_image_set(path)[1],
        "a/1.png",
    ),
    "a file of CIFAR-10": (write_cifar, read_cifar, "a/test_batch.bin"),
    "the description of a zarr folder": (write_folder("zarr", BITS), jl.open, "a/zarr.json"),
    "a chunk of a zarr folder": (write_folder("zarr", BITS), jl.open, "a/c/0/0/0"),
    "the chunks of a zarr folder": (write_folder("zarr", BITS), jl.open, "a/c"),
    "an array of a zarr folder": (write_folder("zarr", BITS_WITH_MAPS), jl.open, "a/mask"),
}
"""What is replaced by a link: a writer, a reader, and the file or folder."""


def numbers(capture):
    """Return the numbers of a capture or of a list of images."""
    return np.asarray(capture.to_array() if isinstance(capture, jl.Bits) else capture)


@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
@pytest.mark.parametrize("what", CAPTURES)
def test_a_link_may_lead_only_where_the_user_allows_it(what, tmp_path, monkeypatch):
    if "zarr" in what:
        pytest.importorskip("zarr")
    write, read, name = CAPTURES[what]
    (tmp_path / "own").mkdir()
    (tmp_path / "private").mkdir()
    path = write(tmp_path / "own")
    expected = numbers(read(path))
    replaced, target = tmp_path / "own" / name, tmp_path / "private" / "target"
    shutil.move(replaced, target)
    replaced.symlink_to(target)
    with pytest.raises(ValueError, match=rf"outside of the folder .*copy.*{LINK_FOLDERS}=\S+$"):
        read(path)
    monkeypatch.setenv(LINK_FOLDERS, os.pathsep.join(["/nowhere", str(tmp_path / "private")]))
    np.testing.assert_array_equal(numbers(read(path)), expected)
    monkeypatch.delenv(LINK_FOLDERS)
    if what == "an array of a zarr folder":
        return  # Its new name in the same folder would not be in the list of files.
    # A link may lead to another place in the same folder. The whole folder may be linked, too.
    replaced.unlink()
    shutil.move(target, replaced.with_name(".moved"))
    replaced.symlink_to(".moved")
    (tmp_path / "linked").symlink_to(tmp_path / "own")
    linked = tmp_path / "linked" / path.name
    np.testing.assert_array_equal(numbers(read(linked)), expected)


def test_a_capture_may_itself_be_a_link(tmp_path):
    (tmp_path / "disk").mkdir()
    for write in (write_npy, write_folder("visionsim", BITS)):
        path = write(tmp_path / "disk")
        (tmp_path / path.name).symlink_to(path)
        np.testing.assert_array_equal(
            jl.open(tmp_path / path.name, width=13).to_array(), BITS.to_array()
        )


@pytest.mark.parametrize("name", ["a.npy", "a.npy.gz"])
@pytest.mark.parametrize("old", [True, False])
def test_a_capture_is_saved_and_read_through_a_link(tmp_path, name, old):
    (tmp_path / "disk").mkdir()
    target, link = tmp_path / "disk" / name, tmp_path / f"link{name[1:]}"
    mask = np.zeros((8, 8), bool)
    mask[2, 3] = True
    if old:
        jl.save(jl.Sensor(frames=3).expose(np.ones((8, 8)), rng=0), target)
    link.symlink_to(target)
    bits = jl.Sensor(frames=3, mask=mask).expose(np.ones((8, 8)), rng=1)
    jl.save(bits, link)
    assert link.is_symlink()
    for path in (link, target):
        assert jl.open(path) == bits
    assert list(tmp_path.iterdir()) in ([tmp_path / "disk", link], [link, tmp_path / "disk"])


def test_a_link_to_a_capture_may_have_a_link_to_its_description(tmp_path):
    mask = np.zeros((8, 8), bool)
    mask[2, 3] = True
    sensor = jl.Sensor(frames=3, mask=mask)
    (tmp_path / "linked").mkdir()
    for name in ("own", "other"):
        (tmp_path / name).mkdir()
        jl.save(jl.Bits.from_array(np.ones((3, 8, 8), bool), sensor), tmp_path / name / "a.npy")
    (tmp_path / "linked" / "a.npy").symlink_to("../own/a.npy")
    (tmp_path / "linked" / "a.json").symlink_to("../own/a.json")
    assert jl.open(tmp_path / "linked" / "a.npy").sensor == sensor
    (tmp_path / "linked" / "a.json").unlink()
    (tmp_path / "linked" / "a.json").symlink_to("../other/a.json")
    with pytest.raises(ValueError, match=r"a\.json: leads to .*other.*outside of the folder"):
        jl.open(tmp_path / "linked" / "a.npy")


def test_links_that_lead_nowhere_are_refused(tmp_path):
    path = write_npy(tmp_path)
    (tmp_path / "a.mask.npy").unlink()
    (tmp_path / "a.mask.npy").symlink_to("a.mask.npy")
    with pytest.raises((OSError, ValueError), match=r"a\.mask\.npy"):
        jl.open(path)


def test_files_below_a_folder_are_listed_for_each_path_that_leads_to_them(tmp_path):
    (tmp_path / "a" / "b").mkdir(parents=True)
    for name in ("1.bin", "2.TIF", "a/3.BIN", "a/b/4.bin"):
        (tmp_path / name).touch()
    (tmp_path / "other").symlink_to("a")
    (tmp_path / "5.bin").symlink_to("1.bin")
    (tmp_path / "6.bin").mkdir()
    (tmp_path / "7.bin").symlink_to("nowhere")
    found = {path.relative_to(tmp_path).as_posix() for path in list_below(tmp_path, (".bin",))}
    below = {f"{folder}/{name}" for folder in ("a", "other") for name in ("3.BIN", "b/4.bin")}
    assert found == {"1.bin", "5.bin"} | below


@pytest.mark.parametrize("links", [{"loop": "."}, {"a/x": "../b", "a/y": "../b", "b/z": "../a"}])
def test_folders_with_links_in_a_loop_are_refused(tmp_path, links):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    (tmp_path / "1.bin").touch()
    for name, target in links.items():
        (tmp_path / name).symlink_to(target)
    with pytest.raises(ValueError, match="remove links that form a loop"):
        list(list_below(tmp_path))


@pytest.mark.parametrize("image", [[], ["a.png"], ["a.tif"]])
def test_the_search_for_a_capture_in_a_wrong_folder_is_bounded(tmp_path, monkeypatch, image):
    for name in image:
        (tmp_path / name).touch()
    for number in range(2 * MAX_SEARCHED):
        (tmp_path / str(number)).mkdir()
    read, scan = [], os.scandir

    def scandir(path):
        read.append(path)
        return scan(path)

    monkeypatch.setattr(os, "scandir", scandir)
    message = rf"got a folder with more than {MAX_SEARCHED} folders that contain no .*\.bin;"
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path)
    assert len(read) <= MAX_SEARCHED + 10


def test_folders_with_files_of_a_capture_do_not_bound_its_search(tmp_path):
    for number in range(MAX_SEARCHED + 10):
        (tmp_path / str(number)).mkdir()
        (tmp_path / str(number) / "1.bin").touch()
    found = list(list_below(tmp_path, (".bin",), max_others=MAX_SEARCHED))
    assert len(found) == MAX_SEARCHED + 10


def test_a_folder_that_cannot_be_read_is_named_with_the_one_above(tmp_path, monkeypatch):
    (tmp_path / "private").mkdir()
    scan = os.scandir

    def scandir(path):
        if str(path).endswith("private"):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return scan(path)

    monkeypatch.setattr(os, "scandir", scandir)
    message = r"expected the folder of a capture, but .*private in it cannot be read \(Permission"
    with pytest.raises(PermissionError, match=message):
        jl.open(tmp_path)


def test_the_soft_links_of_hdf5_stay_in_the_file(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["secret"] = COUNTS
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["own"] = COUNTS
        file["soft"] = h5py.SoftLink("/own")
        file["external"] = h5py.ExternalLink("other.h5", "/secret")
    np.testing.assert_array_equal(jl.open(tmp_path / "a.h5"), COUNTS)
    for key in ("external", "secret"):
        with pytest.raises(ValueError, match=r"--key.*own"):
            jl.open(tmp_path / "a.h5", key=key)
