"""Warnings about frames that the files of a folder seem to lack."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.errors import record_warnings
from jotlight.formats.files.file_sequence import describe_files, join_files


def joined(names, lengths=None, **options):
    """Return the warnings about files of these names and numbers of frames."""
    files = [Path(f"folder/{name}") for name in names]
    parts = [np.zeros((length, 1, 1), np.uint8) for length in lengths or [1] * len(names)]
    with record_warnings() as warnings:
        assert len(join_files(Path("folder"), files, parts, **options)) == sum(map(len, parts))
    return warnings


@pytest.mark.parametrize(
    ("names", "numbers", "message"),
    [
        (("a1.png", "a2.png", "a5.png"), None, "expected 5 files .* from 1 to 5, got 3; .* a2.png"),
        (("3_a1", "3_a2", "3_a3", "3_a5"), None, "expected 5 files .* from 1 to 5, got 4; .* 3_a3"),
        (("a0", "a100", "a200", "a500"), None, "expected 6 files .* from 0 to 500, got 4; .* a200"),
        (("x/a1", "y/a2", "y/a5"), None, "from 1 to 5, got 3; the first gap is after y/a2,"),
        (("b", "a"), [0, 2], "expected 3 files .* from 0 to 2, got 2; .* b,"),
    ],
)
def test_gaps_in_the_numbers_of_files_are_stated(names, numbers, message):
    (warning,) = joined(names, numbers=numbers)
    assert re.search(message, warning)


def test_the_first_and_last_file_are_named_by_their_paths_below_the_folder(tmp_path):
    files = [tmp_path / "x" / "f0.bin", tmp_path / "y" / "f0.bin"]
    assert describe_files(tmp_path, files) == (
        "2 files in the natural order of their names, from x/f0.bin to y/f0.bin"
    )
    assert describe_files(tmp_path, files, "an order").startswith("2 files in an order, from x/")


@pytest.mark.parametrize(
    "names",
    [
        ("a1", "a2", "a3"),
        ("a0", "a100", "a200"),
        ("a1", "b3", "b4", "b7"),  # other texts
        ("1_1", "1_2", "2_1", "2_4"),  # two numbers
        ("t0.0.png", "t33.3.png", "t66.6.png"),
        ("a1", "a4", "a2", "a3"),  # an order by something else
        ("t10", "t43", "t77", "t110", "t177"),  # times
        ("a1", "a8", "a29", "a30"),  # a choice of images
        ("i_095958", "i_095959", "i_100000", "i_100001"),  # times of a clock
        ("20260130", "20260131", "20260201", "20260202"),  # dates
        ("t10", "t20", "t30", "t60", "t120"),  # exposures
        ("z0.1", "z0.2", "z0.25", "z0.3"),  # positions
    ],
)
def test_other_numbers_in_names_count_nothing(names):
    assert joined(names) == []


@pytest.mark.parametrize(
    ("lengths", "message"),
    [
        (
            (4, 0, 4, 4),
            "folder/b: expected at least 4 frames, as in other files, got 0; the file may",
        ),
        (
            (4, 1, 4, 4),
            "folder/b: expected at least 4 frames, as in other files, got 1; the file may",
        ),
        ((2, 4, 3, 4), "folder/a: .* the file may lack frames, as may 1 other file$"),
        ((1, 4), "folder/a: expected at least 4 frames, .*, got 1"),
        (
            (0, 3, 0, 5, 7),
            "folder/a: expected at least 1 frame, .*, got 0; .*, as may 1 other file$",
        ),
    ],
)
def test_files_with_fewer_frames_than_others_are_stated(lengths, message):
    with pytest.warns(jl.JotlightWarning, match=message):
        join_files(
            Path("folder"),
            [Path(f"folder/{name}") for name in "abcde"[: len(lengths)]],
            [np.zeros((length, 1, 1), np.uint8) for length in lengths],
        )


@pytest.mark.parametrize("lengths", [(4, 4, 2), (4, 4, 0), (9, 5, 7), (4, 4, 5)])
def test_the_last_file_may_hold_fewer_frames_and_files_may_differ(lengths):
    assert joined("abc", lengths) == []


@pytest.mark.parametrize(
    ("finished", "number"), [((True, False, True), 1), ((False,) * 3, 0), ((True,) * 3, 0)]
)
def test_files_without_the_end_of_others_are_stated(finished, number):
    warnings = joined("abc", finished=finished)
    assert len(warnings) == number
    assert all("folder/b: unlike other files, it does not end" in text for text in warnings)


def test_folders_of_images_state_gaps(tmp_path):
    for number in (1, 2, 4):
        Image.fromarray(np.ones((3, 9), bool)).save(tmp_path / f"f{number}.png")
    with pytest.warns(
        jl.JotlightWarning, match=r"expected 4 files .* from 1 to 4, got 3; .* after f2\.png"
    ):
        jl.open(tmp_path)
