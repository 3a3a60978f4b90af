"""List every use of a word or phrase that the glossary replaces; exit with 1 if there is any.

    python tools/check_words.py

The gate runs it. `docs/notation.md` is the glossary.
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[1]
TEXT = {".css", ".html", ".js", ".md", ".py", ".pyi", ".rs", ".toml", ".yml"}
SELF = "tools/check_words.py"

REPLACED = {
    # Phrases and verbs.
    r"(?<![A-Za-z])told(?![A-Za-z])": "name who says what: 'conditional on K', 'the file states'",
    r"\bso many\b": "the number itself",
    r"\bof (which|it|them|that|those|what) on\b": "a main clause",
    r"\bof it that\b": "a main clause",
    r'"""(Give|Gives|Gave)\b': "'Return …'",
    r'"""Of (?!\w+ing\b)': "say what the constant is",
    r"\bcome of\b|\bcomes of\b": "a plain verb",
    r"\bhow it came to be\b": "'the history'",
    r"(?i)(?<![a-z])pictures?(?![a-z])": "image or estimate",
    # Names that the field does not use.
    r"\b(bend|bends|bent)\b": "activate, spline",
    r"goes_on(?![a-z])": "ConvergenceMonitor.update",
    r"\b(most|least)_\w+": "max_…, min_…",
    r"(?<![A-Za-z])(MOST_\w+|LEAST_\w+|_MOST\b|_LEAST\b)": "MAX_…, MIN_…",
    r"\bstep_of\b": "size_divisor",
    r"\bwork_of\b": "flops_per_pixel",
    r"\bshares_of\b": "conditioning_weights",
    r"\bhalo_of\b": "halo",
    r"\bchained\b": "is_sequential",
    r"\bMEMBERS?\b": "ARCHITECTURES",
    r"\bdeeper\(": "build_residual",
    r"\bfill_blind\b": "inpaint_dead_pixels",
    # Browsers have the method `new ResizeObserver(…).observe(…)`.
    r"\bObservation\b|(?<!\)\.)\bobserve\(": "PixelCounts, count_pixels",
    r"\bfires\(": "detection_probability",
    r"\brate_of\b": "inverse_detection_probability",
    r"\bunclipped\b": "saturation_intensity",
    r"\blacking\(|\bunserved\b|\.lacks\b": "unsupported_reason",
    r"\bwritten_whole\b|\bspare_inputs\b|\bslabs_of\b": "atomic_write, check_outputs, chunks",
    r"\bstep_size\b|--step-size\b": "learning_rate",
    r"\bsurprise\b": "negative log-likelihood",
    r"\bCalibrated\b|\bWanted\b": "AppliedCalibration, OutputOptions",
    r"\bself-supervised\.py|--self-supervised\b": "jotlight fine-tune",
    # American spelling. The name of a package is not ours.
    r"(?i)\b(multi)?colou?rs?(?<!color)(?<!colors)\b(?!-demosaicing)": "color",
    r"(?i)(?<![A-Za-z])grey(?!scale=)\w*": "gray",  # pypng has a parameter `greyscale`
    r"(?i)(optim|minim|maxim|normal|regular|stabil|recogn|initial|general)is[eia]\w*": "-ize",
    r"(?i)\b(summar|organ|vector|parametr|factor|equal|visual|penal|random)is[eia]\w*": "-ize",
    r"(?i)\bcentre(s|d|line)?\b|\bcentring\b": "center",
    r"(?i)\bneighbour\w*": "neighbor",
    r"(?i)\b(behaviour|favour|honour)\w*": "-or",
    r"(?i)\blicences?\b": "license",
    r"(?i)\b(labelled|labelling|modelled|modelling|cancelled|levelled)\b": "one l",
    r"(?i)\b(analyse[sd]?|catalogue|metres?|artefacts?)\b": "American spelling",
    # Parts of unclear sentences.
    r"what rows and columns of a picture have to be": "'the divisor of height and width'",
    r"with more certainty than so many ones": "'Probabilities are clamped to …'",
    r"likely and without needless change": "'Minimize −ℓ(c) + λ TV(c) over [0, S].'",
    r"The layers for the K that was": "'Cached layers for the most recent K.'",
    r"Of a step at most": "'Maximum number of backtracking halvings.'",
    r"How many times as many rows a band has": "'Minimum height of a band, in receptive fields.'",
    r"Numbers of planes at a pixel, times the step": "'Maximum value of channels per pixel …'",
}
PATTERNS = [(re.compile(pattern), instead) for pattern, instead in REPLACED.items()]


def text_files() -> Iterator[Path]:
    """Yield the tracked text files, except this one."""
    names = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split("\0")
    for name in names:
        if Path(name).suffix in TEXT and name != SELF and (ROOT / name).is_file():
            yield ROOT / name


def uses(path: Path) -> list[str]:
    """Return a line of the report for each use in a file."""
    return [
        f"{path.relative_to(ROOT)}:{number}: {found[0]!r}; write {instead}"
        for number, line in enumerate(path.read_text("utf-8").splitlines(), 1)
        for pattern, instead in PATTERNS
        if (found := pattern.search(line))
    ]


def main() -> int:
    """Print all uses and return the exit status."""
    with ProcessPoolExecutor() as processes:
        found = [
            use for of_file in processes.map(uses, text_files(), chunksize=32) for use in of_file
        ]
    print(*found, sep="\n")
    print(f"{len(found)} uses of replaced words")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
