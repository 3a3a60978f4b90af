"""``jotlight view``: a page that shows a capture while the user moves a slider."""

import dataclasses
import threading
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Group, Parameter

from jotlight.calibration import Calibration
from jotlight.cli.captures.captured import Captured, add_sensor
from jotlight.cli.captures.jot_checks import mask_hot_jots
from jotlight.cli.options.capture_options import (
    CaptureOptions,
    ViewedCaptureOptions,
    parse_frame_range,
)
from jotlight.cli.options.common_options import convert_file
from jotlight.cli.options.sensor_options import CapturedSensorOptions
from jotlight.cli.terminal.console import caution, report
from jotlight.formats.capture import CountStack
from jotlight.formats.files.checksums import file_checksum
from jotlight.formats.images.maps import is_map, read_map, read_mask
from jotlight.formats.opening.locations import is_url
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.data.alike_frames import exposure_cycle
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.view.access import LOOPBACK, is_loopback
from jotlight.view.extra import require_server
from jotlight.view.live.options import LiveOptions, open_live
from jotlight.view.viewed import Frames, Opening, Viewable, Viewed, variable

SERVER_PANEL = Group("Server", sort_key=1)
LIVE_PANEL = Group("Live view", sort_key=2)

_OF_WINDOW = "gain", "threshold"
"""Options whose values for a window differ from those for all frames."""

_PATIENCE = 1.0
"""Time in seconds without a frame after which the command says that it waits."""


@Parameter(name="*", group=SERVER_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class ServerOptions:
    """Where the server listens."""

    host: Annotated[
        str,
        Parameter(
            help="Address to listen on. Other machines reach the page only if you set another one, "
            "such as 0.0.0.0. Over SSH, a tunnel is safer: ssh -L 8000:localhost:8000 HOST."
        ),
    ] = LOOPBACK
    port: Annotated[int, Parameter(help="Port to listen on. 0 takes any free one.")] = 0
    browser: Annotated[bool, Parameter(help="Open the page in the browser of this machine.")] = (
        False
    )


@Parameter(name="*", group=LIVE_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class FollowOptions:
    """How to follow a capture that is being written."""

    follow: Annotated[
        bool,
        Parameter(
            help="Show the newest frames of a file or folder that grows, or of standard input if "
            "the capture is -. The frames are raw ones, with --format or --layout, or those of a "
            ".npy, or files that appear in a folder."
        ),
    ] = False
    history: Annotated[
        int, Parameter(help="Memory in MiB for the most recent frames, which you can go back to.")
    ] = 256


def view(
    data: Annotated[
        str,
        Parameter(
            allow_leading_hyphen=True,
            converter=convert_file,
            help="A capture of bits, readings, or counts: a file, a folder, or a URL; - with "
            "--follow for standard input.",
        ),
    ],
    /,
    *,
    server: ServerOptions = ServerOptions(),
    follow: FollowOptions = FollowOptions(),
    capture: ViewedCaptureOptions = ViewedCaptureOptions(),
    sensor: CapturedSensorOptions = CapturedSensorOptions(),
) -> None:
    """Show a capture in the browser: move a slider, and see the reconstruction.

    The command prints the address of the page, which contains a secret token, and serves the page
    until Ctrl-C. Only this machine can reach it.
    """
    require_server()
    if capture.region is not None:
        raise ValueError(
            "region: is not for the viewer; `jotlight convert --region` writes a part of a capture"
        )
    from jotlight.view.serving import Server

    viewed: Viewable
    if follow.follow:
        viewed = _follow(Path(data), follow, capture, sensor)
    else:
        _refuse_live_options(follow)
        viewed = _open(data, capture, sensor)
    if not is_loopback(server.host):
        caution("host", f"other machines can reach the page on {server.host}, without encryption")
    serving = Server(viewed, server.host, server.port)
    report(f"{viewed.title}: {serving.address}")
    if viewed.sensor_note:
        report(viewed.sensor_note)
    report("Ctrl-C ends the viewer")
    if server.browser:
        serving.open_browser()
    try:
        serving.run()
    except KeyboardInterrupt:
        report("ended")
    finally:
        viewed.close()


def _refuse_live_options(follow: FollowOptions) -> None:
    """Raise ValueError for an option that only a capture that grows has."""
    if follow.history != FollowOptions().history:
        raise ValueError("history: is for a capture that grows; add --follow, or leave it out")


def _open(path: str, capture: CaptureOptions, sensor: CapturedSensorOptions) -> Viewed:
    """Return a complete capture with its sensor."""
    is_several_bits = (sensor.bit_depth or 1) > 1
    opened = capture.open(
        path if is_url(path) else Path(path), sensor.stated_trials(), sensor.bit_depth
    )
    has_frames = isinstance(opened, Bits) or opened.sensor is not None or is_several_bits
    if has_frames and sensor.frames not in (None, len(opened)):
        raise ValueError(
            f"frames: expected the {len(opened)} frames of the capture, got {sensor.frames}; the "
            "page selects those of a window, and --frame-range leaves some of them out"
        )
    calibration = None if sensor.calibration is None else Calibration.load(sensor.calibration)
    captured = add_sensor(opened, path, sensor.to_kwargs(), calibration)
    exposure_cycle(captured.sensor)
    if sensor.find_hot_jots:
        captured = mask_hot_jots(captured, None)
    is_known = captured.has_own_sensor or sensor.max_intensity is not None
    opening = _opening(path, capture, sensor, captured)
    data: Frames = captured.data
    if captured.sensor.bit_depth > 1 and isinstance(data, CountStack):
        data = data.readings(captured.sensor)
    note = "" if captured.has_own_sensor else captured.sensor_note()
    return Viewed(Path(path).name or path, data, captured.sensor, is_known, opening, note)


def _opening(
    path: str, capture: CaptureOptions, sensor: CapturedSensorOptions, captured: Captured
) -> Opening:
    """Return how `jotlight reconstruct` and Python open the same capture."""
    frames = parse_frame_range(capture.frame_range) or slice(None)
    of_window = _of_window(sensor)
    words = dataclasses.replace(capture, frame_range=None).to_argv()
    unset: dict[str, Any] = dict.fromkeys(("frames", *of_window))
    words += dataclasses.replace(sensor, **unset).to_argv()
    options = dataclasses.replace(capture.to_options(sensor.bit_depth), frames=None, isolate=False)
    if options.holds_means and isinstance(captured.data, CountStack):
        options = dataclasses.replace(options, trials=captured.data.trials)
    arguments = {name: repr(value) for name, value in options.stated().items()}
    lines = _sensor_lines(sensor, captured)
    if sensor.find_hot_jots:
        lines += _hot_jot_lines(path, {**arguments, "frames": repr(frames)}, captured)
    facts: dict[str, Any] = {"hot_jots": captured.hot_jots}
    if sensor.calibration is not None:
        facts["calibration_sha256"] = file_checksum(sensor.calibration)
    return Opening(
        path,
        argv=tuple(words),
        arguments=arguments,
        sensor_lines=tuple(lines),
        frames=frames,
        of_window=of_window,
        searches_all=sensor.find_hot_jots,
        facts=facts,
    )


def _of_window(sensor: CapturedSensorOptions) -> tuple[str, ...]:
    """Return the options whose values for a window differ. A map is that of all windows."""
    stated = {name: getattr(sensor, name) for name in _OF_WINDOW}
    return tuple(name for name, text in stated.items() if text is not None and not is_map(text))


def _sensor_lines(sensor: CapturedSensorOptions, captured: Captured) -> list[str]:
    """Return lines of Python after which `sensor` is the sensor of the data."""
    kwargs, data = sensor.stated(), variable(captured.sensor)
    for name in ("frames", *_of_window(sensor)):  # the page sets those of a window
        kwargs.pop(name, None)
    imports: list[str] = []
    texts = []
    for name, value in kwargs.items():
        text, needed = _as_python(name, value)
        imports += needed
        texts.append(f"{name}={text}")
    arguments = ", ".join(texts)
    lines = list(dict.fromkeys(imports))
    if sensor.calibration is not None:
        lines.append(f"calibration = jl.Calibration.load({str(sensor.calibration)!r})")
        made = (
            f"calibration.applied_to({data}.sensor"
            if captured.has_own_sensor
            else "calibration.sensor("
        )
        glue = ", " if captured.has_own_sensor and arguments else ""
        lines.append(f"sensor = {made}{glue}{arguments})")
    elif captured.has_own_sensor:
        lines.append(
            f"sensor = {data}.sensor.replace({arguments})" if texts else f"sensor = {data}.sensor"
        )
    else:
        lines.append(f"sensor = jl.Sensor({arguments})")
    return lines


def _hot_jot_lines(path: str, arguments: dict[str, str], captured: Captured) -> list[str]:
    """Return lines of Python that mask the hot jots of the whole capture."""
    options = ", ".join(f"{name}={value}" for name, value in arguments.items())
    trials = "" if isinstance(captured.data, Bits) else f"trials={captured.sensor.trials}, "
    return [
        f"whole = jl.open({path!r}, {options})",
        f"hot = jl.calibration.find_hot_jots(whole, {trials}threshold=sensor.threshold, "
        "mask=sensor.mask)",
        "sensor = sensor.replace(mask=hot if sensor.mask is None else hot | sensor.mask)",
    ]


def _as_python(name: str, value: Any) -> tuple[str, list[str]]:
    """Return an option as an expression of Python, and the imports that it needs.

    Masks, maps, and mosaics are read from their files.

    Examples
    --------
    >>> _as_python("efficiency", "0.5")
    ('0.5', [])
    >>> _as_python("efficiency", "map.npy")
    ("read_map('map.npy')", ['from jotlight.formats.images.maps import read_map'])
    """
    path = repr(str(value))
    if name == "mask":
        imports = ["from pathlib import Path", f"from {read_mask.__module__} import read_mask"]
        return f"read_mask(Path({path}))", imports
    if name == "mosaic" and str(value).endswith(".json"):
        imports = ["import json", "from pathlib import Path"]
        imports += [f"from {Mosaic.__module__} import Mosaic"]
        return f"Mosaic.of(json.loads(Path({path}).read_bytes()))", imports
    if name in ("dark_counts", "efficiency"):
        try:
            return repr(float(value)), []
        except ValueError:
            pass
    elif name != "threshold":
        return repr(value), []
    return f"read_map({path})", [f"from {read_map.__module__} import read_map"]


def _follow(
    path: Path, follow: FollowOptions, capture: CaptureOptions, sensor: CapturedSensorOptions
) -> Viewable:
    """Return a capture that grows."""
    unsupported = {
        "--frame-range": capture.frame_range,
        "--rotate": capture.rotate or None,
        "--flip": capture.flip,
        "--find-hot-jots": sensor.find_hot_jots or None,
        "--frames": sensor.frames,
        "--counts": capture.counts,
        "--counts-scale": capture.counts_scale,
        "--trials": capture.trials,
        "--bit-depth above 1": (sensor.bit_depth or 1) > 1 or None,
        "--read-noise": sensor.read_noise or None,
    }
    for name in _OF_WINDOW:
        has_several = "," in (getattr(sensor, name) or "")
        unsupported[f"--{name} with several values"] = has_several or None
    for option, value in unsupported.items():
        if value is not None:
            raise ValueError(f"follow: {option} is for complete captures, not for --follow")
    arguments = {"width": capture.width, "key": capture.key, "unpacked": capture.unpacked or None}
    arguments = {name: value for name, value in arguments.items() if value is not None}
    kwargs = {"frames": 1, **sensor.to_kwargs()}
    calibration = None if sensor.calibration is None else Calibration.load(sensor.calibration)
    is_known = sensor.max_intensity is not None
    options = LiveOptions(capture.format, capture.layout, follow.history, arguments)
    waiting = threading.Timer(_PATIENCE, report, (f"{path}: waiting for the first frame",))
    waiting.daemon = True
    waiting.start()
    try:
        return open_live(path, options, kwargs, calibration, is_range_known=is_known)
    finally:
        waiting.cancel()
        waiting.join()  # its line comes before those that follow
