"""The first layer of a network whose weights differ from jot to jot."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import jotlight as jl
from suite.case import Case, Rival, largest
from suite.paths.scene import HEIGHT, PIXELS, SENSOR, WIDTH, bits, unpacked, untied


def cases(quick: bool) -> Iterator[Case]:
    layer = untied(jl.pretrained(SENSOR, "two-layer")).layers[0]
    side = SENSOR.oversampling
    # Gives what it is given: φ of a line of coefficients is that line.
    most = float(layer.filters.sum())
    line = np.linspace(-most / 4, 5 * most / 4, 7)[None]
    given = jl.Layer(layer.filters, line, 0.0, most / 4)
    engine = [given.engine_layer]

    def ours(threads: int) -> np.ndarray:
        packed, width = bits().packed, bits().width
        return engine.forward_bits(engine, packed, width, threads)[None]

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
        words=f"From packed bits, K = 16, to p of equation (11) for {WIDTH} × {HEIGHT} pixels.",
        items=PIXELS,
        unit="pixels",
        ours=ours,
        rivals=[
            Rival("NumPy, unpackbits and einsum", lambda _: numpy_sums),
            Rival("PyTorch, conv2d with a stride", torch_sums, "torch"),
        ],
        difference=largest,
        agreement="largest difference relative to the largest sum",
        tolerance=1e-5,
        slots=(side + 1) * PIXELS,
        bytes=bits().packed.nbytes + 4 * PIXELS,
        counted="bits read and sums written once; K̂ rows of bits put in place and one look-up",
    )
