"""Random partitions of a capture's bits into an input and a target, and the target's likelihood.

The bits of a pixel are independent given the light, so the noise of one part does not predict the
noise of the other. `docs/guide/fine_tuning.md` describes the method.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from jotlight.array_types import Integers
from jotlight.errors import hide_warnings
from jotlight.estimators.inverse_response import equivalent_counts
from jotlight.networks.inference.trials_map import denoise_fractions
from jotlight.networks.network import Network
from jotlight.sensing.bits.subsampling import subsample_counts
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.likelihood.reference import Jot, reference_jot
from jotlight.sensing.parameters import response
from jotlight.sensing.sensor import Sensor
from jotlight.torch.blind_spots import draw_blind_spots, fill_blind_spots
from jotlight.torch.estimates import probability_of
from jotlight.torch.response import detection_probability

HELD_OUT_FRACTION = 0.1
"""Fraction of all bits that no step trains on."""

INPUT_RANGE = 0.6, 0.9
"""Smallest and largest fraction of the other bits that are the input of a step."""

_FLOOR = 0.01
"""Probabilities are clamped to [floor/K, 1 - floor/K], so that no bit is impossible."""

_MAX_PROBABILITY = 1 - 1e-6
"""Largest estimated P(b = 1) whose rate is computed; the rate of 1 is infinite."""

_MIN_SLOPE = 1e-6
"""Smallest ∂P/∂s by which a derivative is divided."""


def check_kernel(sensor: Sensor) -> None:
    """Raise ValueError when the jots of a pixel receive different light.

    Examples
    --------
    >>> check_kernel(jl.Sensor(frames=8))
    """
    if sensor.kernel != "box":
        raise ValueError(
            f"sensor: expected the box kernel, got {sensor.kernel}: the jots of a pixel receive "
            "different light, so its bits cannot be split at random"
        )


@dataclasses.dataclass(frozen=True)
class Split:
    """The bits of N patches, split into the network's input and the target."""

    input_trials: int
    """K' to which the input counts are scaled: their own number of bits, or the network's K."""
    conditional: bool
    """Whether the network is K-conditioned."""
    planes: Tensor
    """(N, 5, H, W): input counts, ones and number of target bits, and η and d of the jots."""

    @property
    def network_trials(self) -> int | None:
        """K' as an argument of the network; None for a network that is not conditioned."""
        return self.input_trials if self.conditional else None

    @property
    def counts(self) -> Tensor:
        """Input of the network, (N, 1, H, W)."""
        return self.planes[:, :1]

    @property
    def target_bits(self) -> float:
        """Number of target bits in all patches."""
        return float(self.planes[:, 2].double().sum())

    def to(self, device: torch.device) -> "Split":
        """Return a copy on a device."""
        return dataclasses.replace(self, planes=self.planes.to(device))

    def select(self, patches: slice) -> "Split":
        """Return some of the patches."""
        return dataclasses.replace(self, planes=self.planes[patches])


class BitSplitter:
    """The bits of a capture: some are held out from the start, each step splits the others anew.

    Parameters
    ----------
    network : Network
        Tied network whose input the bits are.
    sensor : Sensor
        Sensor of the capture.
    channels : sequence of PixelCounts
        The channels of the capture. The jots inside each pixel are alike.
    rng : numpy.random.Generator
        Source of randomness for the held-out bits.

    Attributes
    ----------
    channel_trials : list of ndarray, shape (H, W)
        Number n of all bits of each pixel, per channel.
    training_bits : list of (ndarray, ndarray)
        L and n of the bits that steps may use, per channel.
    held_out : list of Split
        The held-out bits as the target and all others as the input, per channel.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import count_pixels
    >>> sensor = jl.Sensor(frames=8)
    >>> channels = [count_pixels(np.full((32, 32), 4), sensor, None)]
    >>> rng = np.random.default_rng(0)
    >>> splitter = BitSplitter(jl.Network.conditional("small", rng=0), sensor, channels, rng)
    >>> splitter.draw(rng, number=3, side=16).counts.shape
    torch.Size([3, 1, 16, 16])
    """

    def __init__(
        self,
        network: Network,
        sensor: Sensor,
        channels: Sequence[PixelCounts],
        rng: np.random.Generator,
    ) -> None:
        self.network = network
        self.trials = sensor.trials
        self.conditional = network.trials_range is not None
        # The same reference jot as in `Network.reconstruct`.
        efficiency, dark = reference_jot(sensor)
        own = sensor if self.conditional else network.sensor
        self.reference = Jot(efficiency, reference_jot(own).dark_counts)
        self._sensor = sensor.replace(
            oversampling=1, frames=self.trials, mask=None, efficiency=efficiency, dark_counts=dark
        )
        self.channels = channels
        self.channel_trials: list[Integers] = []
        self.training_bits: list[tuple[Integers, Integers]] = []
        self.held_out: list[Split] = []
        self.is_single = max(int(np.max(channel.trials)) for channel in channels) == 1
        """Whether no pixel has two bits, so that bits cannot be split, but hidden."""
        for channel in channels:
            self._hold_out(channel, rng)
        if not any(trials.any() for _, trials in self.training_bits):
            raise ValueError(
                "data: expected bits to train on besides those that are held out, but all are held "
                "out; pass a capture with more valid pixels or frames"
            )

    def sensor_with_trials(self, trials: int) -> Sensor:
        """Return a sensor without maps, with K = `trials` and the same rate per bit."""
        return self._sensor.replace(frames=trials)

    def draw(self, rng: np.random.Generator, number: int, side: int) -> Split:
        """Return the split of random patches, rotated and mirrored, all with the same K'.

        Parameters
        ----------
        rng : numpy.random.Generator
            Source of randomness.
        number : int
            Number of patches.
        side : int
            Height and width of a patch, in pixels.
        """
        available = (1 - HELD_OUT_FRACTION) * self.trials
        low = max(1, round(INPUT_RANGE[0] * available))
        input_trials = int(rng.integers(low, max(low, int(INPUT_RANGE[1] * available)) + 1))
        parts = [self._draw_patch(rng, input_trials, side) for _ in range(number)]
        return dataclasses.replace(parts[0], planes=torch.cat([part.planes for part in parts]))

    def estimate(self, network: Callable[[Tensor, int | None], Tensor], split: Split) -> Tensor:
        """Return the differentiable output of a network for the input of a split, (N, 1, H, W).

        Above the largest K of the network, it takes several passes, as in
        :meth:`jotlight.Network.reconstruct`.
        """
        trials, known = split.network_trials, self.network.trials_range
        if trials is None or known is None or trials <= known[1]:
            return network(split.counts, trials)
        return probability_of(network, split.counts, trials, known)

    def negative_log_likelihood(self, estimates: Tensor, split: Split) -> Tensor:
        """Return the negative log-likelihood of the target bits, in nats per bit.

        Parameters
        ----------
        estimates : Tensor, shape (N, 1, H, W)
            Output of the network: intensities, or P(b = 1) for a K-conditioned network.
        split : Split
            The target.
        """
        _, ones, trials, efficiency, dark = split.planes.to(estimates).split(1, dim=1)
        threshold = self._sensor.threshold
        if self.conditional:
            reference_efficiency, reference_dark = self.reference
            rate = _rate_from_probability(threshold, estimates)
            light = (rate - reference_dark) / reference_efficiency
        else:
            light = self._sensor.light_per_intensity * estimates
        p = detection_probability(threshold, (efficiency * light + dark).clamp(min=0))
        floor = _FLOOR / self.trials
        p = floor + (1 - 2 * floor) * p
        terms = ones * p.log() + (trials - ones) * torch.log1p(-p)
        per_bit: Tensor = -terms.sum() / trials.sum().clamp(min=1)
        return per_bit

    def held_out_negative_log_likelihood(self, network: Network, threads: int | None) -> float:
        """Return the value for the held-out bits, with all other bits as the input.

        The network runs in the engine, as it does without PyTorch.
        """
        total = bits = 0.0
        for split in self.held_out:
            counts: npt.NDArray[np.float32] = split.counts[0].numpy()
            if network.trials_range is not None:
                trials = split.input_trials
                fractions = counts[:1] / np.float32(trials)
                output = denoise_fractions(network, fractions, [trials], threads=threads)[0]
            else:
                trials = network.sensor.trials
                output = network.engine_network.run_counts(list(counts), trials, False, threads)[0]
            estimate = torch.from_numpy(output).double()[None, None]
            total += split.target_bits * float(self.negative_log_likelihood(estimate, split))
            bits += split.target_bits
        return total / max(bits, 1)

    def _hold_out(self, channel: PixelCounts, rng: np.random.Generator) -> None:
        """Separate the held-out bits of a channel from its training bits."""
        ones = channel.counts.astype(np.int64)
        trials = np.full(ones.shape, channel.trials, np.int64)
        # The fractional part of a tenth of the bits becomes one more bit in some of the pixels.
        subset = np.floor(HELD_OUT_FRACTION * trials + rng.random(trials.shape)).astype(np.int64)
        held_out = subsample_counts(ones, trials, subset, rng)
        training = ones - held_out, trials - subset
        self.channel_trials.append(trials)
        self.training_bits.append(training)
        if self.is_single:
            training = _fill(rng, *training)
        whole = slice(None), slice(None)
        input_trials = max(1, round((1 - HELD_OUT_FRACTION) * self.trials))
        self.held_out.append(
            self._split(channel, whole, input_trials, training, (held_out, subset))
        )

    def _draw_patch(self, rng: np.random.Generator, input_trials: int, side: int) -> Split:
        """Return the split of one random patch that has training bits."""
        while True:
            index = int(rng.integers(len(self.channels)))
            ones, trials = self.training_bits[index]
            top, left = rng.integers(np.array(trials.shape) - side + 1)
            window = slice(top, top + side), slice(left, left + side)
            if trials[window].any():
                break
        ones, trials = ones[window], trials[window]
        subset = self._input_trials(rng, trials, self.channel_trials[index][window], input_trials)
        input_ones = subsample_counts(ones, trials, subset, rng)
        target = ones - input_ones, trials - subset
        input_bits = input_ones, subset
        if self.is_single:
            input_bits = _fill(rng, *input_bits)
        # The split of the held-out bits already warned that dead pixels are inpainted.
        with hide_warnings():
            split = self._split(self.channels[index], window, input_trials, input_bits, target)
        symmetry = int(rng.integers(8))
        planes = torch.rot90(split.planes, symmetry % 4, (2, 3))
        return dataclasses.replace(split, planes=planes.mT if symmetry >= 4 else planes)

    def _input_trials(
        self, rng: np.random.Generator, trials: Integers, whole: Integers, input_trials: int
    ) -> Integers:
        """Return how many of the training bits of each pixel are the input, (H, W).

        `whole` are the numbers of all bits, with those that are held out.
        """
        if self.is_single:
            return np.where(draw_blind_spots(rng, trials > 0), 0, trials)
        # A pixel with dead jots contributes the same fraction of its bits as others.
        subset = np.rint(input_trials / self.trials * whole)
        clipped = np.clip(subset, np.minimum(trials, 1), trials)
        return np.asarray(clipped, np.int64)

    def _split(
        self,
        channel: PixelCounts,
        window: tuple[slice, slice],
        input_trials: int,
        input_bits: tuple[Integers, Integers],
        target: tuple[Integers, Integers],
    ) -> Split:
        """Return a split whose input counts are scaled to `input_trials` bits or the network's K.

        The counts are those that the reference jot would report. `input_bits` and `target` are
        pairs of L and n.
        """
        if self.network.trials_range is not None:
            input_trials = max(input_trials, self.network.trials_range[0])
        else:
            input_trials = self.trials
        efficiency, dark = _crop(channel.efficiency, window), _crop(channel.dark_counts, window)
        ones, trials = input_bits[0].astype(np.int32), input_bits[1].astype(np.float64)
        sensor = self.sensor_with_trials(input_trials)
        pixels = PixelCounts(sensor, ones, trials, efficiency, dark, varies_within_pixels=False)
        counts = equivalent_counts(pixels, self.reference, input_trials, None)
        planes = np.broadcast_arrays(counts, *target, efficiency, dark)
        tensor = torch.from_numpy(np.stack(planes).astype(np.float32)[None])
        return Split(input_trials, self.conditional, tensor)


def _fill(rng: np.random.Generator, ones: Integers, trials: Integers) -> tuple[Integers, Integers]:
    """Return single bits in all pixels, where those of neighbors replace the missing ones."""
    return fill_blind_spots(rng, ones, trials > 0), np.ones_like(trials)


def _rate_from_probability(threshold: int, probability: Tensor) -> Tensor:
    """Return P⁻¹(q, p), with its derivative."""
    with torch.no_grad():
        p = probability.clamp(0, _MAX_PROBABILITY).double().cpu().numpy()
        rate = response.inverse_detection_probability(threshold, p, 1 - p)
        slope = 1 / np.maximum(response.detection_density(threshold, rate), _MIN_SLOPE)
        rates, slopes = (torch.from_numpy(x).to(probability) for x in (rate, slope))
    return rates + slopes * (probability - probability.detach())


def _crop(
    value: float | npt.NDArray[np.float64], window: tuple[slice, slice]
) -> float | npt.NDArray[np.float64]:
    return np.ascontiguousarray(value[window]) if isinstance(value, np.ndarray) else value
