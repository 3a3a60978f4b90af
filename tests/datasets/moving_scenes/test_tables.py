"""Tables of poses in text files."""

import numpy as np
import pytest

from jotlight.datasets.moving_scenes.tables import read_poses

POSES = np.random.default_rng(0).normal(size=(5, 4))


@pytest.mark.parametrize("columns", [2, 4])
@pytest.mark.parametrize("separator", [" ", ",", ", ", "\t", "  "])
def test_files_of_numpy_are_read(tmp_path, columns, separator):
    poses = POSES[:, :columns]
    path = tmp_path / "poses.txt"
    np.savetxt(path, poses, delimiter=separator, header="rows and columns")
    np.testing.assert_array_equal(read_poses(path), poses)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2\n1,,2\n", "expected numbers that commas or spaces separate"),
        ("1, 2,\n", "expected numbers that commas or spaces separate"),
        ("1; 2\n", "expected numbers that commas or spaces separate"),
        ("1 2\n1\n", "as many in each line"),
        ("1 2 3\n", "optionally both degrees and zoom; got shape"),
        ("", "expected 2 or 4 numbers in each line"),
    ],
)
def test_other_texts_are_refused(tmp_path, text, message):
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"poses.txt: .*{message}"):
        read_poses(path)
