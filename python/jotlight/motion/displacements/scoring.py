"""Fisher scoring: the normal equations of the displacement errors of a block of frames."""

import dataclasses
import functools

import numpy as np

import jotlight._engine as engine
from jotlight.array_types import AnyArray, Image
from jotlight.blur import blur
from jotlight.estimators.trial_levels import fill_from_nearest
from jotlight.kept import kept_property
from jotlight.motion.counts.equivalent import MIN_PROBABILITY, equivalent_sums
from jotlight.motion.counts.lights import Lights
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.regularize import Equations
from jotlight.networks.network import Network
from jotlight.networks.pretrained import DEFAULT_SIZE, FOLDER, MAX_TRIALS, TEMPLATES

FAST, PRECISE = TEMPLATES, DEFAULT_SIZE
"""Networks that denoise templates."""

_EQUAL_TRIALS = np.float32(1024)
"""Number of trials above those that the network serves, for which its error equals the noise."""

_BLUR = 1.5
"""Standard deviation of the filter of blurred templates, in pixels."""


@dataclasses.dataclass(frozen=True)
class Template:
    """The probability of a one at each pixel at the reference time, and its number of trials.

    Parameters
    ----------
    probability : ndarray of float32, shape (H, W)
        p, above 0 and below 1.
    trials : ndarray of int32, shape (H, W)
        D_R.
    threads : int, optional
        The number of threads of the functions that use the template.
    lights : Lights, optional
        The light of the frames behind the template, if jots need several photons.
    """

    probability: Image
    trials: AnyArray
    threads: int | None = None
    lights: Lights | None = None
    _filtered: dict[float, engine.FilteredTemplate] = dataclasses.field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @kept_property
    def mean_trials(self) -> float:
        """The mean of D_R."""
        return float(self.trials.mean())

    def filtered(self, sigma: float) -> engine.FilteredTemplate:
        """Return the template after a Gaussian filter. Each width is computed only once."""
        if sigma not in self._filtered:
            self._filtered[sigma] = engine.FilteredTemplate(
                self.probability, self.trials, sigma, self.threads
            )
        return self._filtered[sigma]


@functools.cache
def template_network(name: str = FAST) -> Network:
    """Return a network that denoises templates: FAST, or PRECISE. Each is read only once."""
    return Network.load(FOLDER / f"{name}.safetensors")


def make_template(sums: Sums, threads: int | None, network: str = FAST) -> Template:
    """Return the template of sums: the fraction of ones, denoised by a K-conditioned network.

    Of more trials than the network serves, the fraction itself has an increasing weight.
    """
    jots_differ = sums.jots is not None
    sums = equivalent_sums(sums)
    fraction, known = fraction_of_ones(sums)
    # Most pixels have about the same number of trials.
    trials = int(np.clip(sums.trials.sum() / max(known, 1), 1, MAX_TRIALS))
    if jots_differ:
        fraction = _supplement(fraction, sums, np.float32(trials), threads)
    probability = template_network(network).denoise_probability(fraction, trials, threads=threads)
    if sums.trials.max() > MAX_TRIALS:
        excess = np.maximum(sums.trials - MAX_TRIALS, 0).astype(np.float32)
        probability += excess / (excess + _EQUAL_TRIALS) * (fraction - probability)
    return without_shift(probability, sums, threads)


def fraction_of_ones(sums: Sums) -> tuple[Image, int]:
    """Return the fraction of ones of each pixel, (H, W), and the number of pixels with trials.

    The others have the fraction of the nearest one of these.
    """
    fraction = np.empty(sums.trials.shape, np.float32)
    if sums.trials.min() > 0:
        np.divide(sums.ones, sums.trials, out=fraction, dtype=np.float32, casting="unsafe")
        return fraction, fraction.size
    known = sums.trials > 0
    np.divide(
        sums.ones, np.where(known, sums.trials, 1), fraction, dtype=np.float32, casting="unsafe"
    )
    return fill_from_nearest(fraction, known), int(known.sum())


def _supplement(fraction: Image, sums: Sums, trials: np.float32, threads: int | None) -> Image:
    """Return fractions of ones in which the neighbors supplement pixels with fewer trials.

    Where jots with little efficiency or many dark counts have seen a pixel, its equivalent number
    of trials is small, and its fraction of ones has more noise than the network expects.
    """
    ones, number = (blur(each, _BLUR, threads) for each in (sums.ones, sums.trials))
    near = ones / np.maximum(number, np.float32(1e-3))
    own = np.minimum(sums.trials / trials, np.float32(1))
    return np.asarray(near + own * (fraction - near), np.float32)


def make_blurred_template(sums: Sums, threads: int | None) -> Template:
    """Return the template of sums, denoised by a Gaussian filter: in less time, but worse."""
    sums = equivalent_sums(sums)
    ones, trials = blur(np.stack([sums.ones, sums.trials]), _BLUR, threads)
    fraction = np.asarray(ones / np.maximum(trials, 1e-3), np.float32)
    return without_shift(fraction, sums, threads)


def without_shift(probability: Image, sums: Sums, threads: int | None) -> Template:
    """Return probabilities of sums as a template at the exact positions."""
    # The remainders have shifted the ones on average. This removes the shift to first order.
    moved = np.empty_like(probability)
    engine.undo_remainders(
        probability, sums.remainders, sums.frames, MIN_PROBABILITY, moved, threads
    )
    return Template(moved, sums.trials.astype(np.int32, copy=False), threads)


def normal_equations(sums: Sums, template: Template, sigma: float) -> Equations:
    """Return the normal equations of the displacement errors e of all tiles.

    The ones of a block are expected to be D p(x + e), with the probabilities p of the template.
    A Gaussian filter of width `sigma` widens the range of errors that can be found.

    Parameters
    ----------
    sums : Sums
        N, D, and m of the block.
    template : Template
        p and D_R of the template.
    sigma : float
        Standard deviation of the filter in pixels, above 0 and at most 100.

    Raises
    ------
    ValueError
        When the shapes do not match, or a value is outside its range.
    """
    sums = equivalent_sums(sums, template.probability)
    information, right = engine.displacement_equations(
        template.filtered(sigma),
        sums.ones,
        sums.trials,
        sums.remainders,
        sums.frames,
        template.threads,
    )
    return Equations(information, right)
