"""The sensor as a layer: from intensities to counts or bits, with a gradient."""

import torch
from torch import Tensor, nn
from torch.nn import functional

import jotlight._engine as engine
from jotlight.sensing.sensor import KERNELS, Sensor
from jotlight.torch.network import continued
from jotlight.torch.response import detection_probability, logarithms

OUTPUTS = "counts", "bits"
GRADIENTS = "straight-through", "expectation"

_LEAST = 1e-12
"""The likelihood takes jots for at least so bright, since no slope at 0 is finite."""


class Sensing(nn.Module):
    """A sensor as a layer of PyTorch: equations (2) and (3).

    Parameters
    ----------
    sensor : jotlight.Sensor
        Of any kernel, with or without maps of its jots.
    output : {"counts", "bits"}
        Counts L (N, 1, H, W), or bits (N, T, H·K̂, W·K̂).
    gradient : {"straight-through", "expectation"}
        With "straight-through" the output is drawn, and its derivative is taken to be that of its
        expectation: ∂L/∂c := Σ ∂P(q, s)/∂c over the pixel's K bits, and ∂b/∂c := ∂P(q, s)/∂c of a
        bit, with ∂P/∂s = s^(q - 1) exp(-s) / (q - 1)!. With "expectation" the output itself is the
        expectation, Σ P(q, s) or P(q, s), and nothing is drawn.

    Raises
    ------
    ValueError
        For another output or gradient.

    Examples
    --------
    >>> sensing = Sensing(Sensor(oversampling=4), gradient="expectation")
    >>> light = torch.ones(1, 1, 1, 1, requires_grad=True)
    >>> counts = sensing(light)
    >>> counts.sum().backward()
    >>> round(counts.item(), 3), round(light.grad.item(), 3)  # 16 (1 - 1/e) and 16/e
    (10.114, 5.886)
    """

    def __init__(
        self, sensor: Sensor, *, output: str = "counts", gradient: str = "straight-through"
    ) -> None:
        super().__init__()
        for name, value, known in (
            ("output", output, OUTPUTS),
            ("gradient", gradient, GRADIENTS),
        ):
            if value not in known:
                raise ValueError(f"{name}: expected one of {', '.join(known)}, got {value!r}")
        self.sensor, self.output, self.gradient = sensor, output, gradient
        degree = KERNELS.index(sensor.kernel)
        self._degree, self._taps = degree, engine.kernel_taps(degree, sensor.oversampling)
        maps = sensor.maps()
        for name, map_ in maps.items():
            self.register_buffer(name, torch.from_numpy(map_.astype("float32")), persistent=False)
        self._even = degree == 0 and not maps

    def forward(self, intensities: Tensor, generator: torch.Generator | None = None) -> Tensor:
        """Give counts (N, 1, H, W) or bits (N, T, H·K̂, W·K̂), as floating-point numbers.

        Parameters
        ----------
        intensities : Tensor, shape (N, 1, H, W)
            c; below 0 they count as 0. What is narrower than float32 is computed in float32.
        generator : torch.Generator, optional
            Of the draws, on the device of the intensities. Default: PyTorch's own.
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
        chances = self._chances(self._rate(intensities, jots=not self._even))
        trials = torch.full_like(
            chances, sensor.bits_per_pixel if self._even else sensor.frames, requires_grad=False
        )
        mean = self._counted(trials * chances)
        if self.gradient == "expectation":
            return mean
        drawn = torch.binomial(trials, chances.detach(), generator=generator)
        return _straight_through(self._counted(drawn), mean)

    def rate(self, intensities: Tensor) -> Tensor:
        """Detections per jot and frame in the mean, η s + d (N, 1, H·K̂, W·K̂)."""
        return self._rate(intensities, jots=True)

    def probability(self, intensities: Tensor) -> Tensor:
        """P(b = 1) of each jot (N, 1, H·K̂, W·K̂); 0 for a dead one."""
        return self._chances(self.rate(intensities))

    def log_likelihood(self, data: Tensor, intensities: Tensor) -> Tensor:
        """ℓ(c) = Σ L log P(q, s) + (n - L) log(1 - P(q, s)) of each picture: equation (4).

        Parameters
        ----------
        data : Tensor
            What the layer gives: counts (N, 1, H, W), or bits (N, T, H·K̂, W·K̂).
        intensities : Tensor, shape (N, 1, H, W)

        Returns
        -------
        Tensor, shape (N,)
            In nats.

        Raises
        ------
        ValueError
            For counts of a sensor whose jots see different light: their likelihood takes bits.
        """
        bits = self.output == "bits"
        if not (bits or self._even):
            raise ValueError(
                "data: expected bits for a smooth kernel and for maps of the jots, since a count "
                'does not tell which jots fired; use Sensing(sensor, output="bits")'
            )
        rate = self._rate(intensities, jots=bits)
        rate = rate + (_LEAST - rate).clamp(min=0).detach()
        ones, trials = data.to(rate.dtype), self.sensor.bits_per_pixel
        if bits:
            ones, trials = ones.sum(1, keepdim=True), self.sensor.frames
        fired, rested = logarithms(self.sensor.threshold, rate)
        each = ones * fired + (trials - ones) * rested
        return self._living(each).sum((1, 2, 3)).to(rate.dtype)

    def _rate(self, intensities: Tensor, *, jots: bool) -> Tensor:
        if intensities.dim() != 4 or intensities.shape[1] != 1:
            raise ValueError(
                f"intensities: expected shape (N, 1, H, W), got {tuple(intensities.shape)}"
            )
        wide = torch.promote_types(intensities.dtype, torch.float32)
        with torch.autocast(intensities.device.type, enabled=False):
            # Clamping would take away the slope at 0, too.
            light = intensities.to(wide)
            light = torch.where(light < 0, 0, light)
            if jots:
                side = self.sensor.oversampling
                self.sensor.check_map_shapes(*(size * side for size in light.shape[2:]))
                light = self._spread(light)
            _, per_intensity, _ = self.sensor.pixel_response()
            light = per_intensity * light
            return self._of_jots("efficiency", wide) * light + self._of_jots("dark_counts", wide)

    def _spread(self, light: Tensor) -> Tensor:
        """K̂² G c, so that an even picture stays what it is."""
        side = self.sensor.oversampling
        if self._degree == 0:
            return light.repeat_interleave(side, 2).repeat_interleave(side, 3)
        height, width = (size * side for size in light.shape[2:])
        taps = side * torch.tensor(self._taps, dtype=light.dtype, device=light.device)
        rim = self._degree // 2 + 1
        start = rim * side + self._degree * side // 2
        light = functional.conv_transpose2d(
            continued(light, (rim, rim), (rim, rim)),
            torch.outer(taps, taps)[None, None],
            None,
            side,
        )
        return light[..., start : start + height, start : start + width]

    def _of_jots(self, name: str, dtype: torch.dtype) -> Tensor | float:
        """A parameter, a number or a map."""
        value = self._buffers.get(name)
        return float(getattr(self.sensor, name)) if value is None else value.to(dtype)

    def _chances(self, rate: Tensor) -> Tensor:
        return self._living(detection_probability(self.sensor.threshold, rate))

    def _living(self, of_jots: Tensor) -> Tensor:
        mask = self._buffers.get("mask")
        return of_jots if mask is None else of_jots * (1 - mask)

    def _counted(self, cells: Tensor) -> Tensor:
        if self._even:
            return cells
        return functional.avg_pool2d(cells, self.sensor.oversampling, divisor_override=1)


def _straight_through(drawn: Tensor, mean: Tensor) -> Tensor:
    """What was drawn, with the derivative of its mean."""
    return drawn + (mean - mean.detach())
