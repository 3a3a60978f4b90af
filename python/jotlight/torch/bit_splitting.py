"""The bits of a capture in parts: some that a network sees, others that it has to tell."""

import dataclasses
import warnings
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

import jotlight
from jotlight.estimators.inverse_response import equivalent_counts
from jotlight.networks.inference import Inference
from jotlight.sensing import response
from jotlight.sensing.pixel_counts import PixelCounts
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor
from jotlight.torch.response import detection_probability

Whole = npt.NDArray[np.int64]

HELD_OUT = 0.1
"""The share of all bits that no step learns from."""
SEEN = 0.6, 0.9
"""The least and the largest share of the other bits that a step gives to the network."""
_FLOOR = 0.01
"""No bit is told to be 0 or 1 with more certainty than so many ones or zeros among K say."""


def subsample_counts(
    ones: npt.ArrayLike, trials: npt.ArrayLike, taken: npt.ArrayLike, rng: int | np.random.Generator
) -> Whole:
    """Draw so many of each pixel's bits, without putting any back; gives the ones among them.

    The bits of a pixel are exchangeable, so this is as good as having drawn the bits themselves.

    Parameters
    ----------
    ones, trials, taken : array_like of int, shape (H, W)
        L of the n bits of each pixel, and how many of them to draw.
    rng : int or numpy.random.Generator

    Returns
    -------
    ndarray of int64, shape (H, W)

    Examples
    --------
    >>> drawn([[0, 3, 8]], [[8, 8, 8]], [[5, 8, 5]], rng=0).tolist()
    [[0, 3, 5]]
    """
    ones = np.asarray(ones, np.int64)
    zeros = np.asarray(trials, np.int64) - ones
    return np.random.default_rng(rng).hypergeometric(ones, zeros, np.asarray(taken, np.int64))


def check_kernel(sensor: Sensor) -> None:
    """Raise ValueError where the jots of a pixel see different light.

    Examples
    --------
    >>> check_kernel(Sensor(frames=8))
    """
    if sensor.kernel != "box":
        raise ValueError(
            f"sensor: expected the box kernel, got {sensor.kernel}: the jots of a pixel see "
            "different light, so that its bits cannot be split at random"
        )


@dataclasses.dataclass(frozen=True)
class Split:
    """What a network sees of some pixels, and what it has to tell."""

    bits: int
    """The bits per pixel that what it sees is scaled to: as many as it sees, or its own K."""
    told: int | None
    """The same where it is told."""
    planes: Tensor
    """(N, 5, H, W): the counts that it sees, ones and trials that it has to tell, and η and d."""

    @property
    def counts(self) -> Tensor:
        """What the network sees, (N, 1, H, W)."""
        return self.planes[:, :1]

    @property
    def number(self) -> float:
        """How many bits it has to tell."""
        return float(self.planes[:, 2].double().sum())

    def of(self, some: slice) -> "Split":
        """Give some of the patches."""
        return dataclasses.replace(self, planes=self.planes[some])


class Splits:
    """The bits of each pixel of a capture: some held out for good, the others split anew.

    Parameters
    ----------
    network : jotlight.Network
        Which is to see some of them.
    sensor : Sensor
        What made the capture.
    seen : sequence of PixelCounts
        The capture, its channels one by one; the jots of a pixel are alike.
    rng : numpy.random.Generator
        Draws what is held out.
    """

    def __init__(
        self,
        network: jotlight.Network,
        sensor: Sensor,
        seen: Sequence[PixelCounts],
        rng: np.random.Generator,
    ) -> None:
        self.network = network
        self.whole = sensor.bits_per_pixel
        self.told = network.trials_range is not None
        # As `reconstruct` takes them.
        efficiency, dark = reference_jot(sensor)
        self.reference = efficiency, dark if self.told else reference_jot(network.sensor)[1]
        self._sensor = sensor.replace(
            oversampling=1, frames=self.whole, mask=None, efficiency=efficiency, dark_counts=dark
        )
        self.seen = seen
        self.trials: list[Whole] = []
        """n of all bits."""
        self.rest: list[tuple[Whole, Whole]] = []
        """L and n of the bits that may be learned from."""
        self.held_out: list[Split] = []
        for plane in seen:
            ones = plane.counts.astype(np.int64)
            trials = np.full(ones.shape, plane.trials, np.int64)
            # Few bits are held out in some of the pixels only.
            taken = np.floor(HELD_OUT * trials + rng.random(trials.shape)).astype(np.int64)
            kept = subsample_counts(ones, trials, taken, rng)
            rest = ones - kept, trials - taken
            self.trials.append(trials)
            every = slice(None), slice(None)
            bits = max(1, round((1 - HELD_OUT) * self.whole))
            self.rest.append(rest)
            self.held_out.append(self._split(plane, every, bits, rest, (kept, taken)))

    def sensor_at(self, bits: int) -> Sensor:
        """Give a sensor without maps of so many bits per pixel, each as bright as the capture's."""
        return self._sensor.replace(frames=bits)

    def draw(self, rng: np.random.Generator, number: int, side: int) -> Split:
        """Draw patches, turned and mirrored at random, all with as many bits seen."""
        rest = (1 - HELD_OUT) * self.whole
        least = max(1, round(SEEN[0] * rest))
        bits = int(rng.integers(least, max(least, int(SEEN[1] * rest)) + 1))
        parts = [self._patch(rng, bits, side) for _ in range(number)]
        return dataclasses.replace(parts[0], planes=torch.cat([part.planes for part in parts]))

    def _patch(self, rng: np.random.Generator, bits: int, side: int) -> Split:
        while True:
            index = int(rng.integers(len(self.seen)))
            ones, trials = self.rest[index]
            top, left = rng.integers(np.array(trials.shape) - side + 1)
            where = slice(top, top + side), slice(left, left + side)
            if trials[where].any():
                break
        ones, trials = ones[where], trials[where]
        # Of a pixel with dead jots as large a share as of others.
        taken = np.rint(bits / self.whole * self.trials[index][where])
        taken = np.clip(taken, np.minimum(trials, 1), trials).astype(np.int64)
        shown = subsample_counts(ones, trials, taken, rng)
        left_over = ones - shown, trials - taken
        with warnings.catch_warnings():
            # It was said of the whole capture that blind pixels are filled.
            warnings.simplefilter("ignore", jotlight.JotlightWarning)
            split = self._split(self.seen[index], where, bits, (shown, taken), left_over)
        turn = int(rng.integers(8))
        planes = torch.rot90(split.planes, turn % 4, (2, 3))
        return dataclasses.replace(split, planes=planes.mT if turn >= 4 else planes)

    def _split(
        self,
        plane: PixelCounts,
        where: tuple[slice, slice],
        bits: int,
        shown: tuple[Whole, Whole],
        target: tuple[Whole, Whole],
    ) -> Split:
        """Bring what is shown to `bits` valid bits of the reference jot, or to the network's K."""
        if self.network.trials_range is not None:
            bits = max(bits, self.network.trials_range[0])
        else:
            bits = self.whole
        efficiency, dark = _part(plane.efficiency, where), _part(plane.dark_counts, where)
        ones, trials = (x.astype(np.int32) for x in shown)
        counts = equivalent_counts(
            PixelCounts(
                self.sensor_at(bits), ones, trials, efficiency, dark, varies_within_pixels=False
            ),
            self.reference,
            None,
        )
        planes = np.broadcast_arrays(counts, *target, efficiency, dark)
        return Split(
            bits,
            bits if self.told else None,
            torch.from_numpy(np.stack(planes).astype(np.float32)[None]),
        )

    def negative_log_likelihood(self, pictures: Tensor, split: Split) -> Tensor:
        """Give the negative log likelihood of what was to be told, in nats per bit.

        Parameters
        ----------
        pictures : Tensor
            The network's, (N, 1, H, W): intensities, or chances to fire of one that is told K.
        split : Split
        """
        _, ones, trials, efficiency, dark = split.planes.to(pictures).split(1, dim=1)
        threshold, light, _ = self._sensor.pixel_response()
        if self.told:
            own_efficiency, own_dark = self.reference
            detected = (_rates(threshold, pictures) - own_dark) / own_efficiency
        else:
            detected = light * pictures
        chances = detection_probability(threshold, (efficiency * detected + dark).clamp(min=0))
        floor = _FLOOR / self.whole
        chances = floor + (1 - 2 * floor) * chances
        told = ones * chances.log() + (trials - ones) * torch.log1p(-chances)
        return -told.sum() / trials.sum().clamp(min=1)

    def held_out_negative_log_likelihood(
        self, network: jotlight.Network, threads: int | None
    ) -> float:
        """Give that of the bits held out, where the network sees all others."""
        total = number = 0.0
        for split in self.held_out:
            ready = network.conditioned_on(self.sensor_at(split.bits)) if self.told else network
            inference = Inference(ready.layers, ready.sensor, self.reference, threads)
            output = inference.run_counts(split.counts[0].numpy())
            picture = torch.from_numpy(output).double()[None, None]
            total += split.number * float(self.negative_log_likelihood(picture, split))
            number += split.number
        return total / max(number, 1)


def _rates(threshold: int, chances: Tensor) -> Tensor:
    """P⁻¹(q, p), with its slope."""
    with torch.no_grad():
        p = chances.clamp(0, 1 - 1e-6).double().cpu().numpy()
        found = response.inverse_detection_probability(threshold, p, 1 - p)
        slopes = 1 / np.maximum(response.detection_density(threshold, found), 1e-6)
        rates, slope = (torch.from_numpy(x).to(chances) for x in (found, slopes))
    return rates + slope * (chances - chances.detach())


def _part(
    value: float | npt.NDArray[np.float64], where: tuple[slice, slice]
) -> float | npt.NDArray[np.float64]:
    return np.ascontiguousarray(value[where]) if isinstance(value, np.ndarray) else value
