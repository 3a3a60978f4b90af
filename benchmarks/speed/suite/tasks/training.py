"""One training step: the gradient in the paper's setting, with new counts."""

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
from suite.tasks.filtering import TAPS
from suite.tasks.scene import SENSOR
from suite.tasks.splines import OPERATIONS

SCENES, SIDE = 128, 32
PIXELS = SCENES * SIDE**2
DRAWING_OPERATIONS = 120
"""Operations per count: 16 random bytes of ChaCha with 8 rounds take 50, e⁻ˢ takes 30, and each of
the 16 terms of the binomial distribution takes 2.5."""
TORCH = "PyTorch, with drawing of counts"
TORCH_BITS = "PyTorch, with drawing of bits"
PLAIN_TORCH = "PyTorch, with torch.poisson and indexing"


def cases(quick: bool) -> Iterator[Case]:
    scenes = jl.datasets.uniform_scene((SCENES, SIDE, SIDE), rng=0)
    network = jl.Network.initial(SENSOR)
    examples = PatchSampler(scenes, SENSOR, 0, SCENES, SIDE, network.halo)
    batch = examples.batch(0)
    order = batch["patches"][:, 0]
    vector = parameter_vector(network)
    # A network without filters does little but the drawing.
    table = jl.Network([jl.Layer(np.ones((1, 1, 1, 1)), np.zeros((1, 4)), 0.0, 16.0)], SENSOR)

    @functools.cache
    def cost(network: jl.Network, threads: int) -> Cost:
        return Cost(network, examples, 0, 1, jl.training.SafeSet(), threads)

    def with_torch(torch: Any, draws: str | None, plain: bool = False) -> Callable[[], np.ndarray]:
        counts = draw_counts(batch, scenes[order])
        rival = torch_gradient(torch, network, scenes[order], counts, plain=plain)
        return lambda: rival(draws)

    yield Case(
        name="training",
        title="Training step",
        description=f"The gradient of the cost of {SCENES} scenes of {SIDE} × {SIDE}, K = 16, two "
        "layers. Each step of jotlight draws new counts. The first three rows of PyTorch use the "
        "fastest operations that we found; the last row uses torch.poisson and coefficients by "
        "indices.",
        items=SCENES,
        unit="scenes",
        run=lambda threads: cost(network, threads).gradient(vector)[1],
        rivals=[
            Rival("PyTorch, gradient alone", functools.partial(with_torch, draws=None), "torch"),
            *(
                Rival(name, functools.partial(with_torch, **options), "torch", same=False)
                for name, options in (
                    (TORCH, {"draws": "counts"}),
                    (TORCH_BITS, {"draws": "bits"}),
                    (PLAIN_TORCH, {"draws": "bits", "plain": True}),
                )
            ),
        ],
        difference=lambda result, other: float(
            np.linalg.norm(result - other) / np.linalg.norm(other)
        ),
        agreement="norm of the difference of the gradients, relative to PyTorch's",
        tolerance=1e-4,
        operations=(3 * (TAPS**2 + 2 * OPERATIONS) + DRAWING_OPERATIONS) * PIXELS,
        bytes=4 * PIXELS,
        operations_note="225 multiply-adds per pixel forward and twice as many backward, splines "
        "likewise, "
        "and 120 operations to draw a count; scenes are read once",
        parts={
            "jotlight, drawing and counting alone": lambda threads: cost(table, threads).value(
                parameter_vector(table)
            )
        },
    )


def draw_counts(batch: dict[str, Any], scenes: np.ndarray) -> np.ndarray:
    """Return the counts of a batch's patches."""
    counts = np.empty(scenes.shape, np.int32)
    sensor = SENSOR.engine_arguments()
    for index, (scene, out) in enumerate(zip(scenes, counts, strict=True)):
        engine.draw_counts(sensor, SENSOR.frames, scene, batch["seed"], index, out)
    return counts


def torch_gradient(
    torch: Any, network: jl.Network, scenes: np.ndarray, counts: np.ndarray, *, plain: bool
) -> Callable[..., np.ndarray]:
    from suite.torch_network import TorchNetwork, spline_by_weights

    rival = TorchNetwork(network, SIDE, SIDE, functools.partial(spline_by_weights, plain=plain))
    for parameter in rival.parameters:
        parameter.requires_grad_()
    intensities = torch.from_numpy(scenes)[:, None]
    fixed = torch.from_numpy(counts.astype(np.float32))[:, None]
    rates = intensities.expand(-1, SENSOR.trials, -1, -1)
    probability = -torch.expm1(-rates)

    trials = torch.full_like(intensities, SENSOR.trials)

    def run(draws: str | None) -> np.ndarray:
        sums = fixed
        if draws == "counts":
            sums = torch.binomial(trials, probability[:, :1])
        elif draws == "bits":
            # Uniform numbers are ten times as fast as photon counts.
            drawn = (
                torch.poisson(rates) >= 1 if plain else torch.rand(probability.shape) < probability
            )
            sums = drawn.sum(1, keepdim=True, dtype=torch.float32)
        cost = 0.5 * ((rival.estimate(sums) - intensities) ** 2).sum() / SCENES
        gradients = torch.autograd.grad(cost, rival.parameters)
        return np.concatenate([gradient.numpy().ravel() for gradient in gradients])

    return run
