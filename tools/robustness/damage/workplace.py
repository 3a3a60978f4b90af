"""The folder in which a command runs, and its expected outputs."""

import dataclasses
import shutil
from pathlib import Path

from damage.commands import Command
from damage.inputs import make_inputs
from damage.outputs import Content, read_outputs
from damage.processes import Tree, copy_tree, is_hidden, read_tree, run

NEW, OLD = "in", "old"
"""Folders of the inputs of the command, and of the earlier command whose output it replaces."""


@dataclasses.dataclass(frozen=True)
class Workplace:
    """A folder with inputs in which commands run, one after the other."""

    folder: Path
    inputs: Tree
    """What the folder contains in addition to `out`."""

    @classmethod
    def make(cls, folder: Path, frames: int) -> "Workplace":
        """Return a new workplace whose captures have this number of frames."""
        make_inputs(folder / NEW, 1, frames)
        make_inputs(folder / OLD, 2, frames)
        return cls(folder, read_tree(folder))

    @property
    def out(self) -> Path:
        """Return the folder of outputs."""
        return self.folder / "out"

    @property
    def scratch(self) -> Path:
        """Return the folder of the temporary files of commands."""
        return self.folder.with_name("scratch")

    def reset(self, before: Path) -> None:
        """Replace the outputs by those of an earlier command."""
        copy_tree(before, self.out)
        shutil.rmtree(self.scratch, ignore_errors=True)

    def damage(self) -> list[str]:
        """Return what is wrong with the inputs."""
        now = {name: sha for name, sha in read_tree(self.folder).items() if name[:3] != "out"}
        return [] if now == self.inputs else ["an input changed"]

    def leftovers(self) -> list[str]:
        """Return the hidden files in the folder of outputs, and all temporary files.

        PyTorch's folder of compiled code is not temporary: later processes use it.
        """
        hidden = [name for name in read_tree(self.out) if is_hidden(name)]
        temporary = list(read_tree(self.scratch)) if self.scratch.exists() else []
        return hidden + [name for name in temporary if not name.startswith("torchinductor_")]


@dataclasses.dataclass(frozen=True)
class Expected:
    """The outputs of a command before it runs, and when it is complete."""

    before: Path
    """Folder with the outputs before the command runs."""
    old: Content
    """Contents of these outputs."""
    new: Content
    """Contents of the outputs of the complete command."""

    @classmethod
    def of(cls, command: Command, place: Workplace, before: Path) -> "Expected":
        """Return the outputs of a command, and write those that it replaces to `before`."""
        contents = []
        before.mkdir(parents=True)
        for inputs in ([OLD] if command.replaces else []) + [NEW]:
            place.reset(before)
            launcher, arguments = command.launch(inputs)
            done = run(arguments, place.folder, place.scratch, launcher)
            if done.returncode:
                raise RuntimeError(f"{command.name}: {done.stderr.strip()}")
            if inputs == OLD:
                copy_tree(place.out, before)
                contents.append(read_outputs(place.out))
        return cls(before, contents[0] if contents else {}, read_outputs(place.out))
