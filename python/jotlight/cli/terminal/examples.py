"""Examples of each command, which end its help page."""

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("jotlight demo", "jotlight demo --photo coins -o coins.png"),
    "compare": (
        "jotlight compare photo.png",
        "jotlight compare photo.png --method mle,admm-tv --quality small,medium",
        "jotlight compare photo.png --method mle,mine:denoise -o mine.png",
    ),
    "simulate": (
        "jotlight simulate photo.png -o capture.npy",
        "jotlight simulate photo.png -o capture.npy -k 1 --frames 64 --dark-counts 0.01",
        "jotlight simulate photo.png -o moving.npy -k 1 -t 64 --motion shake",
    ),
    "reconstruct": (
        "jotlight reconstruct capture.npy -o image.png",
        "jotlight reconstruct capture.npy -o image.npy --quality small",
        "jotlight reconstruct capture.npy -o image.tif -m admm-tv --preview view.png",
        "jotlight reconstruct counts.npy --frames 64 -o image.tif --units photons",
        "jotlight reconstruct raw.bin --format swissspad2 -o image.png",
        "jotlight reconstruct moving.npy --motion -o sharp.png",
        "jotlight reconstruct capture.npy -o video.zarr --window 64 --workers 2",
    ),
    "film": (
        "jotlight film capture.npy --window 16 -o film.gif",
        "jotlight film moving.npy --window 16 --step 4 --motion -o film.npy",
    ),
    "calibrate": (
        "jotlight calibrate dark.npy -o camera.safetensors",
        "jotlight calibrate dark.npy flat.npy -o camera.safetensors --plot camera.png",
    ),
    "train": (
        "jotlight train photos -o mine.safetensors --bits-per-pixel 16",
        "jotlight train photos -o deep.safetensors --bits-per-pixel 16 --quality medium",
        "jotlight train photos -o a.safetensors --bits-per-pixel 1:256 --quality medium",
        "jotlight train --sensor capture.npy -o mine.safetensors",
    ),
    "fine-tune": (
        "jotlight fine-tune capture.npy -o tuned.safetensors",
        "jotlight fine-tune capture.npy -o tuned.safetensors --steps 100",
    ),
    "evaluate": (
        "jotlight evaluate photos --first 2",
        "jotlight evaluate photos --method mine:denoise -o scores.csv",
        "jotlight evaluate photos --model mine.safetensors",
    ),
    "reproduce": (
        "jotlight reproduce fig5 --quick",
        "jotlight reproduce all --data data",
        "jotlight reproduce fig7 --method mine:denoise",
    ),
    "plan": (
        "jotlight plan 0.01:1 --target-psnr 30",
        "jotlight plan 100:10000 --frame-rate 100000 --plot plan.png",
    ),
    "info": ("jotlight info capture.npy", "jotlight info mine.safetensors"),
    "convert": (
        "jotlight convert raw.bin --format swissspad2 -o capture.npy",
        "jotlight convert capture.npy -o counts.tif",
        "jotlight convert capture.npy -o counts.zarr --window 64",
    ),
    "gather": ("jotlight gather videos",),
    "view": (
        "jotlight view capture.npy",
        "jotlight view raw.bin --format swissspad2 --port 8000",
        "jotlight view growing.bin --format swissspad2 --follow",
        "jotlight view - --follow --layout 256x512",
    ),
}
"""Command lines by the name of the command."""


OVERVIEW = (
    "jotlight demo",
    "jotlight simulate photo.png -o capture.npy",
    "jotlight reconstruct capture.npy -o image.png",
)
"""Command lines for the help page of all commands."""

USAGES = {
    "calibrate": "Usage: jotlight calibrate --output PATH [OPTIONS] DARK [FLAT]",
    "train": "Usage: jotlight train --output PATH [OPTIONS] [IMAGES]",
}
"""Usage lines of the commands with optional arguments, which cyclopts does not name."""


def help_epilogue(command: str) -> str:
    """Return the examples of a command as Markdown.

    Examples
    --------
    >>> print(help_epilogue("info"))
    **Examples**
    <BLANKLINE>
        jotlight info capture.npy
        jotlight info mine.safetensors
    """
    return _as_markdown(EXAMPLES[command])


def overview_epilogue() -> str:
    """Return the examples for the help page of all commands as Markdown."""
    return _as_markdown(OVERVIEW)


def _as_markdown(lines: tuple[str, ...]) -> str:
    return "\n".join(("**Examples**", "", *(f"    {line}" for line in lines)))
