"""SwissSPAD2: folders of files."""

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames
from reference import formats as twin

HALF = (256, 512)


def test_files_of_a_folder_are_sorted_by_the_number_in_their_names(tmp_path):
    array = random_frames((12, *HALF))
    for number in range(12):
        folder = tmp_path / str(number // 8) / str(number // 3)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"filename{number}.bin").write_bytes(
            twin.encode_half_array(array[number : number + 1])
        )
    (tmp_path / "notes.txt").write_text("no frames")
    bits = jl.open(tmp_path, format="swissspad2")
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits[3:11].counts(), array[3:11].sum(0))
    assert "12 files" in str(bits.provenance.notes)


def test_missing_files_warn_and_duplicate_numbers_are_refused(tmp_path):
    content = twin.encode_half_array(random_frames((1, *HALF)))
    for number in (0, 1, 4):
        (tmp_path / f"filename{number}.bin").write_bytes(content)
    with pytest.warns(jl.JotlightWarning, match="expected 5 files with numbers from 0 to 4, got 3"):
        jl.open(tmp_path, format="swissspad2")
    (tmp_path / "other4.bin").write_bytes(content)
    with pytest.raises(ValueError, match="one capture at a time"):
        jl.open(tmp_path, format="swissspad2")
