"""The natural order of file names."""

from jotlight.formats.files.file_lists import natural_sort_key


def test_numbers_in_names_sort_by_value(tmp_path):
    names = ["a/2.bin", "a/10.bin", "b/1.bin", "b/1x2.bin", "b/1x10.bin"]
    paths = [tmp_path / name for name in names]
    assert sorted(paths, key=natural_sort_key) == paths
