"""The command line and the Python code that make the same image as the page."""

import dataclasses
import shlex
from typing import Any

import numpy as np

from jotlight.estimators.demosaicing import COLORS
from jotlight.evaluation.methods import COLOR_NETWORK, METHODS
from jotlight.formats.capture import CountStack
from jotlight.view.estimate import DEMOSAICING, choose
from jotlight.view.state import COUNTS, ViewState
from jotlight.view.viewed import Opening, Viewable, variable


def recipe(viewed: Viewable, state: ViewState) -> dict[str, str | None]:
    """Return the command line and the Python code of a state, or None where there is none.

    The command for counts, for differences, for hot jots of all frames, and for two or four
    channels runs the Python code. A live capture cannot be opened again.

    Examples
    --------
    >>> from jotlight.view.viewed import Viewed
    >>> opening = Opening("a capture.npy", argv=("--gain", "2.0"))
    >>> bits = jl.Sensor(frames=8).expose([[0.5, 0.5]], rng=0)
    >>> viewed = Viewed("a capture.npy", bits, jl.Sensor(frames=8), opening=opening)
    >>> recipe(viewed, ViewState(2, 4, "mle", white=0.5))["command"]
    "jotlight reconstruct 'a capture.npy' -o view.png --depth 16 --frame-range 2:6 --gain 2.0 \
--method mle --curve gamma --white 0.5"
    """
    if viewed.is_live:
        return {"command": None, "python": None}
    if state.method == COUNTS:
        state = dataclasses.replace(state, align=False, compare=None)
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
    sensor = viewed.sensor(state.window)
    may_have_planes = sensor.mosaic is not None and state.align
    finds_others |= may_have_planes and state.method != COLOR_NETWORK
    is_averaged = bool(_mean_lines(viewed))
    if state.method == COUNTS or state.compare is not None or finds_others or is_averaged:
        return shlex.join(["python", "-c", _python(viewed, state)])
    frames = file_frames(opening, state.span)
    step = f":{frames.step}" if frames.step else ""
    # A name that begins with a hyphen would be taken for an option.
    path = f"./{opening.path}" if opening.path.startswith("-") else opening.path
    words = ["jotlight", "reconstruct", path, "-o", "view.png", "--depth", "16"]
    words += ["--frame-range", f"{frames.start}:{frames.stop}{step}", *opening.argv]
    values = {name: getattr(sensor, name) for name in opening.of_window}
    if sensor.frames != state.window or any(np.ndim(value) for value in values.values()):
        words += ["--frames", str(sensor.frames)]
    for name, value in values.items():
        words += [f"--{name}", _as_words(value, viewed.cycle)]
    words += [*_method_words(viewed, state), "--curve", state.curve]
    words += ["--white", f"{state.white!r}"] if state.white is not None else []
    words += ["--motion"] if state.align else []
    return shlex.join(words)


def _as_words(value: Any, cycle: int) -> str:
    """Return the value of an option, which for a value of each frame repeats that of a cycle.

    Examples
    --------
    >>> _as_words(2.5, 1), _as_words(np.array([1.0, 8.0, 1.0, 8.0]), 2)
    ('2.5', '1.0,8.0,...')
    """
    if np.ndim(value) == 0:
        return repr(value)
    return ",".join(map(repr, value[:cycle].tolist())) + ",..."


def _as_code(value: Any, cycle: int) -> str:
    """Return the value of a parameter of a sensor as Python.

    Examples
    --------
    >>> _as_code(2.5, 1), _as_code(np.array([1.0, 8.0, 1.0, 8.0]), 2)
    ('2.5', '[1.0, 8.0] * 2')
    """
    if np.ndim(value) == 0:
        return repr(value)
    return f"{value[:cycle].tolist()} * {len(value) // cycle}"


def _method_words(viewed: Viewable, state: ViewState) -> list[str]:
    """Return the options of the command line for a method. The color network is the default."""
    if state.method == COLOR_NETWORK:
        return []
    has_planes = viewed.sensor(state.window).mosaic is not None and not state.align
    return ["--method", state.method, *(["--demosaicing", DEMOSAICING] if has_planes else [])]


def _python(viewed: Viewable, state: ViewState) -> str:
    window, name = viewed.sensor(state.window), _name(viewed)
    lines = ["import jotlight as jl"]
    if state.method != COUNTS:
        lines.append("from jotlight.images.tone import Tone")
    lines.append("")
    if viewed.opening.path is None:
        lines.append(f"{name} = {variable(window)}[{state.start} : {state.start + state.window}]")
    else:
        lines += _open_lines(viewed, state)
    lines += _sensor_lines(viewed, state)
    if state.method == COUNTS:
        lines += [f"image = {_counts_code(viewed, state)}", *_mean_lines(viewed)]
        return "\n".join([*lines, 'jl.save_image("view.tif", image)', ""])
    has_mosaic = window.mosaic is not None
    data = name
    if state.align and has_mosaic:
        lines += [
            f"motion = jl.align({name}, sensor)",
            'if motion.model != "none":  # Each pixel is seen through all filters.',
            f"    {name} = jl.merge({name}, sensor, motion=motion)",
            f"    sensor = {name}.sensor",
        ]
        lines += ["else:", f"    {name} = {name}.sum()"] if _holds_counts(viewed) else []
    elif state.align:
        lines += [f"merged = jl.merge({name}, sensor)"]
        data = "merged"
    sensor = "" if data == "merged" else ", sensor"
    is_color = len(viewed.shape) == 3 and _holds_counts(viewed)
    axis = ", channel_axis=-1" if is_color and data != "merged" else ""
    planes = repr(DEMOSAICING) + (" if sensor.mosaic else None" if state.align else "")

    def call(method: str, sensor: str = sensor) -> str:
        options = "" if method == COLOR_NETWORK else f", method={method!r}"
        options += f", demosaicing={planes}" if options and has_mosaic else ""
        return f"jl.reconstruct({data}{sensor}{options}{axis})"

    lines.append(f"image = {call(state.method)}")
    if state.compare is not None:
        limit, other = (
            choose(viewed, state.window, method).max_intensity
            for method in (state.method, state.compare)
        )
        if other != limit:
            own = "merged.sensor" if data == "merged" else "sensor"
            sensor = f", {own}.replace(max_intensity={other})"
        lines.append(f"image -= {call(state.compare, sensor)}")
        lines += _mean_lines(viewed)
        return "\n".join([*lines, 'jl.save_image("view.tif", image)', ""])
    lines += _mean_lines(viewed)
    white = "" if state.white is None else f", white={state.white!r}"
    lines.append(f"tone = Tone.fit(image, {state.curve!r}{white})")
    lines.append('jl.save_image("view.png", tone(image), white=1.0, depth=16)')
    return "\n".join([*lines, ""])


def _name(viewed: Viewable) -> str:
    """Return the name of the data of a window. Code must not change the data of the user."""
    return "window" if viewed.opening.path is None else variable(viewed.sensor(viewed.cycle))


def _mean_lines(viewed: Viewable) -> list[str]:
    """Return lines after which an image of two or four channels is their mean, as on the page."""
    if viewed.shape[2:] in ((), (COLORS,)):
        return []
    return ['image = image.astype("float32").mean(axis=2, dtype="float32")']


def _open_lines(viewed: Viewable, state: ViewState) -> list[str]:
    """Return lines after which the data are those of the window."""
    opening, name = viewed.opening, _name(viewed)
    frames = file_frames(opening, state.span)
    ends = (frames.start, frames.stop, *([frames.step] if frames.step else []))
    options = {**opening.arguments, "frames": f"slice({', '.join(map(str, ends))})"}
    if not state.align or not _holds_counts(viewed):
        return [f"{name} = jl.open({_call(opening.path, options)})"]
    # jl.open sums the images of a stack, which an alignment needs one by one.
    return [
        "from jotlight.formats import open_capture",
        f"bits = open_capture({_call(opening.path, options)})",
    ]


def _call(path: str | None, options: dict[str, str]) -> str:
    """Return the arguments of a call."""
    return ", ".join([repr(path), *(f"{name}={value}" for name, value in options.items())])


def _sensor_lines(viewed: Viewable, state: ViewState) -> list[str]:
    """Return lines after which `sensor` is the sensor of the window."""
    lines = list(viewed.opening.sensor_lines)
    sensor = viewed.sensor(state.window)
    changes: dict[str, Any] = {"frames": sensor.frames}
    changes |= {name: getattr(sensor, name) for name in viewed.opening.of_window}
    if state.method in METHODS or state.method == COLOR_NETWORK:
        changes["max_intensity"] = choose(viewed, state.window, state.method).max_intensity
    texts = ", ".join(f"{name}={_as_code(each, viewed.cycle)}" for name, each in changes.items())
    return [
        *(lines or [f"sensor = {_name(viewed)}.sensor or jl.Sensor()"]),
        f"sensor = sensor.replace({texts})",
    ]


def _counts_code(viewed: Viewable, state: ViewState) -> str:
    """Return the counts as fractions of the largest, in Python."""
    name = _name(viewed)
    if _holds_counts(viewed):
        return f"{name} / sensor.trials"
    if viewed.sensor(state.window).bit_depth == 1:
        return f"{name}.counts(sensor.oversampling) / sensor.trials"
    return f"{name}.sum(oversampling=sensor.oversampling) / (sensor.trials * sensor.max_reading)"


def _holds_counts(viewed: Viewable) -> bool:
    """Return whether a capture holds images of counts rather than frames."""
    return isinstance(viewed.part(viewed.frames[:1]), CountStack)
