import contextlib
import io
import pickle
import struct
import tarfile
import tracemalloc
from fractions import Fraction

import numpy as np
import pytest

from jotlight import datasets
from jotlight.datasets import cifar10_files

TRAIN = [f"data_batch_{number}" for number in range(1, 6)]


@pytest.fixture
def small(monkeypatch):
    """Original files of at most 4 images instead of 10,000."""
    monkeypatch.setattr(cifar10_files, "RECORDS", 4)


@pytest.fixture
def pixels():
    """Red, green and blue of 24 images: five files for training, one for the test."""
    return np.random.default_rng(0).integers(0, 256, (24, 3, 32, 32), np.uint8)


@pytest.fixture
def gray(pixels):
    red, green, blue = np.moveaxis(pixels.astype(int), 1, 0)
    level, rest = np.divmod(299 * red + 587 * green + 114 * blue, 1000)
    return level + (rest > 500) + ((rest == 500) & (level % 2 == 1))


def batches(pixels):
    return zip([*TRAIN, "test_batch"], pixels.reshape(6, 4, 3072), strict=True)


def binary(batch):
    return np.insert(batch, 0, 7, axis=1).tobytes()


def pickled(content, *, before=b"", python=2):
    """A dictionary with an array as Python 2 and NumPy wrote it, opcode by opcode."""
    size = struct.pack("<I", len(content))
    return b"".join(
        [
            b"\x80\x02}q\x01(",
            before,
            b"U\x0bbatch_labelq\x02U\x14testing batch 1 of 1q\x03U\x06labelsq\x04](K\x03K\x08e",
            b"U\x04dataq\x05cnumpy.core.multiarray\n_reconstruct\nq\x06cnumpy\nndarray\nq\x07",
            b"K\x00\x85U\x01b\x87Rq\x08(K\x01J\x10\x27\x00\x00M\x00\x0c\x86cnumpy\ndtype\nq\x09",
            b"U\x02u1K\x00K\x01\x87Rq\x0a(K\x03U\x01|NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb",
            b"\x89" + (b"T" if python == 2 else b"B") + size + content + b"q\x0btbu.",
        ]
    )


def test_the_opcodes_are_those_of_an_array():
    content = bytes(range(256)) * 120_000
    # Trusted, since it is made here.
    array = pickle.loads(pickled(content), encoding="latin-1")["data"]
    assert array.shape == (10_000, 3072)
    assert array.tobytes() == content


def as_binary(folder, pixels):
    folder.mkdir()
    for name, batch in batches(pixels):
        (folder / f"{name}.bin").write_bytes(binary(batch))


def as_pickles(folder, pixels):
    folder.mkdir()
    for number, (name, batch) in enumerate(batches(pixels)):
        (folder / name).write_bytes(pickled(batch.tobytes(), python=2 + number % 2))


def as_archive(path, pixels, order=1, ending=".bin", change=lambda content: content):
    with tarfile.open(path, "w:gz") as archive:
        for name, batch in list(batches(pixels))[::order]:
            content = change(binary(batch))
            member = tarfile.TarInfo(f"cifar-10-batches-bin/{name}{ending}")
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))


def assert_is_cifar10(folder, gray):
    train, test = (datasets.cifar10(split, folder) for split in ("train", "test"))
    assert (train.dtype, train.shape, test.shape) == (np.float32, (20, 32, 32), (4, 32, 32))
    np.testing.assert_array_equal(np.concatenate([train, test]), (gray / 255).astype(np.float32))
    for first in (1, 4, 5, 21):
        np.testing.assert_array_equal(datasets.cifar10("train", folder, first=first), train[:first])


@pytest.mark.parametrize(
    ("name", "write"), [("cifar-10-batches-bin", as_binary), ("cifar-10-batches-py", as_pickles)]
)
@pytest.mark.usefixtures("small")
def test_cifar10_is_read_from_the_original_folders(name, write, tmp_path, pixels, gray):
    write(tmp_path / name, pixels)
    assert_is_cifar10(tmp_path, gray)
    assert_is_cifar10(tmp_path / name, gray)
    (tmp_path / name).rename(tmp_path / "renamed")
    assert_is_cifar10(tmp_path / "renamed", gray)
    shares = []
    datasets.cifar10("train", tmp_path / "renamed", progress=shares.append)
    assert shares == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.usefixtures("small")
def test_cifar10_is_read_from_the_archive_in_any_order(order, tmp_path, pixels, gray):
    as_archive(tmp_path / cifar10_files.ARCHIVE, pixels, order)
    assert_is_cifar10(tmp_path, gray)
    assert len(list(tmp_path.iterdir())) == 1


def test_halves_round_to_even_on_every_machine():
    colors = np.stack(np.meshgrid(*[np.arange(0, 256, 3)] * 3), axis=-1).reshape(-1, 3)
    thousandths = colors @ [299, 587, 114]
    halves = colors[thousandths % 1000 == 500][:100]
    assert len(halves) == 100
    pixels = np.repeat(halves.astype(np.uint8), 1024, axis=1)
    even = [round(Fraction(int(value), 1000)) for value in halves @ [299, 587, 114]]
    assert cifar10_files.gray_levels(pixels)[:, 0, 0].tolist() == even


@pytest.mark.parametrize("ending", [".bin", ""])
@pytest.mark.usefixtures("small")
def test_the_error_of_an_incomplete_folder_names_the_missing_files(ending, tmp_path, pixels):
    folder = tmp_path / ("cifar-10-batches-bin" if ending else "cifar-10-batches-py")
    (as_binary if ending else as_pickles)(folder, pixels)
    (folder / f"data_batch_3{ending}").unlink()
    with pytest.raises(FileNotFoundError, match=f"did not find data_batch_3{ending}; unpack"):
        datasets.cifar10("train", tmp_path)
    assert len(datasets.cifar10("test", tmp_path)) == 4
    for path in folder.iterdir():
        path.unlink()
    with pytest.raises(FileNotFoundError, match=f"did not find test_batch{ending}; unpack"):
        datasets.cifar10("test", tmp_path)


def test_the_error_without_cifar10_names_the_forms(tmp_path):
    with pytest.raises(FileNotFoundError) as error:
        datasets.cifar10("train", tmp_path)
    for form in ("-bin/data_batch_1.bin", "-py/data_batch_1", "binary.tar.gz", "gray.npz", "pass"):
        assert form in str(error.value)


@pytest.mark.parametrize("size", [0, 3072, 3073 * 4 - 1, 3073 * 5])
@pytest.mark.usefixtures("small")
def test_a_binary_file_of_a_wrong_size_is_refused(size, tmp_path, pixels):
    (tmp_path / "test_batch.bin").write_bytes(bytes(size))
    with pytest.raises(ValueError, match=f"up to 4 records of 3073 bytes, got {size} bytes"):
        datasets.cifar10("test", tmp_path)


@pytest.mark.usefixtures("small")
class TestArchive:
    def test_one_that_is_cut_off_is_refused(self, tmp_path, pixels):
        path = tmp_path / cifar10_files.ARCHIVE
        as_archive(path, pixels)
        whole = path.read_bytes()
        for size in (0, 5, len(whole) // 2, len(whole) - 3000, len(whole) - 1):
            path.write_bytes(whole[:size])
            with pytest.raises(ValueError, match="the archive is damaged"):
                datasets.cifar10("test", tmp_path)

    def test_one_whose_checksum_differs_is_refused_before_an_image_is_returned(
        self, tmp_path, pixels
    ):
        path = tmp_path / cifar10_files.ARCHIVE
        name, batch = next(iter(batches(pixels)))
        # The second file is longer than a buffer, so the first is read without the end.
        files = {name: binary(batch), "other": np.random.default_rng(0).bytes(1 << 21)}
        with tarfile.open(path, "w:gz") as archive:
            for stem, content in files.items():
                member = tarfile.TarInfo(f"cifar-10-batches-bin/{stem}.bin")
                member.size = len(content)
                archive.addfile(member, io.BytesIO(content))
        assert len(next(cifar10_files.read_archive(path, [name]))) == len(batch)
        whole = path.read_bytes()
        path.write_bytes(whole[:-8] + bytes([whole[-8] ^ 1]) + whole[-7:])
        with pytest.raises(ValueError, match="the archive is damaged"):
            next(cifar10_files.read_archive(path, [name]))

    def test_one_without_the_files_is_refused(self, tmp_path, pixels):
        as_archive(tmp_path / cifar10_files.ARCHIVE, pixels, ending=".txt")
        with pytest.raises(FileNotFoundError, match=r"batches-bin/data_batch_1\.bin in the arch"):
            datasets.cifar10("train", tmp_path)

    def test_a_link_in_it_is_not_followed(self, tmp_path):
        with tarfile.open(tmp_path / cifar10_files.ARCHIVE, "w:gz") as archive:
            member = tarfile.TarInfo("cifar-10-batches-bin/test_batch.bin")
            member.type, member.linkname = tarfile.SYMTYPE, "/etc/passwd"
            archive.addfile(member)
        with pytest.raises(FileNotFoundError, match="in the archive, found none"):
            datasets.cifar10("test", tmp_path)

    def test_a_member_of_a_wrong_size_is_refused_before_it_is_read(self, tmp_path, pixels):
        as_archive(tmp_path / cifar10_files.ARCHIVE, pixels, change=lambda content: content * 2)
        with pytest.raises(ValueError, match=r"test_batch\.bin: expected up to 4 records"):
            datasets.cifar10("test", tmp_path)


class TestPickle:
    @pytest.mark.slow
    def test_one_of_the_original_size_is_read(self, tmp_path):
        content = np.zeros((10_000, 3072), np.uint8)
        content[1, 1024] = 255  # the first pixel's green
        (tmp_path / "test_batch").write_bytes(pickled(content.tobytes()))
        images = datasets.cifar10("test", tmp_path, first=2)
        assert images.sum() == images[1, 0, 0] == np.float32(150) / np.float32(255)

    @pytest.mark.parametrize("pixels_too", [True, False])
    @pytest.mark.usefixtures("small")
    def test_code_in_it_is_never_run(self, pixels_too, tmp_path):
        marker = tmp_path / "run"
        hostile = b"cos\nmkdir\n(V" + str(marker).encode() + b"\ntRN"
        content = pickled(bytes(4 * 3072 + (not pixels_too)), before=hostile)
        with contextlib.suppress(ValueError):  # the array's size is not the usual
            pickle.loads(content, encoding="latin-1")
        assert marker.is_dir()  # so it does its harm where it is unpickled
        marker.rmdir()
        (tmp_path / "test_batch").write_bytes(content)
        if pixels_too:
            assert not datasets.cifar10("test", tmp_path).any()
        else:
            with pytest.raises(ValueError, match="string of 12288 bytes in it, found none"):
                datasets.cifar10("test", tmp_path)
        assert not marker.exists()

    @pytest.mark.usefixtures("small")
    def test_no_memory_is_taken_for_bytes_that_only_an_opcode_claims(self, tmp_path):
        claim = b"B" + (1 << 28).to_bytes(4, "little")
        (tmp_path / "test_batch").write_bytes(claim + bytes(13_000))
        tracemalloc.start()
        try:
            with pytest.raises(ValueError, match="expected 268435456 bytes"):
                datasets.cifar10("test", tmp_path)
            assert tracemalloc.get_traced_memory()[1] < 1 << 20
        finally:
            tracemalloc.stop()

    @pytest.mark.parametrize("size", [0, 4 * 3072, 4 * 4096 + 1])
    @pytest.mark.usefixtures("small")
    def test_a_wrong_size_is_refused(self, size, tmp_path):
        (tmp_path / "test_batch").write_bytes(bytes(size))
        with pytest.raises(ValueError, match=f"the 12288 bytes of 4 images, got {size};"):
            datasets.cifar10("test", tmp_path)

    @pytest.mark.parametrize(
        "content",
        [
            bytes(13_000),
            b"I" + b"1" * 13_000 + b"\n",
            b"\x8e" + b"\xff" * 13_000,
            b"F" + b"x" * 13_000 + b"\n",
        ],
    )
    @pytest.mark.usefixtures("small")
    def test_what_is_no_pickle_is_refused(self, content, tmp_path):
        (tmp_path / "test_batch").write_bytes(content)
        with pytest.raises(
            ValueError, match="test_batch: expected a batch of CIFAR-10's Pyth"
        ) as e:
            datasets.cifar10("test", tmp_path)
        assert len(str(e.value)) < 600


class TestGray:
    def test_only_lossless_images_are_returned(self, tmp_path):
        stack = np.arange(5, dtype=np.uint8)[:, None, None] + np.zeros((32, 32), np.uint8)
        lossless = np.array([False, True, True, False, True])
        np.savez(tmp_path / "cifar10_gray.npz", x_test=stack, test_lossless=lossless)
        images = datasets.cifar10("test", tmp_path)
        np.testing.assert_array_equal(images * 255, stack[[1, 2, 4]])
        assert len(datasets.cifar10("test", tmp_path, first=2)) == 2
        fractions = []
        np.savez(tmp_path / "cifar10_gray.npz", x_train=stack, train_lossless=lossless)
        assert len(datasets.cifar10("train", tmp_path, progress=fractions.append)) == 3
        assert fractions[-1] == 1
        with pytest.raises(ValueError, match="x_test"):
            datasets.cifar10("test", tmp_path)

    @pytest.mark.parametrize(
        ("images", "lossless", "message"),
        [
            (np.zeros((3, 32, 31), np.uint8), np.ones(3, bool), r"\(N, 32, 32\), got uint8 of"),
            (np.zeros((3, 32, 32)), np.ones(3, bool), "got float64"),
            (np.zeros((3, 32, 32), np.uint8), np.ones(2, bool), r"bool \(3,\) with some True, got"),
            (np.zeros((3, 32, 32), np.uint8), np.ones(3), "got float64"),
            (np.zeros((3, 32, 32), np.uint8), np.zeros(3, bool), "some True"),
        ],
    )
    def test_other_arrays_are_refused(self, images, lossless, message, tmp_path):
        np.savez(tmp_path / "cifar10_gray.npz", x_test=images, test_lossless=lossless)
        with pytest.raises(ValueError, match=message):
            datasets.cifar10("test", tmp_path)

    def test_the_copy_of_the_experiments_is_read(self, data):
        images = datasets.cifar10("test", data, first=3)
        assert (images.dtype, images.shape) == (np.float32, (3, 32, 32))
        assert images.max() <= 1
