"""Small inputs of all commands, which differ by their seed."""

import os
from pathlib import Path

import numpy as np
import skimage.data

import jotlight as jl
from jotlight.images.io import image_writer


def make_inputs(folder: Path, seed: int, frames: int) -> None:
    """Write inputs into a new folder: captures, a photograph, a motion, and a network.

    `bits.npy` and `half.npy` have this number of frames, in the sizes of SPAD512S and SwissSPAD2.
    """
    folder.mkdir(parents=True)
    rng = np.random.default_rng(seed)
    photograph = skimage.data.camera()[64 * seed :, 64 * seed :][:128, :192] / 255
    image_writer(folder / "photo.png")(folder / "photo.png", photograph)
    np.save(folder / "photos.npy", np.stack([photograph, photograph[::-1]]).astype(np.float32))
    for name, shape in (("bits", (512, 512)), ("half", (256, 512))):
        packed = rng.integers(0, 256, (frames, shape[0], shape[1] // 8), np.uint8)
        jl.save(jl.Bits(packed), folder / f"{name}.npy")
    jl.save(jl.open(folder / "bits.npy").counts(1), folder / "counts.tif")
    sparse = np.packbits(rng.random((max(1, frames // 16), 512, 512)) < 0.01, axis=2)
    jl.save(jl.Bits(sparse), folder / "dark.npy")
    sensor = jl.Sensor(frames=8)
    jl.save(sensor.expose(photograph, rng=seed), folder / "small.npy")
    tiles = 8, 12
    jl.Motion(
        np.zeros((1, 2, 2, *tiles), np.float32),
        np.zeros(photograph.shape, np.uint8),
        np.array([0.0, 7.0]),
        4.0,
        "affine",
        np.ones((1, 2, 3, *tiles), np.float32),
    ).save(folder / "motion.safetensors")
    maps = sensor.replace(
        dark_counts=rng.random(photograph.shape) / 20, mask=rng.random(photograph.shape) < 0.01
    )
    jl.save(maps.expose(photograph, rng=seed), folder / "maps.npy")
    ones = {
        name: rng.binomial(4000, 1 - np.exp(-light), (64, 64)).astype(np.int32)
        for name, light in (("black", 0.01), ("flat", 0.7))
    }
    for name, counts in ones.items():
        jl.save(counts, folder / f"{name}.tif")
    jl.calibrate(*ones.values(), frames=4000).save(folder / "calibration.safetensors")
    jl.save(sensor.expose(photograph[:64, :64], rng=seed), folder / "calibrated.npy")
    jl.Network.conditional("small", rng=seed).save(folder / "conditional.safetensors")
    # Then nothing but the commands under test writes to these files.
    for path in folder.iterdir():
        os.utime(path, (0, 0))
