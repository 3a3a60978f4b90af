import pytest

from jotlight import datasets


@pytest.mark.parametrize("read", [datasets.bsds300, datasets.cifar10])
class TestArguments:
    def test_an_unknown_split_is_refused(self, read, tmp_path):
        with pytest.raises(ValueError, match="split: expected 'train' or 'test', got 'val'"):
            read("val", tmp_path)

    @pytest.mark.parametrize("first", [0, -1])
    def test_less_than_one_image_is_refused_before_anything_is_fetched(self, read, first):
        with pytest.raises(ValueError, match=f"first: expected at least 1 image, got {first}"):
            read("test", first=first)

    def test_a_folder_that_is_not_there_is_named(self, read, tmp_path):
        with pytest.raises(FileNotFoundError, match=r"there is no folder .*nowhere"):
            read("test", tmp_path / "nowhere")


# BSDS300
