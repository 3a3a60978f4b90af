"""Valid small files of every family that is read, and what reads each."""

import contextlib
import dataclasses
import functools
import gzip
import io
import tarfile
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

import jotlight as jl
from jotlight.calibration.figure import facts
from jotlight.datasets.cifar10_files import from_archive
from jotlight.experiments.tables import read_results, write_facts, write_table
from jotlight.formats.image_files import read_mask
from jotlight.formats.writing import write_capture
from jotlight.images.io import image_writer, read_image
from jotlight.images.sets import read_image_set
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.history import History, Record

RNG = np.random.default_rng(0)
BITS = jl.Bits.from_array(RNG.random((3, 6, 13)) < 0.4)
COLOUR = jl.Bits.from_array(RNG.random((2, 5, 9, 3)) < 0.4)
WIDE = jl.Bits.from_array(RNG.random((2, 512, 512)) < 0.1)
HALF = jl.Bits.from_array(RNG.random((2, 256, 512)) < 0.1)
SPARSE = jl.Bits.from_array(RNG.random((2, 512, 512)) < 1e-4)
IMAGE = RNG.integers(0, 300, (6, 9), np.int32)
MAPPED = jl.Sensor(
    frames=3, dark_counts=RNG.random((6, 13)) / 9, mask=RNG.random((6, 13)) < 0.1, gain=2.0
)
SENSED = jl.Bits(BITS.packed, BITS.width, MAPPED)
RUN = {"seed": 1}


@dataclasses.dataclass(frozen=True)
class Reader:
    """What reads a file, and how valid examples of it are made."""

    opens: str
    """The name of what is opened, a file or a folder."""
    read: Callable[[Path], object]
    """Takes its path."""
    makers: tuple[Callable[[Path], object], ...]
    """Each makes an example at a path, where nothing stands yet."""
    file: str = ""
    """The file that is damaged, where that is one in the folder or beside what is opened."""
    wrap: Callable[[bytes], bytes] = bytes
    """Turns the bytes that are damaged into those of the file, such as by compressing them."""
    unwrap: Callable[[bytes], bytes] = bytes
    """Undoes that."""
    json: bool = False
    """Whether the bytes that are damaged are JSON."""
    needs: str = "numpy"
    """The package that it takes."""

    def example(self, folder: Path, number: int = 0) -> tuple[Path, Path, bytes]:
        """Make an example; give what is opened, the file to damage, and its bytes unwrapped."""
        path = folder / self.opens
        self.makers[number](path)
        file = folder / (self.file or self.opens)
        return path, file, self.unwrap(file.read_bytes())


def read_or_refused(read, path):
    """What reading comes to, or None where it is refused with an error that names the file.

    Any other exception comes through.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return read(path)
    except (OSError, ValueError, jl.MissingExtraError) as error:
        said = str(error)
    named = (path.name, path.parent.name, str(path))
    assert any(name in said for name in named), f"an error that names no file: {said}"
    return None


def opened(path, **options):
    """The counts of a capture, which are whole numbers that its frames can have."""
    data = jl.open(path, **options)
    counts = data.counts(1) if isinstance(data, jl.Bits) else data
    assert counts.dtype == np.int32
    assert counts.min() >= 0
    assert not isinstance(data, jl.Bits) or counts.max() <= len(data)
    return counts


def npy(array):
    """The bytes of a `.npy`."""
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def zipped(content):
    """The bytes of a `.npz` with one member of these bytes."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", content)
    return file.getvalue()


def unzipped(content):
    """Undo :func:`zipped`."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return archive.read(archive.namelist()[0])


def with_checksums(content):
    """The bytes of a PNG with the checksum of each part made right, as far as there are parts."""
    out, place = bytearray(content), 8
    while place + 12 <= len(out):
        end = place + 8 + int.from_bytes(out[place : place + 4], "big")
        if end + 4 > len(out):
            break
        out[end : end + 4] = zlib.crc32(out[place + 4 : end]).to_bytes(4, "big")
        place = end + 4
    return bytes(out)


def _written(name, *captures):
    """Makers with the project's own writers."""
    return tuple(functools.partial(write_capture, data, name=name) for data in captures)


def _saved(*arrays):
    return tuple(functools.partial(_save, array=array) for array in arrays)


def _save(path, array):
    path.write_bytes(npy(array))


def _mat(path, data, **options):
    from scipy.io import savemat

    savemat(path, data, **options)


def _mat_7_3(path):
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        file["OUTPUT"] = np.eye(9).reshape(3, 3, 9)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(512))


def _hdf5(path):
    import h5py

    with h5py.File(path, "w", libver="latest") as file:
        file.create_dataset("b", data=np.eye(5, dtype=bool)[None], chunks=(1, 3, 3), shuffle=True)


def _zarr(path, **options):
    import zarr

    array = zarr.open_array(str(path), mode="w", shape=IMAGE.shape, dtype="i4", **options)
    array[...] = IMAGE


def _tiff(array, **options):
    return lambda path: tifffile.imwrite(path, array, **options)


def _pictures(*formats):
    grey = Image.fromarray(IMAGE.astype(np.uint8))
    return tuple(functools.partial(grey.save, format=format_) for format_ in formats)


def _black_and_white(path):
    Image.fromarray(MAPPED.mask).save(path)


def _palette(path):
    Image.fromarray(IMAGE.astype(np.uint8) % 4).convert("P").save(path, bits=2)


def _deep(path):
    image_writer(path, depth=16)(path, RNG.random((6, 9, 3)))


def _network(path):
    network = jl.Network.initial(jl.Sensor(oversampling=4))
    jl.Network(network.layers, network.sensor, {"steps": 7}).save(path)


@functools.cache
def _calibrated():
    rng = np.random.default_rng(0)
    dark = rng.binomial(4000, 0.008, (32, 32))
    rates = rng.uniform(0.4, 0.6, (32, 32))
    return jl.calibrate(dark, jl.Bits.from_array(rng.random((400, 32, 32)) < rates), frames=4000)


def _calibration(path):
    _calibrated().save(path)


def _checkpoint(path):
    history = History([Record(0, 2.0, 0.5, 20.0), Record(1, 1.0, 0.25, None)])
    Checkpoint(RUN, np.arange(5.0), {"memory": np.ones((2, 5))}, history).save(path)


def _with_header(maker):
    """How the header of a `.safetensors` becomes the file, with the numbers of an example."""

    def wrap(header):
        return len(header).to_bytes(8, "little") + header + body()

    @functools.cache
    def body():
        with tempfile.TemporaryDirectory() as folder:
            maker(Path(folder) / "a.safetensors")
            content = (Path(folder) / "a.safetensors").read_bytes()
        return content[8 + len(_header(content)) :]

    return {"wrap": wrap, "unwrap": _header, "json": True}


def _header(content):
    return content[8 : 8 + int.from_bytes(content[:8], "little")]


def _cifar_archive(path):
    with tarfile.open(path, "w:gz") as archive:
        member = tarfile.TarInfo("cifar-10-batches-bin/test_batch.bin")
        member.size = 3073
        archive.addfile(member, io.BytesIO(bytes(3073)))


def _results(path):
    path.mkdir()
    write_table(path / "fig5.csv", [{"image": "a", "psnr": 1.5}, {"image": "b", "psnr": 2}])
    write_facts(path / "run.csv", {"fig5": {"settings": "{}"}})


def _use_network(path):
    """A network that can be read is used without a crash, and may refuse."""
    network = jl.Network.load(path)
    with contextlib.suppress(ValueError, TypeError):
        network.reconstruct(jl.Bits.from_array(np.eye(8, dtype=bool)), network.sensor)
    return network


def _use_calibration(path):
    calibration = jl.Calibration.load(path)
    with contextlib.suppress(ValueError):
        calibration.sensor(16)
    return facts(calibration)


def _read_results(path):
    return read_results(path, lambda name: None)


def _raw(name):
    return functools.partial(opened, format=name)


def _gzipped(content):
    return gzip.compress(content, 1)


GZIPPED = {"wrap": _gzipped, "unwrap": gzip.decompress}
ZIPPED = {"wrap": zipped, "unwrap": unzipped}
SUMS = {"wrap": with_checksums}
RAW = {"swissspad2": HALF, "swissspad2-full": WIDE, "spad512s": WIDE, "spad512s-sparse": SPARSE}

READERS = {
    "npy": Reader(
        "a.npy",
        opened,
        _saved(BITS.packed, COLOUR.packed, IMAGE, IMAGE.T, IMAGE[:4, None], IMAGE[None] > 99),
    ),
    "npy-description": Reader("a.npy", opened, _written("npy", SENSED), file="a.json", json=True),
    "npy-map": Reader("a.npy", opened, _written("npy", SENSED), file="a.dark_counts.npy"),
    "npy.gz": Reader("a.npy.gz", opened, _written("npy.gz", BITS, IMAGE)),
    "npy.gz-inside": Reader("a.npy.gz", opened, _written("npy.gz", COLOUR, IMAGE), **GZIPPED),
    "npz": Reader("a.npz", opened, _written("npz", IMAGE)),
    "npz-inside": Reader("a.npz", opened, _written("npz", IMAGE, IMAGE.T), **ZIPPED),
    "visionsim": Reader(
        "a", opened, _written("visionsim", BITS, COLOUR), file="a/transforms.json", json=True
    ),
    **{name: Reader("a.bin", _raw(name), _written(name, data)) for name, data in RAW.items()},
    "matlab": Reader(
        "a.mat",
        opened,
        (
            functools.partial(_mat, data={"OUTPUT": np.eye(4, dtype=np.uint8).reshape(2, 4, 2)}),
            functools.partial(_mat, data={"a": np.eye(4, dtype=bool)}, do_compression=True),
            functools.partial(_mat, data={"OUTPUT": np.eye(4), "b": {"c": np.ones(3)}, "d": "e"}),
        ),
    ),
    "matlab-description": Reader(
        "a", opened, _written("matlab", BITS), file="a/info.json", json=True
    ),
    "matlab-7.3": Reader("a.mat", opened, (_mat_7_3,), needs="h5py"),
    "tiff": Reader(
        "a.tif",
        opened,
        (
            *_written("tiff", IMAGE),
            _tiff(np.ones((3, 5, 9), np.uint16), photometric="minisblack", compression="zlib"),
            _tiff(
                np.ones((3, 32, 32), np.uint8),
                photometric="minisblack",
                tile=(16, 16),
                bigtiff=True,
                byteorder=">",
            ),
            _tiff(np.ones((3, 5, 9), np.uint16), imagej=True),
            _tiff(np.ones((3, 5, 9), np.uint8), photometric="minisblack", ome=True),
        ),
    ),
    "png": Reader(
        "a.png",
        opened,
        (*_written("png", IMAGE, IMAGE % 256), _black_and_white, _palette),
        **SUMS,
    ),
    "hdf5": Reader("a.h5", opened, (*_written("hdf5", BITS, IMAGE), _hdf5), needs="h5py"),
    "zarr": Reader(
        "a",
        opened,
        _written("zarr", BITS, IMAGE),
        file="a/zarr.json",
        json=True,
        needs="zarr",
    ),
    "zarr-2": Reader(
        "a",
        opened,
        (functools.partial(_zarr, zarr_format=2),),
        file="a/.zarray",
        json=True,
        needs="zarr",
    ),
    "zarr-chunk": Reader("a", opened, (_zarr,), file="a/c/0/0", needs="zarr"),
    "mask": Reader("a.npy", read_mask, _saved(MAPPED.mask)),
    "mask-png": Reader("a.png", read_mask, (_black_and_white, *_written("png", IMAGE)), **SUMS),
    "network": Reader("a.safetensors", _use_network, (_network,)),
    "network-header": Reader("a.safetensors", _use_network, (_network,), **_with_header(_network)),
    "calibration": Reader("a.safetensors", _use_calibration, (_calibration,)),
    "calibration-header": Reader(
        "a.safetensors", _use_calibration, (_calibration,), **_with_header(_calibration)
    ),
    "checkpoint": Reader(
        "a.safetensors",
        functools.partial(Checkpoint.load, run=RUN),
        (_checkpoint,),
        **_with_header(_checkpoint),
    ),
    "picture": Reader("a.jpg", read_image, _pictures("JPEG", "PPM", "BMP", "WEBP", "GIF", "TGA")),
    "picture-png": Reader(
        "a.png",
        functools.partial(read_image, gray=True),
        (_deep, _palette, *_written("png", IMAGE)),
        **SUMS,
    ),
    "picture-tiff": Reader(
        "a.tif",
        functools.partial(read_image, gray=True),
        (
            _tiff(np.ones((5, 9, 3), np.float32), photometric="rgb"),
            _tiff(np.ones((5, 9), np.uint8), compression="zlib"),
        ),
    ),
    "images": Reader("a.npy", read_image_set, _saved(RNG.random((2, 5, 9), np.float32))),
    "images-npz": Reader(
        "a.npz",
        read_image_set,
        (functools.partial(np.savez, a=np.ones((2, 5, 9), np.uint8)),),
        **ZIPPED,
    ),
    "cifar-archive": Reader(
        "a.tar.gz",
        lambda path: list(from_archive(path, ["test_batch"])),
        (_cifar_archive,),
        **GZIPPED,
    ),
    "results-facts": Reader("a", _read_results, (_results,), file="a/run.csv"),
    "results-table": Reader("a", _read_results, (_results,), file="a/fig5.csv"),
}
"""All that is read from files, by a name."""
