"""Options of commands that process many captures, or a capture in many windows."""

import dataclasses
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Group, Parameter

from jotlight.cli.options.common_options import convert_file

RUN_PANEL = Group("Many captures and windows", sort_key=9)

CapturePaths = Annotated[
    str,
    Parameter(
        converter=convert_file,
        help="A capture of bits or counts, or several captures of bits: files, folders, URLs such "
        "as s3://bucket/a.npy, or globs of them in quotation marks.",
    ),
]


@Parameter(name="*", group=RUN_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Windows of frames, and the processes that compute them."""

    window: Annotated[
        int | None,
        Parameter(
            help="Number of frames of a window of a capture of bits. Each window becomes an image "
            "of a .zarr. Default: one image of all frames."
        ),
    ] = None
    step: Annotated[
        int | None,
        Parameter(help="Frames from one window to the next. Default: the size of a window."),
    ] = None
    workers: Annotated[
        int | None,
        Parameter(
            help="Number of worker processes of dask on this machine. Default: this process alone."
        ),
    ] = None
    scheduler: Annotated[
        str | None,
        Parameter(
            help="Address of a running scheduler of dask, such as tcp://10.0.0.1:8786. Default: "
            "none."
        ),
    ] = None
    part: Annotated[
        str | None,
        Parameter(
            help="Part of the work, such as 3/64, for job arrays without dask, or slurm for the "
            "part of this task of a Slurm job array; `jotlight gather` completes the results. "
            "Default: all; a Slurm job array needs a part."
        ),
    ] = None
    chunks: Annotated[
        str | None,
        Parameter(
            help="Size of the parts of a capture that are computed at a time, such as 128MiB. The "
            "result does not depend on it. Default: 128MiB, or a 1024th of a large capture."
        ),
    ] = None
    storage_option: Annotated[
        list[str] | None,
        Parameter(
            help="Option of the file system of a URL, such as anon=true for public data on S3. "
            "Repeat it for several. Default: none."
        ),
    ] = None

    def is_requested(self, captures: tuple[str, ...]) -> bool:
        """Return whether the captures and options need a run, rather than one reconstruction."""
        from jotlight.formats.opening.locations import is_glob

        return len(captures) != 1 or is_glob(captures[0]) or self != RunOptions()

    def storage_options(self) -> dict[str, Any] | None:
        """Return the options of the file system by name; None without any."""
        if not self.storage_option:
            return None
        values: dict[str, Any] = {}
        for text in self.storage_option:
            name, sign, value = text.partition("=")
            if not sign or not name:
                raise ValueError(f"storage-option: expected NAME=VALUE, got {text!r}")
            values[name] = {"true": True, "false": False}.get(value.lower(), value)
        return values


def name_output(output: Path, capture: str) -> Path:
    """Return the output of a single capture, whose name replaces ``{name}``.

    Examples
    --------
    >>> name_output(Path("images/{name}.tif"), "captures/1.npy").as_posix()
    'images/1.tif'
    """
    if "{name}" not in output.as_posix():
        return output
    from jotlight.runs.names import name_captures, name_outputs

    return name_outputs(output, name_captures([capture], [capture]))[0]
