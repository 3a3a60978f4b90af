"""All checks, by name. `nox` runs the gate; `nox --tags release` runs the slower checks.

The tags below are the only list of the gate's steps: `.ci/run` and CONTRIBUTING refer to them.
"""

import os
import re
import shutil
from pathlib import Path

import nox
from nox.command import CommandFailed

nox.needs_version = ">=2024.10.9"
nox.options.default_venv_backend = "venv"
nox.options.reuse_existing_virtualenvs = True
nox.options.tags = ["gate"]

ROOT = Path(__file__).parent
DIST = ROOT / "dist"
DATA = Path(os.environ.get("JOTLIGHT_DATA", ROOT.parent / "shared" / "data")).resolve()
NEEDS_TORCH = (
    "tests/torch",
    "tests/cli/test_train_deep.py",
    "tests/cli/test_fine_tune.py",
    "tests/tools/test_train.py",
)
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@nox.session(tags=["gate"])
def lint(session: nox.Session) -> None:
    """Check the style and the lints of Python and Rust, and the words of the glossary."""
    session.install("ruff>=0.9")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("python", "tools/check_words.py")
    for tool, arguments in (
        ("rustfmt", ["fmt", "--all", "--check"]),
        ("cargo-clippy", ["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"]),
    ):
        if shutil.which(tool):
            session.run("cargo", *arguments, external=True)
        else:
            session.warn(f"{tool} is not installed: its check was NOT made")


@nox.session(venv_backend="none", tags=["gate"])
def readme(session: nox.Session) -> None:
    """Run the README's test commands unchanged, in a copy of the tracked files; then slow tests."""
    copy = Path(session.create_tmp()).resolve() / "jotlight"
    shutil.rmtree(copy, ignore_errors=True)
    tracked = session.run("git", "ls-files", "-z", external=True, silent=True) or ""
    for name in filter(None, tracked.split("\0")):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, copy / name)
    blocks = re.findall(r"^```sh\n(.*?)^```", (copy / "README.md").read_text(), re.S | re.M)
    with session.chdir(copy):
        # All sessions share this target folder, so the engine is compiled once.
        env = {"CARGO_TARGET_DIR": str(ROOT / "target"), "JOTLIGHT_DATA": str(DATA)}
        session.run("bash", "-ec", blocks[1], env=env, external=True)
        session.run("bash", "-ec", ".venv/bin/pytest -m slow", env=env, external=True)


@nox.session(venv_backend="none", tags=["gate"])
def rust(session: nox.Session) -> None:
    """Run the engine's own tests, and the examples in its documentation."""
    session.run("cargo", "test", "--workspace", external=True)


@nox.session(tags=["gate"])
def wheel(session: nox.Session) -> None:
    """Build the wheel that the sessions below install."""
    session.install("maturin>=1.9.4,<2")
    shutil.rmtree(DIST, ignore_errors=True)
    session.run("maturin", "build", "--release", "--locked", "--out", str(DIST))


@nox.session(tags=["gate"])
def types(session: nox.Session) -> None:
    """Check the types strictly, and compare the engine's stub with the compiled module."""
    install_wheel(session, "mypy>=1.13", extra="zarr")  # we derive classes from those of zarr
    session.run("mypy")
    session.run("python", "-m", "mypy.stubtest", "jotlight._engine")


@nox.session(tags=["gate"])
def torch(session: nox.Session) -> None:
    """Run all tests that need PyTorch; arguments go to pytest.

    Set PIP_EXTRA_INDEX_URL to an index of CPU-only builds. Otherwise pip installs gigabytes of CUDA
    libraries that the tests do not use.
    """
    install_wheel(session, extra="test,deepinv")
    session.run("pytest", "-m", "slow or not slow", *NEEDS_TORCH, *session.posargs)
    pages = ("-k", "torch or fine_tuning or tutorial")
    session.run("pytest", "-m", "slow or not slow", "tests/docs/test_documents.py", *pages)


@nox.session(tags=["release"])
def reproduce(session: nox.Session) -> None:
    """Run all of the paper's experiments in quick mode, on the data in folder JOTLIGHT_DATA."""
    if not DATA.is_dir():
        session.skip(f"there is no data in {DATA}: the experiments were NOT run on it")
    install_wheel(session)
    output = Path(session.create_tmp()) / "reproduction"
    session.run(
        *("jotlight", "reproduce", "all", "--quick", "--data", str(DATA)),
        *("--output", str(output), "--restart"),
    )


@nox.session(tags=["release"])
def browser(session: nox.Session) -> None:
    """Test the pages of the reproduction and of the viewer in a browser."""
    if not any(map(shutil.which, BROWSERS)):
        session.error(f"none of {', '.join(BROWSERS)} is installed: the pages were NOT tested")
    install_wheel(session, extra="test,browser")
    pages = ("tests/experiments/report", "tests/view")
    names = [f"{folder}/test_page_browser.py" for folder in pages]
    session.run("pytest", "-m", "slow", *names, *session.posargs)


@nox.session(tags=["release"])
def napari(session: nox.Session) -> None:
    """Test the napari plugin in an offscreen Qt."""
    install_wheel(session, "PyQt6>=6.6", extra="test,napari")
    # The pytest plugins of napari and npe2 issue warnings, which the tests treat as errors.
    plugins = ("-p", "no:napari", "-p", "no:npe2")
    session.run(
        *("pytest", *plugins, "-m", "slow or not slow", "tests/napari"),
        *session.posargs,
        env={"QT_QPA_PLATFORM": "offscreen"},
    )


@nox.session(tags=["release"])
def fuzz(session: nox.Session) -> None:
    """Fuzz every file reader for a few seconds; arguments go to fuzz/readers.py."""
    try:
        install_wheel(session, "atheris>=3", extra="test")
    except CommandFailed:
        session.error("atheris cannot be installed here: the readers were NOT fuzzed")
    session.run("python", "fuzz/readers.py", *(session.posargs or ["all", "--seconds", "5"]))


@nox.session
def tests(session: nox.Session) -> None:
    """Run the tests that the arguments select, such as `nox -s tests -- -k sensor`."""
    install_wheel(session, extra="test")
    session.run("pytest", *session.posargs, env={"JOTLIGHT_DATA": str(DATA)})


def install_wheel(session: nox.Session, *others: str, extra: str = "") -> None:
    """Install the wheel that the session `wheel` built, and other packages."""
    wheels = sorted(DIST.glob("jotlight-*.whl"))
    if len(wheels) != 1:
        session.error(f"expected one wheel in {DIST}, got {len(wheels)}: run `nox -s wheel` first")
    session.install(f"{wheels[0]}[{extra}]" if extra else str(wheels[0]), *others)
    session.run("pip", "install", "--quiet", "--force-reinstall", "--no-deps", str(wheels[0]))
