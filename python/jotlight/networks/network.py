"""A reconstruction network: its layers, and the sensor that it is for."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.checks import check_threads
from jotlight.networks.architectures import (
    build_conditional,
    build_residual,
    build_two_layer,
    find_architecture,
)
from jotlight.networks.description import html_of, repr_of
from jotlight.networks.figure import figure_of_layers
from jotlight.networks.files.network_files import read_network, write_network
from jotlight.networks.files.onnx_export import write_onnx
from jotlight.networks.inference.conditional_inference import estimate_intensity
from jotlight.networks.inference.engine_backed import GrayNetwork
from jotlight.networks.inference.inference import Inference
from jotlight.networks.inference.served_sensors import check_served
from jotlight.networks.layer import Layer
from jotlight.networks.layer_checks import check_layers, check_rotations, require_layers
from jotlight.networks.torch_hints import TorchHints
from jotlight.parameter_names import takes_rng
from jotlight.seeds import random_generator
from jotlight.sensing.data.data_lists import carried_sensor
from jotlight.sensing.data.gray_outputs import output_of
from jotlight.sensing.data.pixel_counts import Data, gray_images, prepare_data
from jotlight.sensing.sensor import Sensor

if TYPE_CHECKING:
    from jotlight.figures import Figure


@require_layers
class Network(GrayNetwork, TorchHints):
    """A reconstruction network: linear filters and pointwise splines, equations (8) to (11).

    Parameters
    ----------
    layers : sequence of Layer
        Each layer filters the output of the previous one, or of its `input`. The last layer has one
        channel.
    sensor : Sensor
        Sensor that the network is for. A K-conditioned network serves other sensors, too.
    history : mapping, optional
        Where the parameters came from, in values that JSON can hold: the text `start`, and the list
        `stages` of the training runs and other changes since then.
    trials_range : (int, int), optional
        Smallest and largest K of a K-conditioned network. Its layers have sets of parameters, and
        the first one is tied. Default: the network is for one K, that of its sensor.
    rotations : {1, 4}
        4 averages the output of a tied network over the rotations of the data by 90 degrees. This
        takes four times as long, and the estimate is slightly better.

    Raises
    ------
    ValueError
        When the layers do not fit each other, the sensor, `trials_range`, or `rotations`, or when
        data exist for which a value in the network could overflow.

    Examples
    --------
    >>> sensor = jl.Sensor(oversampling=4)
    >>> bits = sensor.expose(np.full((20, 30), 0.5), rng=0)
    >>> jl.Network.initial(sensor).reconstruct(bits).shape
    (20, 30)
    """

    def __init__(
        self,
        layers: Sequence[Layer],
        sensor: Sensor,
        history: Mapping[str, Any] | None = None,
        *,
        trials_range: tuple[int, int] | None = None,
        rotations: int = 1,
    ) -> None:
        self.layers = tuple(layers)
        self.sensor = sensor
        self.trials_range = trials_range
        self.history = dict(history or {})
        self.default_sensor: Sensor | None = None
        """Sensor of counts without a sensor of their own, if it differs from `sensor`."""
        check_layers(self.layers, sensor, trials_range)
        self.rotations = check_rotations(rotations, tied=self.tied)
        _ = self.engine_network  # It refuses layers whose values could overflow.

    @classmethod
    def initial(
        cls,
        sensor: Sensor,
        *,
        sigma: float = 0.7,
        tied: bool = True,
        taps: int = 15,
        coefficients: int = 150,
        nu: float = 0.5,
    ) -> Self:
        """Return the paper's two-layer network at its initial parameters (section 3.2).

        The network is the non-iterative method with a Gaussian denoiser and the algebraic inverse,
        up to the fit of its splines, which is coarser for larger q: h1 = 1 (20), φ1 = T (6), h2 a
        Gaussian, and φ2 = (K/α)(P⁻¹(q, T⁻¹(z)/K) - d)/η clipped to [0, S].

        Parameters
        ----------
        sensor : Sensor
            Medians replace its maps of dark counts and efficiency.
        sigma : float
            Standard deviation of h2 in pixels; the paper uses 0.25 to 1.
        tied : bool
            Whether h1 has one weight for all bits of a pixel. With the box kernel these bits are
            exchangeable, so a tied network loses no accuracy, and it accepts counts.
        taps : int
            Height and width of h2, odd.
        coefficients : int
            N_w, the number of coefficients of each spline, at least 5.
        nu : float
            ν, the margin for learned filters. If their negative taps sum to -ν or more, every r
            lies in the domain of φ2. Outside the range of T, the initial φ2 is constant.
        """
        layers = build_two_layer(sensor, sigma, tied, taps, coefficients, nu)
        return cls(layers, sensor, {"start": f"initial parameters of the paper, sigma = {sigma}"})

    @classmethod
    @takes_rng
    def residual(
        cls, sensor: Sensor, architecture: str = "small", *, rng: int | None = None
    ) -> Self:
        """Return an untrained deep network, whose output is x0 = P⁻¹ of the smoothed L/K.

        Training with :mod:`jotlight.torch` teaches its U-Net to correct x0. The last filters of the
        U-Net start at 0, the others at random.

        Parameters
        ----------
        sensor : Sensor
            Medians replace its maps of dark counts and efficiency.
        architecture : {"small", "medium", "large"}
            Layers and channels: :data:`jotlight.networks.architectures.ARCHITECTURES`.
        rng : int, optional
            Seed of the filters. Default: a fresh one.

        Examples
        --------
        >>> jl.Network.residual(jl.Sensor(frames=16), rng=0).halo
        8
        """
        layers = build_residual(find_architecture(architecture), sensor, random_generator(rng))
        history = {"start": f"{architecture}, starts at the smoothed, inverted counts"}
        return cls(layers, sensor, history)

    @classmethod
    @takes_rng
    def conditional(
        cls,
        architecture: str = "medium",
        *,
        trials_range: tuple[int, int] = (1, 256),
        rng: int | None = None,
    ) -> Self:
        """Return an untrained K-conditioned network, whose output is a smoothed estimate.

        It serves every K of a range at any exposure. Train it with :mod:`jotlight.torch`.

        Parameters
        ----------
        architecture : {"two-layer", "small", "medium", "large"}
            The paper's two layers, or the layers and channels of
            :data:`jotlight.networks.architectures.ARCHITECTURES`.
        trials_range : (int, int)
            Smallest and largest K, the number of trials per pixel.
        rng : int, optional
            Seed of the filters. Default: a fresh one.

        Examples
        --------
        >>> network = jl.Network.conditional("small", rng=0)
        >>> network.reconstruct([[3, 1], [0, 9]], jl.Sensor(frames=9)).shape
        (2, 2)
        """
        layers = build_conditional(architecture, random_generator(rng))
        history = {
            "start": f"{architecture}, conditional on K; starts at the smoothed, stabilized counts"
        }
        return cls(layers, Sensor(), history, trials_range=trials_range)

    def reconstruct(
        self,
        data: Data,
        sensor: Sensor | None = None,
        *,
        trials: npt.ArrayLike | None = None,
        channel_axis: int | None = None,
        out: npt.NDArray[np.float32] | None = None,
        threads: int | None = None,
    ) -> npt.NDArray[np.float32]:
        """Return the estimate of the image, or of each image of a stack.

        Parameters
        ----------
        data : Bits, Merged, list of them, or array_like of int
            Bits; for a tied network also merged counts, or counts L of shape (..., H, W).
        sensor : Sensor, optional
            Sensor of the data, which may have its own dead jots and dark counts. Default: the
            sensor that bits or merged counts carry, else the one for which
            :func:`jotlight.pretrained` was called, else that of a network for one K.
        trials : float or array_like of float, optional
            Number of binary readings behind each pixel of counts, 0 or more: a number, or a map of
            their shape. Default: the sensor's K.
        channel_axis : int, optional
            Axis of counts that holds color channels. Default: none, and axes before the last two
            are those of a stack.
        out : ndarray of float32, optional
            Array of the shape of the result to write to and return. Default: a new one.
        threads : int, optional
            The number of threads. Default: the number of cores.

        Returns
        -------
        ndarray of float32
            Intensities in [0, S], of the shape of the counts. Estimates of color bits are
            (H, W, C).

        Raises
        ------
        TypeError, ValueError
            When data, sensor, trials, network, and `out` do not fit together.

        Warns
        -----
        JotlightWarning
            When pixels without a valid bit were inpainted from their neighbors.
        """
        sensor = sensor or self.sensor_of(data, trials)
        data, sensor = prepare_data(data, sensor, trials, channel_axis)
        self.check_sensor(sensor)
        images = gray_images(data)
        output = output_of(images, sensor, out)
        task = Inference(self, images, sensor, output, threads)
        return output.finish(task.run() if self.trials_range is None else estimate_intensity(task))

    __call__ = reconstruct

    def sensor_of(self, data: Data, trials: npt.ArrayLike | None = None) -> Sensor | None:
        """Return the default sensor of data, as :meth:`reconstruct` states it, or None."""
        own = self.sensor if self.trials_range is None or trials is not None else None
        return carried_sensor(data) or self.default_sensor or own

    def denoise_probability(
        self, fraction: Image, trials: int, *, threads: int | None = None
    ) -> Image:
        """Return P(b = 1), (H, W), for the fractions of ones (H, W) among K = `trials` bits."""
        return self.denoise_probabilities([fraction], trials, threads=threads)[0]

    def denoise_probabilities(
        self, fractions: Sequence[Image], trials: int, *, threads: int | None = None
    ) -> list[Image]:
        """Return :meth:`denoise_probability` of several images, which may differ in size."""
        check_threads(threads)
        counts = [image * np.float32(trials) for image in fractions]
        return self.engine_network.run_counts(counts, trials, False, threads)

    def check_sensor(self, sensor: Sensor) -> None:
        """Check that the network serves the data of a sensor.

        A tied network serves every combination of jots and frames with the same K.

        Raises
        ------
        ValueError
            When the network is for other sensors; the message says how they differ.
        """
        check_served(self.sensor, sensor, self.trials_range, tied=self.tied)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the network to a `.safetensors` file, with its sensor and history as metadata.

        The file does not store the precision, so :meth:`load` returns a network in "f32".
        """
        write_network(path, self)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Return the network in a file that :meth:`save` wrote. No code in the file is executed.

        Raises
        ------
        OSError, ValueError
            When the file does not exist, is not a network file, or holds a color or film network,
            which :meth:`jotlight.ColorNetwork.load` or :meth:`jotlight.FilmNetwork.load` reads.
        """
        return read_network(path, cls, planes=0)

    def export_onnx(self, path: str | os.PathLike[str], sensor: Sensor | None = None) -> None:
        """Write an ONNX model from counts (N, 1, H, W) to intensities (extra `onnx`).

        The sensor is by default the one for which :func:`jotlight.pretrained` was called, else the
        network's. :func:`jotlight.networks.files.onnx_export.write_onnx` describes the model and
        the errors.
        """
        write_onnx(path, self, sensor or self.default_sensor)

    def plot(self) -> Figure:
        """Return a figure of splines and filters: those of the first and the last trained layer."""
        return figure_of_layers(self.layers)

    def _repr_html_(self) -> str:
        return html_of(self)

    def __repr__(self) -> str:
        return repr_of(self)
