"""One training step: the gradient of the paper's setting, with its bits drawn anew."""

import functools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import jotlight as jl
import jotlight._engine as engine
from jotlight.training.cost import Cost
from jotlight.training.parameters import parameter_vector
from jotlight.training.patches import PatchSampler
from suite.case import Case, Rival
from suite.paths.filtering import TAPS
from suite.paths.sampling import SLOTS as DRAWING
from suite.paths.scene import SENSOR
from suite.paths.splines import SLOTS

SCENES, SIDE = 128, 32
PIXELS = SCENES * SIDE**2
DRAWN, PLAIN = "PyTorch, bits drawn too", "PyTorch, as one writes it at first"


def cases(quick: bool) -> Iterator[Case]:
    scenes = jl.datasets.uniform_scene((SCENES, SIDE, SIDE), rng=0)
    network = jl.Network.initial(SENSOR)
    examples = PatchSampler(scenes, SENSOR, 0, SCENES, SIDE, network.halo)
    batch = examples.batch(0)
    order = batch["patches"][:, 0]
    vector = parameter_vector(network)
    # A network without filters has next to nothing to do but the drawing.
    table = jl.Network([jl.Layer(np.ones((1, 1, 1, 1)), np.zeros((1, 4)), 0.0, 16.0)], SENSOR)

    @functools.cache
    def cost(network: jl.Network, threads: int) -> Cost:
        return Cost(network, examples, 0, 1, jl.training.SafeSet(), threads)

    def with_torch(torch: Any, *, draws: bool, plain: bool = False) -> Callable[[], np.ndarray]:
        counts = counted(batch, scenes[order])
        rival = gradient_of_torch(torch, network, scenes[order], counts, plain=plain)
        return lambda: rival(draws=draws)

    yield Case(
        name="training",
        title="Training step",
        words=f"The gradient of the cost of {SCENES} scenes of {SIDE} × {SIDE}, K = 16, two "
        "layers. A step of jotlight always draws its bits anew. PyTorch is in the quickest form "
        "that we found, and in the first one, with torch.poisson and coefficients by indices.",
        items=SCENES,
        unit="scenes",
        ours=lambda threads: cost(network, threads).gradient(vector)[1],
        rivals=[
            Rival("PyTorch, gradient alone", functools.partial(with_torch, draws=False), "torch"),
            Rival(DRAWN, functools.partial(with_torch, draws=True), "torch", same=False),
            Rival(
                PLAIN, functools.partial(with_torch, draws=True, plain=True), "torch", same=False
            ),
        ],
        difference=lambda ours, theirs: float(
            np.linalg.norm(ours - theirs) / np.linalg.norm(theirs)
        ),
        agreement="norm of the difference of the gradients relative to theirs",
        tolerance=1e-4,
        slots=(3 * (TAPS**2 + 2 * SLOTS) + 16 * DRAWING) * PIXELS,
        bytes=4 * PIXELS,
        counted="225 multiply-adds a pixel forwards and twice as many backwards, splines likewise, "
        "and the drawing of 16 bits; scenes read once",
        parts={
            "jotlight, drawing and counting alone": lambda threads: cost(table, threads).value(
                parameter_vector(table)
            )
        },
    )


def counted(batch: dict[str, Any], scenes: np.ndarray) -> np.ndarray:
    """Counts of the patches of a batch: patch i has the frames of number i."""
    counts = np.empty(scenes.shape, np.int32)
    sensor = SENSOR.engine_arguments()
    jots = SIDE * SENSOR.oversampling
    for index, scene in enumerate(scenes):
        packed = np.empty((1, jots, jots // 8), np.uint8)
        frames, pixels = (index, index + 1), (0, SIDE)
        engine.expose(sensor, scene, batch["seed"], 0, frames, pixels, pixels, packed, None)
        counts[index] = jl.Bits(packed, jots).counts(SENSOR.oversampling)
    return counts


def gradient_of_torch(
    torch: Any, network: jl.Network, scenes: np.ndarray, counts: np.ndarray, *, plain: bool
) -> Callable[..., np.ndarray]:
    from suite.torch_network import TorchNetwork, by_weights

    rival = TorchNetwork(network, SIDE, SIDE, functools.partial(by_weights, plain=plain))
    for parameter in rival.parameters:
        parameter.requires_grad_()
    light = torch.from_numpy(scenes)[:, None]
    fixed = torch.from_numpy(counts.astype(np.float32))[:, None]
    rates = light.expand(-1, SENSOR.bits_per_pixel, -1, -1)
    fires = -torch.expm1(-rates)

    def run(*, draws: bool) -> np.ndarray:
        sums = fixed
        if draws:
            # The second is ten times as quick, since nobody needs the photons.
            drawn = torch.poisson(rates) >= 1 if plain else torch.rand(fires.shape) < fires
            sums = drawn.sum(1, keepdim=True, dtype=torch.float32)
        cost = 0.5 * ((rival.picture(sums) - light) ** 2).sum() / SCENES
        gradients = torch.autograd.grad(cost, rival.parameters)
        return np.concatenate([gradient.numpy().ravel() for gradient in gradients])

    return run
