"""The command line and the Python code that make the same image as the page."""

import shlex
from typing import Any

from jotlight.evaluation.choice import COLOR_NETWORK
from jotlight.evaluation.methods import METHODS
from jotlight.view.estimate import DEMOSAICING, choose
from jotlight.view.state import COUNTS, ViewState
from jotlight.view.viewed import Opening, Viewable


def recipe(viewed: Viewable, state: ViewState) -> dict[str, str | None]:
    """Return the command line and the Python code of a state, or None where there is none.

    The command for counts, for differences, and for hot jots of all frames runs the Python code. A
    live capture cannot be opened again.

    Examples
    --------
    >>> from jotlight.sensing.sensor import Sensor
    >>> from jotlight.view.viewed import Viewed
    >>> opening = Opening("a capture.npy", ("--gain", "2.0"), {}, ("sensor = jl.Sensor()",))
    >>> bits = Sensor(frames=8).expose([[0.5, 0.5]], rng=0)
    >>> viewed = Viewed("a capture.npy", bits, Sensor(frames=8), opening=opening)
    >>> recipe(viewed, ViewState(2, 4, "mle", white=0.5))["command"]
    "jotlight reconstruct 'a capture.npy' -o view.png --depth 16 --frame-range 2:6 --gain 2.0 \
--method mle --curve gamma --white 0.5"
    """
    if viewed.is_live:
        return {"command": None, "python": None}
    return {"command": _command(viewed, state), "python": _python(viewed, state)}


def file_frames(opening: Opening, frames: range) -> slice:
    """Return the frames of the file that are those frames of the capture.

    Examples
    --------
    >>> file_frames(Opening(frames=slice(100, None, 2)), range(3, 5))
    slice(106, 109, 2)
    """
    first, step = opening.frames.start or 0, opening.frames.step or 1
    start, last = first + frames.start * step, first + (frames.stop - 1) * step
    return slice(start, last + 1, None if step == 1 else step)


def _command(viewed: Viewable, state: ViewState) -> str | None:
    opening = viewed.opening
    if opening.path is None:
        return None
    finds_others = opening.searches_all and state.span != viewed.frames
    # Only the code knows how to combine planes, if the scene stands still, and if it moves.
    may_have_planes = viewed.sensor(1).mosaic is not None and state.align
    finds_others |= may_have_planes and state.method != COLOR_NETWORK
    if state.method == COUNTS or state.compare is not None or finds_others:
        return shlex.join(["python", "-c", _python(viewed, state)])
    frames = file_frames(opening, state.span)
    step = f":{frames.step}" if frames.step else ""
    # A name that begins with a hyphen would be taken for an option.
    path = f"./{opening.path}" if opening.path.startswith("-") else opening.path
    words = ["jotlight", "reconstruct", path, "-o", "view.png", "--depth", "16"]
    words += ["--frame-range", f"{frames.start}:{frames.stop}{step}", *opening.argv]
    if viewed.sensor(1).frames != 1:
        words += ["--frames", str(viewed.sensor(state.window).frames)]
    if opening.states_gain:
        words += ["--gain", repr(viewed.sensor(state.window).gain)]
    words += [*_method_words(viewed, state), "--curve", state.curve]
    words += ["--white", f"{state.white!r}"] if state.white is not None else []
    words += ["--motion"] if state.align else []
    return shlex.join(words)


def _method_words(viewed: Viewable, state: ViewState) -> list[str]:
    """Return the options of the command line for a method. The color network is the default."""
    if state.method == COLOR_NETWORK:
        return []
    has_planes = viewed.sensor(1).mosaic is not None and not state.align
    return ["--method", state.method, *(["--demosaicing", DEMOSAICING] if has_planes else [])]


def _python(viewed: Viewable, state: ViewState) -> str:
    opening = viewed.opening
    lines = ["import jotlight as jl"]
    if state.method != COUNTS:
        lines.append("from jotlight.images.tone import Tone")
    lines.append("")
    if opening.path is None:
        lines.append(f"bits = bits[{state.start} : {state.start + state.window}]")
    else:
        lines += _open_lines(viewed, state)
    lines += _sensor_lines(viewed, state)
    if state.method == COUNTS:
        counts = "bits.counts(sensor.oversampling)" if _holds_bits(viewed) else "bits"
        lines += [f"image = {counts} / sensor.trials"]
        return "\n".join([*lines, 'jl.save_image("view.tif", image)', ""])
    has_mosaic = viewed.sensor(1).mosaic is not None
    data = "bits"
    if state.align and has_mosaic:
        lines += [
            "motion = jl.align(bits, sensor)",
            'if motion.model != "none":  # Each pixel is seen through all filters.',
            "    bits = jl.merge(bits, sensor, motion=motion)",
            "    sensor = bits.sensor",
        ]
    elif state.align:
        lines += ["merged = jl.merge(bits, sensor)"]
        data = "merged"
    sensor = "" if data == "merged" else ", sensor"
    is_color = len(viewed.shape) == 3 and not _holds_bits(viewed)
    axis = ", channel_axis=-1" if is_color and data == "bits" else ""
    planes = repr(DEMOSAICING) + (" if sensor.mosaic else None" if state.align else "")

    def call(method: str) -> str:
        options = "" if method == COLOR_NETWORK else f", method={method!r}"
        options += f", demosaicing={planes}" if options and has_mosaic else ""
        return f"jl.reconstruct({data}{sensor}{options}{axis})"

    lines.append(f"image = {call(state.method)}")
    if state.compare is not None:
        lines.append(f"image -= {call(state.compare)}")
        return "\n".join([*lines, 'jl.save_image("view.tif", image)', ""])
    white = "" if state.white is None else f", white={state.white!r}"
    lines.append(f"tone = Tone.fit(image, {state.curve!r}{white})")
    lines.append('jl.save_image("view.png", tone(image), white=1.0, depth=16)')
    return "\n".join([*lines, ""])


def _open_lines(viewed: Viewable, state: ViewState) -> list[str]:
    """Return lines after which `bits` are the bits or counts of the window."""
    opening = viewed.opening
    frames = file_frames(opening, state.span)
    ends = (frames.start, frames.stop, *([frames.step] if frames.step else []))
    options = {**opening.arguments, "frames": f"slice({', '.join(map(str, ends))})"}
    if not state.align or _holds_bits(viewed):
        return [f"bits = jl.open({_call(opening.path, options)})"]
    # jl.open sums the images of a stack, which an alignment needs one by one.
    lines = ["from jotlight.formats import open_capture"]
    scale, trials = options.pop("counts_scale", None), options.pop("trials", None)
    if scale is None:
        return [*lines, f"bits = open_capture({_call(opening.path, options)})"]
    options |= {"counts": options.get("counts", "True"), "means": "True"}
    return [
        "from jotlight.formats.scaled import unscale",
        *lines,
        f"bits = unscale(open_capture({_call(opening.path, options)}), {scale}, {trials})",
    ]


def _call(path: str | None, options: dict[str, str]) -> str:
    """Return the arguments of a call."""
    return ", ".join([repr(path), *(f"{name}={value}" for name, value in options.items())])


def _sensor_lines(viewed: Viewable, state: ViewState) -> list[str]:
    """Return lines after which `sensor` is the sensor of the window."""
    lines = list(viewed.opening.sensor_lines)
    number = viewed.sensor(state.window).frames
    changes: dict[str, Any] = {"frames": number}
    if viewed.opening.states_gain:
        changes["gain"] = viewed.sensor(state.window).gain
    if state.method in METHODS or state.method == COLOR_NETWORK:
        changes["max_intensity"] = choose(viewed, state.window, state.method).max_intensity
    texts = ", ".join(f"{name}={value!r}" for name, value in changes.items())
    return [
        *(lines or ["sensor = bits.sensor or jl.Sensor()"]),
        f"sensor = sensor.replace({texts})",
    ]


def _holds_bits(viewed: Viewable) -> bool:
    """Return whether a capture holds bits rather than counts."""
    from jotlight.sensing.bits import Bits

    return isinstance(viewed.part(viewed.frames[:1]), Bits)
