"""The first layer of a network with a weight for each jot."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import jotlight as jl
from jotlight.networks.inference.engine_backed import sensor_model
from suite.case import Case, Rival, relative_difference
from suite.tasks.scene import HEIGHT, PIXELS, SENSOR, WIDTH, bits, unpacked, untied

NUMPY, TORCH = "NumPy, unpackbits and einsum", "PyTorch, conv2d with a stride"


def cases(quick: bool) -> Iterator[Case]:
    layer = untied(jl.pretrained(SENSOR, "two-layer")).layers[0]
    side = SENSOR.oversampling
    # A network limits its output to [0, S]. No sum exceeds that of all weights.
    sensor = SENSOR.replace(max_intensity=float(layer.filters.sum()))
    network = jl.Network([jl.Layer(layer.filters, None)], sensor).engine_network
    model = sensor_model(sensor)

    def sums(threads: int) -> np.ndarray:
        packed, width = bits().packed, bits().width
        out = np.empty((1, HEIGHT, WIDTH), np.float32)
        network.bits([packed], width, side, model, list(out), threads)
        return out

    def numpy_sums() -> np.ndarray:
        blocks = unpacked(bits()).reshape(HEIGHT, side, WIDTH, side).astype(np.float32)
        return np.einsum("yixj,cij->cyx", blocks, layer.filters[:, 0], optimize=True)

    def torch_sums(torch: Any) -> Callable[[], np.ndarray]:
        filters = torch.from_numpy(layer.filters)

        def run() -> np.ndarray:
            jots = torch.from_numpy(unpacked(bits()))[None].float()
            return torch.nn.functional.conv2d(jots, filters, stride=side)[0].numpy()

        return run

    yield Case(
        name="first-layer",
        title="First layer, untied",
        description=f"From packed bits, K = 16, to p of equation (11) for {WIDTH} × {HEIGHT} "
        "pixels.",
        items=PIXELS,
        unit="pixels",
        run=sums,
        rivals=[
            Rival(NUMPY, lambda _: numpy_sums),
            Rival(TORCH, torch_sums, "torch"),
        ],
        difference=relative_difference,
        agreement="largest difference relative to the largest sum",
        tolerance=1e-5,
        operations=(side + 1) * PIXELS,
        bytes=bits().packed.nbytes + 4 * PIXELS,
        operations_note="bits are read and sums written once; each pixel takes K̂ rows of bits "
        "and one look-up",
    )
