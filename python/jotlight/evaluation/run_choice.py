"""The estimate of images by the method that was chosen for them."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from jotlight.array_types import Image
from jotlight.evaluation.choice import Choice, check_fallback
from jotlight.evaluation.color.color_images import reconstruct_channels
from jotlight.evaluation.held_out import blend
from jotlight.evaluation.methods import BLEND_METHOD, COLOR_NETWORK, METHODS
from jotlight.evaluation.request import Request
from jotlight.networks.loading import AnyNetwork
from jotlight.networks.planes_network import ColorNetwork
from jotlight.networks.pretrained import DEFAULT_SIZE, pretrained, pretrained_conditional
from jotlight.sensing.data.gray_outputs import output_of
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.sensor import Sensor


class Run(NamedTuple):
    """The estimate of images, and how its method ended."""

    estimate: Image
    history: Any = None
    """The progress of an iterative method."""
    shares: dict[str, float] | None = None
    """The mean weight of each method of a blend."""


def run_choice(
    choice: Choice,
    request: Request,
    images: GrayImages,
    sensor: Sensor,
    out: Image | None,
    *,
    network: AnyNetwork | None = None,
    is_conditional: bool = False,
) -> Run:
    """Return the estimate of images by the method that was chosen for them.

    Parameters
    ----------
    choice : Choice
        The method.
    request : Request
        Its settings. Its method and `quality` are not read.
    images : GrayImages
        The images, all of which are of a sensor without a mosaic.
    sensor : Sensor
        Their sensor.
    out : ndarray of float32, optional
        Array for the estimate. Default: a new one.
    network : Network or ColorNetwork, optional
        The network to run, that of the caller or a pretrained one. Default: that of the choice.
    is_conditional : bool
        Whether a pretrained network must be K-conditioned, because the numbers of trials differ.

    Raises
    ------
    ValueError
        When the method does not serve the sensor.
    """
    threads = request.threads
    if isinstance(network, ColorNetwork) or choice.method == COLOR_NETWORK:
        own = network if isinstance(network, ColorNetwork) else None
        return Run(reconstruct_channels(images, sensor, out, threads, own, request.precision))
    if request.fallback or choice.method == BLEND_METHOD:
        check_fallback(sensor, choice.method, choice.quality, network)
        network = network or pretrained_conditional(sensor, choice.quality or DEFAULT_SIZE)
        output = output_of(images, sensor, out)
        blends, shares = blend(images, sensor, network, threads, is_color=choice.is_color)
        return Run(output.finish(blends), shares=shares)
    if network is not None or choice.quality is not None:
        load = pretrained_conditional if is_conditional else pretrained
        network = network or load(sensor, str(choice.quality))
        network = network.with_precision(request.precision) if request.precision else network
        return Run(network.reconstruct(images, sensor, out=out, threads=threads))
    method = METHODS[choice.method]
    run: Callable[..., Any] = partial(method.run, out=out, threads=threads, **request.options)
    if method.iterative:
        return Run(*run(images, sensor, return_history=True))
    return Run(run(images, sensor))
