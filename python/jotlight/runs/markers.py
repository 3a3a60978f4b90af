"""Files that note which groups of images of an unfinished video are complete.

The folder of an unfinished video may come from a stranger. So each file must lie in it, its content
is checked, and the time depends on the number of files, and not on that of groups.
"""

import dataclasses
import json
import math
import re
from collections.abc import Iterable
from pathlib import Path

from jotlight.files import write_file
from jotlight.formats.files.safe_paths import check_inside
from jotlight.runs.records import Record, read_json
from jotlight.runs.streaming import Checksum

_NAME = re.compile(r"(0|[1-9]\d*)\.json")

_MAX_BYTES = 2**63
"""Upper limit of the number of bytes that were read for a group."""


@dataclasses.dataclass(frozen=True)
class Markers:
    """The markers of an unfinished video: one file for each group that is complete.

    Parameters
    ----------
    part : path
        The folder of the unfinished video.
    groups : int
        Number of groups.
    """

    part: Path
    groups: int

    def done(self) -> set[int]:
        """Return the numbers of the groups that have a marker."""
        folder = check_inside(self.part / "groups", self.part)
        try:
            names = [path.name for path in folder.iterdir()]
        except (FileNotFoundError, NotADirectoryError):  # no video was begun
            return set()
        found = {int(match[1]) for match in map(_NAME.fullmatch, names) if match}
        return {group for group in found if group < self.groups}

    def write(self, group: int, facts: Record, output: Path) -> None:
        """Write a marker. `facts` are checksum, size, minimum, and maximum; errors name `output`.

        Nothing waits for the disk: whoever completes the video finds what a power failure damaged.
        """
        write_file(self._path(group), json.dumps(facts), durable=False, output=output)

    def read(self, group: int) -> Record | None:
        """Return the facts of a marker, or None if it is damaged."""
        path = self._path(group)
        try:
            facts = read_json(path)
        except (ValueError, FileNotFoundError):
            return None
        return facts if _are_facts(facts) else None

    def delete(self, group: int) -> None:
        """Delete a marker, whose group is not complete."""
        path = self._path(group)
        if path.is_dir() and not path.is_symlink():
            path.rmdir()  # jotlight makes no such folder; one with content is an error
        else:
            path.unlink(missing_ok=True)

    def _path(self, group: int) -> Path:
        return check_inside(self.part / "groups" / f"{group}.json", self.part)


def _are_facts(facts: Record) -> bool:
    checksum, size, low, high = map(facts.get, ("crc32", "bytes", "minimum", "maximum"))
    return (
        isinstance(checksum, str)
        and re.fullmatch("[0-9a-f]{8}", checksum) is not None
        and type(size) is int
        and 0 <= size < _MAX_BYTES
        and isinstance(low, float)
        and isinstance(high, float)
        and -math.inf < low <= high < math.inf
    )


def summarize(facts: Iterable[Record]) -> Record:
    """Return the checksum of all frames that were read, and the range of the values.

    Examples
    --------
    >>> one = {"crc32": "00000000", "bytes": 0, "minimum": 0.5, "maximum": 1.0}
    >>> summarize([one, {**one, "minimum": 0.0}])["minimum"]
    0.0
    """
    total, low, high = Checksum(), math.inf, -math.inf
    for each in facts:
        total.append(int(each["crc32"], 16), each["bytes"])
        low, high = min(low, each["minimum"]), max(high, each["maximum"])
    return {
        "input": {"packed_bytes": total.size, "packed_crc32": f"{total.value:08x}"},
        "minimum": low,
        "maximum": high,
    }
