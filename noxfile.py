"""Every check by name; plain `nox` is the gate."""

import os
import shutil
from pathlib import Path

import nox
from nox.command import CommandFailed

nox.needs_version = ">=2024.10.9"
nox.options.default_venv_backend = "venv"
nox.options.reuse_existing_virtualenvs = True
nox.options.sessions = [
    "lint", "rust", "wheel", "types", "stubs", "tests", "torch", "docs", "browser", "reproduce",
]  # fmt: skip

DIST = Path("dist")
DATA = Path(os.environ.get("JOTLIGHT_DATA", "../shared/data"))
EXTRAS = (
    "tests/cli/test_convert.py",
    "tests/cli/test_output_options.py",
    "tests/cli/test_signals.py",
    "tests/images/test_video.py",
    "tests/formats/test_arrays.py",
    "tests/formats/test_hostile_files.py",
)
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@nox.session
def lint(session: nox.Session) -> None:
    """Style and lints of Python and Rust."""
    session.install("ruff>=0.9")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    for tool, arguments in (
        ("rustfmt", ["fmt", "--all", "--check"]),
        ("cargo-clippy", ["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"]),
    ):
        if shutil.which(tool):
            session.run("cargo", *arguments, external=True)
        else:
            session.warn(f"{tool} is not installed: its check was NOT made")


@nox.session(venv_backend="none")
def rust(session: nox.Session) -> None:
    """The engine's own tests, and its documentation's examples."""
    session.run("cargo", "test", "--workspace", external=True)


@nox.session
def wheel(session: nox.Session) -> None:
    """Build the one wheel that the sessions below install."""
    session.install("maturin>=1.9.4,<2")
    shutil.rmtree(DIST, ignore_errors=True)
    session.run("maturin", "build", "--release", "--locked", "--out", str(DIST))


@nox.session
def types(session: nox.Session) -> None:
    """Strict types."""
    install_wheel(session, "mypy>=1.13")
    session.run("mypy")


@nox.session
def stubs(session: nox.Session) -> None:
    """The stub of the engine against the compiled module."""
    install_wheel(session, "mypy>=1.13")
    session.run("python", "-m", "mypy.stubtest", "jotlight._engine")


@nox.session
def tests(session: nox.Session) -> None:
    """The default suite; arguments go to pytest."""
    install_wheel(session, extra="test,hdf5,zarr,exr,video")
    session.run("pytest", *session.posargs)


@nox.session
def extras(session: nox.Session) -> None:
    """What the default suite skips for want of a package."""
    install_wheel(session, extra="test,hdf5,zarr,exr,video")
    session.run("pytest", *EXTRAS, *session.posargs)


@nox.session
def torch(session: nox.Session) -> None:
    """The modules of PyTorch, their commands, what deepinv takes of them; arguments go to pytest.

    Where pip is told of an index with builds for the CPU alone (PIP_EXTRA_INDEX_URL), it takes
    those; else it installs gigabytes of CUDA libraries that the tests do not use.
    """
    install_wheel(session, extra="test,deepinv")
    examples = ("tests/docs/test_documents.py", "-k", "test_torch or (docstring and torch)")
    modules = sorted(str(path) for path in Path("tests/unit").glob("test_torch_*.py"))
    modules += ["tests/cli/test_train_deep.py", "tests/cli/test_fine_tune.py"]
    session.run("pytest", *modules, *examples, *session.posargs)


@nox.session
def fuzz(session: nox.Session) -> None:
    """Every reader of files, a few seconds each; arguments as of fuzz/readers.py."""
    try:
        install_wheel(session, "atheris>=3", extra="test,hdf5,zarr")
    except CommandFailed:
        session.error("atheris cannot be installed here: the readers were NOT fuzzed")
    session.run("python", "fuzz/readers.py", *(session.posargs or ["all", "--seconds", "5"]))


@nox.session
def docs(session: nox.Session) -> None:
    """README, docs, docstrings and examples run as they stand."""
    install_wheel(session, extra="test")
    session.run("pytest", "tests/docs", *session.posargs)


@nox.session
def browser(session: nox.Session) -> None:
    """The report's page in a browser."""
    if not any(map(shutil.which, BROWSERS)):
        session.skip(f"none of {', '.join(BROWSERS)} is installed: the page was NOT tested")
    install_wheel(session, extra="test,browser")
    session.run("pytest", "tests/browser", *session.posargs)


@nox.session
def reproduce(session: nox.Session) -> None:
    """All of the paper's experiments, quickly, on the data that JOTLIGHT_DATA names."""
    if not DATA.is_dir():
        session.skip(f"there is no data in {DATA}: the experiments were NOT run on it")
    install_wheel(session)
    output = Path(session.create_tmp()) / "reproduction"
    session.run(
        *("jotlight", "reproduce", "all", "--quick", "--data", str(DATA)),
        *("--output", str(output), "--restart"),
    )


def install_wheel(session: nox.Session, *packages: str, extra: str | None = None) -> None:
    found = sorted(DIST.glob("jotlight-*.whl"))
    if not found:
        session.error("there is no wheel in dist/; run `nox -s wheel` first")
    session.install(f"{found[-1]}[{extra}]" if extra else str(found[-1]), *packages)
