"""The sensor as a PyTorch layer, from intensities to counts or bits, with a gradient."""

import torch
from torch import Tensor, nn
from torch.nn import functional

import jotlight._engine as engine
from jotlight.parameter_names import check_choice
from jotlight.sensing.parameters.reading_groups import require_plain_bits
from jotlight.sensing.sensor import KERNELS, Sensor, require_any_sensor
from jotlight.torch.data_checks import as_floats, check_intensities, shape_advice, warn_about_levels
from jotlight.torch.padding import mirror_pad
from jotlight.torch.response import detection_probability, log_probabilities

OUTPUTS = "counts", "bits"
"""Names of the outputs that the layer can return."""

GRADIENTS = "straight-through", "expectation"
"""Names of the derivatives of the output, which :class:`Sensing` describes."""

_MIN_LIKELIHOOD_RATE = 1e-12
"""Smallest rate s in the likelihood, because the slope of log P is infinite at s = 0."""

_SIMULATION = "jotlight.Sensor.expose simulates such a sensor, without a gradient"
"""What to do with other sensors."""


class Sensing(nn.Module):
    """A sensor as a layer: equations (2) and (3).

    :meth:`jotlight.Sensor.expose` also simulates other sensors, such as brackets and readings of
    several bits, but on the CPU and without a gradient.

    Parameters
    ----------
    sensor : Sensor
        A sensor of any kernel, with or without maps of its jots.
    output : {"counts", "bits"}
        Counts L (N, 1, H, W), or bits (N, T, H·K̂, W·K̂).
    gradient : {"straight-through", "expectation"}
        "straight-through": the output is random, and its derivative is that of its expectation,
        ∂L/∂c := Σ ∂P(q, s)/∂c over the pixel's K bits and ∂b/∂c := ∂P(q, s)/∂c for a bit, with
        ∂P/∂s = s^(q - 1) exp(-s) / (q - 1)!. "expectation": the output is the expectation itself,
        Σ P(q, s) or P(q, s), and nothing is random.

    Raises
    ------
    TypeError, ValueError
        For another output or gradient, and for anything but a sensor of plain bits.

    Examples
    --------
    >>> sensing = Sensing(jl.Sensor(oversampling=4), gradient="expectation")
    >>> intensity = torch.ones(1, 1, 1, 1, requires_grad=True)
    >>> counts = sensing(intensity)
    >>> counts.sum().backward()
    >>> round(counts.item(), 3), round(intensity.grad.item(), 3)  # 16 (1 - 1/e) and 16/e
    (10.114, 5.886)
    """

    def __init__(
        self, sensor: Sensor, *, output: str = "counts", gradient: str = "straight-through"
    ) -> None:
        super().__init__()
        for name, value, choices in (
            ("output", output, OUTPUTS),
            ("gradient", gradient, GRADIENTS),
        ):
            check_choice(name, value, choices)
        require_any_sensor(sensor)
        require_plain_bits(sensor, _SIMULATION)
        self.sensor, self.output, self.gradient = sensor, output, gradient
        self._degree = KERNELS.index(sensor.kernel)
        self._taps = engine.kernel_taps(self._degree, sensor.oversampling)
        maps = sensor.maps()
        for name, map_ in maps.items():
            self.register_buffer(name, torch.from_numpy(map_.astype("float32")), persistent=False)
        # The jots of a pixel are alike, so one binomial variable per pixel is enough.
        self._has_uniform_pixels = self._degree == 0 and not maps

    def forward(self, intensities: Tensor, generator: torch.Generator | None = None) -> Tensor:
        """Return counts (N, 1, H, W) or bits (N, T, H·K̂, W·K̂), as floating-point numbers.

        Parameters
        ----------
        intensities : Tensor, shape (N, 1, H, W)
            c. Negative intensities count as 0. Types narrower than float32 become float32.
        generator : torch.Generator, optional
            Source of randomness, on the device of the intensities. Default: PyTorch's own.

        Raises
        ------
        TypeError
            For anything but a tensor of floats.
        ValueError
            When the shape is another one, or does not fit the sensor's maps.

        Warns
        -----
        JotlightWarning
            When the intensities look like gray levels, such as 0 to 255.
        """
        sensor = self.sensor
        if self.output == "bits":
            mean = self.probability(intensities).expand(-1, sensor.frames, -1, -1)
            if self.gradient == "expectation":
                return mean
            uniform = torch.rand(
                mean.shape, generator=generator, dtype=mean.dtype, device=mean.device
            )
            return _straight_through((uniform < mean).to(mean.dtype), mean)
        per_jot = not self._has_uniform_pixels
        probability = self._probability(self._rate(intensities, per_jot=per_jot))
        trials = torch.full_like(
            probability, sensor.frames if per_jot else sensor.trials, requires_grad=False
        )
        mean = self._sum_pixels(trials * probability)
        if self.gradient == "expectation":
            return mean
        sample = torch.binomial(trials, probability.detach(), generator=generator)
        return _straight_through(self._sum_pixels(sample), mean)

    def extra_repr(self) -> str:
        """Return the arguments of the layer, which PyTorch prints."""
        return f"{self.sensor!r}, output={self.output!r}, gradient={self.gradient!r}"

    def rate(self, intensities: Tensor) -> Tensor:
        """Return the expected detections per jot and frame, η s + d, (N, 1, H·K̂, W·K̂)."""
        return self._rate(intensities, per_jot=True)

    def probability(self, intensities: Tensor) -> Tensor:
        """Return P(b = 1) of each jot, (N, 1, H·K̂, W·K̂); 0 for a dead one."""
        return self._probability(self.rate(intensities))

    def log_likelihood(self, data: Tensor, intensities: Tensor) -> Tensor:
        """Return ℓ(c) = Σ L log P(q, s) + (n - L) log(1 - P(q, s)) per image: equation (4).

        Rates below 10⁻¹² count as 10⁻¹², but keep the derivative.

        Parameters
        ----------
        data : Tensor
            An output of the layer: counts (N, 1, H, W), or bits (N, T, H·K̂, W·K̂). N may be 1 for
            several intensities, and theirs for several data.
        intensities : Tensor, shape (N, 1, H, W)
            c.

        Returns
        -------
        Tensor, shape (N,)
            Log-likelihoods in nats.

        Raises
        ------
        ValueError
            As for :meth:`check_data`.
        """
        self.check_data(data, intensities)
        per_jot = self.output == "bits"
        rate = self._rate(intensities, per_jot=per_jot)
        rate = rate + (_MIN_LIKELIHOOD_RATE - rate).clamp(min=0).detach()
        ones, trials = data.to(rate.dtype), self.sensor.trials
        if per_jot:
            ones, trials = ones.sum(1, keepdim=True), self.sensor.frames
        log_one, log_zero = log_probabilities(self.sensor.threshold, rate)
        terms = ones * log_one + (trials - ones) * log_zero
        return self._mask_dead_jots(terms).sum((1, 2, 3)).to(rate.dtype)

    def check_data(self, data: Tensor, intensities: Tensor) -> None:
        """Raise ValueError for data whose likelihood at given intensities is unknown.

        Parameters
        ----------
        data, intensities : Tensor
            As for :meth:`log_likelihood`.

        Raises
        ------
        ValueError
            For counts of a sensor whose jots receive different light: their likelihood takes bits.
            For data whose shape or range is not that of an output of the layer.

        Examples
        --------
        >>> cubic = Sensing(jl.Sensor(oversampling=4, kernel="cubic"))
        >>> cubic.check_data(torch.ones(1, 1, 2, 2), torch.ones(1, 1, 2, 2))
        Traceback (most recent call last):
        ...
        ValueError: data: expected bits for a smooth kernel ... use Sensing(sensor, output="bits")
        """
        per_jot = self.output == "bits"
        if not (per_jot or self._has_uniform_pixels):
            raise ValueError(
                "data: expected bits for a smooth kernel and for maps of the jots, since a count "
                'does not say which jots reported 1; use Sensing(sensor, output="bits")'
            )
        _check_images(intensities)
        number, _, *sizes = intensities.shape
        number = len(data) if data.dim() == 4 and number == 1 else number
        if per_jot:
            sizes = [size * self.sensor.oversampling for size in sizes]
        expected = (number, self.sensor.frames if per_jot else 1, *sizes)
        if tuple(data.shape) not in (expected, (1, *expected[1:])):
            raise ValueError(
                f"data: expected {self.output} of shape {expected}, as the layer returns for these "
                f"intensities, got {tuple(data.shape)}{shape_advice('data', data)}"
            )
        data = as_floats(data)
        highest = 1 if per_jot else self.sensor.trials
        if not bool(((data >= 0) & (data <= highest)).all()):
            raise ValueError(
                f"data: expected {self.output} from 0 to {highest}, got {data.min():g} to "
                f"{data.max():g}"
            )

    def _rate(self, intensities: Tensor, *, per_jot: bool) -> Tensor:
        """Return the rate of each jot, or of each pixel if its jots are alike."""
        _check_images(intensities)
        warn_about_levels(intensities, self.sensor.max_intensity)
        dtype = torch.promote_types(intensities.dtype, torch.float32)
        with torch.autocast(intensities.device.type, enabled=False):
            # `clamp` would set the slope at 0 to 0, too.
            light = intensities.to(dtype)
            light = torch.where(light < 0, 0, light)
            if per_jot:
                side = self.sensor.oversampling
                self.sensor.check_map_shapes(*(size * side for size in light.shape[2:]))
                light = self._light_field(light)
            light = self.sensor.light_per_intensity * light
            efficiency = self._jot_parameter("efficiency", dtype)
            return efficiency * light + self._jot_parameter("dark_counts", dtype)

    def _light_field(self, light: Tensor) -> Tensor:
        """Return K̂² G c, the light of each jot; a constant image stays what it is."""
        side = self.sensor.oversampling
        if self._degree == 0:
            return light.repeat_interleave(side, 2).repeat_interleave(side, 3)
        height, width = (size * side for size in light.shape[2:])
        taps = side * torch.tensor(self._taps, dtype=light.dtype, device=light.device)
        margin = self._degree // 2 + 1
        start = margin * side + self._degree * side // 2
        padded = mirror_pad(light, (margin, margin), (margin, margin))
        kernel = torch.outer(taps, taps)[None, None]
        light = functional.conv_transpose2d(padded, kernel, None, side)
        return light[..., start : start + height, start : start + width]

    def _jot_parameter(self, name: str, dtype: torch.dtype) -> Tensor | float:
        """Return a parameter of the jots: a number, or a map (H·K̂, W·K̂)."""
        value = self._buffers.get(name)
        return float(getattr(self.sensor, name)) if value is None else value.to(dtype)

    def _probability(self, rate: Tensor) -> Tensor:
        return self._mask_dead_jots(detection_probability(self.sensor.threshold, rate))

    def _mask_dead_jots(self, values: Tensor) -> Tensor:
        """Return the values with 0 for dead jots."""
        mask = self._buffers.get("mask")
        return values if mask is None else values * (1 - mask)

    def _sum_pixels(self, values: Tensor) -> Tensor:
        """Return the sum over each pixel's jots, of values per jot or already per pixel."""
        if self._has_uniform_pixels:
            return values
        return functional.avg_pool2d(values, self.sensor.oversampling, divisor_override=1)


def _check_images(intensities: Tensor) -> None:
    """Raise TypeError or ValueError for anything but floats (N, 1, H, W)."""
    check_intensities(intensities)
    if intensities.dim() != 4 or intensities.shape[1] != 1:
        raise ValueError(
            f"intensities: expected shape (N, 1, H, W), got {tuple(intensities.shape)}"
            f"{shape_advice('intensities', intensities)}"
        )


def _straight_through(sample: Tensor, mean: Tensor) -> Tensor:
    """Return the sample, with the derivative of its mean."""
    return sample + (mean - mean.detach())
